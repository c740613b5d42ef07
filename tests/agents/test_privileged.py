"""Critics that see more than actors."""

import dataclasses

import numpy as np
import pytest
import torch
from stable_baselines3 import PPO

import gym_passive_walker as gpw
from agents import envs as agents_envs
from agents.config import ConfigError
from agents.envs import training_envs
from agents.learner import LearnedPolicy, build, export, learned, on_numpy
from agents.ppo_fast import FastPPO
from agents.training import Run
from gym_passive_walker.envs.privileged import PrivilegedCriticPolicy
from gym_passive_walker.envs.sb3 import PassiveWalkerVecEnv
from tests.agents.runs import small, weights


def hips(step):
    state = step.state
    return state.stance, state.thigh, state.stance_rate, state.thigh_rate


ENV = {
    "observation": {
        "policy": "tests.agents.test_privileged:hips", "critic": ["default", "randomized"],
    },
    "domain_randomization": {"foot_radius": 0.2, "max_hip_torque": [0.5, 1.0]},
}  # fmt: skip
SCENE = ENV | {"observation": {"policy": hips, "critic": ("default", "randomized")}}
ALGORITHMS = ["ppo-fast", "ppo"]


@pytest.fixture(autouse=True)
def _short_exams(monkeypatch):
    """Make evaluations during training short."""
    usual = agents_envs.arena
    monkeypatch.setattr(agents_envs, "arena", lambda config, count: usual(config, min(count, 2)))


def built(algo):
    config = small(algo, env=ENV)
    return config, build(config, training_envs(config))


@pytest.mark.parametrize("algo", ALGORITHMS)
def test_the_actor_does_not_see_what_the_critic_sees(algo):
    _, model = built(algo)
    random = np.random.default_rng(0)
    rows = {"policy": random.normal(size=(5, 4)), "critic": random.normal(size=(5, 10))}
    seen = {name: torch.tensor(x, dtype=torch.float32) for name, x in rows.items()}
    others = {name: seen | {name: seen[name] + torch.randn_like(seen[name])} for name in seen}
    policy = model.policy

    def both(observations):
        with torch.no_grad():
            mean = policy.get_distribution(observations).distribution.mean
            return mean, policy.predict_values(observations)

    mean, value = both(seen)
    assert torch.equal(both(others["critic"])[0], mean)
    assert not torch.isclose(both(others["critic"])[1], value).any()
    assert torch.equal(both(others["policy"])[1], value)
    assert not torch.isclose(both(others["policy"])[0], mean).any()


def test_rollouts_and_gradients_use_each_group():
    """The critic's weights learn from its own columns alone, and the actor's from theirs."""
    _, model = built("ppo-fast")
    size = model.observation_space["policy"].shape[0]
    rollout_of = model.walk
    kept = []

    def walk(callback):
        kept.append(rollout_of(callback))
        return kept[-1]

    model.walk = walk
    before = weights(model)
    model.learn(16 * 8)
    (rollout,) = kept
    assert rollout.seen.shape == (16, 8, 4 + 10)
    assert (model.acts_on, model.judges_by) == (slice(0, size), slice(size, None))
    assert not np.array_equal(weights(model), before)
    assert model.critic.linear[0].in_features == 10 and model.actor.linear[0].in_features == 4
    # Actor and critic see the stance angle, first in their columns.
    np.testing.assert_allclose(rollout.seen[..., 0], rollout.seen[..., size], atol=1e-6)
    drawn = rollout.seen[:3, :, -2:]
    assert torch.equal(drawn[0], drawn[1]) and drawn[0].std() > 0.1  # no episode has ended
    scale = model.get_vec_normalize_env().obs_rms
    assert scale["critic"].mean.shape == (10,) and scale["policy"].count > 100


def test_a_file_of_the_library_acts_as_its_model(tmp_path):
    envs = PassiveWalkerVecEnv(2, SCENE)
    model = PPO(PrivilegedCriticPolicy, envs, n_steps=8, batch_size=8, seed=0, device="cpu")
    model.save(tmp_path / "model.zip")
    seen = np.random.default_rng(0).normal(size=(20, 4)).astype(np.float32)
    groups = {"policy": seen, "critic": np.zeros((20, 10), np.float32)}
    found, _ = gpw.load_policy(tmp_path / "model.zip").predict(seen)
    np.testing.assert_allclose(found, model.predict(groups, deterministic=True)[0], atol=2e-6)


@pytest.mark.parametrize("algo", ALGORITHMS)
def test_a_run_is_saved_resumed_exported_and_needs_the_policy_s_group_alone(algo, tmp_path):
    whole = Run(small(algo, 256, env=ENV), tmp_path / "whole")
    assert whole.train(progress=False)
    half = Run(small(algo, 128, env=ENV), tmp_path / "half")
    assert half.train(progress=False)
    longer = dataclasses.replace(half.config, steps=256)
    again = Run(longer, tmp_path / "half")
    assert again.resumed and again.train(progress=False)
    np.testing.assert_array_equal(weights(again.model), weights(whole.model))
    config, policy = learned(tmp_path / "whole", trust=True)
    assert isinstance(policy, LearnedPolicy)
    seen = np.random.default_rng(0).uniform(-0.3, 0.3, (6, 4)).astype(np.float32)
    actions, _ = policy.predict(seen)
    np.testing.assert_allclose(on_numpy(policy, config).predict(seen)[0], actions, atol=1e-6)
    export(policy, config, tmp_path / "policy")
    found = gpw.load_policy(tmp_path / "policy", trust=True)
    np.testing.assert_allclose(found.predict(seen)[0], actions, atol=1e-6)
    assert found.scene.observation.__name__ == "hips" and found.scene.groups is None
    names = found.trained["env"]["observation"]
    assert names == ENV["observation"]
    found.to_onnx(tmp_path / "policy.onnx")
    onnx = gpw.load_policy(tmp_path / "policy.onnx", trust=True)
    np.testing.assert_allclose(onnx.predict(seen)[0], actions, atol=1e-5)
    walks = gpw.evaluate(onnx, episodes=2, max_episode_steps=20, beside=(), time_limit=0.0)
    assert len(walks.walks) == 1


def test_stable_baselines3_learns_with_both_policies():
    envs = PassiveWalkerVecEnv(4, SCENE, seed=0)
    usual = PPO("MultiInputPolicy", envs, n_steps=16, batch_size=32, n_epochs=1, device="cpu")
    usual.learn(64)
    own = PPO(PrivilegedCriticPolicy, envs, n_steps=16, batch_size=32, n_epochs=1, device="cpu")
    own.learn(64)
    seen = envs.reset()
    other = seen | {"critic": seen["critic"] + 1.0}
    assert np.array_equal(own.predict(seen, deterministic=True)[0],
                          own.predict(other, deterministic=True)[0])  # fmt: skip
    assert not np.array_equal(usual.predict(seen, deterministic=True)[0],
                              usual.predict(other, deterministic=True)[0])  # fmt: skip


def test_a_policy_with_a_privileged_critic_is_read_from_stable_baselines3_s_file(tmp_path):
    envs = PassiveWalkerVecEnv(2, SCENE, seed=0)
    model = PPO(PrivilegedCriticPolicy, envs, n_steps=16, batch_size=32, device="cpu")
    model.save(tmp_path / "model.zip")
    again = PPO.load(tmp_path / "model.zip", device="cpu")
    seen = envs.reset()
    assert np.array_equal(again.predict(seen, deterministic=True)[0],
                          model.predict(seen, deterministic=True)[0])  # fmt: skip


@pytest.mark.parametrize("algo", ["sac", "shac"])
def test_other_learners_refuse_groups(algo):
    config = small(algo, env=ENV)
    with pytest.raises(ConfigError, match="by ppo and ppo-fast"):
        build(config, training_envs(config))


def test_a_policy_of_groups_refuses_an_observation_without():
    with pytest.raises(ValueError, match="needs an observation with the groups"):
        PPO(PrivilegedCriticPolicy, PassiveWalkerVecEnv(2), device="cpu")


def slope_alone(step):
    return (step.slope,)


def step_count(step):
    return (step.steps,)


@pytest.mark.learning
def test_a_critic_learns_what_only_it_sees():
    """Returns of passive walkers on slopes from 0 to 0.03 depend on the slope.

    The critic that sees it explains their variance, and the one that sees what the blind actor sees
    does not.
    """
    scene = {"slope": (0.0, 0.03), "max_hip_torque": 0.0, "reset_noise_scale": 0.02}
    explained = {}
    for name, critic in (("sees", slope_alone), ("blind", step_count)):
        observation = {"policy": step_count, "critic": critic}
        envs = PassiveWalkerVecEnv(64, scene, observation=observation, max_episode_steps=40)
        model = FastPPO("MultiInputPolicy", envs, n_steps=40, batch_size=640, seed=0, device="cpu")
        rollouts = []
        walk = model.walk
        model.walk = lambda callback, walk=walk, kept=rollouts: (
            kept.append(walk(callback)) or kept[-1]
        )
        model.learn(40 * 64 * 15)
        last = rollouts[-1]
        with torch.no_grad():
            left = last.returns - model.value(last.seen)
        explained[name] = 1.0 - float(left[0].var() / last.returns[0].var())
    assert explained["sees"] > 0.5 > 0.2 > explained["blind"]
