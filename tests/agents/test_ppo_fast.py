"""PPO on tensors against PPO of stable-baselines3."""

import dataclasses
import sys
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from stable_baselines3.common.buffers import RolloutBuffer
from stable_baselines3.common.logger import Logger
from stable_baselines3.common.vec_env import VecCheckNan, VecFrameStack

from agents import envs
from agents.config import configure
from agents.first_order import SHAC
from agents.learned_steps import LearnedSHAC
from agents.learner import build
from agents.ppo_fast import FastPPO, advantages, carried, chances
from gym_passive_walker.envs.policies.network import ACTIVATIONS
from gym_passive_walker.envs.sb3 import PassiveWalkerVecEnv
from gym_passive_walker.torch.environment import PassiveWalkerTorchEnv


def made(scene="level", **changes):
    """An untrained agent of eight walkers before its first update, and its callbacks."""
    config = dataclasses.replace(configure("ppo-fast", scene, n_envs=8), episode_steps=45)
    hyperparams = {"n_steps": 100, "batch_size": 200} | changes
    model = build(
        dataclasses.replace(config, exploration=None), envs.training_envs(config), **hyperparams
    )
    _, callback = model._setup_learn(1, None)
    return config, model, callback


def drawn(steps=20, count=5):
    """Random rewards, values and ends of episodes."""
    generator = torch.Generator().manual_seed(0)
    rewards, values = torch.randn((2, steps, count), generator=generator)
    return rewards, values, torch.rand((steps, count), generator=generator) < 0.2


def test_small_updates_are_on_the_cpu_beside_a_gpu(monkeypatch):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    assert made()[1].device.type == "cpu"


@pytest.mark.parametrize(
    ("interval", "at"), [(1, [400, 800, 1200, 1600, 2000]), (2, [800, 1600]), (None, [])]
)
def test_it_logs_at_every_so_many_updates_as_the_library_does(interval, at, monkeypatch):
    *_, model, _ = made(n_steps=50)
    written = []
    monkeypatch.setattr(Logger, "dump", lambda _, step=0: written.append(step))
    model.learn(2000, log_interval=interval)
    assert written == at


@pytest.mark.parametrize("gae_lambda", [0.0, 0.9, 1.0])
def test_advantages_are_those_of_the_library(gae_lambda):
    """Two derivations: in the library, the value at a time limit is part of the reward."""
    rewards, values, ended = drawn()
    last, final = torch.randn((2, 5), generator=torch.Generator().manual_seed(1))
    after = torch.where(ended, torch.zeros(()), torch.cat([values[1:], last[None]]))
    late = ended.clone()
    late[::2] = False  # of those that ended, the others fell
    after = torch.where(late, final.expand_as(after), after)
    found = advantages(rewards, values, after, ended, gamma=0.9, gae_lambda=gae_lambda)
    _, model, _ = made()
    buffer = RolloutBuffer(
        20, model.observation_space, model.action_space, gamma=0.9, gae_lambda=gae_lambda, n_envs=5
    )
    begun = np.zeros(5)
    for t in range(20):
        paid = rewards[t] + 0.9 * final * late[t]
        buffer.add(np.zeros((5, 8)), np.zeros((5, 1)), paid.numpy(), begun, values[t], values[t])
        begun = ended[t].numpy()
    buffer.compute_returns_and_advantage(last, begun)
    np.testing.assert_allclose(found, buffer.advantages, rtol=1e-4, atol=1e-5)


def test_chances_are_a_gaussians_but_for_a_constant():
    actions, mean = torch.randn((2, 7, 3), generator=torch.Generator().manual_seed(0))
    log_std = torch.tensor([-1.0, 0.0, 0.5])
    density = torch.distributions.Normal(mean, log_std.exp()).log_prob(actions).sum(-1)
    apart = density - chances(actions, mean, log_std)
    torch.testing.assert_close(apart, torch.full((7,), -1.5 * np.log(2.0 * np.pi)))


@pytest.mark.parametrize("units", ACTIVATIONS)
@pytest.mark.parametrize("scene", ["level", "push-off"])
def test_the_gradient_is_that_of_the_loss_by_autograd(scene, units):
    """Two derivations: written out, and by autograd from the printed loss."""
    _, model, _ = made(scene, policy_kwargs={"activation_fn": f"nn.{units}", "net_arch": [16, 9]})
    net, torques = model.policy, len(model.policy.log_std)
    generator = torch.Generator().manual_seed(0)
    seen, actions, before, gains, returns = (
        torch.randn((200, width), generator=generator) for width in (8, torques, 1, 1, 1)
    )
    actions = 0.3 * actions
    with torch.no_grad():
        before = 0.2 * before + chances(actions, torch.zeros(torques), net.log_std)[:, None]
        model.differentiate(seen, actions, before, gains, returns)
    mean = net.action_net(net.mlp_extractor.policy_net(seen))
    ratio = torch.exp(chances(actions, mean, net.log_std)[:, None] - before)
    near = ratio.clamp(1.0 - model.clip_range, 1.0 + model.clip_range)
    assert 20 < (ratio == near).sum() < 180  # some went too far already
    gain = torch.min(gains * ratio, gains * near).mean()
    expected = net.value_net(net.mlp_extractor.value_net(seen))
    loss = model.vf_coef * (expected - returns).square().mean() - gain
    by_torch = torch.autograd.grad(loss, list(net.parameters()))
    torch.testing.assert_close(
        model.gradient, torch.cat([x.flatten() for x in by_torch]), rtol=1e-4, atol=1e-6
    )


@pytest.mark.parametrize("scene", ["level", "steep", "push-off"])
def test_a_rollout_is_the_walk_that_the_library_would_have_seen(scene):
    """For equal actions: observations, ends of episodes, and moments of the normalizer."""
    config, model, callback = made(scene)
    ours, theirs = (
        model.get_vec_normalize_env(),
        build(
            config, envs.training_envs(config), n_steps=100, batch_size=200
        ).get_vec_normalize_env(),
    )
    first = theirs.reset()
    rollout = model.walk(callback)
    np.testing.assert_allclose(rollout.seen[0], first, atol=1e-5)
    for actions in rollout.actions.numpy():
        theirs.step(actions.clip(-1.0, 1.0))
    np.testing.assert_array_equal(model._last_obs, theirs.get_original_obs())
    for name in ("obs_rms", "ret_rms"):
        for key in ("mean", "var", "count"):
            found = [np.asarray(getattr(getattr(env, name), key)) for env in (ours, theirs)]
            np.testing.assert_allclose(*found, rtol=1e-5, atol=1e-6, err_msg=f"{name}.{key}")
    np.testing.assert_allclose(ours.returns, theirs.returns, rtol=1e-5, atol=1e-6)


def test_without_the_extra_for_devices_the_processor_carries_walkers(monkeypatch):
    monkeypatch.setitem(sys.modules, "gym_passive_walker.devices.gpu.environment", None)
    env = PassiveWalkerVecEnv(2, "level")
    walkers = carried(env, torch.device("cuda"))
    assert type(walkers) is PassiveWalkerTorchEnv and walkers.envs is env.envs


class OnGpu:
    """Walkers of their own beside those of the environments, as a GPU has them."""

    def __init__(self, walkers):
        self.scene, self.inner = walkers.scene, PassiveWalkerTorchEnv(8, walkers.scene)
        self.set_energy_cost, self.step = self.inner.set_energy_cost, self.inner.step

    def reset(self, seed):
        """Begin."""
        return self.inner.reset(seed=seed % 1000)


@pytest.mark.parametrize("beside", [False, True])
def test_a_scene_that_a_callback_sets_holds_in_the_next_rollout(beside, monkeypatch):
    if beside:
        monkeypatch.setattr("agents.ppo_fast.carried", lambda walkers, device: OnGpu(walkers))
    _, model, callback = made()
    model.walk(callback)
    model.env.unwrapped.set_scene(slope=0.01, energy="net")
    model.walk(callback)
    walking = model.walkers.inner if beside else model.walkers
    assert walking.scene.slope == 0.01 and walking.envs.energy_cost == "net"


@pytest.mark.parametrize("own", [{"walkers": ["C", "lab"]}, {"slopes": [0.0, 0.01]}])
def test_walkers_and_slopes_of_each_environment_stay_on_the_cpu(own, monkeypatch):
    cuda, here = SimpleNamespace(is_available=lambda: True), "gym_passive_walker.devices.gpu."
    monkeypatch.setitem(sys.modules, here + "device", SimpleNamespace(cuda=cuda))
    monkeypatch.setitem(sys.modules, here + "environment", SimpleNamespace(PassiveWalkerGpuEnv=0))
    env = PassiveWalkerVecEnv(2, "level", **own)
    assert carried(env, torch.device("cuda")).envs is env.envs


def test_a_file_is_loaded_as_those_of_the_library_are(tmp_path):
    """With fewer environments than the default batch needs, and without any."""
    envs = PassiveWalkerVecEnv(4)
    model = FastPPO("MlpPolicy", envs, n_steps=8, batch_size=16, seed=0)
    model.learn(32)
    model.save(tmp_path / "model.zip")
    seen = np.full((3, 8), 0.1, np.float32)
    for env in (None, envs):
        found = FastPPO.load(tmp_path / "model.zip", env=env)
        np.testing.assert_array_equal(
            *(x.predict(seen, deterministic=True)[0] for x in (model, found))
        )
    assert found.learn(32).num_timesteps == 32


@pytest.mark.parametrize("of", [FastPPO, SHAC, LearnedSHAC])
@pytest.mark.parametrize("envs", [
    lambda: "PassiveWalker-v0", lambda: VecFrameStack(PassiveWalkerVecEnv(2), 2),
    lambda: VecCheckNan(PassiveWalkerVecEnv(2)),
])  # fmt: skip
def test_walkers_are_refused_in_wrappers_that_their_steps_would_pass_by(of, envs):
    with pytest.raises(TypeError, match="a PassiveWalkerVecEnv, alone or in VecNormalize, not"):
        of("MlpPolicy", envs(), n_steps=8, batch_size=8)


def test_an_activation_without_a_derivative_is_refused_by_its_name():
    with pytest.raises(ValueError, match="activation GELU: choose from ReLU, Tanh, ELU, SiLU"):
        given = {"policy_kwargs": {"activation_fn": torch.nn.GELU}}
        FastPPO("MlpPolicy", PassiveWalkerVecEnv(2), n_steps=8, batch_size=8, **given)
