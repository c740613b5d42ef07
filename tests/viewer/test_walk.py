"""What is changed while a walker walks changes its equations at that instant, and nothing else."""

from __future__ import annotations

import copy
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest

from gym_passive_walker import WALKERS, Outcome, find_gait, load_policy, stride
from gym_passive_walker.apps.viewer.walk import LiveWalk, Setup
from gym_passive_walker.envs.policies import TrainedPolicy
from gym_passive_walker.gaits.look.dense_stride import states_at
from gym_passive_walker.gaits.scenes.scene import make_scene
from tests.before_impact import just_before
from tests.equations.bodies import kinetic_energy, potential_energy
from tests.equations.examples import LONG_GAITS

FRAME = 1 / 60


def walk_of(name: str) -> LiveWalk:
    gait = LONG_GAITS[name]
    return LiveWalk(Setup(WALKERS[name], gait.slope), gait.state)


def until_heelstrikes(walk: LiveWalk, count: int) -> None:
    while walk.strides < count:
        assert walk.outcome == Outcome.RUNNING
        walk.advance(FRAME * walk.setup.walker.time_unit)


@pytest.mark.parametrize("name", LONG_GAITS)
def test_frames_cut_a_walk_into_pieces_and_change_nothing(name):
    gait = LONG_GAITS[name]
    walk, walker = walk_of(name), WALKERS[name]
    first = stride(walker, gait.slope, gait.state)
    passed = 0.0
    while passed < 0.8 * first.duration:
        walk.advance(FRAME)
        passed += FRAME
        expected, _ = states_at(walker, gait.slope, gait.state, [passed])
        np.testing.assert_allclose(walk.state, expected[0], rtol=0.0, atol=1e-8)
    walk.advance(first.duration - passed + 0.1)
    second, _ = states_at(walker, gait.slope, first.state, [0.1])
    np.testing.assert_allclose(walk.state, second[0], rtol=0.0, atol=1e-7)
    assert walk.strides == 1
    rolled = walker.foot_radius * (first.state[0] - second[0, 0])
    assert walk.contact == pytest.approx(first.step_length + rolled, rel=1e-7)


@pytest.mark.parametrize("name", ["lab", "A", "D"])
def test_the_last_stride_is_measured_as_the_gait_is(name):
    walk, gait = walk_of(name), find_gait(name, LONG_GAITS[name].slope)
    until_heelstrikes(walk, 1)
    assert walk.last is not None
    speed = walk.last.step_length / walk.last.step_period
    assert speed == pytest.approx(gait.froude_speed, rel=1e-6)
    assert walk.last.cost_of_transport == pytest.approx(np.sin(gait.slope), rel=1e-6)


def test_a_change_in_a_stride_leaves_it_unmeasured_and_the_next_one_measured():
    walk = walk_of("lab")
    walk.advance(0.3)
    walk.change(walk.setup._replace(slope=0.037))
    until_heelstrikes(walk, 1)
    assert walk.last is None
    until_heelstrikes(walk, 2)
    assert walk.last is not None


@pytest.mark.parametrize(
    "changes", [{"foot_radius": 0.25}, {"thigh_length": 0.5}, {"gravity": 3.0}, {"hip_mass": 2.0}]
)
def test_another_parameter_keeps_angles_rates_and_the_contact(changes):
    walk = walk_of("lab")
    walk.advance(0.3)
    state, contact = walk.state, walk.contact
    walk.change(changed(walk, **changes))
    np.testing.assert_allclose(walk.state, state, rtol=1e-14)
    assert walk.contact == pytest.approx(contact, rel=1e-14)


def energy(walk: LiveWalk) -> float:
    state = walk.state
    walker, slope, _ = walk.setup
    return kinetic_energy(walker, state) + potential_energy(walker, slope, state[:3])


def changed(walk: LiveWalk, **parameters: float) -> Setup:
    return walk.setup._replace(walker=replace(walk.setup.walker, **parameters))


@pytest.mark.parametrize("name", ["lab", "A"])
@pytest.mark.parametrize(
    "change",
    [
        lambda walk: walk.change(changed(walk, gravity=5.0, thigh_mass=3.0)),
        lambda walk: walk.change(changed(walk, foot_radius=0.1)),
        lambda walk: walk.change(walk.setup._replace(slope=0.08)),
        lambda walk: walk.push(0.02, 0.01),
    ],
)
def test_energy_is_conserved_from_a_change_on(name, change):
    """Kneestrike costs energy; the knee of this walker is free here, or always locked."""
    walk = walk_of(name)
    walk.advance(0.1)
    change(walk)
    before = energy(walk)
    for _ in range(6):
        walk.advance(0.02)
    assert walk.strides == 0 and walk.trail[-1].free == walk.setup.walker.knees
    assert energy(walk) == pytest.approx(before, rel=1e-9)


def test_less_gravity_is_slower_walking_through_the_same_postures():
    """Time goes with sqrt(l/g): a quarter of the gravity takes twice the time."""
    gait = LONG_GAITS["lab"]
    moon = replace(WALKERS["lab"], gravity=WALKERS["lab"].gravity / 4)
    start = gait.state * [1, 1, 1, 0.5, 0.5, 0.5]
    here, there = walk_of("lab"), LiveWalk(Setup(moon, gait.slope), start)
    for _ in range(90):
        here.advance(FRAME)
        there.advance(2 * FRAME)
    assert here.strides == there.strides > 0
    np.testing.assert_allclose(there.state[:3], here.state[:3], rtol=0.0, atol=1e-8)


def test_a_held_torque_is_that_of_the_stride_map():
    gait, walker = LONG_GAITS["lab"], WALKERS["lab"]
    walk = walk_of("lab")
    walk.change(walk.setup._replace(controller=0.002))
    expected = stride(
        walker,
        gait.slope,
        gait.state,
        hip_torque=0.002 * walker.total_mass * walker.gravity * walker.leg_length,
    )
    walk.advance(float(expected.duration) * (1.0 - 1e-8))
    before = just_before(
        walker,
        gait.slope,
        gait.state,
        float(expected.duration),
        hip_torque=0.002 * walker.total_mass * walker.gravity * walker.leg_length,
    )
    np.testing.assert_allclose(walk.state, before, rtol=0.0, atol=1e-6)


def hip_velocity(walk: LiveWalk) -> np.ndarray:
    """Downhill and off the ground: the stance leg rolls on its foot."""
    walker, (angle, rate) = walk.setup.walker, walk.state[[0, 3]]
    leg, radius = walker.leg_length - walker.foot_radius, walker.foot_radius
    return -rate * np.array([radius + leg * np.cos(angle), leg * np.sin(angle)])


@pytest.mark.parametrize("push", [(0.02, 0.0), (-0.02, 0.0), (0.0, 0.02), (0.0, -0.02)])
@pytest.mark.parametrize("passed", [0.1, 0.6], ids=["before midstance", "after midstance"])
@pytest.mark.parametrize("name", ["lab", "A", "D"])
def test_a_push_moves_the_hip_where_it_points(name, passed, push):
    walk = walk_of(name)
    walk.advance(passed * stride(WALKERS[name], walk.setup.slope, walk.state).duration)
    state, before = walk.state, hip_velocity(walk)
    walk.push(*push)
    np.testing.assert_array_equal(walk.state[:3], state[:3])
    change = hip_velocity(walk) - before
    assert change @ push > 0.0
    assert (walk.state[3] < state[3]) == (change[0] > 0.0)


def test_a_walker_that_falls_stays_where_it_is_until_it_begins_again():
    walk = walk_of("lab")
    walk.push(-0.5, 0.0)
    walk.advance(10.0)
    assert walk.outcome == Outcome.FELL_BACKWARD
    fallen = walk.state
    walk.advance(1.0)
    np.testing.assert_array_equal(walk.state, fallen)
    walk.begin(walk.setup)
    walk.advance(1.0)
    assert walk.outcome == Outcome.RUNNING


def test_a_change_of_knees_begins_the_walk_again():
    walk = walk_of("lab")
    until_heelstrikes(walk, 1)
    walk.change(walk.setup._replace(walker=WALKERS["A"]))
    assert walk.strides == 0 and walk.state[2] == walk.state[1]
    walk.advance(1.0)
    assert walk.outcome == Outcome.RUNNING


@pytest.mark.parametrize("name", ["level-ppo", "steep-ppo", "push-off-ppo", "commanded-ppo"])
def test_a_policy_walks_in_frames_as_in_its_environment(name):
    """Torques are held for ticks, whatever the frames do."""
    policy = load_policy(name)
    command = policy.scene.command and float(np.mean(policy.scene.command))
    calm = {"reset_noise_scale": 0.0, "tolerance": 1e-10, "command": command}
    env = gym.make("PassiveWalker-v0", **vars(policy.scene) | calm)
    seen, _ = env.reset(seed=0)
    setup = Setup(env.unwrapped.walker, env.unwrapped.slope, policy)
    walk = LiveWalk(setup, env.unwrapped.state)
    struck = 0
    while struck < 3:
        seen, _, fell, _, info = env.step(policy.predict(seen)[0])
        assert not fell
        struck = info["strides"]
        if info["step_length"]:
            until_heelstrikes(walk, struck)
            assert walk.last is not None
            assert walk.last.step_length == pytest.approx(info["step_length"], rel=1e-5)
            assert walk.last.cost_of_transport == pytest.approx(info["cost_of_transport"], rel=1e-4)


def policy_of_point_feet() -> TrainedPolicy:
    """A policy with an ankle torque, which round feet cannot bear."""
    policy = copy.copy(load_policy("level-ppo"))
    policy.scene = make_scene(
        policy.scene, walker="D", actions=("hip", "ankle"), end_on_toe_stub=None
    )
    return policy


@pytest.mark.parametrize("wrong", [{"slope": 2.0}, {"controller": policy_of_point_feet()}])
def test_a_change_that_is_refused_leaves_the_walk_as_it_was(wrong):
    walk, other = walk_of("lab"), walk_of("lab")
    for one in (walk, other):
        one.advance(0.3)
    with pytest.raises(ValueError, match=r"slope|foot_radius"):
        walk.change(walk.setup._replace(**wrong))
    assert walk.setup == other.setup
    until_heelstrikes(walk, 1)
    until_heelstrikes(other, 1)
    np.testing.assert_array_equal(walk.state, other.state)
    assert walk.last == other.last is not None
