"""Actuation that is equal in each stride: constant torques, and a push-off at the end."""

from __future__ import annotations

import math
from operator import mul, truediv
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker._tools.arguments import real_array
from gym_passive_walker.models.model import check_supports
from gym_passive_walker.models.units import Units
from gym_passive_walker.models.walkers import Walker


class Actuation(NamedTuple):
    """Constant torques and a push-off at the end of each stride.

    Arguments of public functions are in the walker's own units; elsewhere they are dimensionless.

    Attributes:
        hip_torque: Torque between stance leg and swing thigh, positive when it opens the legs in
            the walking direction; per unit of foot mass for the simplest walker.
        ankle_torque: Torque between ground and stance leg, positive when it tips the walker
            forward; requires point feet.
        push_off: Impulse of the ground along the stance leg just before each heelstrike.
    """

    hip_torque: Any = 0.0
    ankle_torque: Any = 0.0
    push_off: Any = 0.0

    @classmethod
    def dimensionless(
        cls, hip_torque: Any = 0.0, ankle_torque: Any = 0.0, push_off: Any = 0.0
    ) -> DimensionlessActuation:
        """Return an actuation without units, for a walker of any size.

        Example:
            >>> import gym_passive_walker as gpw
            >>> held = gpw.Actuation.dimensionless(push_off=0.05)
            >>> gait = gpw.find_gait(gpw.stride_map("D", 0.0, controller=held))
            >>> round(gait.dimensionless.controller.push_off, 4)
            0.05

        Args:
            hip_torque: Hip torque over m g l; over g l for the simplest walker.
            ankle_torque: Ankle torque over m g l.
            push_off: Push-off over m sqrt(g l).
        """
        return DimensionlessActuation(hip_torque, ankle_torque, push_off)

    @property
    def passive(self) -> bool:
        """Whether all torques and the push-off are zero."""
        return self == PASSIVE if _single(self) else not any(np.any(part) for part in self)

    @property
    def using(self) -> tuple[str, ...]:
        """Names in `models.equations.systems.EXTRAS` that this actuation needs."""
        if self[1:] == PASSIVE[1:] if _single(self) else not (np.any(self[1]) or np.any(self[2])):
            return ()
        return "ankle", "push_off"


class DimensionlessActuation(Actuation):
    """An actuation without units, which is converted where the walker is known."""

    __slots__ = ()


def _single(actuation: Actuation) -> bool:
    """Whether all parts are plain floats, which are handled without arrays."""
    return type(actuation[0]) is type(actuation[1]) is type(actuation[2]) is float


PASSIVE = Actuation()
"""No motors."""

USES = {"hip_torque": "hip", "ankle_torque": "ankle", "push_off": "push_off"}
"""The engine's name for each part of an actuation."""


def actuation_units(units: Units) -> Actuation:
    """Return the units of a dimensionless actuation, in the walker's own units."""
    return Actuation(units.torque, units.energy, units.impulse)


def to_dimensionless(units: Units, actuation: Actuation) -> Actuation:
    """Return an actuation in a walker's own units in dimensionless form."""
    return Actuation(*map(truediv, actuation, actuation_units(units)))


def to_own(units: Units, actuation: Actuation) -> Actuation:
    """Return a dimensionless actuation in a walker's own units."""
    return Actuation(*map(mul, actuation, actuation_units(units)))


def check_actuation(
    walker: Walker, actuation: Actuation, *, foot_radii: NDArray | None = None
) -> Actuation:
    """Check that an actuation has numbers or arrays as parts, and that the walker permits it.

    Args:
        walker: The walker.
        actuation: The actuation.
        foot_radii: Radii of the feet of walkers that differ in it, (n,); None for the walker's own.

    Raises:
        ValueError: if a check fails; the message says what is allowed.
    """
    if isinstance(actuation, DimensionlessActuation):
        actuation = to_own(walker.units, check_actuation(walker, Actuation(*actuation)))
    if type(actuation) is Actuation and _single(actuation) and sum(map(abs, actuation)) < math.inf:
        if actuation == PASSIVE:
            return PASSIVE
        check_supports(walker, "actuation")
        if actuation.push_off >= 0.0 and (
            actuation.ankle_torque == 0.0 or walker.foot_radius == 0.0
        ):
            return actuation
    check_supports(walker, "actuation")
    if len(actuation) != len(Actuation._fields) or isinstance(actuation, str):
        raise ValueError(
            f"an actuation is a Actuation(hip_torque, ankle_torque, push_off), not {actuation!r}"
        )
    allowed = "a number or an array of them"
    hip, ankle, push = (
        real_array(part, name, allowed)
        for name, part in zip(Actuation._fields, actuation, strict=True)
    )
    radii = np.asarray(walker.foot_radius if foot_radii is None else foot_radii)
    if np.any((radii != 0.0) & (ankle != 0.0)):
        raise ValueError(
            "ankle_torque needs point feet: a round foot rolls, and the ground under it bears no "
            f"torque; foot_radius of this walker is {radii.max():g}"
        )
    if np.any(np.less(push, 0.0)):
        raise ValueError("push_off must not be negative: the ground cannot pull")
    return Actuation(hip, ankle, push)


def one_actuation(walker: Walker, actuation: Actuation) -> Actuation:
    """Check an actuation of single numbers.

    Raises:
        ValueError: if a part is not a single number.
    """
    checked = check_actuation(walker, actuation)
    if any(np.ndim(part) for part in checked):
        raise ValueError(f"a stride map has one Actuation, of single numbers, not {actuation!r}")
    return Actuation(*(float(part) for part in checked))


def for_each(value: ArrayLike, count: int) -> NDArray[np.float64]:
    """Return a number, or one number for each of `count` points, as an array (count,)."""
    values = np.asarray(value, dtype=float)
    return values if values.ndim else np.full(count, values)
