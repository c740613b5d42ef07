"""Parallel parameter sweeps: an analysis over many walkers, slopes, seeds and scenes."""
