"""Libraries that train with this package: their first examples run."""
