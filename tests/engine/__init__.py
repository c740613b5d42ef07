"""The engine's machinery."""
