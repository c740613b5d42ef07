"""A compass walker with unequal legs, as with a prosthesis: a system that exchanges parameters.

    python -m examples.unequal_legs

Goswami's compass: its hip weighs 10 kg, its legs 5 kg each in their middle, and they are 1 m long.
The fields of one leg are those of the stance leg, the fields of the other those of the swing leg;
they change places at each heelstrike.

References:
    A. Goswami, B. Thuilot, B. Espiau, "A study of the passive gait of a compass-like biped robot",
    Int. J. Robotics Research 17 (1998) 1282-1301.
"""

from __future__ import annotations

import math
import sys
from dataclasses import replace
from typing import NamedTuple

import gym_passive_walker as gpw
from gym_passive_walker import console
from gym_passive_walker.math import cos, sin


class Legs(NamedTuple):
    """Masses and lengths of both legs.

    Attributes:
        hip: Mass of the hip.
        stance_mass: Mass of the stance leg.
        swing_mass: Mass of the swing leg.
        stance_length: Length of the stance leg.
        swing_length: Length of the swing leg.
        stance_centre: Distance of the stance leg's mass from the hip, as a share of its length.
        swing_centre: Distance of the swing leg's mass from the hip, as a share of its length.
    """

    hip: float = 10.0
    stance_mass: float = 5.0
    swing_mass: float = 5.0
    stance_length: float = 1.0
    swing_length: float = 1.0
    stance_centre: float = 0.5
    swing_centre: float = 0.5


class State(NamedTuple):
    """Angles in rad from the ground's normal, positive backwards, and their rates."""

    stance: float
    swing: float
    stance_rate: float
    swing_rate: float


class Hip(NamedTuple):
    """A torque between the legs."""

    hip: float


def hip(body, state):
    """Position of the hip from the stance foot."""
    return -body.stance_length * sin(state.stance), body.stance_length * cos(state.stance)


def links(body, state):
    """Masses: the hip and both legs."""
    x, y = hip(body, state)
    up, down = 1.0 - body.stance_centre, body.swing_centre * body.swing_length
    return [
        gpw.Link(body.hip, x, y),
        gpw.Link(body.stance_mass, up * x, up * y),
        gpw.Link(body.swing_mass, x + down * sin(state.swing), y - down * cos(state.swing)),
    ]


def landing(body, state):
    """The swing foot."""
    x, y = hip(body, state)
    return x + body.swing_length * sin(state.swing), y - body.swing_length * cos(state.swing)


UNEQUAL_LEGS = gpw.System(
    name="unequal legs",
    body=Legs(),
    State=State,
    links=links,
    landing=landing,
    relabel=lambda body, state: (state.swing, state.stance),
    exchange={
        "stance_mass": "swing_mass",
        "stance_length": "swing_length",
        "stance_centre": "swing_centre",
    },
    falls={
        "fell_forward": lambda body, state: state.stance + 0.5 * math.pi,
        "fell_backward": lambda body, state: 0.5 * math.pi - state.stance,
    },
    # Where legs pass each other the height of the foot crosses zero: a strike counts where each leg
    # is on its own side of the normal.
    counts=(lambda body, state: -state.stance, lambda body, state: state.swing),
    pose=lambda body, state: [[(0.0, 0.0), hip(body, state), landing(body, state)]],
    start=(0.271, -0.271, -0.349, -0.121),
)

PROSTHESIS = replace(
    UNEQUAL_LEGS.vary(swing_mass=5.2),
    Control=Hip,
    travel=lambda state: Hip(state.swing - state.stance),
)
"""One leg is 4 % heavier than the other, and the hip has a motor."""


def main() -> None:
    """Print how the gait at 3 degrees changes with one leg's mass and length."""
    slope = math.radians(3.0)
    print(gpw.find_gait(UNEQUAL_LEGS, slope))
    print(gpw.parameter_family(UNEQUAL_LEGS, "swing_mass", 1.0, 10.0, slope=slope))
    print(gpw.parameter_family(UNEQUAL_LEGS, "swing_length", 0.98, 1.02, slope=slope))


if __name__ == "__main__":
    sys.exit(console.run(main))
