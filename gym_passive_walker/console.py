"""Public names of `_tools.console`: how a program prints, ends and is stopped."""

from gym_passive_walker._tools.console import run

__all__ = ["run"]
