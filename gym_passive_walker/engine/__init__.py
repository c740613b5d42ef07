"""The engine: compiles the equations of a system to native code that integrates batches."""
