"""Agents that learn nothing."""

from dataclasses import replace
from itertools import islice

import gymnasium
import numpy as np
import pytest

import gym_passive_walker as gpw
from gym_passive_walker.envs.evaluation.steps import steps
from gym_passive_walker.envs.evaluation.walks import TIME_LIMIT, simulate_episodes
from gym_passive_walker.envs.registration import (
    EASY_ID,
    EASY_REWARD_THRESHOLD,
    ID,
    REWARD_THRESHOLD,
)
from gym_passive_walker.envs.vector_env import PassiveWalkerVectorEnv
from gym_passive_walker.gaits.control.baselines import (
    BASELINES,
    ConstantTorque,
    LinearFeedback,
    Optimal,
    Passive,
)
from gym_passive_walker.gaits.control.feedback import powered_gait
from gym_passive_walker.gaits.scenes.scene import make_scene
from tests.own.statements import DRIVEN


def walks(policy, scene, episodes=4, **env):
    """Some walks of an agent in a scene."""
    arena = gymnasium.make_vec("PassiveWalker-v0", num_envs=episodes, scene=scene, **env)
    return simulate_episodes(policy, arena, seed=7)


@pytest.mark.parametrize(
    "policy",
    [
        Passive(),
        ConstantTorque(0.01, "level"),
        ConstantTorque(-0.2, "level"),
        LinearFeedback("steep"),
    ],
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


def test_a_policy_gets_the_starts_of_episodes_and_acts_without_noise():
    reported = []

    class Watched(Passive):
        def predict(self, observation, state=None, episode_start=None, deterministic=False):
            reported.append((episode_start.copy(), deterministic))
            return super().predict(observation, state, episode_start, deterministic)

    arena = gymnasium.make_vec("PassiveWalker-v0", num_envs=3, scene="level")
    seen, _ = arena.reset(seed=0)
    walked = list(islice(steps(Watched(), arena, seen), 400))
    ended = np.array([step.terminated | step.truncated for step in walked])
    assert ended.any()
    assert reported[0][0].all() and all(deterministic for _, deterministic in reported)
    np.testing.assert_array_equal([first for first, _ in reported[1:]], ended[:-1])


def test_no_torque_gets_nowhere_on_level_ground():
    passive = walks(Passive(), "level")
    assert np.median(passive.distance) < 12.0


def test_a_torque_of_a_quarter_percent_walks_on_level_ground_by_itself():
    constant = walks(ConstantTorque(0.0025, "level"), "level", reset_noise_scale=0.02)
    assert constant.endings == [TIME_LIMIT] * 4
    assert constant.speed == pytest.approx(0.1, abs=0.01)


def test_a_torque_means_the_same_in_every_scene():
    scene = {"control": "stride", "reset_noise_scale": 0.02}
    by_stride = walks(ConstantTorque(0.0025, scene), "level", **scene)
    assert by_stride.speed == pytest.approx(0.102, abs=0.002)
    # All of what the motor gives is lost at strikes: there is no slope to pay.
    assert by_stride.cost_of_transport == pytest.approx(0.0051, abs=0.0001)


@pytest.mark.parametrize("method", ["lqr", "deadbeat"])
def test_feedback_holds_the_walker_that_steep_slopes_fell(method):
    near = {"reset_noise_scale": 0.01}
    assert np.max(walks(Passive(), "steep", **near).strides) < 50
    held = walks(LinearFeedback("steep", method), "steep", **near)
    assert held.endings == [TIME_LIMIT] * 4
    assert held.cost_of_transport == pytest.approx(np.sin(0.11), rel=1e-3)


def test_feedback_holds_its_torque_through_the_ticks_of_a_stride():
    policy = LinearFeedback("level")
    held = walks(policy, "level", reset_noise_scale=0.02)
    assert held.endings == [TIME_LIMIT] * 4
    world = gymnasium.make("PassiveWalker-v0", reset_noise_scale=0.02)
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
    end = gpw.stride(gait, tolerance=1e-12)
    assert end.state == pytest.approx(gait.state, abs=1e-8)
    assert (gait.controller is None) == (slope > 0.0)


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


def test_two_torques_a_stride_are_held_through_a_half_each():
    rows = LinearFeedback("level", pieces=2).rows[:, 0]
    (change,) = np.flatnonzero(np.any(np.diff(rows, axis=0) != 0.0, axis=1))
    assert change + 1 == pytest.approx(len(rows) / 2, abs=0.5)


def test_each_walker_of_a_batch_has_a_stride_of_its_own():
    """A walker that begins a stride plans it again; the others continue with their plans."""
    scene = {"slope": 0.03, "reset_noise_scale": 0.03}
    policy = LinearFeedback(scene, pieces=2)
    many = gymnasium.make_vec("PassiveWalker-v0", num_envs=4, **scene)
    singles = [gymnasium.make("PassiveWalker-v0", **scene) for _ in range(4)]
    seen, state = many.reset(seed=0)[0], None
    alone = [(world.reset(seed=i)[0], None) for i, world in enumerate(singles)]
    for _ in range(150):
        action, state = policy.predict(seen, state)
        seen = many.step(action)[0]
        for i, world in enumerate(singles):
            own, its_state = policy.predict(*alone[i])
            assert own == pytest.approx(action[i])
            alone[i] = world.step(own)[0], its_state


@pytest.mark.parametrize(
    ("name", "threshold"), [(ID, REWARD_THRESHOLD), (EASY_ID, EASY_REWARD_THRESHOLD)]
)
def test_the_threshold_of_the_task_lies_between_the_passive_walk_and_the_optimum(name, threshold):
    scene, arena = make_scene("level"), gymnasium.make_vec(name, num_envs=100)
    passive, optimal = (
        simulate_episodes(BASELINES[agent](scene), arena, seed=0).reward.mean()
        for agent in ("passive", "optimal")
    )
    assert passive + 0.9 * (optimal - passive) == pytest.approx(threshold, rel=0.001)
    assert gymnasium.spec(name).reward_threshold == threshold


def test_a_constant_torque_is_that_of_the_hip_alone():
    scene = make_scene({"actions": ("push_off", "hip"), "max_push_off": 0.1})
    (action,), _ = ConstantTorque(0.01, scene).predict(np.zeros((1, 8)))
    np.testing.assert_allclose(action, [0.0, 0.01 / scene.largest("hip")], rtol=1e-6)
    with pytest.raises(ValueError, match="needs a largest torque above 0"):
        ConstantTorque(0.01, {"max_hip_torque": 0.0})
    heavy = replace(DRIVEN, body=DRIVEN.body._replace(hip=4.0))
    scene = make_scene(system=heavy, control="stride")
    action, _ = ConstantTorque(0.01, scene).predict(np.zeros(5))
    np.testing.assert_allclose(action * scene.largest("hip"), 0.01 * heavy.weight, rtol=1e-6)
    with pytest.raises(ValueError, match="a hip torque is none of"):
        ConstantTorque(0.01, {"actions": ("push_off",), "max_push_off": 0.1})


@pytest.mark.parametrize("scene", ["level", "steep"])
@pytest.mark.parametrize(
    "changes",
    [{"terrain": {"rough": {"height_std": 0.003}}}, {"observation_noise": 0.02}],
    ids=["rough ground", "noise"],
)
def test_feedback_notices_a_heelstrike_where_legs_do_not_mirror_each_other(scene, changes):
    there = make_scene(scene, **changes)
    policy, arena = Optimal(scene), gymnasium.make_vec("PassiveWalker-v0", num_envs=20, scene=there)
    observations, _ = arena.reset(seed=3)
    memory, begun, strikes = None, np.ones(20, bool), 0
    for _ in range(150):
        actions, memory = policy.predict(observations, memory, begun)
        assert np.array_equal(memory[1] == 0, begun) or scene == "steep"
        assert memory[1].max() == 0 or scene == "level"
        observations, _, terminated, truncated, infos = arena.step(actions)
        struck = infos["step_period"] > 0.0
        begun = struck | terminated | truncated
        strikes += int((struck & ~terminated).sum())
    assert strikes > 40


def test_feedback_walks_as_far_in_the_environment_as_by_its_stride_map():
    """On rough ground, where linear feedback walks for some 60 strides and the passive walker 8."""
    rough = {"terrain": {"rough": {"height_std": 0.002}}, "reset_noise_scale": 0.0}
    there = make_scene("steep", **rough)
    arena = PassiveWalkerVectorEnv(200, there, max_episode_steps=33)
    done = simulate_episodes(LinearFeedback("steep"), arena, seed=0)
    assert 0.4 < done.endings.count(TIME_LIMIT) / 200 < 0.75


@pytest.mark.parametrize(
    ("scene", "said"),
    [
        ({"actions": ("hip", "push_off")}, "works the hip alone, not hip, push_off"),
        ({"max_hip_torque": 0.0}, "needs a control, and the scene a largest torque above 0"),
        ({"max_hip_torque": 0.001, "slope": 0.0}, "feedback holds needs 0.0024.* choose a scene"),
        ({"system": DRIVEN}, "system 'compass' chooses controls once a stride"),
    ],
)
def test_a_feedback_that_cannot_act_is_refused(scene, said):
    with pytest.raises(ValueError, match=said):
        LinearFeedback({"slope": 0.03, **scene})
