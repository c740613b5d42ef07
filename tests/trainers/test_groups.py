"""Trainers get what the actor and what the critic see, apart."""

from __future__ import annotations

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from gym_passive_walker.envs.seeds import training_seeds  # noqa: E402
from gym_passive_walker.envs.vector_env import PassiveWalkerVectorEnv  # noqa: E402
from gym_passive_walker.torch.environment import PassiveWalkerTorchEnv  # noqa: E402


def rates(step):
    state = step.state
    return state.stance, state.thigh, state.stance_rate, state.thigh_rate


SCENE = {
    "observation": {"policy": rates, "critic": ("default", "randomized")},
    "domain_randomization": {"foot_radius": 0.2},
}


def test_tensors_are_the_arrays_of_the_vector_environment():
    there = PassiveWalkerTorchEnv(3, SCENE, max_episode_steps=4)
    here = PassiveWalkerVectorEnv(3, SCENE, max_episode_steps=4, autoreset_mode="SameStep")
    (seen, _), (known, _) = (envs.reset(seed=2) for envs in (there, here))
    for k in range(9):
        for name in ("policy", "critic"):
            np.testing.assert_array_equal(seen[name], known[name])
        actions = torch.full((3, 1), 0.1 * k)
        seen, *_, info = there.step(actions)
        known, *_, infos = here.step(actions.numpy())
        if "final_obs" in infos:
            for name in ("policy", "critic"):
                last = np.stack([row[name] for row in infos["final_obs"]])
                np.testing.assert_array_equal(info["final_obs"][name], last)
        drawn = info["randomized"]["foot_radius"]
        assert drawn.shape == (3,) and (drawn > 0.0).all()


def test_rsl_rl_trains_a_critic_on_its_own_group(rsl_rl_configuration):
    pytest.importorskip("rsl_rl")
    from rsl_rl.runners import OnPolicyRunner

    from gym_passive_walker.torch.trainers.rsl_rl import RslRlWalkers

    envs = RslRlWalkers(8, seed=0, **SCENE)
    seen = envs.get_observations()
    assert seen["policy"].shape == (8, 4) and seen["critic"].shape == (8, 9)
    rsl_rl_configuration["obs_groups"] = {"actor": ["policy"], "critic": ["critic"]}
    runner = OnPolicyRunner(envs, rsl_rl_configuration)
    runner.learn(2)
    other = seen.clone()
    other["critic"] = seen["critic"] + 1.0
    act, value = runner.get_inference_policy(), runner.alg.critic
    with torch.no_grad():
        assert torch.equal(act(seen), act(other))
        assert not torch.isclose(value(seen), value(other)).any()


def test_torchrl_finds_its_specifications_met_by_each_group():
    pytest.importorskip("torchrl")
    from torchrl.envs.utils import check_env_specs

    from gym_passive_walker.torch.trainers.torchrl import TorchRlWalkers

    envs = TorchRlWalkers(4, seed=0, max_episode_steps=5, **SCENE)
    check_env_specs(envs)
    rollout = envs.rollout(12, break_when_any_done=False)
    assert rollout["policy"].shape == (4, 12, 4)
    assert rollout["next", "critic"].shape == (4, 12, 9)
    known = PassiveWalkerVectorEnv(4, SCENE).reset(seed=training_seeds(0, 4))[0]
    np.testing.assert_array_equal(
        TorchRlWalkers(4, seed=0, **SCENE).reset()["critic"], known["critic"]
    )


def test_skrl_gets_what_the_critic_sees_as_its_state():
    pytest.importorskip("skrl")
    from gym_passive_walker.torch.trainers.skrl import SkrlWalkers

    envs = SkrlWalkers(3, seed=1, **SCENE)
    assert envs.observation_space.shape == (4,) and envs.state_space.shape == (9,)
    seen, _ = envs.reset()
    assert seen.shape == (3, 4) and envs.state().shape == (3, 9)
    before = envs.state()
    seen, *_ = envs.step(torch.full((3, 1), 0.2))
    assert seen.shape == (3, 4) and not torch.equal(envs.state(), before)
    plain = SkrlWalkers(3, seed=1)
    plain.reset()
    assert plain.state_space is None and plain.state() is None
