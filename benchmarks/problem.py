"""What is measured: strides from around a gait, and how the error of their ends is told."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from gym_passive_walker.physics.constants import Kind
from numpy.typing import NDArray

from gym_passive_walker import WALKERS, find_gait
from gym_passive_walker.physics import constants as K

STARTS = 64


class Problem(NamedTuple):
    """Strides of one walker, dimensionless.

    Attributes:
        name: How tables and files call it.
        kind: Which equations it obeys.
        c: Its constants, shape (COUNT,).
        slope: In rad.
        starts: Section states, shape (STARTS, 6): a gait's, moved by up to 1 %.
    """

    name: str
    kind: Kind
    c: NDArray
    slope: float
    starts: NDArray


WALKS = {"simplest": ("D", 0.009), "straight": ("A", 0.03), "kneed": ("lab", 0.036)}


def problem(name: str) -> Problem:
    """A problem by name: "simplest", "straight" or "kneed"."""
    walker, slope = WALKERS[WALKS[name][0]], WALKS[name][1]
    gait = find_gait(walker, slope)
    state = gait.state * np.repeat([1.0, walker.time_unit], 3)
    random = np.random.default_rng(1)
    starts = state * (1.0 + 0.01 * random.uniform(-1.0, 1.0, (STARTS, 6)))
    starts[:, 1] = starts[:, 2] = -starts[:, 0]
    kind = K.kind_of(walker)
    if kind != Kind.KNEED:
        starts[:, 5] = starts[:, 4]
    return Problem(name, kind, K.constants(walker), slope, starts)


def error(found: NDArray, reference: NDArray) -> float:
    """Largest error of a state, relative to its largest angle or rate."""
    difference = np.abs(np.asarray(found - reference, dtype=float)).max(axis=-1)
    return float((difference / np.abs(reference).max(axis=-1)).max())
