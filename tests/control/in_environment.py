"""Strides in the environment, which stride maps under controllers are held against."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gym_passive_walker.envs.evaluation.steps import steps
from gym_passive_walker.envs.vector_env import PassiveWalkerVectorEnv
from gym_passive_walker.gaits.section import Section

COSTS = (
    "gravity_cost", "hip_cost", "net_hip_cost", "ankle_cost", "net_ankle_cost", "push_off_cost",
)  # fmt: skip


class Walked(NamedTuple):
    """Some strides of each of n walkers, dimensionless: sums, and where they end, (n, m)."""

    ends: NDArray[np.float64]
    length: NDArray[np.float64]
    duration: NDArray[np.float64]
    works: dict[str, NDArray[np.float64]]


def walked(strides, points, count=1) -> Walked:
    """Take walkers through strides of a `ControlledMap` as the environment takes them."""
    n, scene = len(points), strides.scene
    envs = PassiveWalkerVectorEnv(n, scene, max_episode_steps=-1)
    sound = (points[:, 0] > 0.0) & (points[:, 0] < 0.5 * math.pi)
    if scene.walker.knees:
        sound &= points[:, 3] <= points[:, 2]
    section = Section(walker=scene.walker)
    states = section.states_at(np.where(sound[:, None], points, 0.0))
    seen, _ = envs.reset(seed=0, options={"state": states, "slope": strides.slope})
    ends = np.full_like(points, np.nan)
    length, duration = np.zeros((2, n))
    works = {name: np.zeros(n) for name in COSTS}
    left = np.where(sound, count, 0)
    for step in steps(strides.controller, envs, seen):
        struck = (left > 0) & step.struck
        if struck.any():
            far = step.infos["step_length"][struck]
            length[struck] += far
            duration[struck] += step.infos["step_period"][struck]
            for name in COSTS:
                works[name][struck] += far * step.infos[name][struck]
        left[struck] -= 1
        there = struck & (left == 0)
        ends[there] = section.points_at(envs.states[there])
        left[step.terminated] = 0
        if not left.any():
            break
    return Walked(ends, length, duration, works)
