"""Mean first-passage time to a fall on random ground, by simulation.

A walker on rough ground falls sooner or later. Once it has forgotten its start, each stride ends in
a fall with the same small probability 1 - lambda. Here lambda is the leading eigenvalue of the
return map with falls absorbing (Byl and Tedrake 2009, Metastable walking machines). It lasts
1 / (1 - lambda) strides on average. That mean is estimated from a batch that walks until it falls.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker._tools.progress import progress
from gym_passive_walker.gaits.flow import Walkers, flow
from gym_passive_walker.gaits.terrain import Terrain

SETTLING = 10
"""Strides after which walkers have forgotten how they began."""

_CONFIDENT = 1.959963984540054  # standard errors on both sides of 95 of 100
_NONE_SEEN = 2.995732273553991  # falls expected at most, 95 times of 100, where none was seen


class FirstPassage(NamedTuple):
    """Strides to a fall, sampled.

    Attributes:
        falls: Number of falls.
        strides: Number of strides, including those that end in a fall.
    """

    falls: int
    strides: int

    @classmethod
    def of(cls, left: NDArray, settling: int = SETTLING) -> FirstPassage:
        """Return the estimate from the number of walkers left, before any stride and after each.

        Args:
            left: Number of walkers left, (1 + strides,).
            settling: Strides that are not counted, after which the start is forgotten.
        """
        counted = left[settling:]
        return cls(int(counted[0] - counted[-1]), int(counted[:-1].sum()))

    @property
    def mean(self) -> float:
        """Strides to a fall on average; infinite if none was seen, NaN if no stride was counted."""
        if not self.strides:
            return math.nan
        return self.strides / self.falls if self.falls else math.inf

    @property
    def error(self) -> float:
        """Standard error of the mean; NaN if no stride was counted."""
        if not self.falls:
            return math.inf if self.strides else math.nan
        return self.mean * math.sqrt((1.0 - self.falls / self.strides) / self.falls)

    @property
    def interval(self) -> tuple[float, float]:
        """95 % confidence interval of the mean; from 0 on if no stride was counted."""
        if not self.falls:
            return self.strides / _NONE_SEEN, math.inf
        return confidence_interval(self.mean, self.error, _CONFIDENT)

    def __str__(self) -> str:
        if not self.strides:
            return "all fell before any stride was counted"
        low, high = self.interval
        if not self.falls:
            return f"none of {self.strides} strides ended in a fall: more than {low:.3g} strides"
        return f"{self.mean:.4g} strides ({low:.4g} to {high:.4g})"


def confidence_interval(mean: float, error: float, errors: float) -> tuple[float, float]:
    """Return the interval of a mean, some standard errors of its logarithm on both sides."""
    # The chance of a fall is what varies evenly: its logarithm is minus that of the mean.
    share = math.exp(errors * error / mean)
    return mean / share, mean * share


def survivors(
    kind: Walkers,
    state: ArrayLike,
    slope: float,
    terrain: Terrain,
    *,
    walkers: int,
    strides: int,
    seed: int = 0,
) -> NDArray[np.int64]:
    """Simulate walkers on random ground, different for each, and count those that are left.

    Args:
        kind: The walker.
        state: Initial state just after heelstrike, dimensionless, (6,).
        slope: Slope in rad.
        terrain: The random ground.
        walkers: Number of walkers.
        strides: Largest number of strides.
        seed: Seed of the ground.

    Returns:
        Number of walkers left, before any stride and after each, (1 + strides,).
    """
    keys = np.random.default_rng(seed).integers(2**64, size=walkers, dtype=np.uint64)
    states = np.repeat(np.asarray(state, dtype=float)[None], walkers, axis=0)
    left = np.zeros(1 + strides, np.int64)
    left[0] = walkers
    with progress("strides on rough ground", strides) as taken:
        for place in range(strides):
            if not len(keys):
                break
            tilts, rises, turns = terrain.ground(keys, place).T
            walked = flow(kind, states, slope + tilts, rises=rises, turns=turns)
            states, keys = walked.states[walked.struck], keys[walked.struck]
            left[1 + place] = len(keys)
            taken()
    return left
