"""Episodes of an agent, and their statistics."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from statistics import NormalDist
from typing import Any, NamedTuple, Self

import numpy as np
from gymnasium.vector import VectorEnv
from numpy.typing import NDArray

from gym_passive_walker._tools.console import in_columns
from gym_passive_walker._tools.progress import progress
from gym_passive_walker.envs.evaluation.steps import steps
from gym_passive_walker.envs.registration import MAX_EPISODE_STEPS
from gym_passive_walker.gaits.control.controllers import ControllerLike, acting

HUNDRED = 100
"""Strides after which a walk counts as long."""

TIME_LIMIT = "reached the time limit"
"""The ending of a walk that the time limit ended."""

_QUANTILE = NormalDist().inv_cdf(0.975)  # of a 95 % interval
_MEDIANS = ("distance", "strides", "speed", "cost_of_transport")
_WORK = {
    "motor_work": ("hip_cost", "ankle_cost", "push_off_cost"),
    "net_work": ("net_hip_cost", "net_ankle_cost", "push_off_cost"),
    "gravity_work": ("gravity_cost",),
}
_PER_EPISODE = ("seeds", "slopes", "reward", *_MEDIANS, "gravity_cost")


class Share(NamedTuple):
    """Share of some walks, with its 95 % interval (Wilson).

    Attributes:
        value: The share, from 0 to 1.
        low: Lower end of the interval.
        high: Upper end of the interval.
    """

    value: float
    low: float
    high: float

    @classmethod
    def of(cls, hits: NDArray) -> Self:
        """Return the share of booleans that are true."""
        n, share = len(hits), float(np.mean(hits))
        spread = _QUANTILE**2 / n
        middle = share + 0.5 * spread
        half = math.sqrt(spread * (share * (1.0 - share) + 0.25 * spread))
        low, high = ((middle + sign * half) / (1.0 + spread) for sign in (-1.0, 1.0))
        return cls(share, min(low, share), max(high, share))  # exactly 0 and 1 where all are alike

    def __str__(self) -> str:
        return f"{self.value:.0%} ({self.low:.0%} to {self.high:.0%})"


@dataclass(frozen=True, kw_only=True)
class Walks:
    """Episodes of one agent, each entry an array over episodes; dimensionless.

    Attributes:
        seeds: Seed of each episode.
        slopes: Slope in rad.
        reward: Sum of the rewards.
        distance: Distance of the whole episode, in leg lengths.
        strides: Heelstrikes.
        length: Distance of the complete strides.
        duration: Time of the complete strides.
        motor_work: Charged work of all actuators in them, over weight and leg length.
        net_work: Net work of the actuators in them, over weight and leg length; NaN for a `System`
            with more than two controls.
        gravity_work: Work of gravity in them, over weight and leg length.
        endings: Ending of each: "reached the time limit", or an outcome's name.
    """

    seeds: NDArray
    slopes: NDArray
    reward: NDArray
    distance: NDArray
    strides: NDArray
    length: NDArray
    duration: NDArray
    motor_work: NDArray
    net_work: NDArray
    gravity_work: NDArray
    endings: list[str]

    def __len__(self) -> int:
        return len(self.endings)

    def __repr__(self) -> str:
        if not len(self):
            return "<Walks: episodes 0>"
        endings = ", ".join(f"{ending} {n}" for ending, n in Counter(self.endings).most_common())
        medians = {name.replace("_", " "): median(getattr(self, name)) for name in _MEDIANS}
        said = ", ".join(f"{name} {median:.4g}" for name, median in medians.items())
        return f"<Walks: episodes {len(self)}: {endings}; medians: {said}>"

    @property
    def speed(self) -> NDArray:
        """Mean speed over sqrt(g l); 0 without a stride."""
        return np.nan_to_num(_ratio(self.length, self.duration))

    @property
    def cost_of_transport(self) -> NDArray:
        """Work of gravity and motors over weight and distance; NaN without a stride."""
        return _ratio(self.gravity_work + self.motor_work, self.length)

    @property
    def gravity_cost(self) -> NDArray:
        """Work of gravity over weight and distance; NaN without a stride."""
        return _ratio(self.gravity_work, self.length)

    @property
    def reached_limit(self) -> NDArray[np.bool_]:
        """Whether the time limit ended the walk, rather than a fall, shape (n,)."""
        return np.array([ending == TIME_LIMIT for ending in self.endings])

    def share(self, ending: str) -> Share:
        """Return the share of the walks with an ending."""
        return Share.of(np.array([each == ending for each in self.endings]))

    @property
    def motor_cost(self) -> NDArray:
        """Charged work of the actuators over weight and distance; NaN without a stride."""
        return _ratio(self.motor_work, self.length)

    def rows(self, agent: str, digits: int | None = 6) -> list[dict[str, Any]]:
        """Return a row for each episode, for a table.

        Args:
            agent: Name of the agent.
            digits: Decimal places that numbers are rounded to; None leaves them as they are.
        """
        exact = {name: getattr(self, name) for name in _PER_EPISODE}
        columns: dict[str, list] = {
            name: (values if digits is None else np.round(values, digits)).tolist()
            for name, values in exact.items()
        }
        columns["ending"] = self.endings
        return [
            {"agent": agent, **dict(zip(columns, row, strict=True))}
            for row in zip(*columns.values(), strict=True)
        ]

    def summary(self) -> dict[str, float]:
        """One row for a learning curve: medians, but the mean of the return."""
        medians = {name: median(getattr(self, name)) for name in _MEDIANS}
        return {
            "reward": float(np.mean(self.reward)),
            **medians,
            "reached_time_limit": self.endings.count(TIME_LIMIT) / len(self),
            "hundred_strides": float(np.mean(self.strides >= HUNDRED)),
        }


def _ratio(amount: NDArray, whole: NDArray) -> NDArray:
    return np.divide(amount, whole, out=np.full(len(whole), np.nan), where=whole > 0.0)


def median(values: NDArray) -> float:
    """The median of those that are numbers; NaN if none is."""
    values = values[np.isfinite(values)]
    return float(np.median(values)) if len(values) else float("nan")


def simulate_episodes(policy: ControllerLike, arena: VectorEnv, *, seed: int) -> Walks:
    """Simulate one episode of an agent in each environment of a batch.

    Args:
        policy: The agent, any controller of `stride_map`; it acts deterministically.
        arena: A native batch in its usual "NextStep" mode, each lane an episode.
        seed: Seed of the first episode, the next ones follow. The same seed is the same starts
            and the same slopes, for every controller.
    """
    scene, count = arena.scene, arena.num_envs  # type: ignore[attr-defined]
    acts, _ = acting(policy, scene)
    further = len(scene.walker.controls) > 2  # of which infos have the charged work alone, in a sum
    sums = {name: np.zeros(count) for name in ("length", "duration", *_WORK)}
    reward, distance, strides = np.zeros((3, count))
    endings = [""] * count
    observations, _ = arena.reset(seed=seed)
    slopes = arena.slopes  # type: ignore[attr-defined]
    under_way = np.ones(count, bool)
    with progress("steps of each walk", MAX_EPISODE_STEPS) as taken:
        for step in steps(acts, arena, observations):
            taken()
            infos = step.infos
            reward[under_way] += step.rewards[under_way]
            struck = step.struck & under_way
            if struck.any():
                length = infos["step_length"][struck]
                sums["length"][struck] += length
                sums["duration"][struck] += infos["step_period"][struck]
                costs: dict[str, Any] = {
                    name: sum(infos[each][struck] for each in _WORK[name]) for name in _WORK
                }
                if further:
                    costs["motor_work"] = infos["cost_of_transport"][struck] - costs["gravity_work"]
                    costs["net_work"] = np.nan
                for name, cost in costs.items():
                    sums[name][struck] += cost * length
            over = step.terminated | step.truncated
            for i in np.flatnonzero(over & under_way):
                distance[i], strides[i] = infos["episode_distance"][i], infos["strides"][i]
                # After a heelstrike, only the scene's own `terminated` ends an episode.
                outcome = "stopped" if step.struck[i] else infos["outcome"][i].replace("_", " ")
                endings[i] = outcome if step.terminated[i] else TIME_LIMIT
            under_way &= ~over
            if not under_way.any():
                break
    return Walks(
        seeds=seed + np.arange(count),
        slopes=slopes,
        reward=reward,
        distance=distance,
        strides=strides.astype(int),
        **sums,
        endings=endings,
    )


_QUANTITIES: tuple[tuple[str, Callable[[Walks], NDArray], str], ...] = (
    ("distance / leg length", lambda walks: walks.distance, ".1f"),
    ("strides", lambda walks: walks.strides, ".0f"),
    ("speed / √(g l)", lambda walks: walks.speed, ".3f"),
    ("cost of transport", lambda walks: walks.cost_of_transport[walks.reached_limit], ".4f"),
    ("  of it gravity's", lambda walks: walks.gravity_cost[walks.reached_limit], ".4f"),
    ("return", lambda walks: walks.reward, ".2f"),
)


def score_table(
    title: str, columns: Mapping[str, Walks], above_optimum: Mapping[str, float] | None = None
) -> str:
    """Agents side by side: medians over the episodes, with their range, and how walks ended.

    Costs are those of walks to the time limit. A walk that ends in a fall has used up the energy of
    its initial state, so its cost may be far too small, or negative. Shares of endings have their
    95 % interval (Wilson).

    Args:
        title: First line of the table.
        columns: Walks of each agent, by its name.
        above_optimum: Costs above the optimum, as shares of it, by the same names; NaN if unknown.
    """
    rows = [["", *columns]]
    for label, quantity, form in _QUANTITIES:
        rows.append([label, *(_spread(quantity(walks), form) for walks in columns.values())])
    if above_optimum is not None:
        shares = (above_optimum[name] for name in columns)
        rows.append(["cost above optimum", *("–" if x != x else f"{x:z.1%}" for x in shares)])
    for ending, _ in Counter(e for walks in columns.values() for e in walks.endings).most_common():
        counts = (_counted(ending, walks) for walks in columns.values())
        rows.append([ending, *counts])
    lines = in_columns(rows, left=(0,))
    rule = "─" * len(lines[0])
    return "\n".join([title, rule, lines[0], rule, *lines[1:], rule])


def _counted(ending: str, walks: Walks) -> str:
    """Number of walks with an ending, and the interval of their share."""
    share = walks.share(ending)
    return f"{walks.endings.count(ending)} of {len(walks)} ({share.low:.0%} to {share.high:.0%})"


def _spread(values: NDArray, form: str) -> str:
    """Median and range of some numbers."""
    values = values[np.isfinite(values)]
    if not len(values):
        return "–"
    low, middle, high = (f"{np.percentile(values, q):{form}}" for q in (0, 50, 100))
    return middle if low == high else f"{middle} ({low} to {high})"
