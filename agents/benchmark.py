"""A benchmark of agents over scenes and seeds, by common measures.

Each unit of work is an agent in a scene with a seed. It writes a file of scores when it is
finished. Finished units are not repeated.
"""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import lru_cache
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from tqdm import tqdm

from agents import envs
from agents.config import ALGORITHMS, ConfigError, configure, presets
from agents.files import CONFIG, read_json
from agents.learner import load_policy
from agents.training import Run
from gym_passive_walker import GaitNotFound
from gym_passive_walker._tools.files import replacing
from gym_passive_walker.envs.evaluation.steps import steps
from gym_passive_walker.envs.evaluation.walks import HUNDRED, TIME_LIMIT, Walks, simulate_episodes
from gym_passive_walker.envs.vector_env import PassiveWalkerVectorEnv
from gym_passive_walker.gaits.control import optimal
from gym_passive_walker.gaits.control.baselines import BASELINES
from gym_passive_walker.gaits.control.maps import closed_loop_gait
from gym_passive_walker.gaits.control.policy import Policy
from gym_passive_walker.gaits.gait import Gait
from gym_passive_walker.gaits.scenes.scene import SCENES, Scene, make_scene

AGENTS = (*BASELINES, *ALGORITHMS)
EPISODES = 100
EPISODE_SEED = 1000
"""Number of evaluation episodes of each agent, and the seed of the first."""

PERTURBATIONS = 0.01 * np.arange(1, 101)
"""Perturbations of the stance leg's angular velocity, as shares of the gait's."""

RECOVERY = 20
"""Strides after which a walker that has not fallen counts as recovered."""

ROUGHNESS = 0.01
"""Standard deviation in rad of the slopes of rough ground, drawn for each stride."""

MAX_STRIDES = 300
"""Largest number of strides of a walk over rough ground."""

LASTING = 0.5
"""Least share of walks to the time limit for which a cost is reported.

Strides before a fall use up the energy of the initial state.
"""

EVALUATIONS = 4
"""Evaluations during training, besides the early ones."""

SCORES = (
    "distance", "strides", "speed", "cost_of_transport", "gravity_cost", "hip_cost",
    "positive_hip_cost", "net_hip_cost", "reward", "reached_time_limit", "hundred_strides",
    "above_optimum", "perturbation_forward", "perturbation_backward", "rough_strides",
    "learning_steps", "learning_seconds", "steps_to_hundred", "seconds_to_hundred",
)  # fmt: skip


class Unit(NamedTuple):
    """An agent in a scene, with the seed of its training; 0 for an agent that does not learn."""

    scene: str
    agent: str
    seed: int

    def __str__(self) -> str:
        return f"{self.scene}-{self.agent}-{self.seed}"


def units(scenes: Iterable[str], agents: Iterable[str], seeds: int) -> list[Unit]:
    """All units, seed after seed, so that an interrupted benchmark can be compared.

    Raises:
        ConfigError: if a name is unknown, or `seeds` is below 1.
    """
    scenes, agents = list(scenes), list(agents)
    for what, names, known in (("scene", scenes, tuple(SCENES)), ("agent", agents, AGENTS)):
        for name in names:
            if name not in known:
                raise ConfigError(f"no {what} {name!r}: choose from {', '.join(known)}")
    if seeds < 1:
        raise ConfigError(f"there must be at least one seed, not {seeds}")
    return [
        Unit(scene, agent, seed)
        for seed, scene, agent in product(range(seeds), scenes, agents)
        if (agent in ALGORITHMS or seed == 0) and suits(agent, scene)
    ]


@lru_cache
def suits(agent: str, scene: str) -> bool:
    """Whether an agent can act in a scene: it has a preset, or its baseline can be built."""
    if agent in ALGORITHMS:
        return scene in presets(agent)
    if agent == "optimal" and isinstance(make_scene(scene).slope, tuple):
        return False  # an optimal gait is for one slope
    try:
        BASELINES[agent](make_scene(scene))
    except (ValueError, GaitNotFound):
        return False
    return True


def run(folder: Path, todo: Sequence[Unit], *, budget: float = 1.0, progress: bool = True) -> None:
    """Run the units that have no scores yet.

    Args:
        folder: Folder of scores and trainings.
        todo: The units.
        budget: Steps of each training, as a share of its preset's steps.
        progress: Whether to show a progress bar.

    Raises:
        ConfigError: if the folder has scores or a training of another budget.
    """
    others = {s.get("budget") for s in load_scores(folder) if s["agent"] in ALGORITHMS} - {budget}
    if others:
        trained = ", ".join("one not known" if share is None else f"{share:g}" for share in others)
        raise ConfigError(
            f"the scores in {folder} are of another --budget ({trained}) than {budget:g}: give "
            "that one, or another --out"
        )
    left = [unit for unit in todo if not score_path(folder, unit).is_file()]
    bar = tqdm(left, disable=not progress, unit="agent", dynamic_ncols=True)
    for unit in bar:
        bar.set_postfix_str(str(unit))
        score = measure(folder, unit, budget)
        with replacing(score_path(folder, unit)) as path:
            path.write_text(json.dumps(score, indent=1), encoding="utf-8")


def score_path(folder: Path, unit: Unit) -> Path:
    """Path of a unit's scores."""
    return folder / "scores" / f"{unit}.json"


def load_scores(folder: Path) -> list[dict[str, Any]]:
    """All scores in a benchmark's folder, each with its scene, agent and seed."""
    paths = sorted((folder / "scores").glob("*.json"))
    return [read_json(path) for path in paths]


def measure(folder: Path, unit: Unit, budget: float) -> dict[str, Any]:
    """Train an agent if it learns, and return its scores."""
    if unit.agent not in ALGORITHMS:
        policy = BASELINES[unit.agent](make_scene(unit.scene))
        return {**unit._asdict(), **scores_of(policy, unit.scene)}
    run_folder = folder / "runs" / str(unit)
    progress = _learn(run_folder, unit, budget)
    return {**unit._asdict(), **scores_of(load_policy(run_folder), unit.scene), **progress}


def _learn(folder: Path, unit: Unit, budget: float) -> dict[str, Any]:
    """Train, or resume an interrupted training; returns how many steps and seconds it took."""
    preset = configure(unit.agent, unit.scene, seed=unit.seed)
    steps = max(1, round(preset.steps * budget))
    config = replace(preset, steps=steps, every=max(1, steps // EVALUATIONS))
    config.check_same(folder / CONFIG)
    training = Run(config, folder)
    if not training.train(progress=False):
        raise KeyboardInterrupt  # an unfinished training has no scores; it is resumed later
    walked = training.first_to_walk or {"steps": math.nan, "seconds": math.nan}
    return {
        "budget": budget,
        "learning_steps": training.steps,
        "learning_seconds": training.notes["seconds"],
        "steps_to_hundred": walked["steps"],
        "seconds_to_hundred": walked["seconds"],
    }


def scores_of(policy: Policy, name: str) -> dict[str, Any]:
    """An agent's scores in a scene, by its name: means over walks, and costs over all distance."""
    scene = make_scene(name)
    walks = simulate_episodes(
        policy, envs.arena(configure("ppo", name), EPISODES), seed=EPISODE_SEED
    )
    # Costs are relative to the total distance, so that a short walk has a small weight.
    way = max(float(walks.length.sum()), 1e-300)
    gravity, hip, net = (
        float(work.sum()) / way for work in (walks.gravity_work, walks.motor_work, walks.net_work)
    )
    speed = way / max(float(walks.duration.sum()), 1e-300)
    score: dict[str, Any] = {
        "distance": float(walks.distance.mean()),
        "strides": float(walks.strides.mean()),
        "speed": speed if walks.strides.any() else 0.0,
        "cost_of_transport": gravity + hip,
        "gravity_cost": gravity,
        "hip_cost": hip,
        "positive_hip_cost": 0.5 * (hip + net),
        "net_hip_cost": net,
        "reward": float(walks.reward.mean()),
        "reached_time_limit": walks.endings.count(TIME_LIMIT) / len(walks),
        "hundred_strides": float(np.mean(walks.strides >= HUNDRED)),
        "endings": dict(Counter(walks.endings)),
        "above_optimum": _above_optimum(name, walks, speed, gravity + hip),
        "rough_strides": rough_strides(policy, scene),
    }
    try:
        gait = closed_loop_gait(policy, scene)
        score["perturbation_forward"], score["perturbation_backward"] = largest_perturbations(gait)
        score["largest_multiplier"] = float(abs(gait.multipliers[0]))
    except GaitNotFound:  # it barely moves, or its walk is not periodic
        score["perturbation_forward"] = score["perturbation_backward"] = math.nan
    return score


class Perturbations(NamedTuple):
    """The largest velocity perturbations just after heelstrike that a walker recovers from.

    The angular velocity of the stance leg is changed, by a share of the gait's. The walker also
    recovers from every smaller share of `PERTURBATIONS`.

    Attributes:
        forward: Largest share by which the walker is accelerated.
        backward: Largest share by which the walker is slowed down.
    """

    forward: float
    backward: float


def largest_perturbations(gait: Gait) -> Perturbations:
    """Largest velocity perturbations, forward and backward, that a gait withstands."""
    strides = gait.stride_map
    starts = np.repeat(strides.points_at(gait.state), 2 * len(PERTURBATIONS), axis=0)
    starts[:, 1] *= np.concatenate([1.0 + PERTURBATIONS, 1.0 - PERTURBATIONS])
    survived = strides.apply(starts, gait.slope, strides=RECOVERY).alive.reshape(2, -1)
    largest = [
        0.0 if not way[0] else float(PERTURBATIONS[np.argmin([*way, False]) - 1])
        for way in survived
    ]
    return Perturbations(*largest)


def rough_strides(policy: Policy, scene: Scene, *, walkers: int = 100, seed: int = 0) -> float:
    """Mean number of strides of a policy until a fall, with a random slope for each stride.

    Slopes are normally distributed about the scene's slope (the middle of its range), with the
    standard deviation `ROUGHNESS`.

    Args:
        policy: The policy.
        scene: The scene, which also gives the initial states.
        walkers: Number of walkers over which the mean is taken.
        seed: Seed of the initial states and the slopes.

    Returns:
        The mean; walks end after `MAX_STRIDES` strides.
    """
    middle = float(np.mean(scene.slope))
    several = PassiveWalkerVectorEnv(walkers, make_scene(scene, slope=middle), max_episode_steps=-1)
    rng = np.random.default_rng(seed)
    observations, _ = several.reset(seed=seed)
    strides, going = np.zeros(walkers, int), np.ones(walkers, bool)
    for step in steps(policy, several, observations):
        going &= ~step.terminated
        strides[step.struck & going] += 1
        going &= strides < MAX_STRIDES
        if not going.any():
            break
        slopes = rng.normal(middle, ROUGHNESS, walkers)  # draws do not depend on the heelstrikes
        step.observations[:] = several.set_slopes(slopes, step.struck)
    return float(strides.mean())


def _above_optimum(scene: str, walks: Walks, speed: float, cost: float) -> float:
    """Cost of transport above the optimum at the walks' speed, as a share of the optimum.

    NaN if no optimum is known, or if most walks end in a fall.
    """
    if walks.endings.count(TIME_LIMIT) < LASTING * len(walks):
        return math.nan
    return cost / least_cost(scene, speed) - 1.0


def least_cost(scene: str, speed: float) -> float:
    """Least cost of transport in a scene at a speed over √(g l); NaN if it is not known."""
    try:
        return optimal.least_cost(scene, speed)
    except ValueError:
        return math.nan
