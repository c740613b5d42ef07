"""Configuration of a run: presets, and the user's changes."""

import numpy as np
import pytest
import yaml

from agents import envs
from agents.config import ALGORITHMS, Config, ConfigError, configure, presets
from agents.learner import build
from gym_passive_walker.envs.scene import make_scene

SCENES = ("level", "steep", "rolling", "lab")


@pytest.mark.parametrize("algo", ALGORITHMS)
@pytest.mark.parametrize("scene", SCENES)
def test_each_scene_has_a_preset(algo, scene):
    config = configure(algo, scene)
    assert config.steps >= 100_000 and config.n_envs >= 8


def test_the_default_is_large_batch_ppo_on_the_level():
    config = configure()
    assert (config.algo, config.scene, config.n_envs) == ("ppo", "level", 64)
    assert config.hyperparams["n_steps"] * config.n_envs in (4096, 8192)
    assert config.hyperparams["batch_size"] == 2048
    assert config.hyperparams["policy_kwargs"]["log_std_init"] == -1.0


def test_a_stride_of_one_torque_starts_with_less_noise():
    assert configure("ppo", "steep").hyperparams["policy_kwargs"]["log_std_init"] == -2.0


def test_a_control_of_ones_own_brings_its_preset():
    config = configure("ppo", "level", env={"control": "stride", "walker": None})
    assert config.env == {"control": "stride"}
    assert config.hyperparams == configure("ppo", "steep").hyperparams


def test_ppo_keeps_the_size_of_its_update_when_environments_change():
    usual, few = configure(), configure(n_envs=4)
    assert few.hyperparams["n_steps"] * 4 == usual.hyperparams["n_steps"] * usual.n_envs


@pytest.mark.parametrize("n_envs", [1, 5, 7, 64, 1000, 5000])
def test_an_update_is_a_number_of_whole_batches(n_envs):
    config = configure(n_envs=n_envs)
    assert config.hyperparams["n_steps"] * n_envs % config.hyperparams["batch_size"] == 0
    assert config.hyperparams["batch_size"] >= 2


def test_presets_name_the_gymnasium_id_too_for_rl_zoo3():
    for algo in ALGORITHMS:
        assert presets(algo)["PassiveWalker-v0"] == presets(algo)["level"]


@pytest.mark.parametrize("algo", ALGORITHMS)
@pytest.mark.parametrize("scene", SCENES)
def test_a_configuration_is_made_again_from_its_preset(algo, scene, monkeypatch):
    config = configure(algo, scene, seed=2)
    written = yaml.safe_load(yaml.safe_dump({scene: config.preset()}))
    monkeypatch.setattr("agents.config.presets", lambda algo: written)
    assert configure(algo, scene, seed=2) == config


@pytest.mark.parametrize("algo", ALGORITHMS)
def test_a_preset_with_a_callback_of_another_algorithm_is_refused(algo, monkeypatch):
    other = configure("ppo" if algo == "sac" else "sac", "level").preset()
    monkeypatch.setattr("agents.config.presets", lambda algo: {"level": other})
    with pytest.raises(ConfigError, match=f"{algo.upper()} has no callback"):
        configure(algo, "level")


def test_what_is_asked_for_is_what_is_done():
    config = configure("sac", "lab", steps=1000, every=70, seed=3)
    assert (config.steps, config.every, config.seed) == (1000, 70, 3)
    assert configure(steps=1000).every == 50


def test_agents_learn_in_short_episodes_from_hard_starts_and_are_evaluated_in_neither():
    config = configure("ppo", "lab", env={"control": "stride", "reset_noise_scale": 0.01}, n_envs=3)
    learning, evaluated = envs.training_envs(config), envs.arena(config, 3)
    learning.reset(), evaluated.reset()
    done = [learning.step(np.zeros((3, 1)))[2] for _ in range(config.episode_steps)]
    assert not np.any(done[:-1]) and np.all(done[-1])
    assert not any(evaluated.step(np.zeros((3, 1)))[3].any() for _ in range(500))
    level = configure("ppo", "level", env={"slope": 0.001})
    assert envs.training_envs(level, 1).scene.reset_noise_scale == 0.15
    assert envs.arena(level, 1).scene == make_scene("level", slope=0.001)
    assert envs.single(level).unwrapped.scene == make_scene("level", slope=0.001)


def test_a_learning_rate_may_fall_to_zero_as_training_ends():
    config = configure("ppo", "steep", n_envs=2)
    assert config.hyperparams["learning_rate"] == "lin_2e-3"
    model = build(config, envs.training_envs(config))
    assert [model.lr_schedule(left) for left in (1.0, 0.5, 0.0)] == [2e-3, 1e-3, 0.0]


@pytest.mark.parametrize("algo", ALGORITHMS)
def test_returns_are_normalised_with_the_discount_that_is_learned_with(algo):
    config = configure(algo, "level", n_envs=2)
    normalizer = build(config, envs.training_envs(config)).get_vec_normalize_env()
    assert normalizer.gamma == config.hyperparams["gamma"] != 0.99


def test_a_configuration_survives_its_file(tmp_path):
    config = configure("sac", "rolling", env={"slope": [0.0, 0.02]}, seed=3)
    config.save(tmp_path / "config.yml")
    assert Config.load(tmp_path / "config.yml") == config
    assert yaml.safe_load((tmp_path / "config.yml").read_text())["scene"] == "rolling"


def test_what_befalls_walkers_stands_in_a_run_s_file(tmp_path):
    given = {
        "pushes": {"rate": 0.1, "impulse": [-0.01, 0.02]}, "observation_noise": 0.01,
        "action_delay": 1,
        "action_noise": 0.05, "command": [0.1, 0.2], "constraints": {"friction": "end"},
        "friction": 0.6,
    }  # fmt: skip
    configure("ppo", "lab", env=given).save(tmp_path / "config.yml")
    scene = envs.scene_of(Config.load(tmp_path / "config.yml"))
    assert scene.command == (0.1, 0.2) and scene.pushes["impulse"] == (-0.01, 0.02)
    assert scene == make_scene("lab", **given)
    given["action_delay"] = -1
    with pytest.raises(ConfigError, match="action_delay must be a whole number from 0 on"):
        envs.scene_of(configure("ppo", "lab", env=given))


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"algo": "dqn"}, "ppo, ppo-fast, sac"),
        ({"scene": "moon"}, "level"),
        ({"steps": 0}, "steps must be a whole number from 1 on"),
        ({"n_envs": -1}, "n_envs must be a whole number from 1 on"),
        ({"seed": -1}, "seed"),
    ],
)
def test_nonsense_is_refused_with_what_is_allowed(arguments, words):
    with pytest.raises(ConfigError, match=words):
        configure(**arguments)


@pytest.mark.parametrize("text", ["", "[1, 2]", "algo: ppo", "a: {", "colour: red"])
def test_a_file_that_is_no_configuration_is_refused(tmp_path, text):
    (tmp_path / "config.yml").write_text(text)
    with pytest.raises(ConfigError, match=r"config\.yml"):
        Config.load(tmp_path / "config.yml")


def test_differences_say_what_is_kept_and_what_was_asked():
    here, asked = configure(seed=1), configure(seed=2, steps=10)
    assert here.differences(asked, ignore=("steps", "every")) == ["seed: 1 here, 2 asked for"]


def test_a_policy_in_the_notation_of_rl_zoo3_is_read_without_running_it():
    policy = configure().hyperparams["policy_kwargs"]
    assert policy == {"log_std_init": -1.0, "net_arch": [64, 64], "activation_fn": "nn.ReLU"}


def test_presets_explore_where_ticks_are_many():
    assert configure("ppo", "level").exploration["energy"] == "positive"
    assert configure("ppo", "steep").exploration is None
    assert configure("sac", "level").exploration["highest"] == 1.0
    assert configure("sac", "steep").exploration is None


def test_seeds_reach_up_to_those_of_the_libraries():
    assert configure(seed=2**31 - 1).seed == 2**31 - 1
    with pytest.raises(ConfigError, match=rf"seed must be a whole number from 0 to {2**31 - 1}"):
        configure(seed=2**31)
