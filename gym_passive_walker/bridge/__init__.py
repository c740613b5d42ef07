"""Walkers in other simulators: files of a walker, and the loop that a simulator needs to walk."""
