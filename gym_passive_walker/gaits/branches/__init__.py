"""Gaits over a parameter, and their bifurcations."""
