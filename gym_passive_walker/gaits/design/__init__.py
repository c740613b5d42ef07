"""Walkers that are designed."""
