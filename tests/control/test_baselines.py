"""Agents that learn nothing."""

import gymnasium as gym
import numpy as np
import pytest

import gym_passive_walker as gpw
from gym_passive_walker.control.baselines import ConstantTorque, LinearFeedback, Passive
from gym_passive_walker.control.feedback import powered_gait
from gym_passive_walker.control.walks import WALKED_ON, evaluate


def walks(policy, scene, episodes=4, **env):
    """Some walks of an agent in a scene."""
    arena = gym.make_vec("PassiveWalker-v0", num_envs=episodes, scene=scene, **env)
    return evaluate(policy, arena, seed=7)


@pytest.mark.parametrize(
    "policy", [Passive(), ConstantTorque(0.01, "level"), LinearFeedback("steep")]
)
def test_policies_act_on_one_observation_and_on_batches_alike(policy):
    rng = np.random.default_rng(0)
    batch = rng.uniform(-0.5, 0.5, (5, 8)).astype(np.float32)
    together, _ = policy.predict(batch)
    assert together.shape == (5, 1) and together.dtype == np.float32
    assert np.all(np.abs(together) <= 1.0)
    for one, action in zip(batch, together, strict=True):
        alone, _ = policy.predict(one)
        assert alone.shape == (1,) and alone == pytest.approx(action)


def test_no_torque_gets_nowhere_on_level_ground():
    passive = walks(Passive(), "level")
    assert np.median(passive.distance) < 12.0


def test_a_torque_of_a_quarter_percent_walks_on_level_ground_by_itself():
    constant = walks(ConstantTorque(0.0025, "level"), "level", perturbation=0.02)
    assert constant.endings == [WALKED_ON] * 4
    assert constant.speed == pytest.approx(0.1, abs=0.01)


def test_a_torque_means_the_same_in_every_scene():
    scene = {"control": "stride", "perturbation": 0.02}
    by_stride = walks(ConstantTorque(0.0025, scene), "level", **scene)
    assert by_stride.speed == pytest.approx(0.102, abs=0.002)
    # All of what the motor gives is lost at strikes: there is no slope to pay.
    assert by_stride.cost_of_transport == pytest.approx(0.0051, abs=0.0001)


@pytest.mark.parametrize("method", ["lqr", "deadbeat"])
def test_feedback_holds_the_walker_that_steep_slopes_fell(method):
    near = {"perturbation": 0.01}
    assert np.max(walks(Passive(), "steep", **near).strides) < 50
    held = walks(LinearFeedback("steep", method), "steep", **near)
    assert held.endings == [WALKED_ON] * 4
    assert held.cost_of_transport == pytest.approx(np.sin(0.11), rel=1e-3)


def test_feedback_holds_its_torque_through_the_ticks_of_a_stride():
    policy = LinearFeedback("level")
    held = walks(policy, "level", perturbation=0.02)
    assert held.endings == [WALKED_ON] * 4
    world = gym.make("PassiveWalker-v0", perturbation=0.02)
    observation, _ = world.reset(seed=1)
    state, torques, strides = None, [], []
    for _ in range(120):
        action, state = policy.predict(observation, state)
        observation, _, _, _, info = world.step(action)
        torques.append(float(action[0]))
        strides.append(info["strides"])
    changes = np.flatnonzero(np.diff(torques)) + 1
    assert len(changes) >= 2
    # A new torque comes in the step after the one that ended with a heelstrike.
    assert set(changes - 1) == set(np.flatnonzero(np.diff([0, *strides]))[: len(changes)])


@pytest.mark.parametrize(("name", "slope"), [("C", 0.03), ("C", 0.0), ("lab", 0.03), ("A", 0.03)])
def test_a_powered_gait_returns_to_itself(name, slope):
    walker = gpw.WALKERS[name]
    gait = powered_gait(walker, slope)
    end = gpw.stride(walker, slope, gait.state, hip_torque=gait.hip_torque, tolerance=1e-12)
    assert end.state == pytest.approx(gait.state, abs=1e-8)
    assert (gait.hip_torque > 0.0) == (slope == 0.0)


def moduli(matrix):
    """Sizes of a matrix's eigenvalues, the largest first."""
    return np.sort(np.abs(np.linalg.eigvals(matrix)))[::-1]


def test_one_torque_a_stride_tames_the_gait_that_steep_slopes_make_unstable():
    assert abs(gpw.find_gait("C", 0.11).multipliers[0]) == pytest.approx(2.21, abs=0.01)
    held = LinearFeedback("steep", "lqr", torque_weight=0.02)
    assert moduli(held.closed_loop)[0] < 0.125


@pytest.mark.parametrize("scene", ["level", {"slope": 0.11}])
def test_two_torques_a_stride_recover_faster_than_one(scene):
    one, two = (LinearFeedback(scene, torque_weight=0.1, pieces=n) for n in (1, 2))
    assert moduli(two.closed_loop)[0] < moduli(one.closed_loop)[0]
    assert len(np.unique(two.rows, axis=0)) == 2


@pytest.mark.parametrize(("pieces", "strides"), [(1, 3), (2, 2)])
def test_deadbeat_feedback_is_back_on_the_gait_in_a_few_strides(pieces, strides):
    # A kneed walker forgets one of four directions at kneestrike: three are left to bring home.
    closed = LinearFeedback("level", "deadbeat", pieces=pieces).closed_loop
    assert np.max(np.abs(np.linalg.matrix_power(closed, strides))) < 1e-9
    assert np.max(np.abs(np.linalg.matrix_power(closed, strides - 1))) > 1e-3


def test_a_stride_of_one_torque_has_no_two_pieces():
    with pytest.raises(ValueError, match="tick"):
        LinearFeedback("steep", pieces=2)


def test_feedback_methods_have_names():
    with pytest.raises(ValueError, match="deadbeat"):
        LinearFeedback("steep", "magic")
