"""Tensors on the device: what learners get from a batch."""

import re
from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from gym_passive_walker.devices.gpu.environment import PassiveWalkerGpuEnv  # noqa: E402
from gym_passive_walker.envs.explain import as_text  # noqa: E402
from gym_passive_walker.envs.vector_env import PassiveWalkerVectorEnv  # noqa: E402
from gym_passive_walker.gaits.scenes.starts import Starts  # noqa: E402
from gym_passive_walker.models.model import bodies  # noqa: E402
from gym_passive_walker.torch.environment import PassiveWalkerTorchEnv  # noqa: E402

SCENE = {"slope": 0.03, "tick": 0.6, "command": (0.1, 0.2)}


def test_the_code_on_the_page_runs():
    page = Path(__file__).parents[2] / "docs" / "gpu.md"
    (code,) = re.findall(r"```py\n(.*?)```", page.read_text(encoding="utf-8"), re.S)
    names: dict = {}
    exec(compile(code.replace("65_536", "2"), page.name, "exec"), names)
    assert names["observations"].shape == (2, 8)
    expected = names["gpw"].stride("C", 0.036, names["states"])
    np.testing.assert_array_equal(names["result"].state, expected.state)


def test_results_of_a_step_do_not_change_afterwards():
    there = PassiveWalkerGpuEnv(2, SCENE)
    seen, _ = there.reset()
    before = seen.clone()
    first = there.step(torch.zeros(2, 1))
    kept = first[1].clone(), first[4]["episode_distance"].clone()
    there.step(torch.ones(2, 1))
    assert torch.equal(seen, before)
    assert torch.equal(first[1], kept[0])
    assert torch.equal(first[4]["episode_distance"], kept[1])


def test_a_seed_begins_all_over():
    there = PassiveWalkerGpuEnv(3, SCENE, seed=5)
    first, _ = there.reset()
    second, _ = there.reset()
    again, _ = there.reset(seed=5)
    assert not torch.equal(first, second)
    assert torch.equal(first, again)


def test_spaces_are_those_of_the_other_environments():
    there = PassiveWalkerGpuEnv(3, SCENE)
    assert there.observation_space.shape == (9,)
    assert there.action_space.shape == (1,)


def test_a_pool_has_the_walkers_of_the_other_environments():
    scene = SCENE | {"domain_randomization": {"foot_radius": 0.2}, "randomization_pool": 3}
    there, here = PassiveWalkerGpuEnv(2, scene), PassiveWalkerVectorEnv(64, scene)
    here.reset(seed=0)
    pool = [Starts(there.batch.scene).randomization.member(k) for k in range(3)]
    walkers = [each.walker for each in pool]
    assert len(walkers) == 3 and {*walkers} == {*here.batch.walkers}
    there.reset()
    constants = bodies(*walkers)[:, 0]  # readings of checks are behind them
    found = np.asarray(there.batch.arrays.bodies)[: constants.shape[1]].T
    assert all((own == constants).all(axis=1).any() for own in found)


def test_infos_have_the_draws_of_the_step_s_own_episode():
    scene = SCENE | {"domain_randomization": {"foot_radius": 0.2, "max_hip_torque": (0.5, 1.0)}}
    there = PassiveWalkerGpuEnv(2, scene | {"randomization_pool": 9}, max_episode_steps=2, seed=4)
    here = PassiveWalkerTorchEnv(2, there.batch.scene, max_episode_steps=2)
    _, info = there.reset()
    _, known = here.reset(seed=4)
    for _ in range(5):
        assert {*info["randomized"]} == {"foot_radius", "max_hip_torque"}
        for name, x in info["randomized"].items():
            assert torch.equal(x, known["randomized"][name])
        info, known = (each.step(torch.zeros(2, 1))[4] for each in (there, here))


def test_infos_lack_the_entries_of_disturbances_alone():
    scene = SCENE | {"pushes": {"rate": 1.0, "impulse": 0.001}}
    there, here = PassiveWalkerGpuEnv(1, scene), PassiveWalkerTorchEnv(1, scene)
    for envs in (there, here):
        envs.reset(seed=0)
    found, known = (envs.step(torch.zeros(1, 1))[4] for envs in (there, here))
    assert {*known} - {*found} == {"command", "pushes", "push_work", "episode_push_work"}
    assert {*found} <= {*known}


def test_its_scene_is_explained():
    there = PassiveWalkerGpuEnv(2, SCENE, max_episode_steps=7)
    here = PassiveWalkerVectorEnv(2, SCENE, max_episode_steps=7)
    assert as_text(there) == as_text(here)


def test_motors_charged_for_other_work_are_those_of_a_scene_that_says_so():
    usual, results, other = (
        PassiveWalkerGpuEnv(2, {**SCENE, "energy": energy})
        for energy in ("absolute", "absolute", "net")
    )
    results.set_energy_cost("net")
    for envs in (usual, results, other):
        envs.reset()
    rewards = [
        torch.stack([envs.step(torch.full((2, 1), 0.5))[1] for _ in range(6)])
        for envs in (usual, results, other)
    ]
    assert torch.equal(rewards[1], rewards[2])
    assert not torch.equal(rewards[0], rewards[1])
    results.set_energy_cost(None)
    usual.reset(seed=1), results.reset(seed=1)
    actions = torch.full((2, 1), 0.5)
    for _ in range(4):
        assert torch.equal(usual.step(actions)[1], results.step(actions)[1])


def test_a_second_thread_is_refused_while_the_first_is_at_work():
    env = PassiveWalkerGpuEnv(2, SCENE)
    env.reset()
    env.token.pop()  # as a thread at work has done
    for call in (
        env.reset,
        lambda: env.step(torch.zeros(2, 1)),
        lambda: env.set_energy_cost("net"),
    ):
        with pytest.raises(RuntimeError, match="another thread is using this PassiveWalkerGpuEnv"):
            call()
    env.token.append(None)
    env.step(torch.zeros(2, 1))


def test_episodes_end_in_time_whatever_motors_are_charged_for():
    env = PassiveWalkerGpuEnv(2, SCENE, max_episode_steps=3)
    env.reset()
    env.set_energy_cost("positive")
    late = [env.step(torch.zeros(2, 1))[3] for _ in range(3)]
    assert late[-1].all() and not torch.stack(late[:-1]).any()


def test_steps_that_have_elapsed_are_set_and_counted_by_the_time_limit():
    there = PassiveWalkerGpuEnv(3, SCENE, max_episode_steps=5)
    there.reset()
    there.set_elapsed_steps(torch.tensor([0, 4, 3]))
    assert there.elapsed_steps.tolist() == [0, 4, 3]
    late = [there.step(torch.zeros(3, 1))[3].tolist() for _ in range(2)]
    assert late == [[False, True, False], [False, False, True]]
    assert there.elapsed_steps.tolist() == [2, 1, 0]
    with pytest.raises(ValueError, match="below the time limit, 5"):
        there.set_elapsed_steps(torch.tensor([0, 0, 5]))


def test_each_walker_may_have_a_seed_of_its_own():
    there, other = PassiveWalkerGpuEnv(3, SCENE), PassiveWalkerGpuEnv(3, SCENE)
    np.testing.assert_array_equal(there.reset(seed=[5, 6, 7])[0], other.reset(seed=5)[0])
    np.testing.assert_array_equal(
        there.reset(seed=[7, 2**63, 5])[0][[0, 2]], other.reset(seed=5)[0][[2, 0]]
    )
    with pytest.raises(ValueError, match="2 seeds for 3 walkers"):
        there.reset(seed=[1, 2])


def test_seeds_may_be_numbers_of_numpy_and_are_whole_numbers():
    there = PassiveWalkerGpuEnv(3, SCENE, seed=np.int64(5))  # type: ignore[arg-type]
    usual, _ = there.reset(seed=5)
    for seed in (np.int64(5), np.array(5), np.arange(5, 8), np.arange(5, 8, dtype=np.uint64)):
        assert torch.equal(there.reset(seed=seed)[0], usual)
    for seed in (-1, 2**64, 0.5, "a", [1, 2, -3]):
        with pytest.raises(ValueError, match=r"^seed(\[2\])? must be a whole number"):
            there.reset(seed=seed)  # type: ignore[arg-type]


@pytest.mark.parametrize("shape", [(2, 1), (2,), (4,), (1, 4), (4, 1)])
def test_actions_of_another_shape_are_refused(shape):
    there = PassiveWalkerGpuEnv(2, SCENE | {"actions": ("hip", "push_off")})
    there.reset()
    with pytest.raises(ValueError, match=r"actions must have shape \(2, 2\), not "):
        there.step(torch.zeros(shape))
