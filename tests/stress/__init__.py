"""Walkers in hard conditions."""
