"""Gymnasium environments on top of the stride."""
