"""Tasks that are not built in: libraries accept them, and their optima are known."""

import warnings

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import gym_passive_walker as gpw
from examples import own_tasks
from gym_passive_walker.envs.vector_env import PassiveWalkerVectorEnv
from gym_passive_walker.gaits.control.stride_reward import StrideReward
from gym_passive_walker.gaits.scenes.scene import make_scene

TASKS = pytest.mark.parametrize("name", own_tasks.TASKS)


def made(name):
    return gymnasium.make("PassiveWalker-v0", **own_tasks.TASKS[name]())


@TASKS
@pytest.mark.filterwarnings("ignore:.*A Box observation space")  # angles without bounds
def test_gymnasium_accepts_the_task(name):
    check_env(made(name).unwrapped, skip_render_check=True)


@TASKS
@pytest.mark.filterwarnings("ignore:We recommend you to use a symmetric")  # a push-off has a sign
def test_stable_baselines3_accepts_the_task(name):
    checker = pytest.importorskip("stable_baselines3.common.env_checker")
    checker.check_env(made(name))


@TASKS
def test_torchrl_accepts_the_task(name):
    pytest.importorskip("torchrl")
    from torchrl.envs.utils import check_env_specs

    from gym_passive_walker.torch.trainers.torchrl import TorchRlWalkers

    check_env_specs(TorchRlWalkers(4, seed=0, **own_tasks.TASKS[name]()))


@TASKS
def test_the_reward_is_compiled_for_the_environment_and_smooth_but_for_its_known_parts(name):
    scene = make_scene(own_tasks.TASKS[name]())
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # of a reward that is not compiled
        PassiveWalkerVectorEnv(1, scene)
    if name == "tracking":
        with pytest.raises(ValueError, match=r"step\.time, which grows"):
            StrideReward(scene, scene.reward)
    else:
        assert not StrideReward(scene, scene.reward).corner


def test_the_target_speed_varies_slowly_about_its_mean():
    times = np.linspace(0.0, own_tasks.PERIOD, 101)[:-1]
    speeds = own_tasks.target(times)
    assert speeds.mean() == pytest.approx(own_tasks.MEAN)
    assert np.ptp(speeds) == pytest.approx(2.0 * own_tasks.AMPLITUDE, rel=1e-2)
    per_stride = 3.0 * np.gradient(speeds, times)  # of a stride's time, and less
    assert np.abs(per_stride).max() < 0.1 * own_tasks.AMPLITUDE


def test_the_optimum_of_a_varying_speed_is_the_mean_over_constant_speeds(monkeypatch):
    asked = []

    class Gait:
        reward_per_control_step = 1.0

    def found(scene, *, reward, time_limit):
        asked.append((scene, reward, time_limit))
        return Gait

    monkeypatch.setattr(gpw, "optimal_gait", found)
    assert own_tasks.optimum("tracking", time_limit=9.0) == 1.0
    assert len(asked) == own_tasks.TARGETS and {limit for *_, limit in asked} == {9.0}
    assert "terrain" not in asked[0][0] and asked[0][0].items() <= own_tasks.tracking().items()
    paid = {round(reward(stride(0.5, 2.5)), 9) for _, reward, _ in asked}
    assert len(paid) == 2  # a sine has each speed twice


def stride(length, period):
    """A step that ends a stride, with no work."""
    numbers = dict.fromkeys(gpw.Transition._fields, 0.0)
    given = {"step_length": length, "step_period": period, "heelstrike": True, "distance": 0.1}
    return gpw.Transition(**numbers | given)


@pytest.mark.parametrize(("error", "lost"), [(0.0, 0.0), (0.1, 0.2)])
def test_a_stride_that_is_too_long_for_the_speed_loses_the_square_of_that(error, lost):
    step = stride(0.2 * 2.5 + error, 2.5)
    assert own_tasks.at_speed(step, 0.2) == pytest.approx(0.1 - lost)
