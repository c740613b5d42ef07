"""Measures of gaits, and the collision matrix of Eq. 4.7."""

from dataclasses import replace

import numpy as np
import pytest

from gym_passive_walker import (
    WALKERS,
    collision_matrix,
    find_gait,
    foot_velocity,
    lab_walker_from_parts,
    stairs,
    stride,
    stride_map,
    tune,
)
from gym_passive_walker.gaits.find.search import at_heelstrike
from gym_passive_walker.gaits.look.dense_stride import clearance_of
from gym_passive_walker.gaits.section import Section
from tests.instants import states_at

ALL = WALKERS | {
    "weighted": lab_walker_from_parts(),
    "tuned A": tune(WALKERS["A"]),
    "tuned C": tune(WALKERS["C"]),
    "large": replace(WALKERS["lab"], thigh_length=350.0, shank_length=460.0, gravity=1.6),
}
TUNED = ["tuned A", "tuned C", "B", "D", "E", "F"]
GAITS = [
    ("lab", 0.036, "long"),
    ("lab-straight", 0.036, "long"),
    ("C", 0.01, "long"),
    ("C", 0.01, "short"),
    ("A", 0.01, "long"),
    ("B", 0.01, "short"),
    ("D", 0.009, "long"),
    ("D", 0.009, "short"),
    ("E", 1e-6, "long"),
    ("E", 1e-6, "short"),
]


def loss_at_heelstrike(walker, before):
    """Energy that a heelstrike loses."""
    units = walker.units
    angle, rates = before[1:2], before[3:5, None] * units.time
    _, lost, _ = at_heelstrike(Section(walker=walker), angle, *rates)
    return lost[0] * units.energy


@pytest.mark.parametrize("name", ALL)
def test_the_collision_matrix_tells_the_loss_of_any_heelstrike(name):
    walker = ALL[name]
    rng = np.random.default_rng(5)
    for angle in np.geomspace(1e-3, 0.6, 30):
        stance_rate, swing_rate = rng.normal(size=2) / walker.time_unit
        before = np.array([-angle, angle, angle, stance_rate, swing_rate, swing_rate])
        velocity = np.array(foot_velocity(walker, before))
        loss = 0.5 * velocity @ collision_matrix(walker, angle) @ velocity
        assert loss == pytest.approx(loss_at_heelstrike(walker, before), rel=1e-12)


@pytest.mark.parametrize("name", ALL)
def test_the_collision_matrix_is_symmetric_and_never_gains_energy(name):
    for angle in np.linspace(0.0, 0.6, 13):
        matrix = collision_matrix(ALL[name], angle)
        assert matrix[0, 1] == matrix[1, 0]
        low, high = np.linalg.eigvalsh(matrix)
        assert low > -1e-15 * high
        assert high <= (1.0 + 1e-15) * ALL[name].total_mass


@pytest.mark.parametrize("name", TUNED)
def test_a_tuned_walker_has_a_diagonal_matrix_at_zero_stance_angle(name):
    matrix, mass = collision_matrix(ALL[name], 0.0), ALL[name].total_mass
    assert abs(matrix[0, 1]) < 1e-16 * mass
    # A foot that comes straight down meets the whole walker (4.6.3, where x and y are exchanged).
    assert matrix[1, 1] == pytest.approx(mass, rel=1e-15)
    assert matrix[0, 0] < 0.2 * mass


@pytest.mark.parametrize("name", ["lab", "lab-straight", "weighted"])
def test_the_lab_walker_has_no_diagonal_matrix(name):
    matrix = collision_matrix(ALL[name], 0.0)
    assert abs(matrix[0, 1]) > 0.01 * ALL[name].total_mass
    assert matrix[1, 1] < 0.999 * ALL[name].total_mass


@pytest.mark.parametrize("name", ["E", "F"])
def test_a_point_foot_that_slides_meets_its_own_mass_alone(name):
    matrix = collision_matrix(name, 0.0)
    assert matrix[0, 0] == pytest.approx(WALKERS[name].shank_mass, rel=1e-13)


def test_the_simplest_walker_is_the_limit_of_a_vanishing_foot_mass():
    light = replace(WALKERS["E"], thigh_mass=0.5, shank_mass=1e-9)
    np.testing.assert_allclose(
        collision_matrix(light, 0.2), collision_matrix("D", 0.2), atol=1e-8, rtol=0.0
    )


@pytest.mark.parametrize("name", ["lab", "A", "D"])
def test_foot_velocity_is_how_the_landing_foot_moves(name):
    walker = WALKERS[name]
    before = np.array([-0.2, 0.2, 0.2, -1.1, 0.4, 0.4])
    clearance, rate = clearance_of(walker, before[None])
    velocity = foot_velocity(walker, before)
    assert clearance[0] == pytest.approx(0.0, abs=1e-15)
    assert velocity.normal == pytest.approx(rate[0], rel=1e-12)
    # By the legs' opening: foot centres are 2 leg sin(angle) apart, and the feet roll.
    leg = walker.thigh_length * np.cos(walker.foot_angle)
    leg += (walker.shank_length - walker.foot_radius) * np.cos(walker.shank_angle)
    expected = -(leg * np.cos(0.2) + walker.foot_radius) * (before[3] - before[4])
    assert velocity.tangential == pytest.approx(expected, rel=1e-12)


def test_foot_velocity_takes_many_states():
    states = np.array([[-a, a, a, -1.0, 0.3, 0.3] for a in (0.1, 0.2, 0.3)])
    velocity = foot_velocity("lab", states)
    assert velocity.tangential.shape == velocity.normal.shape == (3,)
    assert velocity.normal[1] == foot_velocity("lab", states[1]).normal


def test_clearance_has_the_rate_of_its_own_change():
    gait = np.array([0.24395, -0.24395, -0.24395, -1.0491, -0.3015, -1.4831])
    times = 0.2 + np.array([-1e-4, 0.0, 1e-4])
    height, rate = clearance_of(
        WALKERS["lab"], states_at("lab", 0.036, gait, times, tolerance=1e-13)[0]
    )
    assert (height[2] - height[0]) / 2e-4 == pytest.approx(rate[1], rel=1e-6)


def test_long_steps_of_straight_legs_land_without_sliding_as_the_slope_vanishes():
    """Section 4.6.3: the normal velocity goes like slope^(2/3), and the sliding faster."""
    sliding = [foot_velocity(find_gait("E", slope, "long")) for slope in (1e-4, 1e-6)]
    assert abs(sliding[0].tangential / sliding[0].normal) < 1e-4
    assert abs(sliding[1].tangential / sliding[1].normal) < 1e-6
    assert sliding[0].normal / sliding[1].normal == pytest.approx(100.0 ** (2.0 / 3.0), rel=0.01)


def test_a_stride_ends_with_the_loss_that_its_foot_velocity_tells():
    state = np.array([0.25, -0.25, -0.25, -1.06, -0.3, -1.5])
    end = stride("lab", 0.04, state, tolerance=1e-13)
    verge = states_at("lab", 0.04, state, [float(end.duration) - 1e-9], tolerance=1e-13)[0][0]
    velocity = np.array(foot_velocity("lab", verge))
    loss = 0.5 * velocity @ collision_matrix("lab", end.state[0]) @ velocity
    assert loss == pytest.approx(float(end.heelstrike_loss), rel=1e-7)


@pytest.mark.parametrize("measure", [collision_matrix, foot_velocity])
def test_a_gait_on_a_terrain_has_no_collision_on_smooth_ground(measure):
    gait = find_gait(stride_map("lab", 0.036, terrain=stairs(-0.002)))
    with pytest.raises(ValueError, match=r"smooth ground.*on a terrain.*simulate\(gait\)\.strikes"):
        measure(gait)
