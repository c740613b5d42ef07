"""Gaits of the presets, and their dimensionless states."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker import WALKERS, find_gaits
from gym_passive_walker.gaits.gait import Gait

SLOPES = {
    "A": 0.01, "B": 0.01, "C": 0.03, "D": 0.009, "E": 0.01, "F": 0.01, "lab": 0.036,
    "lab-straight": 0.04,
}  # fmt: skip
"""A slope in rad on which each walker has a gait."""


@lru_cache
def gaits(name: str, slope: float | None = None) -> list[Gait]:
    """A preset's gaits, the longest step first."""
    found = find_gaits(name, SLOPES[name] if slope is None else slope)
    return sorted(found, key=lambda gait: -gait.stance_angle)


def start(gait: Gait) -> NDArray[np.float64]:
    """The gait's dimensionless state on the Poincaré section, (6,)."""
    return np.asarray(gait.state) * np.repeat([1.0, gait.walker.time_unit], 3)


def near(
    gait: Gait, rng: np.random.Generator, count: int, share: float, size: ArrayLike = 1.0
) -> NDArray[np.float64]:
    """Dimensionless states (count, 6) just after heelstrike, as near to a gait as a share of it.

    Args:
        gait: The gait.
        rng: Random generator.
        count: Number of states.
        share: Standard deviation of each number over that of the gait.
        size: Factor of the states, or (count,).
    """
    states = start(gait) * (1.0 + share * rng.normal(size=(count, 6)))
    states *= np.reshape(size, (-1, 1))
    states[:, 1:3] = -states[:, :1]
    if not gait.walker.knees:
        states[:, 5] = states[:, 4]
    return states


def every_gait() -> list[tuple[str, Gait]]:
    """Long and short gaits of every preset."""
    return [(name, gait) for name in WALKERS for gait in gaits(name)]
