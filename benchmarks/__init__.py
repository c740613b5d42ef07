"""Measurements of speed against error; each script answers one question (see README.md)."""
