"""The environments for trainers have the interfaces of their libraries."""

from __future__ import annotations

import numpy as np
import pytest

torch = pytest.importorskip("torch")


def reference(steps: list, seed: int, **given):
    """Rewards and endings of the same walkers in the vector environment."""
    from gym_passive_walker.envs.seeds import training_seeds
    from gym_passive_walker.envs.vector_env import PassiveWalkerVectorEnv

    envs = PassiveWalkerVectorEnv(8, autoreset_mode="SameStep", **given)
    envs.reset(seed=training_seeds(seed, 8))
    return [envs.step(actions.numpy())[:4] for actions in steps]


_RANDOM = torch.Generator().manual_seed(0)
ACTIONS = [2.0 * torch.rand((8, 1), generator=_RANDOM) - 1.0 for _ in range(150)]


def test_rsl_rl_gets_timeouts_apart_from_falls():
    pytest.importorskip("rsl_rl")
    from gym_passive_walker.torch.trainers.rsl_rl import RslRlWalkers

    envs = RslRlWalkers(8, max_episode_steps=45, seed=1, reset_noise_scale=0.2)
    late = fallen = 0
    for actions, expected in zip(
        ACTIONS, reference(ACTIONS, 1, max_episode_steps=45, reset_noise_scale=0.2), strict=True
    ):
        observations, rewards, dones, extras = envs.step(actions)
        np.testing.assert_array_equal(observations["policy"], expected[0])
        np.testing.assert_array_equal(rewards, expected[1].astype(np.float32))
        np.testing.assert_array_equal(dones.bool(), expected[2] | expected[3])
        np.testing.assert_array_equal(extras["time_outs"], expected[3] & ~expected[2])
        assert (envs.episode_length_buf[dones.bool()] == 0).all()
        assert (envs.episode_length_buf < 45).all()
        late, fallen = late + int(extras["time_outs"].sum()), fallen + int(expected[2].sum())
    assert late and fallen
    for none in (None, -1):  # rsl_rl draws steps below the limit
        with pytest.raises(ValueError, match="max_episode_steps must be a whole number from 1"):
            RslRlWalkers(8, max_episode_steps=none)


def test_rsl_rl_trains(rsl_rl_configuration):
    pytest.importorskip("rsl_rl")
    from rsl_rl.runners import OnPolicyRunner

    from gym_passive_walker.torch.trainers.rsl_rl import RslRlWalkers

    OnPolicyRunner(RslRlWalkers(8, seed=0), rsl_rl_configuration).learn(2)


def test_a_training_of_rsl_rl_that_begins_within_episodes_meets_its_time_limits_apart(
    rsl_rl_configuration, monkeypatch
):
    pytest.importorskip("rsl_rl")
    from rsl_rl.runners import OnPolicyRunner

    from gym_passive_walker.torch.trainers.rsl_rl import RslRlWalkers

    envs = RslRlWalkers(8, seed=0, max_episode_steps=40, reset_noise_scale=0.0)
    step, late = envs.step, []

    def stepped(actions):  # none falls so soon
        found = step(0.0 * actions)
        late.append(found[3]["time_outs"].nonzero()[:, 0].tolist())
        return found

    monkeypatch.setattr(envs, "step", stepped)
    OnPolicyRunner(envs, rsl_rl_configuration).learn(1, init_at_random_ep_len=True)
    first = {walker: k for k, walkers in reversed([*enumerate(late)]) for walker in walkers}
    assert first.keys() == set(range(8)) and max(first.values()) < 40
    assert len({*first.values()}) >= 5


def test_skrl_finds_columns_and_begins_once():
    pytest.importorskip("skrl")
    from gym_passive_walker.torch.trainers.skrl import SkrlWalkers

    envs = SkrlWalkers(8, max_episode_steps=45, seed=1, reset_noise_scale=0.2)
    first, _ = envs.reset()
    for actions, expected in zip(
        ACTIONS, reference(ACTIONS, 1, max_episode_steps=45, reset_noise_scale=0.2), strict=True
    ):
        found = envs.step(actions)
        np.testing.assert_array_equal(found[0], expected[0])
        for column, values in zip(found[1:4], expected[1:4], strict=True):
            np.testing.assert_array_equal(column[:, 0], values.astype(column.numpy().dtype))
        assert torch.equal(envs.reset()[0], found[0])  # they go on
    assert first.shape == (8, 8)


def test_torchrl_finds_its_specifications_met():
    pytest.importorskip("torchrl")
    from torchrl.envs.utils import check_env_specs

    from gym_passive_walker.torch.trainers.torchrl import TorchRlWalkers

    check_env_specs(TorchRlWalkers(8, seed=0))
    envs = TorchRlWalkers(8, seed=1, max_episode_steps=45, reset_noise_scale=0.2)
    rollout = envs.rollout(150, break_when_any_done=False)
    done, late = rollout["next", "done"], rollout["next", "truncated"]
    assert late.any() and rollout["next", "terminated"].any()
    assert (done == (late | rollout["next", "terminated"])).all()
    begins = rollout["observation"][:, 1:][done[:, :-1, 0]]
    ends = rollout["next", "observation"][:, :-1][done[:, :-1, 0]]
    assert not (begins == ends).all(dim=1).any()  # a new episode, and the last one's end is kept


def test_a_seed_of_torchrl_s_is_of_the_first_reset_alone():
    pytest.importorskip("torchrl")
    from gym_passive_walker.torch.trainers.torchrl import TorchRlWalkers

    envs, again = (TorchRlWalkers(4, seed=1, reset_noise_scale=0.2) for _ in range(2))
    first, second = (envs.reset()["observation"] for _ in range(2))
    assert torch.equal(first, again.reset()["observation"])
    assert not torch.equal(first, second)
