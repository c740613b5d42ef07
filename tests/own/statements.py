"""Systems that tests state: a compass, one with a motor at its hip, one with a torso."""

import math
from dataclasses import replace
from typing import NamedTuple

import gym_passive_walker as gpw
from examples.five_links import FIVE_LINKS
from examples.torso import TORSO, landing
from gym_passive_walker.models.math import cos, exp, sin, tanh
from gym_passive_walker.models.walkers import Walker


class Legs(NamedTuple):
    """Masses of the hip and of each leg."""

    hip: float = 2.0 / 3.0
    leg: float = 1.0 / 6.0


class State(NamedTuple):
    """Angles of both legs and their rates."""

    stance: float
    swing: float
    stance_rate: float
    swing_rate: float


class Hip(NamedTuple):
    """A torque between the legs."""

    hip: float


class Renamed(NamedTuple):
    """The state of a compass by another name."""

    stance: float
    swing: float
    stance_rate: float
    swing_rate: float


class Motor(NamedTuple):
    """The torque of a compass by another name."""

    motor: float


def links(body, state):
    x, y = -sin(state.stance), cos(state.stance)
    return [
        gpw.Link(body.hip, x, y),
        gpw.Link(body.leg, 0.5 * x, 0.5 * y),
        gpw.Link(body.leg, x + 0.5 * sin(state.swing), y - 0.5 * cos(state.swing)),
    ]


def relabel(body, state):
    """The legs exchange their roles."""
    return state.swing, state.stance


def upright(body, state):
    """Positive until the stance leg lies in front."""
    return state.stance + 0.5 * math.pi


def leaning(body, state):
    """Positive until the stance leg lies behind."""
    return 0.5 * math.pi - state.stance


def past_midstance(body, state):
    """Positive once the stance leg leans forward."""
    return -state.stance


def ahead(body, state):
    """Positive where the swing foot is in front."""
    return state.swing - state.stance - 0.02


def hip_angle(state):
    """What a torque between the legs turns."""
    return Hip(state.swing - state.stance)


COMPASS = gpw.System(
    name="compass",
    body=Legs(),
    State=State,
    links=links,
    landing=landing,
    relabel=relabel,
    falls={"fell_forward": upright, "fell_backward": leaning},
    counts=(past_midstance, ahead),
    start=(0.24, -0.24, -0.31, -0.17),
)

DRIVEN = replace(COMPASS, Control=Hip, travel=hip_angle)

STRAIGHT = Walker(
    thigh_length=0.5, thigh_mass=1.0 / 6.0, thigh_com=0.5, shank_length=0.5, shank_mass=0.0,
    hip_mass=2.0 / 3.0, knees=False, gravity=1.0,
)  # fmt: skip
"""The compass by McGeer's parameters."""


def progressive(body, state):
    """Energy of a spring at the torso that stiffens."""
    return body.stiffness * (0.5 * (exp(state.torso) + exp(-state.torso)) - 1.0)


def saturated(body, state):
    """A torque between torso and stance leg that saturates."""
    torque = 0.2 * tanh(5.0 * (state.stance - state.torso) - state.torso_rate)
    return -torque, 0.0, torque


PROGRESSIVE = replace(
    TORSO, name="progressive torso", potential=progressive, dissipation=None, forces=saturated
)

SCENES = {
    "compass": {"system": DRIVEN, "slope": 0.03},
    "five links": {"system": FIVE_LINKS, "slope": 0.05},
}
"""A system with room in a walker's record, and one that needs a larger one."""
