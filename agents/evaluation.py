"""A policy judged beside the passive walker, and what is kept of it."""

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
"""Episodes that judge a run, and the seed of the first."""


def write_rows(path: Path, rows: Sequence[dict[str, Any]]) -> None:
    """Write rows as CSV; older rows may lack columns of the last one."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, fieldnames=list(rows[-1]))
        writer.writeheader()
        writer.writerows(rows)


def judge(
    which: Path | str, *, episodes: int = EPISODES, seed: int = SEED
) -> tuple[str, list[dict[str, Any]]]:
    """Let a policy and the passive walker walk the same episodes.

    Args:
        which: A policy, as of `learned`.
        episodes: How many episodes.
        seed: Of the first one.

    Returns:
        The table, and a row for each episode, which `keep` writes.

    Raises:
        ConfigError: if there is no such policy.
        ValueError: if there is no episode, or the seed is negative.
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
    """Write what `judge` found into a run's folder."""
    with replacing(run / "evaluation.txt") as path:
        path.write_text(text + "\n", encoding="utf-8")
    with replacing(run / "evaluation.csv") as path:
        write_rows(path, rows)
