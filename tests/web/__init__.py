"""Walkers in WebAssembly."""
