"""Trials beside plain walks: kicks that an agent recovers from, and slopes that change."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gym_passive_walker.control.closed_loop import ClosedLoopGait, policy_strides
from gym_passive_walker.control.policy import Policy, steps
from gym_passive_walker.envs.scene import Scene, make_scene
from gym_passive_walker.envs.vector_env import PassiveWalkerVectorEnv

KICKS = 0.01 * np.arange(1, 101)
"""Changes of the stance rate that are tried, as shares of it."""

RECOVERY = 20
"""Strides after which a walker counts as recovered."""

ROUGHNESS = 0.01
"""Standard deviation in rad of the slopes of rough ground, drawn anew at each stride."""

FARTHEST = 300
"""Strides after which a walk over rough ground is broken off."""


class Kicks(NamedTuple):
    """The largest changes of the stance rate just after heelstrike that a walker recovers from.

    Every smaller one of those tried is survived as well. Shares of the gait's own stance rate.

    Attributes:
        forward: Of those that speed it up.
        backward: Of those that slow it down.
    """

    forward: float
    backward: float


def kicks(gait: ClosedLoopGait) -> Kicks:
    """Kick a walker on its gait under a policy, both ways, ever harder."""
    starts = np.tile(gait.point, (2 * len(KICKS), 1))
    starts[:, 1] *= np.concatenate([1.0 + KICKS, 1.0 - KICKS])
    ends = policy_strides(gait.policy, gait.scene, gait.slope, starts, RECOVERY).ends
    survived = np.isfinite(ends).all(axis=1).reshape(2, -1)
    largest = [
        0.0 if not way[0] else float(KICKS[np.argmin([*way, False]) - 1]) for way in survived
    ]
    return Kicks(*largest)


def rough_strides(policy: Policy, scene: Scene, *, walkers: int = 100, seed: int = 0) -> float:
    """How many strides a policy makes until it falls where each stride has a slope of its own.

    Slopes are normal about the scene's own (the middle of its range) by `ROUGHNESS`.

    Args:
        policy: Who acts.
        scene: The scene; walkers start as its episodes do.
        walkers: Over how many the mean is taken.
        seed: Of the starts and the slopes.

    Returns:
        The mean, where walks of `FARTHEST` strides are broken off.
    """
    middle = float(np.mean(scene.slope))
    worlds = PassiveWalkerVectorEnv(walkers, make_scene(scene, slope=middle), max_episode_steps=-1)
    rng = np.random.default_rng(seed)
    observations, _ = worlds.reset(seed=seed)
    strides, going = np.zeros(walkers, int), np.ones(walkers, bool)
    for step in steps(policy, worlds, observations):
        going &= ~step.terminated
        strides[step.struck & going] += 1
        going &= strides < FARTHEST
        if not going.any():
            break
        slopes = rng.normal(middle, ROUGHNESS, walkers)  # as many each time, whoever strikes
        step.observations[:] = worlds.set_slopes(slopes, step.struck)
    return float(strides.mean())
