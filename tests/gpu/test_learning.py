"""PPO on tensors with its walkers on the device: what it sees, and what it never waits for."""

import dataclasses
from contextlib import ExitStack

import numpy as np
import pytest

torch = pytest.importorskip("torch")
pytest.importorskip("stable_baselines3")

from torch.utils._python_dispatch import TorchDispatchMode  # noqa: E402

from agents import envs, ppo_fast  # noqa: E402
from agents.config import configure  # noqa: E402
from agents.learner import build  # noqa: E402
from gym_passive_walker.devices.gpu.environment import PassiveWalkerGpuEnv  # noqa: E402

COUNT, STEPS = 2, 8


@pytest.fixture
def learner(monkeypatch):
    """An untrained agent on the simulated device, before its first step."""
    device, usual = torch.device("cuda"), ppo_fast.carried
    monkeypatch.setattr(ppo_fast, "carried", lambda walkers, _: usual(walkers, device))
    config = dataclasses.replace(
        configure("ppo-fast", "level", n_envs=COUNT, seed=3), episode_steps=5
    )
    model = build(config, envs.training_envs(config), n_steps=STEPS, batch_size=8, n_epochs=1)
    _, callback = model._setup_learn(1, None)
    return model, callback


class NothingComesBack(TorchDispatchMode):
    """Refuses what would have to wait for the device: numbers of tensors, and rows by masks."""

    def __torch_dispatch__(self, func, types, args=(), kwargs=None):
        assert func.overloadpacket not in {
            torch.ops.aten._local_scalar_dense,
            torch.ops.aten.nonzero,
            torch.ops.aten.masked_select,
        }, f"{func} waits for the device"
        return func(*args, **(kwargs or {}))


def test_a_rollout_is_the_walk_of_a_batch_on_the_device(learner, monkeypatch):
    """The same scene, keys, limit of steps and actions: the same observations and rewards."""
    model, callback = learner
    many = PassiveWalkerGpuEnv(COUNT, model.env.unwrapped.scene, max_episode_steps=5)
    many.set_energy_cost("positive")
    model.env.env_method("set_energy_cost", "positive")
    seen, _ = many.reset(seed=3 << 32)
    np.testing.assert_array_equal(model._last_obs, seen)
    rewards, scales = [], model._learn_scales
    model._learn_scales = lambda raw, paid, ended: (rewards.append(paid), scales(raw, paid, ended))[
        1
    ]
    scaled = model._scaling()
    rollout = model.walk(callback)
    for t in range(STEPS):
        torch.testing.assert_close(rollout.seen[t], scaled(seen))
        seen, paid, *_ = many.step(rollout.actions[t].clamp(-1.0, 1.0))
        torch.testing.assert_close(rewards[0][t], paid.float())
    np.testing.assert_array_equal(model._last_obs, seen)


def test_nothing_comes_from_the_device_while_walkers_walk(learner, monkeypatch):
    model, callback = learner
    with ExitStack() as silence:

        def begin():
            silence.enter_context(NothingComesBack())
            closed = silence.enter_context(pytest.MonkeyPatch.context())
            for entry_point in ("cpu", "numpy", "tolist"):
                closed.setattr(torch.Tensor, entry_point, None)

        monkeypatch.setattr(callback, "on_rollout_start", begin)
        monkeypatch.setattr(callback, "on_rollout_end", silence.close)
        rollout = model.walk(callback)
    assert rollout.seen.shape == (STEPS, COUNT, 8)


def test_it_learns_from_what_it_saw(learner):
    model, callback = learner
    before = torch.cat([x.detach().flatten() for x in model.policy.parameters()])
    model.update(model.walk(callback))
    after = torch.cat([x.detach().flatten() for x in model.policy.parameters()])
    assert torch.isfinite(after).all()
    assert not torch.equal(before, after)
    assert model.num_timesteps == STEPS * COUNT
