"""Evaluation of a policy beside the passive walker, and its files."""

from __future__ import annotations

import csv
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from agents import envs
from agents.learner import learned
from gym_passive_walker._tools.arguments import whole
from gym_passive_walker._tools.files import replacing
from gym_passive_walker.envs.evaluation.comparison import Evaluation, evaluate
from gym_passive_walker.envs.evaluation.walks import TIME_LIMIT, Walks, score_table

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
    found = evaluate(
        policy, envs.scene_of(config), episodes=episodes, seed=seed, beside=("passive",)
    )
    names = {found.controller_name: config.algo.upper()}
    walks = {names.get(name, name): made for name, made in found.walks.items()}
    above = {names.get(name, name): share for name, share in found.above_optimum.items()}
    text = score_table(f"{envs.describe(config)}; {episodes} episodes", walks, above)
    text = "\n".join([text, *in_words(found)])
    return text, [row for name, each in walks.items() for row in each.rows(name)]


def in_words(found: Evaluation) -> list[str]:
    """Sentences on a policy's walks: how far, how near the optimum, and without an actuator."""
    walks, passive = found.walks.values()
    return [
        f"With the policy, {_how_far(walks)}",
        found.in_words(),
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


def write_evaluation(run: Path, text: str, rows: Sequence[dict[str, Any]]) -> None:
    """Write the results of `evaluate_policy` into a run's folder."""
    with replacing(run / "evaluation.txt") as path:
        path.write_text(text + "\n", encoding="utf-8")
    with replacing(run / "evaluation.csv") as path:
        write_rows(path, rows)
