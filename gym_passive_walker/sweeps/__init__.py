"""Any analysis over many walkers, slopes, seeds and scenes, on all processors at hand."""
