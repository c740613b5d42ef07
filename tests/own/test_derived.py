"""Equations and impacts of systems of one's own are those of an independent derivation."""

from typing import Any

import numpy as np
import pytest

import gym_passive_walker as gpw
from examples.driven_torso import DRIVEN_TORSO
from examples.five_links import FIVE_LINKS
from examples.torso import TORSO
from gym_passive_walker.engine.own.mechanics import Derived
from gym_passive_walker.models.equations.hybrid import Ground
from tests.own.oracle import Independent
from tests.own.statements import COMPASS, DRIVEN, PROGRESSIVE, STRAIGHT, Hip

SLOPE = 0.03
SYSTEMS = {
    "torso": TORSO,
    "five links": FIVE_LINKS,
    "compass": COMPASS,
    "driven torso": DRIVEN_TORSO,
    "progressive torso": PROGRESSIVE,
}


@pytest.fixture(scope="module", params=SYSTEMS, name="both")
def a_system_and_its_independent_derivation(request):
    system = SYSTEMS[request.param]
    return system, Independent(system, SLOPE)


def random_states(system, count=5):
    rng = np.random.default_rng(1)
    return np.array(system.start) + rng.uniform(-0.3, 0.3, (count, 2 * system.coordinates))


def test_accelerations_are_those_of_lagrange(both):
    system, independent = both
    controls = system.Control(*[0.0] * len(system.controls))
    ground = Ground(np.sin(SLOPE), np.cos(SLOPE))
    accelerations = system.hybrid.phases[0].accelerations
    for state in random_states(system):
        found = accelerations(system.body, system.State(*state), controls, ground)
        np.testing.assert_allclose(found, independent.accelerations(state), rtol=1e-10, atol=1e-10)


def test_an_impact_is_that_of_a_contact_impulse_on_a_free_mechanism(both):
    system, independent = both
    for state in random_states(system):
        expected, lost = independent.strike(state)
        strike = Derived(lambda b, s: system._strike(b, s, 0.0, Ground(0.0, 1.0)))
        found = strike(system.body, system.State(*state))
        np.testing.assert_allclose(found.after, expected, rtol=1e-11, atol=1e-11)
        np.testing.assert_allclose(found.lost, lost, rtol=1e-10, atol=1e-13)


@pytest.mark.parametrize("name", ["torso", "compass", "progressive torso"])
def test_a_stride_is_what_scipy_integrates(name):
    system = SYSTEMS[name]
    independent = Independent(system, SLOPE)
    gait = gpw.find_gait(system, SLOPE)
    state = gait.state * (1.0 + 0.01 * np.arange(len(gait.state)))
    state[1] = -state[0]
    found = gpw.stride(system, SLOPE, state, tolerance=1e-13)
    expected, duration = independent.stride(state)
    assert found.outcome == gpw.Outcome.HEELSTRIKE
    np.testing.assert_allclose(found.state, expected, atol=1e-10)
    assert found.duration == pytest.approx(duration, abs=1e-10)


@pytest.mark.parametrize("name", SYSTEMS)
def test_the_energy_of_a_stride_balances(name):
    system = SYSTEMS[name]
    gait = gpw.find_gait(system, 0.05 if name == "five links" else SLOPE)
    state = gait.state.copy()
    state[system.coordinates :] *= 1.001
    walk = gpw.stride(system, gait.slope, state, tolerance=1e-13)
    assert walk.outcome == gpw.Outcome.HEELSTRIKE
    kinetic = [
        system.hybrid.kinetic_energy(system.body, system.State(*s)) for s in (state, walk.state)
    ]
    supplied = walk.gravity_work + walk.spring_work
    lost = walk.heelstrike_loss + walk.friction_loss
    assert supplied - lost == pytest.approx(kinetic[1] - kinetic[0], abs=2e-12)


def test_a_compass_stated_by_its_masses_walks_as_the_package_s_own():
    for slope in (0.03, 0.06):
        own, package = gpw.find_gait(COMPASS, slope), gpw.find_gait(STRAIGHT, slope)
        np.testing.assert_allclose(own.state, package.state[[0, 1, 3, 4]], rtol=1e-10)
        np.testing.assert_allclose(own.multipliers[:3], package.multipliers, rtol=1e-8)
        assert own.step_length == pytest.approx(package.step_length, rel=1e-10)
        assert own.cost_of_transport == pytest.approx(package.cost_of_transport, rel=1e-10)
    own, package = (gpw.doubling_cascade(x, 0.05, 0.1) for x in (COMPASS, STRAIGHT))
    np.testing.assert_allclose(own.slopes[:3], package.slopes[:3], rtol=1e-7)


@pytest.mark.parametrize("system", [TORSO, PROGRESSIVE], ids=lambda s: s.name)
def test_derivatives_of_a_stride_are_those_of_differences(system):
    gait, body = gpw.find_gait(system, SLOPE), ("torso", "stiffness")
    found = gpw.stride_jacobian(gait, wrt=("state", "slope", *body))
    start = np.array([*gait.state, SLOPE, *(getattr(system.body, name) for name in body)])

    def end(numbers):
        varied = system.vary(**dict(zip(body, numbers[7:].tolist(), strict=True)))
        return gpw.stride(varied, numbers[6], numbers[:6], tolerance=1e-13).state

    columns = [(end(start + way) - end(start - way)) / 2e-6 for way in 1e-6 * np.eye(9)]
    np.testing.assert_allclose(found, np.stack(columns, axis=1), rtol=1e-6, atol=1e-7)


@pytest.mark.parametrize("system", [FIVE_LINKS, PROGRESSIVE], ids=lambda s: s.name)
def test_a_batch_walks_bitwise_as_each_alone(system):
    gait = gpw.find_gait(system, 0.05)
    random = np.random.default_rng(0).normal(size=(40, len(gait.state)))
    states = gait.state * (1.0 + 1e-4 * random)
    many = gpw.stride(system, 0.05, states)
    for i in (0, 17, 39):
        np.testing.assert_array_equal(many.state[i], gpw.stride(system, 0.05, states[i]).state)


def test_controls_act_along_the_coordinates_that_they_move():
    state = DRIVEN.State(0.2, -0.2, -0.4, -0.3)
    still: Any = DRIVEN.hybrid.phases[0].accelerations
    ground = Ground(0.0, 1.0)
    held, free = (np.array(still(DRIVEN.body, state, Hip(t), ground)) for t in (0.1, 0.0))
    matrix = Derived(DRIVEN._mass_matrix)(DRIVEN.body, state)
    mass = np.array([[matrix[0], matrix[1]], [matrix[1], matrix[2]]])
    np.testing.assert_allclose(mass @ (held - free), [-0.1, 0.1], atol=1e-14)


def test_a_compass_stated_by_its_masses_has_the_basin_of_the_package_s_own():
    slice_of = {"stance_angles": np.linspace(0.18, 0.36, 30), "stance_rates": [-0.4, -0.33, -0.28]}
    own, package = (gpw.basin_of_attraction(x, SLOPE, **slice_of) for x in (COMPASS, STRAIGHT))
    assert 0.1 < own.walks.mean() < 0.9
    np.testing.assert_array_equal(own.settled, package.settled)
    np.testing.assert_array_equal(own.outcome, package.outcome)
    assert own.plot().get_xlabel()


def test_a_strike_is_found_with_derivatives_where_its_time_is_rounding():
    """The foot of a small step sinks so slowly that its height is rounding for some time."""
    gait, slopes = gpw.find_gait(COMPASS, 1e-4), np.full(300, 1e-4)
    near = 1.0 + 0.02 * np.random.default_rng(1).normal(size=(300, 4))
    points = near * gait.point.values[0]
    there, _ = gait.stride_map.linearize(points, slopes)
    assert (there.outcomes == gpw.Outcome.HEELSTRIKE).all()
    plain = gait.stride_map.apply(points, slopes)
    np.testing.assert_allclose(there.ends, plain.ends, rtol=0.0, atol=1e-9)
