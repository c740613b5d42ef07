"""The benchmark problems: strides from states around a gait, and the error of their ends."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gym_passive_walker import WALKERS, find_gait
from gym_passive_walker.models.equations.hybrid import Ground, System

STARTS = 64

_DIGITS = 9  # the gait is rounded, so that initial states do not depend on its last digits


class Problem(NamedTuple):
    """Strides of one walker, dimensionless.

    Attributes:
        name: Name in tables and files.
        system: Equations of motion.
        body: Constants of the walker, a `system.Body`.
        slope: Slope in rad.
        starts: States on the Poincaré section, shape (STARTS, 6): a gait's, perturbed by up to 1 %.
    """

    name: str
    system: System
    body: Any
    slope: float
    starts: NDArray

    @property
    def ground(self) -> Ground:
        """The slope in the form that the equations require."""
        return Ground(math.sin(self.slope), math.cos(self.slope))


WALKS = {"simplest": ("D", 0.009), "straight": ("A", 0.03), "kneed": ("lab", 0.036)}


def problem(name: str) -> Problem:
    """A problem by name: "simplest", "straight" or "kneed"."""
    walker, slope = WALKERS[WALKS[name][0]], WALKS[name][1]
    state = np.round(walker.units.to_dimensionless(find_gait(walker, slope).state), _DIGITS)
    random = np.random.default_rng(1)
    starts = state * (1.0 + 0.01 * random.uniform(-1.0, 1.0, (STARTS, 6)))
    starts[:, 1] = starts[:, 2] = -starts[:, 0]
    if not walker.knees:
        starts[:, 5] = starts[:, 4]
    system, body = walker.equations(), walker.body
    return Problem(name, system, type(body)(*map(float, body)), slope, starts)


def error(found: NDArray, reference: NDArray) -> float:
    """Largest error over states (n, 6), each relative to its largest angle or angular velocity."""
    difference = np.abs(np.asarray(found - reference, dtype=float)).max(axis=-1)
    return float((difference / np.abs(reference).max(axis=-1)).max())
