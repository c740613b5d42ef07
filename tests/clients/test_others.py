"""First examples of libraries in environments of their own: rows of `docs/howto-train.md`.

`nox -s clients` installs each library and runs its tests. Changed in an example are the name of the
environment, windows, lengths of training over a minute, and an algorithm of discrete actions.
"""

from __future__ import annotations

import re

import pytest

from tests.clients.examples import NAME, described, run, run_module, with_walker


def test_sb3_contrib(tmp_path):
    pytest.importorskip("sb3_contrib")
    example = f"""
from sb3_contrib import ARS, TQC, RecurrentPPO
from gym_passive_walker.envs.sb3 import PassiveWalkerVecEnv

TQC("MlpPolicy", "{NAME}", top_quantiles_to_drop_per_net=2).learn(200)
RecurrentPPO("MlpLstmPolicy", "{NAME}", n_steps=64).learn(128)
ARS("LinearPolicy", PassiveWalkerVecEnv(4), n_delta=4).learn(500)
"""
    run(example, tmp_path)


def test_sbx(tmp_path):
    pytest.importorskip("sbx")
    example = f"""
import gymnasium as gym
from sbx import PPO, SAC
from gym_passive_walker.envs.sb3 import PassiveWalkerVecEnv

SAC("MlpPolicy", gym.make("{NAME}"), learning_starts=50).learn(100)
PPO("MlpPolicy", PassiveWalkerVecEnv(4), n_steps=32).learn(256)
"""
    run(example, tmp_path)


def test_rl_zoo3(tmp_path):
    """Without hyperparameters of this environment it takes the defaults of stable-baselines3."""
    pytest.importorskip("rl_zoo3")
    asked = "--algo ppo --env PassiveWalker-v0 --gym-packages gym_passive_walker -n 2100"
    run_module("rl_zoo3.train", tmp_path, *asked.split())
    assert list(tmp_path.glob("logs/ppo/PassiveWalker-v0_1/*.zip"))


def test_tianshou(tmp_path):
    """Its seeds are left out: with them the example fails with its own environment too."""
    pytest.importorskip("tianshou")
    example = described("tianshou", "DQNExperimentBuilder")
    example = re.sub(r"^ *(training|test)_seed=.*\n", "", example, flags=re.M)
    networks = ".with_actor_factory_default((64, 64)).with_common_critic_factory_default()"
    discrete = r"\.with_dqn_params\(.*\.with_model_factory_default\([^\n]*"
    example = re.sub(discrete, networks, example, flags=re.S)
    changes = {
        "CartPole-v1": NAME,
        "DQNExperimentBuilder": "SACExperimentBuilder",
        "watch=True": "watch=False",
        "max_epochs=10": "max_epochs=1",
        "epoch_num_steps=10000": "epoch_num_steps=500",
        "num_test_envs=100": "num_test_envs=2",
    }
    run(with_walker(example, changes), tmp_path)


@pytest.mark.parametrize("infos", ["", ", record_infos=True"])
def test_minari(tmp_path, monkeypatch, infos):
    pytest.importorskip("minari")
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    changes = {
        "FrozenLake-v1": NAME,
        "DataCollector(env)": f"DataCollector(env{infos})",
        "range(100)": "range(5)",
    }
    example = with_walker(described("minari", "FrozenLake"), changes)
    run(example + "\nassert dataset.total_episodes == 5\n", tmp_path)


def test_agilerl(tmp_path):
    pytest.importorskip("agilerl")
    changes = {
        '"LunarLander-v3"': f'GymEnvSpec(name="{NAME}", num_envs=2)',
        "import TrainingSpec": "import GymEnvSpec, TrainingSpec",
        "DQN": "PPO",
        "pop_size=4": "pop_size=2, max_steps=4096, eval_steps=200",
    }
    example = with_walker(described("agilerl", "LunarLander"), changes)
    run(example.replace("\ntrainer =", "\nif __name__ == '__main__':\n  trainer =")
        .replace("\npopulation", "\n  population"), tmp_path)  # fmt: skip


def test_evotorch(tmp_path):
    pytest.importorskip("evotorch")
    changes = {
        "Humanoid-v4": NAME, "popsize=200": "popsize=8", "200 * 1000 * 0.75": "200",
        "popsize_max=3200": "popsize_max=16", "searcher.run(500)": "searcher.run(2)",
        "problem.visualize(trained_policy)": "", '"max"': "1",
    }  # fmt: skip
    run(with_walker(described("evotorch", "GymNE"), changes), tmp_path)
