"""Tests of walkers in other simulators."""
