"""The end of a run: its policy beside the passive walker, in a table and in pictures."""

from __future__ import annotations

import csv
from pathlib import Path

from agents import pictures, worlds
from agents.config import Config
from agents.evaluation import evaluate
from agents.files import CONFIG, replacing
from agents.learner import LearnedPolicy, load_policy
from agents.report import table, write_rows
from gym_passive_walker.control.baselines import Passive

EPISODES = 20
SEED = 1000


def judge(run: Path, *, episodes: int = EPISODES, seed: int = SEED, keep: bool = True) -> str:
    """Let a policy and the passive walker walk the same episodes.

    Args:
        run: The folder of a run or of an exported policy.
        episodes: How many episodes.
        seed: Of the first one.
        keep: Whether evaluation.csv and evaluation.txt are written into the folder.

    Returns:
        The table.

    Raises:
        ConfigError: if the folder holds no trained policy.
    """
    config, policy = _policy_of(run)
    arena = worlds.arena(config, episodes)
    columns = {agent.name: evaluate(agent, arena, seed=seed) for agent in (policy, Passive())}
    text = table(f"{worlds.describe(config)}; {episodes} episodes", columns)
    if not keep:
        return text
    with replacing(run / "evaluation.txt") as path:
        path.write_text(text + "\n", encoding="utf-8")
    with replacing(run / "evaluation.csv") as path:
        write_rows(path, [row for name, walks in columns.items() for row in walks.rows(name)])
    return text


def draw(run: Path) -> None:
    """Draw a run's learning curve and the gait of its policy."""
    config, policy = _policy_of(run)
    with (run / "learning_curve.csv").open(newline="", encoding="utf-8") as file:
        rows = [{k: float(v) for k, v in row.items()} for row in csv.DictReader(file)]
    with replacing(run / "learning_curve.png") as path:
        passive = evaluate(Passive(), worlds.arena(config, EPISODES), seed=SEED).summary()
        pictures.learning_curve(path, rows, passive, worlds.describe(config))
    with replacing(run / "gait.png") as path:
        title = f"{policy.name} on {worlds.describe(config)}"
        pictures.gait(path, policy, worlds.single(config), seed=SEED, title=title)


def _policy_of(run: Path) -> tuple[Config, LearnedPolicy]:
    config = Config.load(run / CONFIG)
    return config, load_policy(run, worlds.training_worlds(config, 1), config)
