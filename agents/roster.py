"""Agents by name: baselines, shipped policies, and runs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import gym_passive_walker
from agents.config import Config, ConfigError
from agents.files import CONFIG

if TYPE_CHECKING:
    from agents.learner import LearnedPolicy  # loads torch

SHIPPED = Path(gym_passive_walker.__file__).parent / "policies"
"""Trained policies that come with the package, each a folder as `learner.export` writes it."""


def shipped() -> list[str]:
    """Names of the shipped policies."""
    return sorted(path.parent.name for path in SHIPPED.glob(f"*/{CONFIG}"))


def folder_of(name: str) -> Path:
    """The folder of a learned policy: a shipped one by its name, or a run's.

    Raises:
        ConfigError: if there is none.
    """
    for folder in (SHIPPED / name, Path(name)):
        if (folder / CONFIG).is_file():
            return folder
    raise ConfigError(
        f"no policy {name!r}: give the folder of a run, or one of {', '.join(shipped())}"
    )


def learned(name: str) -> tuple[Config, LearnedPolicy]:
    """A learned policy, and the configuration that it was trained with.

    Raises:
        ConfigError: if there is none of this name, or its files do not fit.
    """
    from agents import worlds
    from agents.learner import load_policy

    folder = folder_of(name)
    config = Config.load(folder / CONFIG)
    return config, load_policy(folder, worlds.training_worlds(config, 1), config)
