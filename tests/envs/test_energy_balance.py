"""The energy balance of each stride closes, with all actuators, springs and disturbances."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import gym_passive_walker as gpw
from gym_passive_walker import WALKERS
from gym_passive_walker.envs.vector_env import PassiveWalkerVectorEnv
from gym_passive_walker.models.equations.hybrid import State
from gym_passive_walker.models.equations.systems import UNEVEN
from gym_passive_walker.models.model import bodies
from tests.equations.examples import fitted

KINDS = {
    "kneed": {"walker": fitted(WALKERS["C"], 0.01, 0.001, 0.003), "slope": 0.05},
    "straight": {
        "walker": fitted(replace(WALKERS["E"], knees=False), 0.01, 0.001),
        "slope": 0.03,
        "actions": ("hip", "ankle", "push_off"),
    },
    "simplest": {"walker": fitted(WALKERS["D"], 0.01, 0.0), "slope": 0.02},
}
"""Walkers with springs and friction, on round feet and on points."""

EVERYTHING = {
    "actions": ("hip", "push_off"), "control": "stride", "max_push_off": 0.03,
    "max_hip_torque": 0.01, "max_ankle_torque": 0.01, "energy": "net", "tolerance": 1e-12,
    "terrain": gpw.rough(0.001, 0.004), "pushes": {"rate": 0.3, "impulse": (-0.01, 0.01)},
    "end_on_toe_stub": False, "reset_noise_scale": 0.05,
}  # fmt: skip


def imbalances(kind: str, walkers: int, wanted: int) -> np.ndarray:
    """Largest error of the energy balance of at least so many strides, in units of m g l."""
    envs = PassiveWalkerVectorEnv(
        walkers, {**EVERYTHING, **KINDS[kind]}, max_episode_steps=-1, autoreset_mode="SameStep"
    )
    walker = KINDS[kind]["walker"]
    system, body = walker.equations(UNEVEN), walker.equations(UNEVEN).Body
    own = body(*bodies(walker)[0, 0])
    rng, found, count = np.random.default_rng(0), [], 0
    envs.reset(seed=0)
    states, pushed = envs.batch.records["state"][:, 0].copy(), np.zeros(walkers)
    while count < wanted:
        actions = rng.uniform(-1.0, 1.0, envs.action_space.shape)
        _, _, terminated, _, infos = envs.step(actions)
        assert not pushed.any()  # each step is a stride
        now = envs.batch.records["state"][:, 0].copy()
        on = np.flatnonzero((infos["step_period"] > 0.0) & ~terminated)
        if len(on):
            before, after = State(*states[on].T), State(*now[on].T)
            gained = system.kinetic_energy(own, after) - system.kinetic_energy(own, before)
            if system.spring_gain:
                gained = gained + system.spring_gain(own, before, after)
            length = infos["step_length"][on]
            given = infos["push_work"][on].copy()
            for name, sign in (
                ("gravity_cost", 1.0), ("net_hip_cost", 1.0), ("net_ankle_cost", 1.0),
                ("push_off_cost", 1.0), ("collision_cost", -1.0), ("friction_cost", -1.0),
            ):  # fmt: skip
                if name in infos:
                    given += sign * length * infos[name][on]
            found.append(np.abs(gained - given))
            count += len(on)
        states = now
    return np.concatenate(found)


@pytest.mark.parametrize("kind", KINDS)
def test_the_energy_balance_of_strides_closes(kind):
    """Rough ground, springs, friction, pushes and every motor at once."""
    assert imbalances(kind, 200, 2000).max() < 1e-11


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_the_energy_balance_of_a_million_strides_closes(kind):
    assert imbalances(kind, 2000, 1_000_000).max() < 1e-11
