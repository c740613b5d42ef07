"""Finding gaits."""
