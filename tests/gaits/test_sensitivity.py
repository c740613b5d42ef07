"""A gait's derivatives agree with differences of gaits that are searched beside it."""

from dataclasses import replace

import numpy as np
import pytest

from gym_passive_walker import WALKERS, Actuation, find_gait, reality_check, tune
from gym_passive_walker.gaits.branches.sensitivity import (
    map_change,
    place_near,
    sensitivity,
    size_of,
)
from gym_passive_walker.gaits.design.objectives import (
    QUANTITIES,
    coefficients,
    inside,
    spectral_radius,
)
from gym_passive_walker.gaits.gait import multipliers_of
from gym_passive_walker.gaits.stride_map import StrideMap
from tests.own.statements import COMPASS

BY = {
    "lab": ("slope", "thigh_com", "shank_gyration", "foot_radius", "thigh_mass", "thigh_length"),
    "A": ("slope", "shank_com", "foot_angle", "gravity"),
    "E": ("slope", "shank_mass", "shank_com"),
    "D": ("slope", "thigh_length"),
}
BY["sprung"] = ("slope", "hip_stiffness", "hip_friction", "knee_stiffness", "shank_mass")
BY["driven"] = ("slope", "shank_com")
SLOPES = {"lab": 0.036, "A": 0.02, "E": 0.02, "D": 0.009, "sprung": 0.036, "driven": 0.01}
SPRUNG = replace(WALKERS["lab"], hip_stiffness=0.3, hip_friction=0.02, knee_stiffness=0.01)
WALKERS = {**WALKERS, "sprung": SPRUNG, "driven": WALKERS["E"]}
HELD = {"driven": Actuation.dimensionless(-0.001, 0.001, 0.01)}
"""Under torques that drive and brake."""


def gait_of(name):
    """A preset's long-step gait and its derivatives."""
    held = HELD.get(name, Actuation())
    strides = StrideMap.of(WALKERS[name], slope=SLOPES[name], controller=held)
    return sensitivity(strides.points(find_gait(strides).state), BY[name])


def multiplier_changes(map_derivative, change):
    """Multipliers, largest modulus first, and their derivatives, by left and right eigenvectors."""
    values, right = np.linalg.eig(map_derivative)
    order = np.argsort(-np.abs(values), kind="stable")
    values, right = values[order].astype(complex), right[:, order]
    moved = np.einsum("ij,jkc,ki->ic", np.linalg.inv(right), change, right)
    return values, moved.astype(complex)


def found_beside(gait, name, column, distance):
    """The gait of the walker with a changed parameter, by Newton's method."""
    place = gait.place
    guess = place.search[0] + distance * gait.coordinates[:, column]
    walker, slope = place.section.walker, place.section.slope
    if name == "slope":
        slope += distance
    else:
        walker = replace(walker, **{name: getattr(walker, name) + distance})
    beside = place_near(place.section.with_walker(walker), slope, guess)
    assert beside is not None
    return sensitivity(beside, gait.by)


def differenced(gait, column, quantity):
    """How a quantity of gaits changes with a parameter, by gaits at four distances."""
    name = gait.by[column]
    size = size_of(name, gait.place.section.walker, gait.place.section.slope)
    h = 2e-4 / max(1.0 / size, np.abs(gait.coordinates[:, column]).max())
    values = [quantity(found_beside(gait, name, column, k * h)) for k in (-2, -1, 1, 2)]
    return np.tensordot([1.0, -8.0, 8.0, -1.0], np.array(values), axes=1) / (12.0 * h)


@pytest.mark.parametrize("name", BY)
def test_a_gait_moves_as_the_implicit_function_theorem_says(name):
    gait = gait_of(name)
    for column in range(len(gait.by)):
        moved = differenced(gait, column, lambda gait: gait.place.search[0])
        np.testing.assert_allclose(
            gait.coordinates[:, column], moved, atol=1e-8 * np.abs(moved).max() + 1e-10
        )


@pytest.mark.parametrize("name", BY)
def test_quantities_of_a_gait_change_as_their_gradients_say(name):
    gait = gait_of(name)
    kneed = WALKERS[name].knees
    # A straight leg scuffs as it leaves the ground, and the simplest walker's all along.
    names = [n for n in QUANTITIES if kneed or n not in ("clearance", "knee_margin")]
    values, gradients = zip(*(QUANTITIES[n](gait) for n in names), strict=True)
    for column in range(len(gait.by)):
        moved = differenced(gait, column, lambda gait: [QUANTITIES[n](gait)[0] for n in names])
        size = np.maximum(np.abs(moved), np.abs(values))
        gradient = np.array([gradient[column] for gradient in gradients])
        np.testing.assert_allclose(gradient / size, moved / size, atol=1e-8)


def test_the_gait_of_a_system_costs_the_sine_of_its_slope_whatever_its_mass():
    """Gravity pays for the collisions."""
    slope, by = 0.03, ("slope", *COMPASS.parameters)
    strides = StrideMap.of(COMPASS, slope=slope)
    gait = sensitivity(strides.points(find_gait(strides).state), by)
    cost, gradient = QUANTITIES["cost_of_transport"](gait)
    assert cost == pytest.approx(np.sin(slope), abs=1e-12)
    np.testing.assert_allclose(gradient, [np.cos(slope), 0.0, 0.0], atol=1e-10)
    mass, by_part = QUANTITIES["total_mass"](gait)
    hip, leg = COMPASS.body
    assert mass == pytest.approx(hip + 2.0 * leg, rel=1e-12)
    np.testing.assert_allclose(by_part, [0.0, 1.0, 2.0], atol=1e-12)


@pytest.mark.parametrize("name", BY)
def test_multipliers_change_as_those_of_gaits_found_beside_do(name):
    gait = gait_of(name)
    sizes = [size_of(n, gait.place.section.walker, gait.place.section.slope) for n in gait.by]
    change = map_change(gait, sizes)
    values, moved = multiplier_changes(gait.map, change)
    np.testing.assert_allclose(values, multipliers_of(gait.map), atol=1e-14)
    _, by = coefficients(gait.map, change)
    for column in range(len(gait.by)):
        differences = differenced(gait, column, lambda gait: gait.map)
        size = np.abs(differences).max()
        np.testing.assert_allclose(change[..., column], differences, atol=1e-8 * size + 1e-10)
        of_cubic = differenced(gait, column, lambda gait: coefficients(gait.map, change)[0])
        np.testing.assert_allclose(by[:, column], of_cubic, atol=1e-8 * size + 1e-10)
        sums = differenced(gait, column, lambda gait: np.trace(gait.map))
        assert moved[:, column].sum() == pytest.approx(sums, rel=1e-7, abs=1e-8 * size + 1e-10)
    # The largest multiplier alone, where it is simple and real.
    if values[0].imag == 0.0:
        largest = differenced(gait, 0, lambda gait: multipliers_of(gait.map)[0].real)
        assert moved[0, 0].real == pytest.approx(largest, rel=1e-7)


@pytest.mark.parametrize("name", ["lab", "sprung", "driven"])
def test_quantities_are_those_that_users_know(name):
    walker, slope, gait = WALKERS[name], SLOPES[name], gait_of(name)
    known = find_gait(gait.place.section)
    spent = known.cost_of_transport / (known.collision_cost + known.friction_cost)
    assert (spent > 1.01) == (name in HELD)
    for name in [n for n in QUANTITIES if walker.knees or n not in ("clearance", "knee_margin")]:
        value = QUANTITIES[name](gait)[0]
        if name == "clearance":
            expected = reality_check(walker, slope, known.state).clearance.value
        elif name == "knee_margin":
            expected = 1.0 - known.kneestrike_time / known.step_period
        else:
            expected = getattr(known, name, None) or getattr(walker, name)
        assert value == pytest.approx(expected, rel=1e-9), name
    assert spectral_radius(gait.map) == pytest.approx(abs(known.multipliers[0]), rel=1e-9)


def test_where_the_knee_stop_turns_the_swing_foot_up_its_height_is_followed_there():
    # Tuned, C's foot would go on down if its knee did not lock.
    walker, slope = tune("C"), 0.05
    known = find_gait(walker, slope)
    gait = sensitivity(known.point, ("slope", "shank_com"))
    _, gradient = QUANTITIES["clearance"](gait)
    for column in (0, 1):
        moved = differenced(gait, column, lambda gait: QUANTITIES["clearance"](gait)[0])
        assert gradient[column] == pytest.approx(moved, rel=1e-6)


def test_there_is_no_gait_near_to_a_guess_far_from_any():
    gait = gait_of("lab")
    assert place_near(StrideMap.of("lab"), 0.001, gait.place.search[0]) is None


def test_all_roots_lie_inside_a_circle_just_where_its_conditions_are_positive():
    random = np.random.default_rng(3)
    agreed = {True: 0, False: 0}
    for _ in range(2000):
        matrix = random.standard_normal((3, 3)) * random.uniform(0.1, 1.0)
        if random.random() < 0.3:
            matrix[:, 0] = 0.0  # a direction that is forgotten
        cubic, _ = coefficients(matrix, np.zeros((3, 3, 1)))
        radius = random.uniform(0.3, 1.5)
        within = spectral_radius(matrix) < radius
        assert (inside(cubic, radius)[0] > 0.0).all() == within
        agreed[bool(within)] += 1
    assert min(agreed.values()) > 200


def test_the_conditions_of_a_circle_change_as_their_derivatives_say():
    cubic, radius, h = np.array([0.3, -0.2, 0.1]), 0.7, 1e-4
    _, by = inside(cubic, radius)
    for column in range(4):
        step = h * np.eye(4)[column]
        ends = [inside(cubic + s * step[:3], radius + s * step[3])[0] for s in (-1.0, 1.0)]
        np.testing.assert_allclose(by[:, column], (ends[1] - ends[0]) / (2.0 * h), atol=1e-6)


def test_states_of_a_place_are_the_gait_s():
    gait = gait_of("lab").place
    np.testing.assert_allclose(gait.states[0], find_gait("lab", 0.036).state, rtol=1e-11)
