"""Equations and impacts of systems of one's own are those of an independent derivation."""

from typing import Any

import numpy as np
import pytest

import gym_passive_walker as gpw
from examples.driven_torso import DRIVEN_TORSO
from examples.five_links import FIVE_LINKS
from examples.rimless_wheel import RIMLESS_WHEEL, closed_form
from examples.torso import TORSO
from gym_passive_walker.engine.own.mechanics import Derived
from gym_passive_walker.models.equations.hybrid import Ground
from gym_passive_walker.models.math import cos, sin
from gym_passive_walker.models.walkers import Walker
from tests.own.oracle import Independent
from tests.own.statements import COMPASS, DRIVEN, PROGRESSIVE, Hip

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


def test_a_rimless_wheel_has_the_gait_and_the_multiplier_of_its_closed_form():
    for slope in (0.06, 0.1):
        gait = gpw.find_gait(RIMLESS_WHEEL, slope)
        rate, multiplier = closed_form(RIMLESS_WHEEL.body, slope)
        assert gait.state[1] == pytest.approx(rate, rel=1e-12)
        assert gait.multipliers[0] == pytest.approx(multiplier, rel=1e-12)


# The compass of `statements` by McGeer's parameters.
STRAIGHT = Walker(
    thigh_length=0.5, thigh_mass=1.0 / 6.0, thigh_com=0.5, shank_length=0.5, shank_mass=0.0,
    hip_mass=2.0 / 3.0, knees=False, gravity=1.0,
)  # fmt: skip


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
    gait = gpw.find_gait(system, SLOPE)
    found = gpw.stride_jacobian(gait, wrt=("state", "slope", "torso", "stiffness"))
    change = 1e-6

    def ends(state=gait.state, slope=SLOPE, system=system):
        return gpw.stride(system, slope, state, tolerance=1e-13).state

    columns = []
    for i in range(6):
        ahead, behind = gait.state.copy(), gait.state.copy()
        ahead[i] += change
        behind[i] -= change
        columns.append((ends(ahead) - ends(behind)) / (2.0 * change))
    columns.append((ends(slope=SLOPE + change) - ends(slope=SLOPE - change)) / (2.0 * change))
    for name in ("torso", "stiffness"):
        value = getattr(system.body, name)
        ahead, behind = (system.vary(**{name: value + s * change}) for s in (1.0, -1.0))
        columns.append((ends(system=ahead) - ends(system=behind)) / (2.0 * change))
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


def test_functions_run_on_numbers_and_arrays_alike():
    assert sin(0.3) == np.sin(0.3) and cos(0.3) == np.cos(0.3)


def test_a_compass_stated_by_its_masses_has_the_basin_of_the_package_s_own():
    slice_of = {"stance_angles": np.linspace(0.18, 0.36, 30), "stance_rates": [-0.4, -0.33, -0.28]}
    own, package = (gpw.basin_of_attraction(x, SLOPE, **slice_of) for x in (COMPASS, STRAIGHT))
    assert 0.1 < own.walks.mean() < 0.9
    np.testing.assert_array_equal(own.settled, package.settled)
    np.testing.assert_array_equal(own.outcome, package.outcome)
    assert own.plot().get_xlabel()


@pytest.mark.parametrize("system", [TORSO, FIVE_LINKS], ids=lambda s: s.name)
def test_states_of_a_basin_s_slice_have_both_feet_on_the_ground(system):
    coordinates = np.array(system.start[: system.coordinates]) * np.linspace(0.5, 1.3, 7)[:, None]
    found = system.with_both_feet_down(coordinates)
    np.testing.assert_array_equal(found[:, 0], coordinates[:, 0])
    for row in found:
        state = system.State(*row, *np.zeros(system.coordinates))
        assert abs(system.landing(system.body, state)[1]) < 1e-12
    assert np.abs(found - coordinates).max() < 0.1
    np.testing.assert_allclose(system.exchanged(system.exchanged(found)), found)


def test_a_basin_needs_two_coordinates():
    with pytest.raises(ValueError, match="two coordinates"):
        gpw.basin_of_attraction(RIMLESS_WHEEL, 0.06)
