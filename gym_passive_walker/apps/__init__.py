"""Programs: command line, sweeps, player."""
