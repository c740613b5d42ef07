"""A compass walker with a torso: a system of one's own in three coordinates.

    python -m examples.torso

A spring and a damper hold the torso on the line that bisects the angle between the legs. A stiff
spring is the bisecting mechanism of Wisse and others.

References:
    M. Wisse, A. L. Schwab, F. C. T. van der Helm, "Passive dynamic walking model with upper body",
    Robotica 22 (2004) 681-688.
"""

from __future__ import annotations

import math
import sys
from typing import NamedTuple

import gym_passive_walker as gpw
from gym_passive_walker import console
from gym_passive_walker.math import cos, sin


class Body(NamedTuple):
    """Masses and springs; legs have the length 1 and their mass in the middle."""

    hip: float = 0.7
    leg: float = 0.1
    torso: float = 0.1
    height: float = 0.3
    stiffness: float = 2.0
    damping: float = 0.02


class State(NamedTuple):
    """Angles in rad from the ground's normal, positive backwards, and their rates."""

    stance: float
    swing: float
    torso: float
    stance_rate: float
    swing_rate: float
    torso_rate: float


def links(body, state):
    """Masses: the hip, both legs and the torso."""
    x, y = -sin(state.stance), cos(state.stance)
    return [
        gpw.Link(body.hip, x, y),
        gpw.Link(body.leg, 0.5 * x, 0.5 * y),
        gpw.Link(body.leg, x + 0.5 * sin(state.swing), y - 0.5 * cos(state.swing)),
        gpw.Link(
            body.torso, x - body.height * sin(state.torso), y + body.height * cos(state.torso)
        ),
    ]


def landing(body, state):
    """The swing foot."""
    return sin(state.swing) - sin(state.stance), cos(state.stance) - cos(state.swing)


def lean(stance, swing, torso):
    """Return the angle of the torso from the bisecting line."""
    return torso - 0.5 * (stance + swing)


def pose(body, state):
    """Both legs and the torso, for pictures."""
    x, y = hip = -sin(state.stance), cos(state.stance)
    foot = x + sin(state.swing), y - cos(state.swing)
    top = x - body.height * sin(state.torso), y + body.height * cos(state.torso)
    return [[hip, foot], [(0.0, 0.0), hip], [hip, top]]


TORSO = gpw.System(
    name="torso",
    body=Body(),
    State=State,
    links=links,
    landing=landing,
    relabel=lambda body, state: (state.swing, state.stance, state.torso),
    falls={
        "fell_forward": lambda body, state: state.stance + 0.5 * math.pi,
        "fell_backward": lambda body, state: 0.5 * math.pi - state.stance,
    },
    # Legs side by side scuff the ground: a heelstrike counts in front.
    counts=(lambda body, state: -state.stance, lambda b, s: s.swing - s.stance - 0.02),
    potential=lambda body, s: 0.5 * body.stiffness * lean(*s[:3]) ** 2,
    dissipation=lambda body, s: 0.5 * body.damping * lean(*s[3:]) ** 2,
    pose=pose,
    start=(0.28, -0.28, 0.0, -0.27, -0.12, -0.57),
)


def main() -> None:
    """Print a gait, and where its branch doubles its period as the torso grows."""
    gait = gpw.find_gait(TORSO, 0.03)
    print(gait)
    print("multipliers", *(f"{abs(multiplier):.4f}" for multiplier in gait.multipliers))
    print(gpw.parameter_family(TORSO, "torso", 0.02, 0.3, slope=0.03))


if __name__ == "__main__":
    sys.exit(console.run(main))
