"""Accelerations, energies and geometry agree with independent derivations."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gym_passive_walker import WALKERS, Walker
from tests.equations import bodies, lagrange, oracle, statements
from tests.equations.examples import KNEED, MASSIVE, random_state, random_walker

PHASES = [
    *(pytest.param(name, False, id=f"{name}-free") for name in KNEED),
    *(pytest.param(name, True, id=f"{name}-locked") for name in MASSIVE),
]


def assert_same_accelerations(walker: Walker, rng: np.random.Generator, *, locked: bool) -> None:
    """Compare the engine with Lagrange's equations at one random state, slope and torque."""
    state = random_state(rng, walker, locked=locked)
    slope = rng.uniform(-0.5, 0.5)
    torque = rng.normal() * walker.total_mass * walker.gravity * walker.leg_length
    expected = lagrange.motion(walker, slope, torque, locked=locked)(state)
    found = statements.accelerations(walker, slope, state, torque, locked=locked)
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-12 * np.abs(expected).max())


@pytest.mark.parametrize(("name", "locked"), PHASES)
def test_a_walker_accelerates_as_lagrange_says(name, locked):
    rng = np.random.default_rng(1)
    for _ in range(50):
        assert_same_accelerations(WALKERS[name], rng, locked=locked)


@pytest.mark.parametrize("locked", [False, True], ids=["free", "locked"])
def test_any_walker_accelerates_as_lagrange_says(locked):
    rng = np.random.default_rng(2)
    for _ in range(100):
        walker = random_walker(rng, knees=not locked)
        assert_same_accelerations(walker, rng, locked=locked)


def test_the_simplest_walker_is_a_strut_and_a_pendulum():
    rng = np.random.default_rng(3)
    walker = replace(WALKERS["D"], thigh_length=0.7, gravity=3.0, hip_mass=2.0)
    for _ in range(50):
        state = random_state(rng, walker, locked=True)
        slope, torque = rng.uniform(-0.5, 0.5), rng.normal()
        expected = oracle.motion(walker, slope, torque, locked=True)(state)
        found = statements.accelerations(walker, slope, state, torque, locked=True)
        np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-13 * np.abs(expected).max())


def test_the_simplest_walker_moves_as_printed():
    """The closed form of Garcia, Chatterjee, Ruina and Coleman (1998), in units of l and g."""
    rng = np.random.default_rng(4)
    walker = Walker(
        thigh_length=0.5, shank_length=0.5, thigh_mass=0.0, shank_mass=0.0, hip_mass=1.0,
        knees=False, gravity=1.0,
    )  # fmt: skip
    for _ in range(50):
        stance, swing, _, rate, _, _ = state = random_state(rng, walker, locked=True)
        slope, between = rng.uniform(-0.5, 0.5), stance - swing
        stance_acceleration = np.sin(stance - slope)
        acceleration_between = (
            stance_acceleration
            + rate**2 * np.sin(between)
            - np.cos(stance - slope) * np.sin(between)
        )
        expected = [stance_acceleration, stance_acceleration - acceleration_between]
        found = statements.accelerations(walker, slope, state, 0.0, locked=True)[:2]
        np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-14 * (1.0 + rate**2))


def point_foot(foot_mass: float) -> Walker:
    """The simplest walker with a mass at each foot."""
    return replace(WALKERS["D"], shank_mass=foot_mass, shank_com=0.5)


def test_the_simplest_walker_is_the_limit_of_vanishing_feet():
    """Its torque is per unit of foot mass, so the compass gets as much less as its feet weigh."""
    rng = np.random.default_rng(5)
    for _ in range(20):
        simplest = WALKERS["D"]
        state = random_state(rng, simplest, locked=True)
        slope, torque = rng.uniform(-0.5, 0.5), rng.normal()
        limit = statements.accelerations(simplest, slope, state, torque, locked=True)
        distance = [
            np.abs(
                statements.accelerations(point_foot(mass), slope, state, torque * mass, locked=True)
                - limit
            ).max()
            for mass in (1e-5, 1e-6)
        ]
        assert distance[1] < 1e-4 * (1.0 + np.abs(limit).max())
        assert distance[0] / distance[1] == pytest.approx(10.0, rel=1e-2)


@pytest.mark.parametrize(("name", "locked"), PHASES)
def test_kinetic_energy_is_the_sum_over_the_bodies(name, locked):
    rng = np.random.default_rng(6)
    for walker in [WALKERS[name], *(random_walker(rng, knees=not locked) for _ in range(20))]:
        state = random_state(rng, walker, locked=locked)
        expected = bodies.kinetic_energy(walker, state)
        assert statements.kinetic_energy(walker, state, locked=locked) == pytest.approx(
            expected, rel=1e-12
        )


@pytest.mark.parametrize(("name", "locked"), PHASES)
def test_clearance_is_the_height_of_the_lowest_point_of_the_swing_foot(name, locked):
    rng = np.random.default_rng(7)
    for walker in [WALKERS[name], *(random_walker(rng, knees=not locked) for _ in range(20))]:
        angles = random_state(rng, walker, locked=locked)[:3]
        stance, swing = bodies.Bodies(walker, angles).legs
        expected = (swing.foot - stance.foot).imag
        found = statements.foot_clearance(walker, angles, locked=locked)
        assert found == pytest.approx(expected, rel=0.0, abs=1e-13 * walker.leg_length)


@pytest.mark.parametrize(("name", "locked"), PHASES)
def test_a_mirror_image_accelerates_the_other_way(name, locked):
    rng = np.random.default_rng(8)
    walker = WALKERS[name]
    mirrored = replace(
        walker,
        thigh_offset=-walker.thigh_offset,
        shank_offset=-walker.shank_offset,
        foot_angle=-walker.foot_angle,
    )
    for _ in range(20):
        state = random_state(rng, walker, locked=locked)
        slope, torque = rng.uniform(-0.5, 0.5), rng.normal()
        here = statements.accelerations(walker, slope, state, torque, locked=locked)
        there = statements.accelerations(mirrored, -slope, -state, -torque, locked=locked)
        np.testing.assert_allclose(there, -here, rtol=0.0, atol=1e-13 * np.abs(here).max())


@pytest.mark.parametrize(("name", "locked"), PHASES)
def test_motion_looks_the_same_backwards_in_time(name, locked):
    """Without an actuator or a collision, accelerations are even in the angular velocities."""
    rng = np.random.default_rng(9)
    walker = WALKERS[name]
    for _ in range(20):
        state = random_state(rng, walker, locked=locked)
        backwards = state * [1.0, 1.0, 1.0, -1.0, -1.0, -1.0]
        here = statements.accelerations(walker, 0.1, state, 0.0, locked=locked)
        there = statements.accelerations(walker, 0.1, backwards, 0.0, locked=locked)
        np.testing.assert_array_equal(here, there)


@pytest.mark.parametrize(("name", "locked"), PHASES)
def test_a_positive_torque_drives_the_swing_leg_forward_and_opens_the_legs(name, locked):
    walker = WALKERS[name]
    rest = np.zeros(6)
    without = statements.accelerations(walker, 0.0, rest, 0.0, locked=locked)
    gain = statements.accelerations(walker, 0.0, rest, 1.0, locked=locked) - without
    assert gain[1] > 0.0
    assert gain[1] > gain[0]
