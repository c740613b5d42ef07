"""Sliders for the quantities that can be changed during a walk."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

from pygame import Rect

from gym_passive_walker.apps.viewer.walk import LiveWalk, Setup
from gym_passive_walker.models.walkers import PARAMETERS, Mechanism, Walker

PANEL = Rect(800, 0, 480, 560)
"""Area of the sliders."""

KNOB = 7
"""Radius of a knob in pixels."""

_TRACK_LEFT, _TRACK_WIDTH = PANEL.left + 170, 200
_TOP, _HEIGHT = PANEL.top + 34, PANEL.height - 98  # of all rows: a message stands below them
_TALLEST = 28  # of a row
_FELT = 0.2  # of m g l, a rad: a spring or friction that is felt, yet a walker still walks


class Slider(NamedTuple):
    """A number of a walk's setup that can be changed.

    Attributes:
        name: A field of `Setup`, or a parameter of its walker or of a `System`'s body.
        label: The name on the screen, with the unit if it is not the walker's own.
        low: The least value.
        high: The largest value.
        home: The value when the walker began.
        row: Area of the slider on the screen, with its label and its value.
    """

    name: str
    label: str
    low: float
    high: float
    home: float
    row: Rect

    @property
    def track(self) -> Rect:
        """Track of the knob."""
        return Rect(_TRACK_LEFT, self.row.centery - 2, _TRACK_WIDTH, 4)

    def read(self, walk: LiveWalk) -> float:
        """The value now; under a policy, the torque is that of the policy."""
        if self.name == "controller":
            return walk.torque
        return getattr(walk.setup if self.name == "slope" else _body(walk.setup), self.name)

    def write(self, walk: LiveWalk, value: float) -> None:
        """Set the nearest value of the range; a torque replaces a policy."""
        setup, value = walk.setup, min(max(value, self.low), self.high)
        if self.name in Setup._fields:
            walk.change(setup._replace(**{self.name: value}))
        elif isinstance(setup.walker, Mechanism):  # without its checks, which take too long here
            walk.change(setup._replace(walker=setup.walker.with_body({self.name: value})))
        else:
            walk.change(setup._replace(walker=replace(setup.walker, **{self.name: value})))

    def knob(self, walk: LiveWalk) -> tuple[int, int]:
        """Return the position of the knob in pixels."""
        share = (self.read(walk) - self.low) / (self.high - self.low)
        return round(_TRACK_LEFT + min(max(share, 0.0), 1.0) * _TRACK_WIDTH), self.row.centery

    def grabbed_at(self, place: tuple[int, int]) -> bool:
        """Whether a place is on the track or the knob."""
        return self.track.inflate(2 * KNOB, self.row.height).collidepoint(place)

    def value_at(self, x: float) -> float:
        """The value to which the knob is moved at a pixel's x, perhaps out of the range."""
        return self.low + (x - _TRACK_LEFT) / _TRACK_WIDTH * (self.high - self.low)


def sliders_of(setup: Setup) -> list[Slider]:
    """Sliders of the slope, the torque, gravity and each parameter, with ranges for the walker."""
    walker, table = setup.walker, [("slope", "slope (rad)", -0.05, 0.15, setup.slope)]
    own = isinstance(walker, Mechanism)
    motor = "".join(walker.controls[:1]) if own else "hip"
    if motor:
        table.append(("controller", f"{motor} torque / (m g l)", -0.05, 0.05, 0.0))
    names = walker.body._fields if own else sorted(PARAMETERS, key="gravity".__ne__)
    for name in names:
        home = float(getattr(_body(setup), name))
        low, high = sorted((0.25 * home, 2.0 * home or 1.0)) if own else _range(walker, name, home)
        table.append((name, name.replace("_", " "), low, high, home))
    height = min(_TALLEST, _HEIGHT // len(table))
    return [
        Slider(*about, Rect(PANEL.left, _TOP + index * height, PANEL.width, height))
        for index, about in enumerate(table)
    ]


def _body(setup: Setup) -> Any:
    """Return the object with the parameters of a setup's walker."""
    return setup.walker.body if isinstance(setup.walker, Mechanism) else setup.walker


def _range(walker: Walker, name: str, value: float) -> tuple[float, float]:
    """The range of a parameter, around its value."""
    match name.rsplit("_", maxsplit=1)[-1]:
        case "length" | "gravity":
            return 0.25 * value, 2.0 * value
        case "mass":
            return 0.0, max(2.0 * value, 0.5 * walker.total_mass)
        case "offset":
            return -0.1 * walker.leg_length, 0.1 * walker.leg_length
        case "angle":
            return -0.4, 0.4
        case "gyration" | "com" | "radius":
            return 0.0, 0.6 * walker.leg_length
        case _:  # a stiffness or friction
            return 0.0, max(2.0 * value, _FELT * walker.units.torque)
