"""The environments for trainers pass on every option, seed, unit and shape."""

from __future__ import annotations

from importlib import import_module

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from gym_passive_walker.envs.seeds import training_seeds  # noqa: E402
from gym_passive_walker.envs.vector_env import PassiveWalkerVectorEnv  # noqa: E402

SCENE = {"scene": "lab", "slope": 0.03, "reset_noise_scale": 0.2}


def begun(count, seed, **changes):
    """First observations of the walkers of a training, in the vector environment."""
    seeds = training_seeds(seed, count)
    return PassiveWalkerVectorEnv(count, **(SCENE | changes)).reset(seed=seeds)[0]


def test_rsl_rl_s_walkers_have_their_options_and_count_their_steps():
    pytest.importorskip("rsl_rl")
    from gym_passive_walker.torch.trainers.rsl_rl import RslRlWalkers

    envs = RslRlWalkers(3, max_episode_steps=9, seed=4, **SCENE)
    assert (envs.num_envs, envs.num_actions, envs.max_episode_length) == (3, 1, 9)
    assert envs.cfg == {"seed": 4, **SCENE} and envs.device == torch.device("cpu")
    found = envs.get_observations()
    np.testing.assert_array_equal(found["policy"], begun(3, 4))
    assert found.batch_size == (3,) and envs.episode_length_buf.tolist() == [0, 0, 0]
    twin = PassiveWalkerVectorEnv(3, max_episode_steps=9, autoreset_mode="SameStep", **SCENE)
    twin.reset(seed=training_seeds(4, 3))
    for k in range(1, 19):
        seen, rewards, dones, extras = envs.step(torch.full((3, 1), 0.1))
        wanted = twin.step(np.full((3, 1), 0.1, np.float32))
        assert (rewards.dtype, dones.dtype) == (torch.float32, torch.long)
        assert rewards.shape == dones.shape == extras["time_outs"].shape == (3,)
        assert torch.equal(envs.get_observations()["policy"], seen["policy"])
        over = dones.bool()
        assert envs.episode_length_buf[~over].tolist() == [k % 9] * int((~over).sum())
        assert ("log" in extras) == bool(over.any())
        if over.any():
            last = wanted[4]["final_info"]["episode_distance"][over.numpy()]
            np.testing.assert_array_equal(extras["log"]["/distance"], last)
    assert over.all()


@pytest.mark.parametrize("write", ["in place", "another tensor"])
def test_the_number_of_steps_that_is_written_into_rsl_rl_s_buffer_is_that_of_the_walkers(write):
    pytest.importorskip("rsl_rl")
    from gym_passive_walker.torch.trainers.rsl_rl import RslRlWalkers

    envs = RslRlWalkers(4, max_episode_steps=20, seed=4, **SCENE)
    for _ in range(2):  # at the beginning, and later
        counts = torch.tensor([0, 19, 12, 5])
        if write == "in place":
            envs.episode_length_buf[:] = counts
        else:
            envs.episode_length_buf = counts
        for k in range(1, 8):
            extras = envs.step(torch.zeros(4, 1))[3]
            assert extras["time_outs"].tolist() == [False, k == 1, False, False]
            assert envs.episode_length_buf.tolist() == [k, k - 1, 12 + k, 5 + k]
            np.testing.assert_array_equal(envs.walkers.elapsed_steps, envs.episode_length_buf)
        extras = envs.step(torch.zeros(4, 1))[3]
        assert extras["time_outs"].tolist() == [False, False, True, False]
    for wrong in ([0, 1, 2], [0, 1, 2, 20], [0, 1, 2, -1], [0.0, 1.0, 2.0, 3.0]):
        envs.episode_length_buf = torch.tensor(wrong)
        with pytest.raises(ValueError, match="steps must be"):
            envs.step(torch.zeros(4, 1))


@pytest.mark.parametrize(
    ("library", "name"),
    [("rsl_rl", "RslRlWalkers"), ("skrl", "SkrlWalkers"), ("torchrl", "TorchRlWalkers")],
)
def test_trainings_with_other_seeds_have_other_walkers_and_no_evaluation_s(library, name):
    pytest.importorskip(library)
    made = getattr(import_module(f"gym_passive_walker.torch.trainers.{library}"), name)
    evaluated = PassiveWalkerVectorEnv(128, **SCENE).reset(seed=1000)[0]
    met = [{*map(tuple, evaluated.tolist())}]
    for seed in (1, 2, 1000):
        envs = made(8, seed=seed, **SCENE)
        envs.reset() if hasattr(envs, "reset") else None
        inner = getattr(envs, "walkers", None) or envs._env
        seen = inner.envs.batch.observe()
        met.append({*map(tuple, seen.tolist())})
    assert len(set.union(*met)) == sum(map(len, met)) == 128 + 3 * 8


@pytest.mark.parametrize(
    ("library", "name"),
    [("rsl_rl", "RslRlWalkers"), ("skrl", "SkrlWalkers"), ("torchrl", "TorchRlWalkers")],
)
def test_a_trainer_s_walkers_are_reset_as_it_expects(library, name):
    """In "NextStep" steps of a reset would be taken for transitions."""
    pytest.importorskip(library)
    walkers = getattr(import_module(f"gym_passive_walker.torch.trainers.{library}"), name)
    with pytest.raises(ValueError, match="autoreset_mode is the one that the trainer expects"):
        walkers(2, autoreset_mode="NextStep")


def test_rsl_rl_s_walkers_may_be_of_another_class():
    pytest.importorskip("rsl_rl")
    from gym_passive_walker.torch import PassiveWalkerTorchEnv
    from gym_passive_walker.torch.trainers.rsl_rl import RslRlWalkers

    made = []

    def envs(count, **given):
        made.append((count, given))
        return PassiveWalkerTorchEnv(count, **given)

    RslRlWalkers(2, envs=envs, max_episode_steps=5, **SCENE)
    assert made == [(2, {"max_episode_steps": 5, **SCENE})]


def test_skrl_s_walkers_begin_with_their_seed_once():
    pytest.importorskip("skrl")
    from gym_passive_walker.torch.trainers.skrl import SkrlWalkers

    envs = SkrlWalkers(3, seed=6, **SCENE)
    first, infos = envs.reset()
    np.testing.assert_array_equal(first, begun(3, 6))
    assert infos == {} and envs.reset()[0] is first
    seen, rewards, fell, late, infos = envs.step(torch.zeros(3, 1))
    assert rewards.shape == fell.shape == late.shape == (3, 1)
    assert (rewards.dtype, fell.dtype, late.dtype) == (torch.float32, torch.bool, torch.bool)
    assert {"episode_distance", "distance"} <= infos.keys()
    assert envs.reset()[0] is seen and envs.num_envs == 3
    assert envs.state() is None and envs.render() is None
    envs.close()


def test_torchrl_s_walkers_are_reset_where_the_mask_says_with_their_own_next_start():
    pytest.importorskip("torchrl")
    from tensordict import TensorDict

    from gym_passive_walker.torch.trainers.torchrl import TorchRlWalkers

    envs = TorchRlWalkers(3, seed=2, **SCENE)
    twin = PassiveWalkerVectorEnv(3, autoreset_mode="Disabled", **SCENE)
    np.testing.assert_array_equal(envs.reset()["observation"], begun(3, 2))
    twin.reset(seed=training_seeds(2, 3))
    act = np.full((3, 1), 0.2, np.float32)
    found = envs.step(TensorDict({"action": torch.from_numpy(act)}, batch_size=[3]))["next"]
    seen, rewards, *_ = twin.step(act)
    np.testing.assert_array_equal(found["observation"], seen)
    np.testing.assert_array_equal(found["reward"], rewards.astype(np.float32)[:, None])
    for name in ("terminated", "truncated", "done"):
        assert found[name].shape == (3, 1) and not found[name].any()
    mask = np.array([False, True, False])
    given = TensorDict({"_reset": torch.from_numpy(mask)[:, None]}, batch_size=[3])
    again = envs._reset(given)["observation"]
    np.testing.assert_array_equal(again, twin.reset(options={"reset_mask": mask})[0])
    np.testing.assert_array_equal(again[~mask], seen[~mask])
    envs.set_seed(9)
    np.testing.assert_array_equal(envs.reset()["observation"], begun(3, 9))


def test_torchrl_s_specifications_are_those_of_the_scene():
    pytest.importorskip("torchrl")
    from gym_passive_walker.torch.trainers.torchrl import TorchRlWalkers

    envs = TorchRlWalkers(2, scene="rough")
    space = PassiveWalkerVectorEnv(2, "rough").single_observation_space
    spec = envs.observation_spec["observation"]
    for i in range(2):
        np.testing.assert_array_equal(spec.space.low[i], space.low)
        np.testing.assert_array_equal(spec.space.high[i], space.high)
    assert envs.action_spec.shape == (2, 1) and envs.reward_spec.shape == (2, 1)
    assert float(envs.action_spec.space.low.min()) == -1.0
    assert float(envs.action_spec.space.high.max()) == 1.0
    assert set(envs.full_done_spec.keys()) == {"done", "terminated", "truncated"}
