"""Window that shows a walk, with pushes and changes of its parameters."""

from gym_passive_walker.apps.viewer.play import play

__all__ = ["play"]
