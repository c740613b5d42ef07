"""The machinery: from a walker's statement to native code over many walkers side by side."""
