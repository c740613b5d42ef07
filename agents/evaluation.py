"""Evaluation of a policy beside the passive walker, and its files."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from agents import envs
from agents.learner import learned
from gym_passive_walker.arguments import whole
from gym_passive_walker.control.baselines import Passive
from gym_passive_walker.evaluation.walks import evaluate, table
from gym_passive_walker.files import replacing

EPISODES, SEED = 20, 1000
"""Number of episodes that evaluate a run, and the seed of the first."""


def write_rows(path: Path, rows: Sequence[dict[str, Any]]) -> None:
    """Write rows as CSV; older rows may lack columns of the last one."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, fieldnames=list(rows[-1]))
        writer.writeheader()
        writer.writerows(rows)


def judge(
    which: Path | str, *, episodes: int = EPISODES, seed: int = SEED
) -> tuple[str, list[dict[str, Any]]]:
    """Evaluate a policy and the passive walker over the same episodes.

    Args:
        which: Folder of a run or of an exported policy, or the name of a policy of the package.
        episodes: Number of episodes.
        seed: Seed of the first episode.

    Returns:
        The table, and a row for each episode, which `keep` writes.

    Raises:
        ConfigError: if there is no such policy.
        ValueError: if `episodes` is below 1, or the seed is negative.
    """
    episodes, seed = whole(episodes, "episodes"), whole(seed, "seed", least=0)
    config, policy = learned(which)
    arena = envs.arena(config, episodes)
    columns = {
        name: evaluate(agent, arena, seed=seed)
        for name, agent in ((config.algo.upper(), policy), (Passive.name, Passive()))
    }
    text = table(f"{envs.describe(config)}; {episodes} episodes", columns)
    return text, [row for name, walks in columns.items() for row in walks.rows(name)]


def keep(run: Path, text: str, rows: Sequence[dict[str, Any]]) -> None:
    """Write the results of `judge` into a run's folder."""
    with replacing(run / "evaluation.txt") as path:
        path.write_text(text + "\n", encoding="utf-8")
    with replacing(run / "evaluation.csv") as path:
        write_rows(path, rows)
