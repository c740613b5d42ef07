"""Stress tests of walkers."""
