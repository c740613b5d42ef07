"""Scheduled noise, and noise that differs from walker to walker."""

import numpy as np
import pytest

from agents.config import ConfigError, configure
from agents.envs import training_envs
from agents.exploration import Ladder, Schedule, explorers
from agents.learner import build


def scheduled(config, steps, *arguments, **options):
    """A learner that makes some steps with a schedule, and the walkers."""
    walkers = training_envs(config)
    model = build(config, walkers)
    model._total_timesteps = steps
    schedule = Schedule(*arguments, **options)
    schedule.init_callback(model)
    return model, schedule, walkers


@pytest.mark.parametrize(
    "log_std", [{0.2: -1.0, 0.6: -3.0}, {0.6: -3.0, 0.4: -2.0, 0.0: -1.0, 0.2: -1.0}]
)
def test_noise_and_charge_follow_the_steps_made(log_std):
    options = {"energy": "positive", "until": 0.5}
    model, schedule, walkers = scheduled(configure(n_envs=4), 1000, log_std, **options)
    seen = []
    for model.num_timesteps in (0, 200, 300, 400, 600, 1000):
        schedule.on_rollout_start()
        seen.append((round(model.policy.log_std.item(), 6), *set(walkers.get_attr("energy_cost"))))
    assert seen == [
        (-1.0, "positive"), (-1.0, "positive"), (-1.5, "positive"), (-2.0, "positive"),
        (-3.0, "absolute"), (-3.0, "absolute"),
    ]  # fmt: skip


@pytest.mark.parametrize("count", [1, 5])
def test_each_walker_strays_more_boldly_than_the_one_before(count):
    config = configure("sac", "level", n_envs=count)
    model = build(config, training_envs(config), learning_starts=0)
    model._setup_learn(0, callback=(ladder := Ladder(0.01, 0.16)))
    assert ladder.training_env.num_envs == count
    draws = np.array([model.action_noise() for _ in range(4000)])
    assert draws.shape == (4000, count, 1)
    expected = np.array([0.01, 0.02, 0.04, 0.08, 0.16])[:count]
    assert np.allclose(draws.std(axis=(0, 2)), expected, rtol=0.1)
    assert abs(np.corrcoef(draws[:-1, -1, 0], draws[1:, -1, 0])[0, 1]) < 0.1


def test_an_algorithm_explores_in_its_own_way_or_not_at_all():
    assert explorers("sac", None) == []
    assert isinstance(explorers("sac", {"lowest": 0.1, "highest": 0.2})[0], Ladder)
    assert isinstance(explorers("ppo", {"log_std": {0.0: -1.0}})[0], Schedule)


@pytest.mark.parametrize(
    ("algo", "arguments", "words"),
    [
        ("ppo", {"log_std": {}}, "PPO cannot explore.*log_std must have"),
        ("ppo", {"log_std": {0.0: -1.0}, "energy": "all"}, "energy"),
        ("ppo", {"log_std": {0.0: -1.0}, "until": "late"}, "until"),
        ("shac", {"log_std": 3.0}, "SHAC cannot explore"),
        ("ppo-fast", {"lowest": 0.1, "highest": 1.0}, "PPO-FAST cannot explore.*lowest"),
        ("sac", {"lowest": 0.0, "highest": 1.0}, "SAC cannot explore.*lowest"),
        ("sac", {"lowest": 0.1, "highest": -1.0}, "highest"),
        ("sac", {"lowest": 0.1}, "highest"),
    ],
)
def test_arguments_that_no_callback_takes_are_refused(algo, arguments, words):
    with pytest.raises(ConfigError, match=words):
        explorers(algo, arguments)


@pytest.mark.parametrize(("until", "first"), [(0.0, "absolute"), (1.0, "net")])
def test_the_scene_s_own_energy_applies_from_the_share_on_that_ends_the_first(until, first):
    options = {"energy": "net", "until": until}
    model, schedule, walkers = scheduled(configure(n_envs=2), 100, {0.0: -1.0}, **options)
    charged = []
    for model.num_timesteps in (0, 99, 100, 150):
        schedule.on_rollout_start()
        charged.append(walkers.get_attr("energy_cost")[1])
    assert charged == [first, first, "absolute", "absolute"]


def test_noise_of_a_schedule_reaches_every_action_of_a_policy():
    config = configure(env={"actions": ["hip", "push_off"]}, n_envs=2)
    model, schedule, _ = scheduled(config, 10, {1.0: -3.0, 0.0: -1.0})
    model.num_timesteps = 5
    schedule.on_rollout_start()
    assert model.policy.log_std.tolist() == [-2.0, -2.0]
