"""Walkers that are thrown about, as records of the engine."""

from dataclasses import replace

import numpy as np

import gym_passive_walker as gpw
from gym_passive_walker.engine.run import new_records
from gym_passive_walker.models.model import bodies
from tests.equations.examples import LONG_GAITS

NAMES = {"kneed": "C", "straight": "E", "simplest": "D"}
FITTED = {"hip_stiffness": 0.1, "hip_friction": 0.02}


def thrown(name, count, *, seed=0, wild=0.4):
    """A walker's constants, and records of it beside its gait, some of them far from it."""
    kind, *fitted = name.split("-")
    walker = gpw.WALKERS[NAMES[kind]]
    if fitted:
        walker = replace(walker, **FITTED)
    rng, gait = np.random.default_rng(seed), LONG_GAITS[NAMES[kind]]
    section = walker.units.to_dimensionless(gait.state)
    states = section * (1.0 + wild * rng.uniform(-1.0, 1.0, (count, 6)))
    states[count // 2 :, 3:] *= rng.uniform(-40.0, 40.0, (count - count // 2, 3))
    states[:, 2] = states[:, 1]
    if kind != "kneed":
        states[:, 5] = states[:, 4]
    records = new_records(states, gait.slope, end=20.0)
    if fitted:
        records["control"][:, 0] = rng.uniform(-0.05, 0.05, (count, 2))
        records["push_off"][:, 0] = rng.uniform(0.0, 0.05, count)
    if fitted == ["uneven"]:
        records["ground"][:, 0, 2:] = rng.uniform(-0.01, 0.01, (count, 2))
    return bodies(walker), records
