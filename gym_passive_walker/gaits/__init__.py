"""Gait analysis on top of the stride."""
