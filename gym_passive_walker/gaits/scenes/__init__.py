"""Tasks and the states from which they start."""
