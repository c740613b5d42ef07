"""Walkers on tensors equal those of the vector environment, with every training library."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from gym_passive_walker.envs.vector_env import PassiveWalkerVectorEnv
from gym_passive_walker.torch.environment import PassiveWalkerTorchEnv

MODES = ("NextStep", "SameStep", "Disabled")


def pair(mode: str, **given):
    """The same walkers, on tensors and on arrays, begun alike."""
    given = {"max_episode_steps": 40, "reset_noise_scale": 0.2, "autoreset_mode": mode} | given
    tensors, arrays = PassiveWalkerTorchEnv(12, **given), PassiveWalkerVectorEnv(12, **given)
    observed, _ = tensors.reset(seed=3)
    np.testing.assert_array_equal(observed, arrays.reset(seed=3)[0])
    return tensors, arrays


def test_tensors_share_the_environments_memory():
    tensors = PassiveWalkerTorchEnv(4)
    made = []
    step = tensors.envs.step

    def watched(actions):
        made.append(step(actions))
        return made[-1]

    tensors.envs.step = watched
    tensors.reset(seed=0)
    found = tensors.step(torch.zeros(4, 1))
    for tensor, array in zip(found[:4], made[0][:4], strict=True):
        assert tensor.data_ptr() == array.ctypes.data


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
def test_infos_of_the_last_step_before_another_scene_are_of_the_scene_before(mode):
    tensors, _ = pair(mode, pushes={"rate": 0.1, "impulse": 0.01}, reset_noise_scale=0.0)
    for pushes in ({}, {"rate": 0.1, "impulse": 0.01}):
        tensors.set_scene(pushes=pushes)
        *_, truncated, infos = tensors.step(torch.zeros(12, 1))
        assert truncated.all() and ("pushes" in infos) == (pushes == {})
        *_, truncated, infos = tensors.step(torch.zeros(12, 1))
        assert not truncated.any() and ("pushes" in infos) == (pushes != {})


def test_a_state_put_back_walks_on_alike():
    tensors, _ = pair("SameStep")
    actions = torch.full((12, 1), 0.3)
    tensors.step(actions)
    kept = tensors.get_state()
    first = [tensors.step(actions)[0] for _ in range(60)]
    tensors.set_state(kept)
    for observed in first:
        assert torch.equal(tensors.step(actions)[0], observed)
