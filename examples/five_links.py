"""A five-link biped with knees and a torso, of RABBIT's size: a system in five coordinates.

    python -m examples.five_links

Springs and dampers hold the knees nearly straight and the torso on the line between the thighs.
Four motors act beside them: at both knees, and between the torso and each thigh. The feet are
points. Lengths are in units of the leg, masses in units of the whole.

References:
    C. Chevallereau, G. Abba, Y. Aoustin, F. Plestan, E. R. Westervelt, C. Canudas-de-Wit, J. W.
    Grizzle, "RABBIT: a testbed for advanced control theory", IEEE Control Systems Magazine 23
    (2003) 57-79.
"""

from __future__ import annotations

import sys
from typing import NamedTuple

import gym_passive_walker as gpw
from gym_passive_walker import console
from gym_passive_walker.control.baselines import LinearFeedback
from gym_passive_walker.math import cos, sin

LEG, MASS = 0.8, 32.0  # m, kg


class Segment(NamedTuple):
    """A segment of the leg or the torso, with its joint nearest to the hip at one end."""

    mass: float
    length: float
    com: float  # from that joint
    inertia: float

    @classmethod
    def of(cls, mass: float, length: float, com: float, inertia: float) -> Segment:
        """A segment from numbers in kg, m and kg m^2."""
        return cls(mass / MASS, length / LEG, com / LEG, inertia / (MASS * LEG**2))


TORSO = Segment.of(12.0, 0.63, 0.24, 1.33)
THIGH = Segment.of(6.8, 0.4, 0.11, 0.47)
SHIN = Segment.of(3.2, 0.4, 0.24, 0.20)


class Body(NamedTuple):
    """Springs and dampers at the joints, and the angle at which the knees rest."""

    knee: float = 20.0
    torso: float = 20.0
    damping: float = 1.0
    bend: float = 0.05


class State(NamedTuple):
    """Angles in rad from the ground's normal, positive backwards, and their rates."""

    shin: float
    thigh: float
    torso: float
    swing_thigh: float
    swing_shin: float
    shin_rate: float
    thigh_rate: float
    torso_rate: float
    swing_thigh_rate: float
    swing_shin_rate: float


class Motors(NamedTuple):
    """Torques that open a knee or turn a thigh against the torso."""

    stance_knee: float
    stance_hip: float
    swing_hip: float
    swing_knee: float


def above(angle, length):
    """A point at a distance from the lower end of a segment."""
    return -length * sin(angle), length * cos(angle)


def added(*vectors):
    """The sum of vectors."""
    x, y = (sum(parts[1:], parts[0]) for parts in zip(*vectors, strict=True))
    return x, y


def joints(state):
    """Stance knee, hip, swing knee and swing foot."""
    knee = above(state.shin, SHIN.length)
    hip = added(knee, above(state.thigh, THIGH.length))
    swing_knee = added(hip, above(state.swing_thigh, -THIGH.length))
    return knee, hip, swing_knee, added(swing_knee, above(state.swing_shin, -SHIN.length))


def links(body, state):
    """The five segments."""
    knee, hip, swing_knee, _ = joints(state)
    centres = (
        (SHIN, added(knee, above(state.shin, -SHIN.com)), state.shin),
        (THIGH, added(hip, above(state.thigh, -THIGH.com)), state.thigh),
        (TORSO, added(hip, above(state.torso, TORSO.com)), state.torso),
        (THIGH, added(hip, above(state.swing_thigh, -THIGH.com)), state.swing_thigh),
        (SHIN, added(swing_knee, above(state.swing_shin, -SHIN.com)), state.swing_shin),
    )
    return [gpw.Link(part.mass, x, y, part.inertia, turn) for part, (x, y), turn in centres]


def stretched(body, angles, bend):
    """Return the deviations of both knees and the torso from the rest of their springs."""
    shin, thigh, torso, swing_thigh, swing_shin = angles
    mean = 0.5 * (thigh + swing_thigh)
    return thigh - shin - bend, swing_thigh - swing_shin - bend, torso - mean


def potential(body, state):
    """Energy of the springs."""
    knee, swing_knee, torso = stretched(body, state[:5], body.bend)
    return 0.5 * (body.knee * (knee**2 + swing_knee**2) + body.torso * torso**2)


def dissipation(body, state):
    """Half the power that the dampers take."""
    return 0.5 * body.damping * sum(rate**2 for rate in stretched(body, state[5:], 0.0))


def pose(body, state):
    """The stance leg, the torso and the swing leg, for pictures."""
    knee, hip, swing_knee, foot = joints(state)
    top = added(hip, above(state.torso, TORSO.length))
    return [[hip, swing_knee, foot], [(0.0, 0.0), knee, hip], [hip, top]]


FIVE_LINKS = gpw.System(
    name="five links",
    body=Body(),
    State=State,
    links=links,
    landing=lambda body, state: joints(state)[3],
    relabel=lambda b, s: (s.swing_shin, s.swing_thigh, s.torso, s.thigh, s.shin),
    falls={
        "fell_forward": lambda body, state: state.shin + 1.2,
        "fell_backward": lambda body, state: 1.2 - state.shin,
    },
    # The swing foot passes through the ground at midstance: a heelstrike counts in front.
    counts=(
        lambda body, state: -state.shin - state.thigh,
        lambda body, state: state.swing_thigh - state.thigh - 0.1,
    ),
    potential=potential,
    dissipation=dissipation,
    Control=Motors,
    travel=lambda s: Motors(
        s.thigh - s.shin, s.thigh - s.torso, s.swing_thigh - s.torso, s.swing_thigh - s.swing_shin
    ),
    pose=pose,
    start=(0.35, 0.4, 0.03, -0.35, -0.4, -0.32, -0.17, -0.53, -0.12, -0.27),
)


def steps(step):
    """The reward of `downhill`: one for each step, less the work of the motors."""
    return step.heelstrike - 10.0 * step.energy


def downhill() -> dict:
    """The scene of `python train.py --scene examples.five_links:downhill --steps 4000000`.

    The gait is unstable: a deviation grows elevenfold in a stride.
    """
    return {
        "system": FIVE_LINKS, "slope": 0.045, "control": "stride", "reset_noise_scale": 0.01,
        "reward": steps,
    }  # fmt: skip


def main() -> None:
    """Print a gait and its multipliers, without and with feedback by the controls."""
    for controller in (
        None,
        LinearFeedback({"system": FIVE_LINKS, "slope": 0.05, "control": "stride"}),
    ):
        gait = gpw.find_gait(gpw.stride_map(FIVE_LINKS, 0.05, controller=controller))
        print(gait)
        print("multipliers", *(f"{abs(multiplier):.4f}" for multiplier in gait.multipliers))


if __name__ == "__main__":
    sys.exit(console.run(main))
