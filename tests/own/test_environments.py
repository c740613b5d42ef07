"""A user's own system walks in every environment, by the equations that it was stated with."""

import pickle
import re
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest

import gym_passive_walker as gpw
from examples.five_links import FIVE_LINKS
from examples.torso import TORSO
from gym_passive_walker.gaits.scenes.scene import SceneError, make_scene
from tests.own.oracle import Independent
from tests.own.statements import COMPASS, DRIVEN, SCENES, STRAIGHT, Legs

SLOPE = 0.03


def made(**arguments):
    return gym.make("PassiveWalker-v0", **arguments).unwrapped


def walked(env, actions, seed=0):
    """Observations, rewards and infos of an episode under actions, until it ends."""
    steps = []
    env.reset(seed=seed)
    for action in actions:
        observation, reward, terminated, _, info = env.step(action)
        steps.append((observation, reward, info))
        if terminated:
            break
    return steps


def actions_of(env, count=40):
    rng = np.random.default_rng(5)
    return rng.uniform(-0.2, 0.2, (count, *env.action_space.shape))


def test_a_tick_is_what_scipy_integrates_from_lagrange_s_equations(scene):
    env = made(**scene, tolerance=1e-12)
    system, independent = scene["system"], Independent(scene["system"], scene["slope"])
    largest = np.array([env.scene.largest(name) for name in env.scene.actions])
    env.reset(seed=1)
    for action in actions_of(env, 3):
        expected, _ = independent.stride(env.state, largest * action, env.scene.tick)
        observation, *_ = env.step(action)
        np.testing.assert_allclose(env.state, expected, atol=1e-9)
        np.testing.assert_allclose(observation, [*expected, scene["slope"]], atol=1e-6)
    assert env.state.shape == (2 * system.coordinates,)


def test_a_heelstrike_in_a_tick_is_that_of_a_free_mechanism():
    env = made(**SCENES["compass"], tolerance=1e-12, control="stride", max_hip_torque=0.02)
    independent = Independent(DRIVEN, SLOPE)
    env.reset(seed=3)
    expected, duration = independent.stride(env.state, np.array([0.5 * 0.02]))
    *_, info = env.step(np.array([0.5]))
    assert info["outcome"] == "heelstrike" and info["strides"] == 1
    np.testing.assert_allclose(env.state, expected, atol=1e-9)
    assert info["step_period"] == pytest.approx(duration, abs=1e-9)


def test_the_compass_earns_what_the_package_s_own_earns():
    own, packaged = (
        made(walker=walker, slope=SLOPE, control="stride", max_hip_torque=0.003)
        for walker in (DRIVEN, STRAIGHT)
    )
    gait = gpw.find_gait(COMPASS, SLOPE)
    stance, swing, stance_rate, swing_rate = gait.state
    own.reset(seed=0, options={"state": gait.state})
    packaged.reset(
        seed=0, options={"state": [stance, swing, swing, stance_rate, swing_rate, swing_rate]}
    )
    for action in (0.3, -0.2, 0.1):
        _, ours, _, _, here = own.step(np.array([action]))
        _, theirs, _, _, there = packaged.step(np.array([action]))
        # Distances are of the centre of mass here and of the hip there: compare what is paid.
        assert here["energy"] == pytest.approx(there["energy"], abs=1e-8)
        assert here["step_length"] == pytest.approx(there["step_length"], abs=1e-8)
        assert here["hip_cost"] == pytest.approx(there["hip_cost"], abs=1e-7)
        assert here["collision_cost"] == pytest.approx(there["collision_cost"], abs=1e-7)
        assert ours == pytest.approx(here["distance"] - 10.0 * here["energy"])
        assert theirs == pytest.approx(there["distance"] - 10.0 * there["energy"])


def test_costs_do_not_depend_on_the_unit_of_mass():
    heavy = replace(DRIVEN, body=Legs(*(7.0 * mass for mass in DRIVEN.body)))
    actions = np.full((40, 1), 0.3)
    ours, theirs = (
        walked(made(**SCENES["compass"] | {"system": s}), actions) for s in (heavy, DRIVEN)
    )
    assert len(ours) == len(theirs) and ours[-1][2]["strides"] > 0
    for (_, here, first), (_, there, second) in zip(ours, theirs, strict=True):
        assert here == pytest.approx(there, rel=1e-7)
        assert first.pop("outcome") == second.pop("outcome")
        assert first == pytest.approx(second, rel=1e-6, abs=1e-12)


def test_energy_is_torque_times_how_far_each_control_has_moved():
    env = made(**SCENES["five links"], energy="net")
    env.reset(seed=0)
    before = np.array(FIVE_LINKS.travel(FIVE_LINKS.State(*env.state)))
    action = np.array([0.5, -0.5, 0.25, 1.0])
    *_, info = env.step(action)
    after = np.array(FIVE_LINKS.travel(FIVE_LINKS.State(*env.state)))
    torques = action * 0.05 * FIVE_LINKS.total_mass
    assert info["energy"] == pytest.approx(torques @ (after - before), abs=1e-9)


def test_a_system_of_functions_that_modules_hold_pickles_and_its_environment_too():
    system = replace(DRIVEN, name="sent")
    sent = pickle.dumps(system)
    assert system.hybrid.name  # compiled code is not sent
    assert len(pickle.dumps(system)) == len(sent)
    copy = pickle.loads(sent)
    assert copy.body == system.body and copy.hybrid.name == system.hybrid.name
    env = made(system=system, slope=SLOPE)
    env.reset(seed=0)
    env.step(np.array([0.1]))
    other = pickle.loads(pickle.dumps(env))
    np.testing.assert_array_equal(other.step(np.array([0.2]))[0], env.step(np.array([0.2]))[0])


def test_the_action_1_is_a_control_s_limit_or_the_hip_s_in_its_weight():
    limited = replace(FIVE_LINKS, limits={"swing_hip": 0.3})
    scene = make_scene(system=limited, max_hip_torque=0.1)
    assert scene.actions == FIVE_LINKS.controls
    weight = FIVE_LINKS.total_mass
    assert [scene.largest(name) for name in scene.actions] == pytest.approx(
        [0.1 * weight, 0.1 * weight, 0.3, 0.1 * weight]
    )


def test_actions_may_be_some_of_the_controls_in_any_order():
    chosen = {"actions": ("swing_knee", "stance_hip")}
    some, every = made(**SCENES["five links"], **chosen), made(**SCENES["five links"])
    for env in (some, every):
        env.reset(seed=0)
    some.step(np.array([0.4, -0.6]))
    every.step(np.array([0.0, -0.6, 0.0, 0.4]))
    np.testing.assert_array_equal(some.state, every.state)


REFUSED = {
    "differ in height, not in slope": {"system": COMPASS, "terrain": {"rough": {"slope_std": 0.1}}},
    "has no knee": {"system": COMPASS, "domain_randomization": {"knee": 0.1}},
    "end_on_toe_stub": {"system": COMPASS, "end_on_toe_stub": True},
    "start must be 4": {"system": COMPASS, "start": (0.1,) * 6},
    "actions must be some of 'hip'": {"system": DRIVEN, "actions": ("ankle",)},
    "actions must be ()": {"system": COMPASS, "actions": ("hip",)},
}


@pytest.mark.parametrize("said", REFUSED)
def test_what_a_system_does_not_have_is_refused(said):
    with pytest.raises(SceneError, match=re.escape(said)):
        make_scene(**REFUSED[said])


def test_systems_of_other_equations_are_not_of_one_batch():
    with pytest.raises(SceneError, match="one system"):
        gym.make_vec("PassiveWalker-v0", num_envs=2, walkers=[COMPASS, TORSO])
    with pytest.raises(SceneError, match="must have one weight"):
        gym.make_vec("PassiveWalker-v0", num_envs=2, walkers=[DRIVEN, DRIVEN.vary(hip=0.8)])
    whole = DRIVEN.total_mass
    bodies = [DRIVEN, DRIVEN.vary(hip=0.8, leg=0.5 * (whole - 0.8))]
    env = gym.make_vec("PassiveWalker-v0", num_envs=2, walkers=bodies, slope=SLOPE)
    env.reset(seed=0, options={"state": np.array(DRIVEN.start)})
    env.step(np.zeros((2, 1)))
    first, second = env.unwrapped.states
    assert not np.array_equal(first, second)


def test_a_system_without_a_gait_begins_at_its_start():
    climbing = made(system=DRIVEN, slope=-0.2, reset_noise_scale=0.0)
    observation, _ = climbing.reset(seed=0)
    gait = gpw.find_gait(DRIVEN, 0.01)  # of the nearest slope that has one
    np.testing.assert_allclose(observation[:4], gait.state, rtol=1e-6)
    with pytest.raises(SceneError, match="give the scene a start"):
        made(system=replace(DRIVEN, start=None), slope=SLOPE).reset()
    given = made(system=replace(DRIVEN, start=None), start=DRIVEN.start, reset_noise_scale=0.0)
    np.testing.assert_allclose(given.reset()[0][:4], DRIVEN.start, rtol=1e-6)


def test_stable_baselines_trains_on_a_system():
    sb3 = pytest.importorskip("stable_baselines3")
    from gym_passive_walker.envs.sb3 import PassiveWalkerVecEnv

    model = sb3.PPO(
        "MlpPolicy", PassiveWalkerVecEnv(8, **SCENES["five links"]), n_steps=16, batch_size=64
    )
    model.learn(256)
    action, _ = model.predict(np.zeros((8, 11), np.float32))
    assert action.shape == (8, 4)
