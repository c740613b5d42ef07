"""Walks: what becomes of an agent in a number of episodes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from gymnasium.vector import VectorEnv
from numpy.typing import NDArray

HUNDRED = 100
"""Strides after which a walk counts as one that goes on."""


WALKED_ON = "walked on"
"""The ending of a walk that the time limit ended."""

_MEDIANS = ("distance", "strides", "speed", "cost_of_transport")
_WORK = {"hip_work": "hip_cost", "net_work": "net_hip_cost", "gravity_work": "gravity_cost"}
_PER_EPISODE = ("seeds", "slopes", "reward", *_MEDIANS, "gravity_cost")


class Policy(Protocol):
    """Whatever acts: stable-baselines3's algorithms, learned policies, baselines."""

    def predict(
        self,
        observation: NDArray,
        state: tuple[NDArray, ...] | None = None,
        episode_start: NDArray | None = None,
        deterministic: bool = True,
    ) -> tuple[NDArray, tuple[NDArray, ...] | None]:
        """Choose actions for a batch of observations."""
        ...


@dataclass(frozen=True, kw_only=True)
class Walks:
    """Some episodes of one agent, each entry an array over episodes; dimensionless.

    Attributes:
        seeds: Seed of each episode.
        slopes: Slope in rad.
        reward: Sum of the rewards.
        distance: Distance of the whole episode, in leg lengths.
        strides: Heelstrikes.
        length: Distance of the complete strides.
        duration: Time of the complete strides.
        hip_work: What the motor was charged for in them, over weight and leg length.
        net_work: The motor's net work in them.
        gravity_work: What gravity paid in them.
        endings: How each ended: "walked on" to the time limit, or an outcome's name.
    """

    seeds: NDArray
    slopes: NDArray
    reward: NDArray
    distance: NDArray
    strides: NDArray
    length: NDArray
    duration: NDArray
    hip_work: NDArray
    net_work: NDArray
    gravity_work: NDArray
    endings: list[str]

    def __len__(self) -> int:
        return len(self.endings)

    @property
    def speed(self) -> NDArray:
        """Mean speed over sqrt(g l); 0 without a stride."""
        return np.nan_to_num(_ratio(self.length, self.duration))

    @property
    def cost_of_transport(self) -> NDArray:
        """Work of gravity and motor over weight and distance; NaN without a stride."""
        return _ratio(self.gravity_work + self.hip_work, self.length)

    @property
    def gravity_cost(self) -> NDArray:
        """Gravity's share of the cost of transport."""
        return _ratio(self.gravity_work, self.length)

    @property
    def hip_cost(self) -> NDArray:
        """What the motor was charged for, over weight and distance."""
        return _ratio(self.hip_work, self.length)

    @property
    def net_hip_cost(self) -> NDArray:
        """The motor's net work over weight and distance."""
        return _ratio(self.net_work, self.length)

    def rows(self, agent: str) -> list[dict[str, Any]]:
        """One row an episode, for a table."""
        columns = {name: np.round(getattr(self, name), 6).tolist() for name in _PER_EPISODE}
        columns["ending"] = self.endings
        return [
            {"agent": agent, **dict(zip(columns, row, strict=True))}
            for row in zip(*columns.values(), strict=True)
        ]

    def summary(self) -> dict[str, float]:
        """One row for a learning curve: medians, but the mean of the return."""
        medians = {name: _median(getattr(self, name)) for name in _MEDIANS}
        return {
            "reward": float(np.mean(self.reward)),
            **medians,
            "walked_on": self.endings.count(WALKED_ON) / len(self),
            "hundred_strides": float(np.mean(self.strides >= HUNDRED)),
        }


def _ratio(amount: NDArray, whole: NDArray) -> NDArray:
    return np.divide(amount, whole, out=np.full(len(whole), np.nan), where=whole > 0.0)


def _median(values: NDArray) -> float:
    """The median of those that are numbers; NaN if none is."""
    values = values[np.isfinite(values)]
    return float(np.median(values)) if len(values) else float("nan")


def evaluate(policy: Policy, worlds: VectorEnv, *, seed: int) -> Walks:
    """Let an agent walk one episode in each of some environments.

    Args:
        policy: The agent; it acts deterministically.
        worlds: A native batch in its usual "NextStep" mode, each lane an episode.
        seed: Seed of the first episode, the next ones follow. The same seed is the same starts
            and the same slopes, whoever walks.

    Returns:
        The walks, one for each environment.
    """
    count = worlds.num_envs
    sums = {name: np.zeros(count) for name in ("length", "duration", *_WORK)}
    reward, distance, strides = np.zeros((3, count))
    endings = [""] * count
    observation, _ = worlds.reset(seed=seed)
    slopes = worlds.slopes  # type: ignore[attr-defined]
    under_way, state, first = np.ones(count, bool), None, np.ones(count, bool)
    while under_way.any():
        action, state = policy.predict(observation, state, first, deterministic=True)
        observation, rewards, terminated, truncated, infos = worlds.step(action)
        reward[under_way] += rewards[under_way]
        struck = infos.get("_step_length", False) & under_way
        if struck.any():
            length = infos["step_length"][struck]
            sums["length"][struck] += length
            sums["duration"][struck] += infos["step_period"][struck]
            for name, cost in _WORK.items():
                sums[name][struck] += infos[cost][struck] * length
        first = terminated | truncated
        for i in np.flatnonzero(first & under_way):
            distance[i], strides[i] = infos["episode_distance"][i], infos["strides"][i]
            endings[i] = infos["outcome"][i].replace("_", " ") if terminated[i] else WALKED_ON
        under_way &= ~first
    return Walks(
        seeds=seed + np.arange(count),
        slopes=slopes,
        reward=reward,
        distance=distance,
        strides=strides.astype(int),
        **sums,
        endings=endings,
    )
