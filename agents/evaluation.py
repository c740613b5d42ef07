"""Evaluation of a policy beside the passive walker, and its files."""

from __future__ import annotations

import csv
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from agents import envs
from agents.config import Config
from agents.learner import learned
from gym_passive_walker._tools.arguments import whole
from gym_passive_walker._tools.files import replacing
from gym_passive_walker.envs.evaluation.walks import TIME_LIMIT, Walks, evaluate, score_table
from gym_passive_walker.gaits.control import optimal
from gym_passive_walker.gaits.control.baselines import Passive
from gym_passive_walker.gaits.scenes.scene import undisturbed

EPISODES, SEED = 20, 1000
"""Number of episodes that evaluate a run, and the seed of the first."""


def write_rows(path: Path, rows: Sequence[dict[str, Any]]) -> None:
    """Write rows as CSV; older rows may lack columns of the last one."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, fieldnames=list(rows[-1]))
        writer.writeheader()
        writer.writerows(rows)


def evaluate_policy(
    which: Path | str, *, episodes: int = EPISODES, seed: int = SEED, trust: bool = False
) -> tuple[str, list[dict[str, Any]]]:
    """Evaluate a policy and the passive walker over the same episodes.

    Args:
        which: Folder of a run or of an exported policy, or the name of a policy of the package.
        episodes: Number of episodes.
        seed: Seed of the first episode.
        trust: Whether to allow a scene of the user's own.

    Returns:
        The table with a summary in words, and a row for each episode, for `write_evaluation`.

    Raises:
        ConfigError: if there is no such policy.
        ValueError: if `episodes` is below 1, or the seed is negative.
    """
    episodes, seed = whole(episodes, "episodes"), whole(seed, "seed", least=0)
    config, policy = learned(which, trust=trust)
    arena = envs.arena(config, episodes)
    passive_agent = Passive(envs.scene_of(config))
    walks, passive = (evaluate(agent, arena, seed=seed) for agent in (policy, passive_agent))
    columns = {config.algo.upper(): walks, Passive.name: passive}
    text = score_table(f"{envs.describe(config)}; {episodes} episodes", columns)
    text = "\n".join([text, *in_words(config, walks, passive)])
    return text, [row for name, each in columns.items() for row in each.rows(name)]


def in_words(config: Config, walks: Walks, passive: Walks) -> list[str]:
    """Sentences on a policy's walks: how far, how near the optimum, and without an actuator."""
    return [
        f"With the policy, {_how_far(walks)}",
        _above_optimum(config, walks),
        f"Without an actuator, {_how_far(passive)}",
    ]


def _how_far(walks: Walks) -> str:
    """Describe how many walks reach the time limit, how others end, and the median walk."""
    endings = Counter(ending for ending in walks.endings if ending != TIME_LIMIT).most_common()
    falls = f" ({', '.join(f'{ending}: {count}' for ending, count in endings)})" if endings else ""
    median = walks.summary()
    return (
        f"{int(walks.reached_limit.sum())} of {len(walks)} walks reach the time limit{falls}. The "
        f"median walk has {median['strides']:.0f} strides and {median['distance']:.1f} leg lengths."
    )


def _above_optimum(config: Config, walks: Walks) -> str:
    """Describe the energy of the walks to the time limit beside that of the optimal gait."""
    lasting = walks.reached_limit
    if 2 * lasting.sum() < len(walks):
        return "Most of its walks end in a fall, so its cost is not compared with the optimum."
    speed = float(np.median(walks.speed[lasting]))
    cost = float(np.median(walks.cost_of_transport[lasting]))
    try:
        scene = undisturbed(envs.scene_of(config), "the optimum is of walks")
        name = optimal.stored_name(scene)
    except ValueError:
        return "No optimal gaits of this scene are stored to compare its cost with."
    try:
        least = optimal.least_cost(name, speed)
    except ValueError:
        return f"No optimal gait is stored at its speed, {speed:.3f} √(g l)."
    share = cost / least - 1.0
    above = f"{share:.1%} above" if share >= 5e-4 else "no more than"
    return (
        f"Its speed is {speed:.3f} √(g l) and its cost of transport {cost:.4f}, {above} the least "
        f"possible at that speed, {least:.4f} (python train.py optimal)."
    )


def write_evaluation(run: Path, text: str, rows: Sequence[dict[str, Any]]) -> None:
    """Write the results of `evaluate_policy` into a run's folder."""
    with replacing(run / "evaluation.txt") as path:
        path.write_text(text + "\n", encoding="utf-8")
    with replacing(run / "evaluation.csv") as path:
        write_rows(path, rows)
