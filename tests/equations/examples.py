"""Walkers, gaits and states that several tests share."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from gym_passive_walker import WALKERS, Walker

MASSIVE = [name for name, walker in WALKERS.items() if not walker.massless_legs]
KNEED = [name for name, walker in WALKERS.items() if walker.knees]
STRAIGHT = [name for name in MASSIVE if not WALKERS[name].knees]


class Gait(NamedTuple):
    """A periodic motion: a section state that comes back after one stride."""

    walker: str
    slope: float
    stance: float
    stance_rate: float
    thigh_rate: float
    shank_rate: float

    @property
    def state(self) -> np.ndarray:
        """The section state [angles, rates], in the walker's own units."""
        a = self.stance
        return np.array([a, -a, -a, self.stance_rate, self.thigh_rate, self.shank_rate])

    def __str__(self) -> str:
        """Name of the gait in a test's id."""
        return f"{self.walker}-{self.slope}-{self.stance:.2f}"


GAITS = [
    Gait("A", 0.01, 0.217209024006316, -0.948181547005571, -0.80861645700225, -0.80861645700225),
    Gait("A", 0.01, 0.160357235624705, -0.767502329566861, -0.731747571788005, -0.731747571788005),
    Gait("B", 0.01, 0.235751233569868, -0.761697129388581, -0.6956008787909, -0.6956008787909),
    Gait("C", 0.03, 0.314584136213028, -1.271138199605252, -0.755230278345574, -1.224549496153112),
    Gait("C", 0.03, 0.280610644450131, -1.238300852376715, -0.898909759299162, -1.176314751349568),
    Gait("D", 0.009, 0.200310900544247, -0.625893680581588, -0.576334589776341, -0.576334589776341),
    Gait("E", 0.01, 0.190106997200149, -0.673694263282728, -0.625582548759707, -0.625582548759707),
    Gait("E", 0.01, 0.138179511077281, -0.515777028953798, -0.496206009194103, -0.496206009194103),
    Gait("F", 0.01, 0.199207584316337, -0.658438209943938, -0.606867353656865, -0.606867353656865),
    Gait(
        "lab", 0.036, 0.243307710868886, -1.048016142461868, -0.304028056927848, -1.480125104851930
    ),
    Gait(
        "lab-straight", 0.04,
        0.307375445671473, -1.236350118376698, -0.624458514249706, -0.624458514249706,
    ),
]  # fmt: skip
"""Gaits of every walker, to all digits: fixed points of the stride map."""

LONG_GAITS = {gait.walker: gait for gait in reversed(GAITS)}
"""The long-step gait of each walker."""


def random_walker(rng: np.random.Generator, *, knees: bool, gravity: float | None = None) -> Walker:
    """A random walker of ordinary proportions in odd units, with masses on all sides."""
    size, mass = rng.uniform(0.2, 5.0), rng.uniform(0.1, 20.0)
    thigh, shank = size * rng.uniform(0.3, 0.7), size * rng.uniform(0.3, 0.7)
    foot = rng.uniform(0.0, 0.6) * shank
    limit = min(0.4, np.arcsin(min(1.0, (shank - foot) / thigh)))
    return Walker(
        thigh_length=thigh,
        thigh_offset=thigh * rng.uniform(-0.2, 0.2),
        thigh_mass=mass * rng.uniform(0.2, 1.0),
        thigh_gyration=thigh * rng.uniform(0.1, 0.5),
        thigh_com=thigh * rng.uniform(0.0, 0.8),
        shank_length=shank,
        shank_offset=shank * rng.uniform(-0.2, 0.2),
        shank_mass=mass * rng.uniform(0.1, 0.6),
        shank_gyration=shank * rng.uniform(0.1, 0.5),
        shank_com=shank * rng.uniform(0.1, 0.8),
        foot_radius=foot,
        foot_angle=limit * rng.uniform(-0.9, 0.9),
        hip_mass=mass * rng.uniform(0.0, 3.0),
        knees=knees,
        gravity=rng.uniform(0.5, 20.0) if gravity is None else gravity,
    )


def fitted(walker: Walker, spring=0.05, friction=0.004, knee=0.01) -> Walker:
    """The walker with springs and friction at its joints, dimensionless."""
    units = walker.units
    return replace(
        walker,
        hip_stiffness=spring * units.torque,
        hip_friction=friction * units.torque * units.time,
        knee_stiffness=knee * units.torque if walker.knees else 0.0,
    )


def random_state(rng: np.random.Generator, walker: Walker, *, locked: bool) -> np.ndarray:
    """A random configuration with random angular velocities."""
    state = np.concatenate([rng.uniform(-1.5, 1.5, 3), rng.normal(scale=1.5, size=3)])
    state[3:] /= walker.time_unit
    if locked:
        state[2], state[5] = state[1], state[4]
    return state
