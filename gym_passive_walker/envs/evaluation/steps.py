"""Steps of many environments under a policy."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from gymnasium.vector import VectorEnv
from numpy.typing import NDArray

from gym_passive_walker.gaits.control.policy import Policy


class RecordedStep(NamedTuple):
    """A step of n walkers under a policy.

    Attributes:
        actions: Actions of the policy, (n, actions).
        observations: Next observations, (n, size), or groups of them by name; changes to them reach
            the policy.
        rewards: Shape (n,).
        terminated: Whether each episode has ended, (n,).
        truncated: Whether each time limit is reached, (n,).
        struck: Whether each stride has ended with a heelstrike, (n,).
        infos: `infos` of the vector environment.
    """

    actions: NDArray[np.float32]
    observations: Any
    rewards: NDArray[np.float64]
    terminated: NDArray[np.bool_]
    truncated: NDArray[np.bool_]
    struck: NDArray[np.bool_]
    infos: dict[str, Any]


def steps(
    policy: Policy, envs: VectorEnv, observations: NDArray[np.float32] | dict[str, Any]
) -> Iterator[RecordedStep]:
    """Yield the steps of an environment under a policy that acts deterministically, without end.

    Args:
        policy: The policy.
        envs: A native batch that has just been reset, in its usual "NextStep" mode.
        observations: Observations that the reset returned.
    """
    memory, first = None, np.ones(envs.num_envs, bool)
    while True:
        seen = observations["policy"] if isinstance(observations, dict) else observations
        actions, memory = policy.predict(seen, memory, first, deterministic=True)
        observations, rewards, terminated, truncated, infos = envs.step(actions)
        first = terminated | truncated
        struck = infos["step_period"] > 0.0
        yield RecordedStep(actions, observations, rewards, terminated, truncated, struck, infos)
