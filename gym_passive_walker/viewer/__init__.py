"""A window in which a walker walks while everything about it can be changed."""

from gym_passive_walker.viewer.play import play

__all__ = ["play"]
