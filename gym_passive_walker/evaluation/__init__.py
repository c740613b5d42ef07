"""How well what acts walks: episodes, robustness, and steps noted to be differentiated."""
