"""Tests of the package, its agents, benchmarks and documentation."""
