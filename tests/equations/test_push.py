"""A push at the hip conserves momentum, and its work is the gain of energy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import null_space

from gym_passive_walker import WALKERS
from tests.equations import bodies, oracle, statements
from tests.equations.bodies import HIP
from tests.equations.examples import KNEED, MASSIVE, random_walker

FREE_OR_LOCKED = [*((name, True) for name in MASSIVE), *((name, False) for name in KNEED)]


def some_push(rng: np.random.Generator, walker, *, locked: bool):
    """A state [angles, rates], and an impulse on the hip, forward plus i times up."""
    angles, rates = rng.uniform(-1.0, 1.0, 3), rng.normal(size=3) / walker.time_unit
    if locked:
        angles[2], rates[2] = angles[1], rates[1]
    size = walker.total_mass * walker.leg_length / walker.time_unit
    return np.array([*angles, *rates]), size * complex(*rng.normal(size=2))


def hip_velocity(walker, state) -> complex:
    """Velocity of the hip over a rolling stance foot, forward plus i times up."""
    contact = bodies.Bodies(walker, state[:3]).legs[0].foot - 1j * walker.foot_radius
    return -1j * state[3] * contact


@pytest.mark.parametrize(("name", "locked"), FREE_OR_LOCKED)
def test_a_push_is_an_impulse_on_the_hip_that_joints_and_the_ground_pass_on(name, locked):
    """Rigid bodies, held together by every joint and held down by the ground, are pushed at one."""
    rng = np.random.default_rng(1)
    for i in range(40):
        walker = WALKERS[name] if i < 20 else random_walker(rng, knees=WALKERS[name].knees)
        state, impulse = some_push(rng, walker, locked=locked)
        walking = bodies.Bodies(walker, state[:3])
        constraints = [walking.joints(), walking.stance_knee_locked(), walking.stance_contact()]
        if locked:
            constraints.append(walking.swing_knee_locked())
        free, mass = null_space(np.vstack(constraints)), walking.mass_matrix
        momentum = mass @ walking.velocities(state[3:])
        momentum += walking.point(HIP, 0j).T @ [impulse.real, impulse.imag]
        after = free @ np.linalg.solve(free.T @ mass @ free, free.T @ momentum)
        expected = after[2::3][[bodies.STANCE_THIGH, bodies.THIGH, bodies.SHANK]]
        found = statements.pushed(walker, state, impulse, locked=locked)
        np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-11 * np.abs(expected).max())


@pytest.mark.parametrize(("name", "locked"), [*FREE_OR_LOCKED, ("D", True)])
def test_a_push_works_by_the_mean_of_the_hips_velocities_before_and_after(name, locked):
    rng, walker = np.random.default_rng(2), WALKERS[name]
    for _ in range(20):
        state, impulse = some_push(rng, walker, locked=locked)
        after = state.copy()
        after[3:] = statements.pushed(walker, state, impulse, locked=locked)
        mean = 0.5 * (hip_velocity(walker, state) + hip_velocity(walker, after))
        energies = [oracle.kinetic_energy(walker, s) for s in (state, after)]
        work = (impulse * mean.conjugate()).real
        scale = max(*energies, abs(work))
        assert energies[1] - energies[0] == pytest.approx(work, rel=0.0, abs=1e-12 * scale)


def test_pushing_the_simplest_walker_is_the_limit_of_vanishing_feet():
    rng, walker = np.random.default_rng(3), WALKERS["D"]
    for _ in range(20):
        state, impulse = some_push(rng, walker, locked=True)
        limit = statements.pushed(walker, state, impulse, locked=True)
        for mass in (1e-4, 1e-6, 1e-8):
            feet = replace(walker, shank_mass=mass, shank_com=0.5)
            found = statements.pushed(feet, state, impulse, locked=True)
            size = np.abs(limit).max()
            np.testing.assert_allclose(found, limit, rtol=0.0, atol=20.0 * mass * size)


def test_a_push_along_a_point_footed_stance_leg_moves_nothing():
    state = [0.3, -0.4, -0.4, -1.0, 0.2, 0.2]
    along = np.exp(1j * (0.5 * np.pi + state[0]))
    found = statements.pushed(WALKERS["E"], state, along, locked=True)
    np.testing.assert_allclose(found, state[3:], rtol=1e-14)
