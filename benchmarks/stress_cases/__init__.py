"""Stress tests of walkers in difficult conditions, for a few trials in a test, or for many."""
