"""Walkers on tensors equal those of the vector environment, with every training library."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from gym_passive_walker.envs.vector_env import PassiveWalkerVectorEnv
from gym_passive_walker.physics.hybrid import Outcome
from gym_passive_walker.torch.environment import PassiveWalkerTorchEnv

MODES = ("NextStep", "SameStep", "Disabled")


def pair(mode: str, **given):
    """The same walkers, on tensors and on arrays, begun alike."""
    given = {"max_episode_steps": 40, "reset_noise_scale": 0.2, "autoreset_mode": mode} | given
    tensors, arrays = PassiveWalkerTorchEnv(12, **given), PassiveWalkerVectorEnv(12, **given)
    observed, _ = tensors.reset(seed=3)
    np.testing.assert_array_equal(observed, arrays.reset(seed=3)[0])
    return tensors, arrays


@pytest.mark.parametrize("mode", MODES)
def test_walks_are_those_of_the_vector_environment(mode):
    tensors, arrays = pair(mode)
    rng, endings = np.random.default_rng(0), 0
    for _ in range(150):
        actions = rng.uniform(-1.0, 1.0, (12, 1)).astype(np.float32)
        *found, _ = tensors.step(torch.from_numpy(actions))
        *expected, _ = arrays.step(actions)
        for a, b in zip(found, expected, strict=True):
            np.testing.assert_array_equal(a, b)
        over = expected[2] | expected[3]
        endings += over.sum()
        if mode == "Disabled" and over.any():
            again, _ = tensors.reset(options={"reset_mask": torch.from_numpy(over)})
            np.testing.assert_array_equal(again, arrays.reset(options={"reset_mask": over})[0])
    assert endings > 12


def test_an_episodes_last_observation_outlives_the_next_ones_beginning():
    tensors, arrays = pair("SameStep")
    rng, seen = np.random.default_rng(1), 0
    for _ in range(150):
        actions = rng.uniform(-1.0, 1.0, (12, 1))
        observed, _, fell, late, info = tensors.step(torch.from_numpy(actions))
        *_, expected = arrays.step(actions)
        over = (fell | late).numpy()
        if not over.any():
            assert "final_obs" not in info
            continue
        last = np.stack(expected["final_obs"][over])
        np.testing.assert_array_equal(info["final_obs"][over], last)
        np.testing.assert_array_equal(info["final_obs"][~over], observed[~over])
        assert not (info["final_obs"][over] == observed[over]).all(dim=1).any()
        seen += 1
    assert seen > 3


def test_falls_and_timeouts_differ_and_every_number_is_reported_for_each_walker():
    tensors, arrays = pair("SameStep", max_episode_steps=25)
    rng, given = np.random.default_rng(2), set()
    for _ in range(150):
        actions = rng.uniform(-1.0, 1.0, (12, 1))
        _, _, fell, late, info = tensors.step(torch.from_numpy(actions))
        *_, expected = arrays.step(actions)
        ended = {Outcome(i) for i in info.get("outcome", torch.zeros(12))[fell].tolist()}
        assert not ended & {Outcome.RUNNING, Outcome.HEELSTRIKE}
        given |= ended
        assert not (late & fell).any() or info["outcome"][late & fell].all()
        parts = [expected] + ([expected["final_info"]] if "final_info" in expected else [])
        for part in parts:
            for name, mask in part.items():
                if name.startswith("_") and name[1:] in info and name != "_outcome":
                    if mask.dtype == bool and name not in ("_final_obs", "_final_info"):
                        np.testing.assert_array_equal(info[name[1:]][mask], part[name[1:]][mask])
    assert given


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


def test_a_state_put_back_walks_on_alike():
    tensors, _ = pair("SameStep")
    actions = torch.full((12, 1), 0.3)
    tensors.step(actions)
    kept = tensors.get_state()
    first = [tensors.step(actions)[0] for _ in range(60)]
    tensors.set_state(kept)
    for observed in first:
        assert torch.equal(tensors.step(actions)[0], observed)
