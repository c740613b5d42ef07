"""Conversion between a walker's own units and dimensionless ones.

Units are the leg length l, the walker's total mass m, and the pendulum time sqrt(l/g). Angles are
in rad in both.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray


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

    @classmethod
    def of(cls, walker: Any) -> Units:
        """The units of a walker, or of anything with its attributes: numbers, arrays or tensors."""
        length, mass = walker.thigh_length + walker.shank_length, mass_of(walker)
        quotient = length / walker.gravity
        time = math.sqrt(quotient) if isinstance(quotient, float) else quotient**0.5
        energy = mass * walker.gravity * length
        torque = walker.gravity * length if walker.massless_legs else energy
        return cls(length, time, energy, torque)

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


class Varied(SimpleNamespace):
    """The attributes of walkers that differ in some parameters: numbers, arrays or tensors."""

    units: Any = property(Units.of)


def varied(walker: Any, parameters: Mapping[str, Any]) -> Varied:
    """Return a walker's attributes with other values of some parameters, such as tensors."""
    return Varied(**{**vars(walker), "massless_legs": walker.massless_legs, **parameters})


def mass_of(walker: Any) -> Any:
    """Return the mass of both legs and the hip, of a walker or of anything with its attributes."""
    return 2.0 * (walker.thigh_mass + walker.shank_mass) + walker.hip_mass


def _times(time: float | NDArray, size: int) -> NDArray[np.float64]:
    """Factors of the numbers of a state, 1 for angles, (size,), or (n, size) for n walkers."""
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


UNITS: dict[str, tuple[str, Callable[[Any, Units], Any]]] = {
    "angle": ("rad", lambda walker, units: 1.0),
    "length": ("l", lambda walker, units: units.length),
    "mass": ("m", lambda walker, units: units.energy / (units.length * walker.gravity)),
    "gravity": ("g", lambda walker, units: walker.gravity),
    "time": ("√(l/g)", lambda walker, units: units.time),
    "speed": ("√(g l)", lambda walker, units: units.speed),
    "torque": ("(m g l)", lambda walker, units: units.torque),
    "energy": ("(m g l)", lambda walker, units: units.energy),
    "rate": ("√(g/l)", lambda walker, units: units.rate),
    "force": ("(m g)", lambda walker, units: units.force),
    "power": ("(m g √(g l))", lambda walker, units: units.energy / units.time),
    "twist": ("(m l √(g l))", lambda walker, units: units.time * units.torque),
    "friction": ("(m l √(g l))", lambda walker, units: units.torque * units.time),
    "impulse": ("(m √(g l))", lambda walker, units: units.impulse),
}
"""Symbol of each kind of unit, and the unit: a function of a walker and its `Units`."""

_NAMES = {
    "length": ("thigh_length", "thigh_offset", "thigh_gyration", "thigh_com", "shank_length",
               "shank_offset", "shank_gyration", "shank_com", "foot_radius"),
    "mass": ("thigh_mass", "shank_mass", "hip_mass"),
    "angle": ("foot_angle",),
    "torque": ("hip_stiffness", "knee_stiffness", "hip_torque"),
    "friction": ("hip_friction",),
    "gravity": ("gravity",),
    "energy": ("ankle_torque",),
    "impulse": ("push_off",),
}  # fmt: skip
KINDS = {name: kind for kind, names in _NAMES.items() for name in names}
"""Kind of the unit of each parameter of a walker and of its actuation."""

PROPORTIONS = tuple(
    name for name in KINDS if name not in ("gravity", "hip_torque", "ankle_torque", "push_off")
)
"""Parameters of a walker that have a dimensionless value."""


def observable(walker: Any) -> tuple[str, ...]:
    """Return the parameters of a model that agents can observe."""
    return PROPORTIONS if "units" in walker.supports else tuple(walker.parameters)


def unit_of(walker: Any, name: str) -> Any:
    """Return the unit of a parameter, in the walker's own units.

    Args:
        walker: A walker, or anything with its attributes: numbers, arrays or tensors.
        name: A parameter of the walker or of its actuation.
    """
    return UNITS[KINDS[name]][1](walker, walker.units)


def proportions(walker: Any, names: Sequence[str]) -> list[Any]:
    """Return dimensionless values of some parameters of a walker, in the order of their names.

    Args:
        walker: A walker, or anything with its attributes: numbers, arrays or tensors.
        names: Some of PROPORTIONS.
    """
    return [getattr(walker, name) / unit_of(walker, name) for name in names]


def observed_numbers(
    model: Any, names: Sequence[str], values: Mapping[str, Any] | None = None
) -> list[Any]:
    """Return what agents observe of a model's parameters, some of `observable`.

    They are `proportions`, or for a model without units of its own the parameters themselves.
    `values` replace some parameters: numbers, arrays or tensors.
    """
    if "units" in model.supports:
        return proportions(varied(model, values) if values else model, names)
    numbers = {**model.parameters, **(values or {})}
    return [numbers[name] for name in names]


def growth(walker: Any, parameter: str) -> Units:
    """Return the logarithmic derivative of each unit with respect to a walker parameter."""
    length = (parameter in ("thigh_length", "shank_length")) / walker.leg_length
    gravity = (parameter == "gravity") / walker.gravity
    mass = {"thigh_mass": 2.0, "shank_mass": 2.0, "hip_mass": 1.0}.get(parameter, 0.0)
    energy = mass / walker.total_mass + gravity + length
    torque = gravity + length if walker.massless_legs else energy
    return Units(length, 0.5 * (length - gravity), energy, torque)
