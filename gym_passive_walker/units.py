"""Conversion between a walker's own units and dimensionless ones.

Units are the leg length l, the walker's total mass m, and the pendulum time sqrt(l/g). Angles are
in rad in both.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker.walkers import Mechanism, Walker


class Units(NamedTuple):
    """Dimensionless units, expressed in a walker's own units: numbers, or arrays (n,).

    Attributes:
        length: Unit of length, l.
        time: Unit of time, sqrt(l/g).
        energy: Unit of energy, m g l.
        torque: Unit of torque, m g l; g l for the simplest walker, with torques per foot mass.
    """

    length: float
    time: float
    energy: float
    torque: float

    @property
    def rate(self) -> float:
        """Unit of angular velocity, sqrt(g/l)."""
        return 1.0 / self.time

    @property
    def force(self) -> float:
        """Unit of force, the weight m g."""
        return self.energy / self.length

    @property
    def impulse(self) -> float:
        """Unit of impulse, m sqrt(g l)."""
        return self.energy / self.speed

    @property
    def speed(self) -> float:
        """Unit of speed, sqrt(g l)."""
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


_KINDS = {
    "length": ("thigh_length", "thigh_offset", "thigh_gyration", "thigh_com", "shank_length",
               "shank_offset", "shank_gyration", "shank_com", "foot_radius"),
    "mass": ("thigh_mass", "shank_mass", "hip_mass"),
    "angle": ("foot_angle",),
    "stiffness": ("hip_stiffness", "knee_stiffness"),
    "friction": ("hip_friction",),
}  # fmt: skip
"""Parameters of a walker by the unit that makes them dimensionless; gravity is always 1 then."""

PROPORTIONS = tuple(name for names in _KINDS.values() for name in names)
"""Parameters of a walker that have a dimensionless value."""


def proportions(walker: Any, names: Sequence[str]) -> list[Any]:
    """Dimensionless values of some parameters of a walker, in the order of their names.

    Lengths are over l, masses over m, stiffnesses over m g l, and friction is over
    m g l sqrt(l/g).

    Args:
        walker: A walker, or anything with its attributes: numbers, arrays or tensors.
        names: Some of PROPORTIONS.
    """
    units = units_of(walker)
    scales = {
        "length": units.length,
        "mass": units.energy / (units.length * walker.gravity),
        "angle": 1.0,
        "stiffness": units.torque,
        "friction": units.torque * units.time,
    }
    kinds = {name: kind for kind, those in _KINDS.items() for name in those}
    return [getattr(walker, name) / scales[kinds[name]] for name in names]


def growth(walker: Walker, parameter: str) -> Units:
    """Return the logarithmic derivative of each unit with respect to a walker parameter."""
    length = (parameter in ("thigh_length", "shank_length")) / walker.leg_length
    gravity = (parameter == "gravity") / walker.gravity
    mass = {"thigh_mass": 2.0, "shank_mass": 2.0, "hip_mass": 1.0}.get(parameter, 0.0)
    energy = mass / walker.total_mass + gravity + length
    torque = gravity + length if walker.massless_legs else energy
    return Units(length, 0.5 * (length - gravity), energy, torque)
