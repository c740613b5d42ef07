"""Public names of `models.math`: functions for rewards and observations of one's own."""

from gym_passive_walker.models.math import cos, exp, maximum, minimum, sin, sqrt, tanh, where

__all__ = ["cos", "exp", "maximum", "minimum", "sin", "sqrt", "tanh", "where"]
