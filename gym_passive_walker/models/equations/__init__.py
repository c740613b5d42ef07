"""Models of the walkers: equations of motion, guards, resets and energies, as plain functions."""
