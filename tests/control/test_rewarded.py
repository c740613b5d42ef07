"""Gaits of most reward: what the environment pays for them, and that nothing nearby earns more."""

import math
import re
from itertools import product

import numpy as np
import pytest

import gym_passive_walker as gpw
from gym_passive_walker.envs.vector_env import PassiveWalkerVectorEnv
from gym_passive_walker.gaits.control import optimal
from gym_passive_walker.gaits.control.optimum import Problem
from gym_passive_walker.gaits.control.stride_reward import StrideReward, own_reward
from gym_passive_walker.gaits.map_result import NoStride
from gym_passive_walker.gaits.scenes.scene import make_scene
from tests.own.statements import DRIVEN

LEVEL = {"slope": 0.0, "tick": 0.6}
POINTED = {
    "walker": "E", "slope": 0.02, "tick": 0.5, "actions": ("push_off", "hip", "ankle"),
    "energy": "positive",
}  # fmt: skip
SYSTEM = {"system": DRIVEN, "slope": 0.02, "tick": 0.5}


def smooth(step):
    """A reward of nearly all that a stride repeats."""
    speed = step.step_length / gpw.math.maximum(step.step_period, 1e-6)
    kept = gpw.math.where(step.heelstrike, (speed - 0.15) ** 2 + 0.1 * step.step_length, 0.0)
    return (
        step.distance - 2.0 * step.energy - kept - 0.02 * step.action[0] ** 2
        - 0.01 * (step.action[0] - step.last_action[0]) ** 2 - 0.3 * step.collision_loss
        + 0.01 * gpw.math.cos(step.state[0]) * step.duration - 0.002 * step.before[1] ** 2
        + 0.1 * step.hip_work - 0.1 * step.hip_work_absolute - 0.2 * step.ankle_work
        - 0.1 * step.ankle_work_absolute - 0.1 * step.push_off_work + 0.02 * step.slope
        + 0.01 * step.knee_locked - 0.1 * step.reward**2 + 0.001 * step.command
    )  # fmt: skip


def problem_of(scene, gait, reward):
    return Problem(scene, None, gait.control_steps, StrideReward(scene, reward))


def paid_by_the_environment(scene, gait, reward):
    """Sum of the rewards of the second stride in the environment, by the torques of a gait."""
    scene = make_scene(scene, reward=reward, tolerance=1e-12)
    envs = PassiveWalkerVectorEnv(1, scene)
    envs.reset(seed=0, options={"state": gait.state, "slope": gait.slope})
    total, held = np.zeros(2), gait.held
    for stride, k in product(range(2), range(gait.control_steps)):
        action = [held[name][k] / scene.largest(name) for name in scene.actions]
        _, paid, fell, _, info = envs.step(np.array([action]))
        total[stride] += paid[0]
        assert not fell[0]
        assert (info["step_length"][0] > 0.0) == (k == gait.control_steps - 1)
    return total[1]


@pytest.mark.parametrize("arguments", [LEVEL, POINTED, SYSTEM], ids=["kneed", "pointed", "system"])
def test_the_environment_pays_what_the_sum_over_a_stride_says(arguments):
    scene = make_scene(arguments)
    if scene.control == "tick" and "units" in scene.walker.supports:
        scene = make_scene(scene, command=0.1)
    gait = optimal.constant_gait(scene)
    problem = problem_of(scene, gait, smooth)
    rewarded = problem.measured(problem.begun_at(gait))
    assert rewarded.reward == pytest.approx(paid_by_the_environment(scene, gait, smooth), abs=1e-9)


@pytest.mark.parametrize("arguments", [LEVEL, POINTED, SYSTEM], ids=["kneed", "pointed", "system"])
def test_derivatives_of_the_reward_are_those_of_finite_differences(arguments):
    scene = make_scene(arguments)
    gait = optimal.constant_gait(scene)
    problem = problem_of(scene, gait, smooth)
    z = problem.begun_at(gait)
    z[problem.m :] = np.linspace(0.1, 0.02, len(z) - problem.m)
    _, gradient, *_ = problem.at(z)
    shifts = 3e-6 * np.eye(len(z))
    ahead, behind = (np.array([problem.at(z + s * x)[0] for x in shifts]) for s in (1.0, -1.0))
    np.testing.assert_allclose(gradient, (ahead - behind) / 6e-6, atol=1e-7)


def test_nothing_nearby_earns_more():
    """Torques are perturbed at random, and each time the stride is closed again."""
    scene, random = make_scene(LEVEL), np.random.default_rng(3)
    found = gpw.optimal_gait(scene, reward=own_reward)
    assert found.optimality < 1e-6 and found.violation < 1e-9
    problem = problem_of(scene, found, own_reward)
    z, earned = problem.begun_at(found), []
    for size in np.geomspace(1e-4, 0.3, 40):
        other = z.copy()
        parts = other[problem.m :]
        np.clip(parts + size * random.standard_normal(len(parts)), 0.0, 1.0, out=parts)
        try:
            earned.append(paid_when_closed(problem, other))
        except NoStride:
            continue
    assert len(earned) > 20
    assert max(earned) <= found.reward_per_control_step + 1e-9


def paid_when_closed(problem, z):
    """Mean reward of the periodic stride under the torques of z."""
    for _ in range(8):
        walked = problem.walk(z)
        by_start = walked.by_point - np.eye(problem.m)
        z[: problem.m] -= np.linalg.solve(by_start, walked.end - z[: problem.m])
    walked = problem.walk(z)
    if np.abs(walked.end - z[: problem.m]).max() > 1e-9:
        raise NoStride
    taken = len(walked.steps.rows)
    if taken == problem.ticks:
        return -problem.at(z)[0]
    torques = np.append(problem.torques(z)[0], problem.torques(z)[0, -1])[:taken]
    other = problem.with_ticks(taken)
    again = other.begun(z[: problem.m], {"hip": torques})
    return -other.at(again)[0]


def test_where_the_reward_is_the_built_in_one_the_optimum_is_that_of_least_cost():
    """A distance less work over the least cost of transport is at most 0, in any time."""
    known = gpw.optimal_gait(LEVEL, 0.12)
    scene = make_scene(LEVEL, energy_weight=1.0 / known.charged_cost)
    found = gpw.optimal_gait(scene, 0.12, reward=lambda step: step.reward)
    assert found.reward == pytest.approx(0.0, abs=1e-8)
    assert found.charged_cost == pytest.approx(known.charged_cost, rel=1e-9)
    np.testing.assert_allclose(found.held["hip"], known.held["hip"], atol=1e-7)
    np.testing.assert_allclose(found.state, known.state, atol=1e-6)


def test_the_optimum_is_one_of_the_scenes_own_reward_paid_in_the_environment():
    scene = make_scene(LEVEL, reward={"distance": 1.0, "energy": -3.0, "action": -0.01})
    found = gpw.optimal_gait(scene)
    assert found.reward == gpw.optimal_gait(LEVEL, reward=scene.reward).reward
    paid = paid_by_the_environment(scene, found, scene.reward)
    assert found.reward == pytest.approx(paid, abs=1e-9)
    assert "reward of a stride" in str(found)


def test_a_reward_at_a_speed_is_the_most_at_that_speed():
    free = gpw.optimal_gait(LEVEL)
    held = gpw.optimal_gait(LEVEL, 0.9 * free.froude_speed, reward=own_reward)
    assert held.froude_speed == pytest.approx(0.9 * free.froude_speed)
    assert held.reward_per_control_step < free.reward_per_control_step


def test_a_control_step_that_is_a_stride_has_the_most_reward_of_a_stride():
    scene = make_scene("steep", energy_weight=2.0)
    found = gpw.optimal_gait(scene)
    assert found.control_steps == 1
    assert found.reward == pytest.approx(paid_by_the_environment(scene, found, own_reward))
    for torque in (0.9, 1.1):
        held = gpw.Actuation.dimensionless(hip_torque=torque * found.held["hip"][0])
        gait = gpw.find_gait(gpw.stride_map(scene.walker, scene.slope, controller=held))
        paid = gait.dimensionless.step_length - 2.0 * gait.dimensionless.step_length * (
            gait.cost_of_transport - math.sin(scene.slope)
        )
        assert paid < found.reward


DRAWS = np.random.default_rng(0)
REFUSED = {
    "cannot be traced (line": lambda step: math.sin(step.distance),
    "gives another result each time": lambda step: step.energy * DRAWS.random(),
    "reads step.time, which grows": lambda step: step.distance * step.time,
    "one commanded speed, and this scene has those from 0.1 to 0.2": (
        lambda step: step.distance * step.command
    ),
    "at a corner of it": lambda step: step.distance - 0.5 * abs(step.action[0]),
    "grows with the absolute work": lambda step: step.distance + 2.0 * step.energy,
    "function of a step": 3,
    "a reward has no": {"speed": 1.0},
}


@pytest.mark.parametrize("said", REFUSED)
def test_a_reward_without_an_optimum_is_refused_in_a_sentence(said):
    with pytest.raises(ValueError, match=re.escape(said)) as refused:
        gpw.optimal_gait(make_scene(LEVEL, command=(0.1, 0.2)), reward=REFUSED[said])
    assert "\n" not in str(refused.value)


def test_a_search_for_the_most_reward_is_bounded_in_time():
    with pytest.raises(TimeoutError, match="no optimal gait was found in 1e-06 s"):
        gpw.optimal_gait(LEVEL, time_limit=1e-6)
