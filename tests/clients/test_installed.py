"""First examples of libraries in the extra `dev` run with a walker: rows of `docs/howto-train.md`.

Where a library's package has an example, it is run with the environment's name in it. Changed
besides are windows, because tests have none, and lengths of training over a minute. That of rsl_rl
is in `tests/trainers/test_contracts.py`.
"""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.clients.examples import NAME, described, documented, run, with_walker

ROOT = Path(__file__).parents[2]


@pytest.mark.slow
def test_stable_baselines3(tmp_path):
    pytest.importorskip("stable_baselines3")
    changes = {
        "CartPole-v1": NAME,
        'render_mode="human"': 'render_mode="rgb_array"',
        "10_000": "2_000",
        "range(1000)": "range(100)",
    }
    run(with_walker(described("stable_baselines3", "gymnasium.make"), changes), tmp_path)


@pytest.mark.slow
def test_torchrl(tmp_path):
    pytest.importorskip("torchrl")
    example = documented("torchrl.envs:GymEnv", "import GymEnv", "max_episode_steps")
    assert "4000" in run(with_walker(example, {"Pendulum-v1": NAME}), tmp_path)


@pytest.mark.slow
def test_torchrl_s_policy(tmp_path):
    """The last line asks for 32 control steps without a fall, and the weights are random.

    So the walker starts at its gait, the slope carries it, and the torque is too weak to fell it.
    """
    pytest.importorskip("torchrl")
    steady = "slope=0.025, max_hip_torque=0.005, reset_noise_scale=0.0"
    changes = {"PendulumEnv()": f'GymEnv("{NAME}", {steady})', "PendulumEnv": "GymEnv"}
    run(with_walker(described("torchrl", "PendulumEnv"), changes), tmp_path)


@pytest.mark.slow
def test_skrl(tmp_path):
    """The environment is wrapped by skrl's own function, and its trainer has its defaults."""
    pytest.importorskip("skrl")
    example = f"""
import gymnasium as gym
from skrl.agents.torch.ppo import PPO
from skrl.envs.wrappers.torch import wrap_env
from skrl.memories.torch import RandomMemory
from skrl.trainers.torch import SequentialTrainer
from skrl.utils.model_instantiators.torch import deterministic_model, gaussian_model

env = wrap_env(gym.make_vec("{NAME}", num_envs=4, render_mode="rgb_array"))
network = [dict(name="net", input="OBSERVATIONS", layers=[64], activations="elu")]
spaces = dict(observation_space=env.observation_space, action_space=env.action_space)
models = dict(
    policy=gaussian_model(**spaces, network=network, output="ACTIONS"),
    value=deterministic_model(**spaces, network=network, output="ONE"),
)
for role, model in models.items():
    model.init_state_dict(role=role)
memory = RandomMemory(memory_size=16, num_envs=env.num_envs)
agent = PPO(models=models, memory=memory, cfg=dict(rollouts=16), **spaces)
SequentialTrainer(env=env, agents=agent, cfg=dict(timesteps=48)).train()
"""
    run(example, tmp_path)


@pytest.mark.slow
def test_optuna(tmp_path):
    pytest.importorskip("optuna")
    example = f"""
import gymnasium as gym
import optuna

def objective(trial):
    env = gym.make("{NAME}", slope=trial.suggest_float("slope", 0.0, 0.05))
    env.reset(seed=0)
    while True:
        _, _, terminated, truncated, info = env.step(env.action_space.sample() * 0.0)
        if terminated or truncated:
            return info["episode_distance"]

study = optuna.create_study(direction="maximize")
study.optimize(objective, n_trials=5)
assert study.best_value > 0.0
"""
    run(example, tmp_path)


def test_versions_in_the_table_are_those_that_are_pinned():
    page = (ROOT / "docs" / "howto-train.md").read_text(encoding="utf-8")
    pins = dict(
        line.split("==") for line in (ROOT / "constraints.txt").read_text().split() if "==" in line
    )
    rows = dict(re.findall(r"^\| ([\w.-]+) \| ([\d.]+) \| gate \|", page, re.M))
    assert rows.keys() == {"stable-baselines3", "torchrl", "skrl", "rsl-rl-lib", "optuna"}
    assert rows == {name: pins[name] for name in rows}
