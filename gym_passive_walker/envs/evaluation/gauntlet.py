"""A fixed set of tests for a controller: disturbances, terrain and other bodies, one score card."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gym_passive_walker._tools.arguments import whole
from gym_passive_walker._tools.progress import progress
from gym_passive_walker._tools.shown import Table
from gym_passive_walker.envs.evaluation.walks import (
    TIME_LIMIT,
    Share,
    Walks,
    median,
    simulate_episodes,
)
from gym_passive_walker.envs.vector_env import PassiveWalkerVectorEnv
from gym_passive_walker.gaits.control.controllers import ControllerLike, acting
from gym_passive_walker.gaits.control.policy import policy_name
from gym_passive_walker.gaits.scenes.scene import (
    OF_OWN_OBSERVATION,
    Scene,
    SceneError,
    SceneLike,
    make_scene,
)
from gym_passive_walker.models.model import check_supports
from gym_passive_walker.models.walkers import name_of

TIME, _STRIDE = 100.0, 3.0
"""Time limit of a walk in sqrt(l/g): some 33 strides; and the time of a stride, about."""

SEED = 7_202_611
"""Seed of the first walk of every test; those that follow have the next ones."""


def _rough(height: float) -> dict[str, Any]:
    return {"terrain": {"rough": {"height_std": height}}}


def _pushes(impulse: float) -> dict[str, Any]:
    return {"pushes": {"rate": 0.1, "impulse": (-impulse, impulse)}}


TESTS: dict[str, dict[str, Any]] = {
    "own scene": {},
    "rough, 0.001 l": _rough(0.001),
    "rough, 0.002 l": _rough(0.002),
    "rough, 0.004 l": _rough(0.004),
    "waves, 0.005 l": {"terrain": {"waves": {"height": 0.005, "strides": 6}}},
    "pushes, 0.02": _pushes(0.02),
    "pushes, 0.05": _pushes(0.05),
    "observation noise, 0.01": {"observation_noise": 0.01},
    "observation noise, 0.03": {"observation_noise": 0.03},
    "action noise, 0.2": {"action_noise": 0.2},
    "action delay, 1": {"action_delay": 1},
    "bodies, 5 %": {"domain_randomization": {"hip_mass": 0.05, "foot_radius": 0.05}},
    "bodies, 20 %": {"domain_randomization": {"hip_mass": 0.2, "foot_radius": 0.2}},
    "starts, 20 %": {"reset_noise_scale": 0.2},
}
"""Changes of the controller's scene in each test. Heights are in leg lengths l, pushes on the hip
in m sqrt(g l), ten in a time of 100 sqrt(l/g); noise is a standard deviation."""


@dataclass(frozen=True, repr=False)
class Gauntlet(Table):
    """Results of `gauntlet`; print it for a table.

    Attributes:
        controller_name: Name of the controller.
        scene: The scene that the tests change.
        episodes: Episodes of each test, by its name.
    """

    controller_name: str
    scene: Scene
    episodes: Mapping[str, Walks]

    @property
    def survival(self) -> NDArray[np.float64]:
        """Share of the walks of each test that reach the time limit, (tests,)."""
        return np.array([walks.reached_limit.mean() for walks in self._each])

    @property
    def survival_interval(self) -> NDArray[np.float64]:
        """95 % intervals of `survival` (Wilson), (tests, 2)."""
        return np.array([walks.share(TIME_LIMIT)[1:] for walks in self._each])

    @property
    def score(self) -> float:
        """Mean survival over the tests, from 0 to 1."""
        return float(self.survival.mean())

    @property
    def score_interval(self) -> tuple[float, float]:
        """95 % interval of the score (Wilson, over the walks of all tests)."""
        return Share.of(np.concatenate([walks.reached_limit for walks in self._each]))[1:]

    def facts(self) -> dict[str, str]:
        """Controller, walker and score."""
        low, high = self.score_interval
        return {
            "controller": self.controller_name,
            "walker": name_of(self.scene.walker),
            "score": f"{self.score:.3f} ({low:.3f} to {high:.3f})",
        }

    def columns(self) -> dict[str, NDArray]:
        """A row for each test; medians of distance / l and of the cost of transport."""
        return {
            "test": np.array(list(self.episodes)),
            "survival": self.survival,
            "low": self.survival_interval[:, 0],
            "high": self.survival_interval[:, 1],
            "distance": np.array([np.median(walks.distance) for walks in self._each]),
            "cost_of_transport": np.array([median(w.cost_of_transport) for w in self._each]),
        }

    @property
    def _each(self) -> list[Walks]:
        return list(self.episodes.values())

    def __str__(self) -> str:
        columns, facts = self.columns(), self.facts()
        width = max(map(len, columns["test"]))
        count = len(self._each[0])
        lines = [
            f"{facts['controller']}, walker {facts['walker']!r}: {count} walks of "
            f"{TIME:g} sqrt(l/g) in each test",
            f"{'test':{width}}  survival  {'95 % interval':>15}  distance / l  cost of transport",
        ]
        for test, share, low, high, distance, cost in zip(*columns.values(), strict=True):
            spent = "-" if np.isnan(cost) else f"{cost:.4f}"
            interval = f"{low:.1%} to {high:.1%}"
            lines.append(
                f"{test:{width}}  {share:8.1%}  {interval:>15}  {distance:12.1f}  {spent:>17}"
            )
        return "\n".join([*lines, f"{'score':{width}}  {facts['score']}"])


def gauntlet(
    controller: ControllerLike, scene: SceneLike | None = None, *, walkers: int = 64
) -> Gauntlet:
    """Test a controller under fixed disturbances, terrains and bodies.

    Each test changes one thing in the controller's scene (`TESTS`). Noise of the observation is
    left out if the scene has an observation of the user's own, which has no noise. Seeds are fixed,
    so the result depends on the controller and on the number of walkers alone.

    Args:
        controller: Any controller of `stride_map`.
        scene: Scene that the tests change; the controller's own if None.
        walkers: Walks in each test.

    Returns:
        The `Gauntlet`.

    Raises:
        ValueError: if there is no such controller, it has no scene, or the number is not positive.

    Example:
        >>> import gym_passive_walker as gpw
        >>> gpw.gauntlet("level-ppo", walkers=4).episodes["own scene"].endings[0]
        'reached the time limit'
    """
    count = whole(walkers, "walkers", 1, 100_000)
    policy, own = acting(controller, scene)
    check_supports(own.walker, "gauntlet")
    walks: dict[str, Walks] = {}
    tests = TESTS
    if not own.shows_own:  # else some are equal
        tests = {n: x for n, x in TESTS.items() if OF_OWN_OBSERVATION.keys().isdisjoint(x)}
    step = min(own.tick, _STRIDE) if own.control == "tick" else _STRIDE
    steps = max(1, round(TIME / step))
    with progress("tests", len(tests)) as done:
        for name, changes in tests.items():
            there = make_scene(own, **_possible(changes, own))
            arena = PassiveWalkerVectorEnv(count, there, max_episode_steps=steps)
            walks[name] = simulate_episodes(controller, arena, seed=SEED)
            done()
    named = isinstance(controller, str | PathLike)
    return Gauntlet(str(controller) if named else policy_name(policy), own, walks)


def _possible(changes: dict[str, Any], scene: Scene) -> dict[str, Any]:
    """Return the changes without tolerances of what does not change the walker."""
    if "domain_randomization" not in changes:
        return changes
    drawn = {}
    for name, share in changes["domain_randomization"].items():
        with suppress(SceneError):
            make_scene(scene, domain_randomization={name: share})
            drawn[name] = share
    pool = scene.randomization_pool if drawn else None  # a pool of nothing is refused
    return {"domain_randomization": drawn, "randomization_pool": pool}
