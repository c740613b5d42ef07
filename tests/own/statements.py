"""Systems that tests state: a compass, and one with a motor at its hip."""

import math
from dataclasses import replace
from typing import NamedTuple

import gym_passive_walker as gpw
from examples.torso import TORSO
from gym_passive_walker.models.math import cos, exp, sin, tanh


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


COMPASS = gpw.System(
    name="compass",
    body=Legs(),
    State=State,
    links=links,
    landing=lambda b, s: (sin(s.swing) - sin(s.stance), cos(s.stance) - cos(s.swing)),
    relabel=lambda b, s: (s.swing, s.stance),
    falls={
        "fell_forward": lambda b, s: s.stance + 0.5 * math.pi,
        "fell_backward": lambda b, s: 0.5 * math.pi - s.stance,
    },
    counts=(lambda b, s: -s.stance, lambda b, s: s.swing - s.stance - 0.02),
    start=(0.24, -0.24, -0.31, -0.17),
)

DRIVEN = replace(COMPASS, Control=Hip, travel=lambda state: Hip(state.swing - state.stance))


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
