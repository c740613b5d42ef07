"""A user's own system on uneven ground and under disturbances."""

import numpy as np
import pytest

import gym_passive_walker as gpw
from examples.torso import TORSO
from gym_passive_walker.engine.own.mechanics import Derived
from tests.own.oracle import Independent
from tests.own.statements import DRIVEN, STRAIGHT
from tests.own.test_environments import made

SLOPE = 0.03


@pytest.mark.parametrize("height_change", [-0.01, 0.004])
def test_a_compass_stated_by_its_masses_steps_up_and_down_as_the_package_s_own(height_change):
    gait = gpw.find_gait(DRIVEN, SLOPE)
    stance, swing, stance_rate, swing_rate = gait.state
    whole = [stance, swing, swing, stance_rate, swing_rate, swing_rate]
    found, expected = (
        gpw.stride(walker, SLOPE, state, height_change=height_change, tolerance=1e-13)
        for walker, state in ((DRIVEN, gait.state), (STRAIGHT, whole))
    )
    np.testing.assert_allclose(found.state, expected.state[[0, 1, 3, 4]], rtol=1e-11)
    for name in ("duration", "step_length", "gravity_work", "heelstrike_loss"):
        assert getattr(found, name) == pytest.approx(getattr(expected, name), rel=1e-11)


def test_a_random_walk_over_rough_ground_is_the_package_s_own():
    ground = gpw.rough(height_std=0.0003)
    gait = gpw.find_gait(STRAIGHT, SLOPE)
    walks = [
        gpw.simulate(walker, SLOPE, state, strides=6, terrain=ground, terrain_seed=3)
        for walker, state in ((STRAIGHT, gait.state), (DRIVEN, gait.state[[0, 1, 3, 4]]))
    ]
    expected, found = walks
    np.testing.assert_allclose(found.states, expected.states[:, [0, 1, 3, 4]], atol=1e-7)
    np.testing.assert_allclose(found.contact_y, expected.contact_y, atol=1e-7)


def test_systems_have_gaits_on_ground_that_repeats():
    passive = gpw.find_gait(TORSO, SLOPE)
    down = gpw.find_gait(gpw.stride_map(TORSO, SLOPE, terrain=gpw.stairs(-0.002)))
    assert down.cost_of_transport > passive.cost_of_transport
    waves = gpw.find_gait(gpw.stride_map(TORSO, SLOPE, terrain=gpw.waves(0.0, 4)))
    np.testing.assert_allclose(waves.state, passive.state, rtol=1e-9)


def test_footholds_of_a_system_differ_in_height_only():
    state = np.array(DRIVEN.start)
    with pytest.raises(ValueError, match="differ in height, not in slope"):
        gpw.stride(DRIVEN, SLOPE, state, slope_change=0.01)
    tilted = gpw.footholds(slopes=[0.0, 0.01])
    with pytest.raises(ValueError, match="differ in height, not in slope"):
        gpw.simulate(DRIVEN, SLOPE, state, strides=2, terrain=tilted)
    held = gpw.stride_map(DRIVEN, SLOPE, controller={"hip": 0.01})
    for walker in (DRIVEN, held):
        with pytest.raises(ValueError, match="differ in height, not in slope"):
            gpw.simulate(walker, SLOPE, state, terrain=gpw.footholds(slopes=[0.01, 0.01]))
    with pytest.raises(ValueError, match="differ in height, not in slope"):
        held.stride(state, slope_change=0.01)


def test_a_push_changes_the_momentum_of_the_centre_of_mass(scene):
    system, slope = scene.values()
    independent = Independent(system, slope)
    env = made(**scene, pushes={"rate": 20.0, "impulse": 0.01}, reset_noise_scale=0.0)
    env.reset(seed=1)
    for _ in range(3):
        before = env.state
        *_, info = env.step(np.zeros(env.action_space.shape))
    assert info["pushes"] > 3
    # At one instant, by independently derived matrices.
    count, shift = system.coordinates, 1e-6
    matrix = independent._mass(*before)
    ways = [
        (
            system._place(system.body, system.State(*(before + shift * way)))
            - system._place(system.body, system.State(*(before - shift * way)))
        )
        / (2.0 * shift)
        for way in np.eye(2 * count)[:count]
    ]

    jumps = Derived(lambda body, state: system._push(body, state, -0.01, 0.0))(
        system.body, system.State(*before)
    )
    impulse = 0.01 * system.total_mass * np.array(ways)
    np.testing.assert_allclose(jumps, np.linalg.solve(matrix, impulse), rtol=1e-7)


def test_the_work_of_pushes_is_what_a_passive_system_gains(scene):
    system, slope = scene.values()
    if system.dissipation is not None:
        system = system.vary(damping=0.0)
    independent = Independent(system, slope)
    env = made(
        system=system, slope=slope, pushes={"rate": 20.0, "impulse": (-0.02, 0.01)},
        reset_noise_scale=0.0, tolerance=1e-12,
    )  # fmt: skip
    env.reset(seed=1)
    for _ in range(4):
        before = env.state
        *_, info = env.step(np.zeros(env.action_space.shape))
        gained = np.sum(independent.energies(env.state)) - np.sum(independent.energies(before))
        assert info["push_work"] == pytest.approx(gained / system.total_mass, abs=1e-10)
