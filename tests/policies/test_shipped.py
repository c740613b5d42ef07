"""Trained policies that come with the package."""

import numpy as np
import pytest

import train
from agents import roster, worlds
from agents.config import ConfigError
from agents.evaluation import evaluate

SCENES = ("level", "steep", "rolling")


def test_each_scene_that_needs_a_motor_has_one():
    assert {name.split("-")[0] for name in roster.shipped()} >= set(SCENES)


@pytest.mark.parametrize("name", roster.shipped())
def test_a_shipped_policy_is_numbers_and_text(name):
    files = sorted(path.name for path in (roster.SHIPPED / name).iterdir())
    assert files == ["config.yml", "policy.safetensors"]
    assert sum(path.stat().st_size for path in (roster.SHIPPED / name).iterdir()) < 100_000


@pytest.mark.parametrize("name", roster.shipped())
def test_a_shipped_policy_walks_in_its_scene(name):
    config, policy = roster.learned(name)
    assert name == f"{config.scene}-{config.algo}"
    walks = evaluate(policy, worlds.arena(config, 10), seed=77)
    assert np.mean(walks.strides >= 100) >= 0.9


def test_a_shipped_policy_is_evaluated_by_its_name(capsys):
    assert train.main(["evaluate", "--policy", "level-ppo", "--episodes", "2"]) == 0
    said = capsys.readouterr().out
    assert "PPO" in said and "passive" in said
    test_a_shipped_policy_is_numbers_and_text("level-ppo")  # it leaves nothing beside it


def test_names_are_told_when_one_is_unknown():
    with pytest.raises(ConfigError, match="level-ppo"):
        roster.folder_of("moon-ppo")
