"""A rimless wheel: the simplest system of one's own, with a gait in closed form.

    python -m examples.rimless_wheel

The wheel rolls on the ends of its spokes. It has one coordinate: the angle of the spoke that
stands, positive when it leans back. The next spoke strikes the ground 2 `half` ahead of it.

References:
    T. McGeer, "Passive dynamic walking", Int. J. Robotics Research 9 (1990) 62-82.
"""

from __future__ import annotations

import math
import sys
from typing import NamedTuple

import gym_passive_walker as gpw
from gym_passive_walker import console
from gym_passive_walker.math import cos, sin


class Wheel(NamedTuple):
    """Parameters of the wheel; its mass and the length of its spokes are 1.

    Attributes:
        half: Half the angle between two spokes, in rad.
        inertia: Moment of inertia about the hub.
    """

    half: float = math.pi / 8.0
    inertia: float = 0.2


class Spoke(NamedTuple):
    """The angle of the stance spoke in rad, and its rate."""

    spoke: float
    spoke_rate: float


RIMLESS_WHEEL = gpw.System(
    name="rimless wheel",
    body=Wheel(),
    State=Spoke,
    links=lambda b, s: [gpw.Link(1.0, -sin(s.spoke), cos(s.spoke), b.inertia, s.spoke)],
    landing=lambda b, s: (
        sin(s.spoke + 2.0 * b.half) - sin(s.spoke),
        cos(s.spoke) - cos(s.spoke + 2.0 * b.half),
    ),
    relabel=lambda b, s: (s.spoke + 2.0 * b.half,),
    falls={"fell_backward": lambda b, s: b.half + 0.01 - s.spoke},
    start=(math.pi / 8.0, -0.5),
)


def closed_form(wheel: Wheel, slope: float) -> tuple[float, float]:
    """Return the rate just after an impact on the gait, and the gait's multiplier.

    An impact keeps the share e of the rate, and between two of them the hub falls by
    2 sin(half) sin(slope).
    """
    e = (wheel.inertia + math.cos(2.0 * wheel.half)) / (wheel.inertia + 1.0)
    gained = 4.0 * math.sin(wheel.half) * math.sin(slope) / (wheel.inertia + 1.0)
    return -e * math.sqrt(gained / (1.0 - e**2)), e**2


def main() -> None:
    """Print the gait at three slopes beside the closed form."""
    print("slope   rate after an impact   closed form   multiplier   closed form")
    for slope in (0.06, 0.08, 0.1):
        gait = gpw.find_gait(RIMLESS_WHEEL, slope)
        rate, multiplier = closed_form(RIMLESS_WHEEL.body, slope)
        print(
            f"{slope:5.2f}   {gait.state[1]:20.12f}   {rate:11.8f}   "
            f"{gait.multipliers[0].real:10.8f}   {multiplier:11.8f}"
        )


if __name__ == "__main__":
    sys.exit(console.run(main))
