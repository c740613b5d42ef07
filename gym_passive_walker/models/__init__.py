"""What walks: walkers, units, equations."""
