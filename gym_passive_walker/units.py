"""A walker's own units and the dimensionless ones, and how numbers turn from one to the other.

The leg length l is the unit of length, the walker's total mass m that of mass, and the pendulum
time sqrt(l/g) that of time. Angles are in rad either way.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker.walkers import Mechanism, Walker


class Units(NamedTuple):
    """Dimensionless units in a walker's own; of n walkers, arrays (n,) instead of numbers.

    Attributes:
        length: l.
        time: sqrt(l/g).
        energy: m g l.
        torque: m g l; g l for the simplest walker, whose torque is per unit of foot mass.
    """

    length: float
    time: float
    energy: float
    torque: float

    @property
    def rate(self) -> float:
        """Of angles: 1 / time."""
        return 1.0 / self.time

    @property
    def force(self) -> float:
        """The weight m g."""
        return self.energy / self.length

    @property
    def impulse(self) -> float:
        """M sqrt(g l)."""
        return self.energy / self.speed

    @property
    def speed(self) -> float:
        """sqrt(g l)."""
        return self.length / self.time

    def to_dimensionless(self, states: ArrayLike) -> NDArray[np.float64]:
        """Dimensionless states (..., 6) of states in the walker's own units."""
        given = np.asarray(states)
        return given * _times(self.time, given.shape[-1])

    def to_own(self, states: ArrayLike) -> NDArray[np.float64]:
        """States (..., 6) in the walker's own units of dimensionless ones."""
        given = np.asarray(states)
        return given / _times(self.time, given.shape[-1])


def _times(time: float | NDArray, size: int) -> NDArray[np.float64]:
    """What rates are multiplied by and angles are not, (size,), or (n, size) for n walkers."""
    if type(time) is float:
        return _times_of_one(time, size)
    times = np.ones((*np.shape(time), size))
    times[..., size // 2 :] = np.asarray(time)[..., None]
    return times


@lru_cache(maxsize=4096)  # one walker's stride waits for it twice
def _times_of_one(time: float, size: int) -> NDArray[np.float64]:
    times = np.array([1.0] * (size // 2) + [time] * (size // 2))
    times.flags.writeable = False
    return times


def units_of(walker: Any) -> Units:
    """The units of a walker, or of anything with its attributes: numbers, arrays or tensors."""
    if isinstance(walker, Mechanism):
        return Units(1.0, 1.0, 1.0, 1.0)
    return _of_walker(walker) if isinstance(walker, Walker) else _of(walker)


def _of(walker: Any) -> Units:
    length = walker.thigh_length + walker.shank_length
    mass = 2.0 * (walker.thigh_mass + walker.shank_mass) + walker.hip_mass
    quotient = length / walker.gravity
    time = math.sqrt(quotient) if isinstance(quotient, float) else quotient**0.5
    energy = mass * walker.gravity * length
    torque = walker.gravity * length if walker.massless_legs else energy
    return Units(length, time, energy, torque)


_of_walker = lru_cache(maxsize=4096)(_of)


def growth(walker: Walker, parameter: str) -> Units:
    """By what share of itself each unit grows with one of the walker's parameters."""
    length = (parameter in ("thigh_length", "shank_length")) / walker.leg_length
    gravity = (parameter == "gravity") / walker.gravity
    mass = {"thigh_mass": 2.0, "shank_mass": 2.0, "hip_mass": 1.0}.get(parameter, 0.0)
    energy = mass / walker.total_mass + gravity + length
    torque = gravity + length if walker.massless_legs else energy
    return Units(length, 0.5 * (length - gravity), energy, torque)
