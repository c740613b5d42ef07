"""Scenes, agents and seeds: everyone who acts, by the same measures.

Each unit of work, an agent in a scene with a seed, leaves a file of scores when it is done; what is
done is not done again.
"""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from tqdm import tqdm

from agents import envs
from agents.config import ALGORITHMS, ConfigError, configure, presets
from agents.files import read_json
from agents.learner import load_policy
from agents.training import Run
from gym_passive_walker import GaitNotFound
from gym_passive_walker.control import optimal
from gym_passive_walker.control.baselines import BASELINES
from gym_passive_walker.control.maps import closed_loop_gait
from gym_passive_walker.control.policy import Policy
from gym_passive_walker.envs.scene import SCENES, Scene, make_scene
from gym_passive_walker.envs.vector_env import PassiveWalkerVectorEnv
from gym_passive_walker.evaluation.steps import steps
from gym_passive_walker.evaluation.walks import HUNDRED, WALKED_ON, Walks, evaluate
from gym_passive_walker.files import replacing
from gym_passive_walker.gaits.gait import Gait

AGENTS = (*BASELINES, *ALGORITHMS)
EPISODES = 100
EPISODE_SEED = 1000
"""Episodes that judge every agent, and the seed of the first."""

KICKS = 0.01 * np.arange(1, 101)
"""Changes of the stance rate that are tried, as shares of it."""

RECOVERY = 20
"""Strides after which a walker counts as recovered."""

ROUGHNESS = 0.01
"""Standard deviation in rad of the slopes of rough ground, drawn for each stride."""

FARTHEST = 300
"""Strides after which a walk over rough ground is broken off."""

EXAMS = 4
"""Evaluations while an agent learns, besides the early ones."""

SCORES = (
    "distance", "strides", "speed", "cost_of_transport", "gravity_cost", "hip_cost",
    "positive_hip_cost", "net_hip_cost", "reward", "walked_on", "hundred_strides",
    "above_optimum", "kick_forward", "kick_backward", "rough_strides", "learning_steps",
    "learning_seconds", "steps_to_hundred", "seconds_to_hundred",
)  # fmt: skip


class Unit(NamedTuple):
    """An agent in a scene, with the seed of its learning; 0 where nothing is learned."""

    scene: str
    agent: str
    seed: int

    def __str__(self) -> str:
        return f"{self.scene}-{self.agent}-{self.seed}"


def units(scenes: Iterable[str], agents: Iterable[str], seeds: int) -> list[Unit]:
    """What there is to do: seed after seed, so that whatever is done by then can be compared.

    Raises:
        ConfigError: if a name is unknown, or there is no seed.
    """
    scenes, agents = list(scenes), list(agents)
    for what, names, known in (("scene", scenes, tuple(SCENES)), ("agent", agents, AGENTS)):
        for name in names:
            if name not in known:
                raise ConfigError(f"no {what} {name!r}: choose from {', '.join(known)}")
    if seeds < 1:
        raise ConfigError(f"there must be at least one seed, not {seeds}")
    found = []
    for seed in range(seeds):
        for scene in scenes:
            for agent in agents:
                if (agent in ALGORITHMS or seed == 0) and suits(agent, scene):
                    found.append(Unit(scene, agent, seed))
    return found


@lru_cache
def suits(agent: str, scene: str) -> bool:
    """Whether an agent can walk in a scene: has a preset, a hip to act by, gaits to follow."""
    if agent in ALGORITHMS:
        return scene in presets(agent)
    if agent == "optimal" and isinstance(make_scene(scene).slope, tuple):
        return False  # it is judged slope by slope
    try:
        BASELINES[agent](make_scene(scene))
    except (ValueError, GaitNotFound):
        return False
    return True


def run(folder: Path, todo: Sequence[Unit], *, budget: float = 1.0, progress: bool = True) -> None:
    """Do what is not done yet.

    Args:
        folder: Where scores and trainings are kept.
        todo: What is to be done.
        budget: Steps of each training, as a share of its preset's.
        progress: Whether to show a bar.
    """
    left = [unit for unit in todo if not score_path(folder, unit).is_file()]
    bar = tqdm(left, disable=not progress, unit="agent", dynamic_ncols=True)
    for unit in bar:
        bar.set_postfix_str(str(unit))
        score = measure(folder, unit, budget)
        with replacing(score_path(folder, unit)) as path:
            path.write_text(json.dumps(score, indent=1), encoding="utf-8")


def score_path(folder: Path, unit: Unit) -> Path:
    """Where a unit's scores are kept."""
    return folder / "scores" / f"{unit}.json"


def load_scores(folder: Path) -> list[dict[str, Any]]:
    """All scores that are there, each with its unit."""
    paths = sorted((folder / "scores").glob("*.json"))
    return [read_json(path) for path in paths]


def measure(folder: Path, unit: Unit, budget: float) -> dict[str, Any]:
    """Train an agent if it learns, and judge it."""
    if unit.agent not in ALGORITHMS:
        policy = BASELINES[unit.agent](make_scene(unit.scene))
        return {**unit._asdict(), **judge(policy, unit.scene)}
    run_folder = folder / "runs" / str(unit)
    progress = _learn(run_folder, unit, budget)
    return {**unit._asdict(), **judge(load_policy(run_folder), unit.scene), **progress}


def _learn(folder: Path, unit: Unit, budget: float) -> dict[str, Any]:
    """Train, or go on with a training that was interrupted; tell how fast it went."""
    preset = configure(unit.agent, unit.scene, seed=unit.seed)
    steps = max(1, round(preset.steps * budget))
    training = Run(replace(preset, steps=steps, every=max(1, steps // EXAMS)), folder)
    if not training.train(progress=False):
        raise KeyboardInterrupt  # half a training is not to be judged; it goes on the next time
    walked = training.first_to_walk or {"steps": math.nan, "seconds": math.nan}
    return {
        "learning_steps": training.steps,
        "learning_seconds": training.notes["seconds"],
        "steps_to_hundred": walked["steps"],
        "seconds_to_hundred": walked["seconds"],
    }


def judge(policy: Policy, name: str) -> dict[str, Any]:
    """An agent's scores in a scene of some name: means over walks; costs over all their way."""
    scene = make_scene(name)
    walks = evaluate(policy, envs.arena(configure("ppo", name), EPISODES), seed=EPISODE_SEED)
    # Over all the way that all walks went, so that a stumble does not weigh as much as a walk.
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
        "walked_on": walks.endings.count(WALKED_ON) / len(walks),
        "hundred_strides": float(np.mean(walks.strides >= HUNDRED)),
        "endings": dict(Counter(walks.endings)),
        "above_optimum": _above_optimum(name, walks, speed, gravity + hip),
        "rough_strides": rough_strides(policy, scene),
    }
    try:
        gait = closed_loop_gait(policy, scene)
        score["kick_forward"], score["kick_backward"] = kicks(gait)
        score["largest_multiplier"] = float(abs(gait.multipliers[0]))
    except GaitNotFound:  # it creeps, or never walks alike
        score["kick_forward"] = score["kick_backward"] = math.nan
    return score


class Kicks(NamedTuple):
    """The largest changes of the stance rate just after heelstrike that a walker recovers from.

    Every smaller one of those tried is survived as well. Shares of the gait's own stance rate.

    Attributes:
        forward: Of those that speed it up.
        backward: Of those that slow it down.
    """

    forward: float
    backward: float


def kicks(gait: Gait) -> Kicks:
    """Kick a walker on its gait, both ways, ever harder."""
    strides = gait.stride_map
    starts = np.repeat(strides.points_at(gait.state), 2 * len(KICKS), axis=0)
    starts[:, 1] *= np.concatenate([1.0 + KICKS, 1.0 - KICKS])
    survived = strides.apply(starts, gait.slope, strides=RECOVERY).alive.reshape(2, -1)
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
    several = PassiveWalkerVectorEnv(walkers, make_scene(scene, slope=middle), max_episode_steps=-1)
    rng = np.random.default_rng(seed)
    observations, _ = several.reset(seed=seed)
    strides, going = np.zeros(walkers, int), np.ones(walkers, bool)
    for step in steps(policy, several, observations):
        going &= ~step.terminated
        strides[step.struck & going] += 1
        going &= strides < FARTHEST
        if not going.any():
            break
        slopes = rng.normal(middle, ROUGHNESS, walkers)  # as many each time, however many strike
        step.observations[:] = several.set_slopes(slopes, step.struck)
    return float(strides.mean())


def _above_optimum(scene: str, walks: Walks, speed: float, cost: float) -> float:
    """How much walks cost above the optimum at their speed, as a share of it.

    NaN where no optimum is known, or where most walks end in a fall: strides before a fall live on
    what the start gave them.
    """
    if walks.endings.count(WALKED_ON) < 0.5 * len(walks):
        return math.nan
    try:
        return cost / optimal.least_cost(optimal.load(scene), speed) - 1.0
    except ValueError:
        return math.nan
