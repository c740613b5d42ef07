"""Walkers on a device, which numba simulates."""
