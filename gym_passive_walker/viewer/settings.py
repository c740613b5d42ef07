"""What may be changed while the walker walks, and within which bounds."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import NamedTuple

from gym_passive_walker.units import units_of
from gym_passive_walker.viewer.walk import LiveWalk
from gym_passive_walker.walkers import Walker
from gym_passive_walker.walkers.walker import PARAMETERS

_FELT = 0.2  # of m g l, a rad


class Setting(NamedTuple):
    """A number that a slider sets.

    Attributes:
        label: What it is called, with its unit if it has one of its own.
        low: Its least value.
        high: Its largest.
        home: What it was when the walker began.
        read: What it is in a walk.
        write: Sets it there.
    """

    label: str
    low: float
    high: float
    home: float
    read: Callable[[LiveWalk], float]
    write: Callable[[LiveWalk, float], None]

    def clipped(self, value: float) -> float:
        """The value, within the bounds."""
        return min(max(value, self.low), self.high)


def settings_of(walk: LiveWalk) -> list[Setting]:
    """Slope, torque, gravity and every parameter, in bounds that suit the walker of a walk."""
    names = ["gravity", *(name for name in PARAMETERS if name != "gravity")]
    slope, torque = (-0.05, 0.15, walk.slope), (-0.05, 0.05, 0.0)
    return [
        Setting("slope (rad)", *slope, lambda walk: walk.slope, LiveWalk.change_slope),
        Setting("hip torque / (m g l)", *torque, lambda walk: walk.torque, LiveWalk.hold),
        *(
            Setting(
                name.replace("_", " "),
                *_bounds(walk.walker, name),
                getattr(walk.walker, name),
                partial(_read, name),
                partial(_write, name),
            )
            for name in names
        ),
    ]


def _read(name: str, walk: LiveWalk) -> float:
    return getattr(walk.walker, name)


def _write(name: str, walk: LiveWalk, value: float) -> None:
    walk.change_walker(replace(walk.walker, **{name: value}))


def _bounds(walker: Walker, name: str) -> tuple[float, float]:
    """Bounds of a parameter, around what the walker has."""
    value, leg, kind = getattr(walker, name), walker.leg_length, name.split("_")[-1]
    if kind in ("length", "gravity"):
        return 0.25 * value, 2.0 * value
    if kind == "mass":
        return 0.0, max(2.0 * value, 0.5 * walker.total_mass)
    if kind == "offset":
        return -0.1 * leg, 0.1 * leg
    if kind == "angle":
        return -0.4, 0.4
    if kind in ("gyration", "com", "radius"):
        return 0.0, 0.6 * leg
    torque = units_of(walker).torque  # springs and friction: felt, yet a walker still walks
    return 0.0, max(2.0 * value, _FELT * torque)
