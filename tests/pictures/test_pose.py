"""The drawn walker is that of Fig. 4.1, at the position of the model."""

import math

import numpy as np
import pytest

from gym_passive_walker import WALKERS, stride
from gym_passive_walker.gaits.look.trajectory import simulate
from gym_passive_walker.models.equations import kneed
from gym_passive_walker.models.equations.hybrid import State
from gym_passive_walker.pictures.pose import legs_by_identity, level, pose

SLOPE = 0.036
GAIT = np.array([0.24395, -0.24395, -0.24395, -1.0491, -0.3015, -1.4831])
POSTURE = np.array([0.21, 0.33, -0.4, 0.0, 0.0, 0.0])

every_walker = pytest.mark.parametrize("name", WALKERS)


@every_walker
def test_both_feet_touch_the_ground_at_heelstrike(name):
    walker = WALKERS[name]
    posture = pose(walker, GAIT)
    assert posture.contact[1] == 0.0
    assert posture.stance.foot[1] == pytest.approx(walker.foot_radius, abs=1e-15)
    assert posture.swing.foot[1] == pytest.approx(walker.foot_radius, abs=1e-15)


@every_walker
def test_links_keep_their_lengths(name):
    walker = WALKERS[name]
    posture = pose(walker, POSTURE, 3.0)
    for leg in (posture.stance, posture.swing):
        assert math.dist(posture.hip, leg.knee) == pytest.approx(walker.thigh_length)
        assert math.dist(leg.knee, leg.tip) == pytest.approx(walker.shank_length)
        assert math.dist(leg.foot, leg.tip) == pytest.approx(walker.foot_radius)
        radii = np.linalg.norm(leg.sole - leg.foot, axis=-1)
        np.testing.assert_allclose(radii, walker.foot_radius, atol=1e-15)


@every_walker
def test_hip_and_stance_foot_stand_apart_as_in_the_equations(name):
    walker = WALKERS[name]
    posture = pose(walker, POSTURE)
    length = walker.body.leg * walker.leg_length
    np.testing.assert_allclose(
        posture.hip - posture.stance.foot,
        [-length * math.sin(POSTURE[0]), length * math.cos(POSTURE[0])],
        rtol=1e-14,
    )


def test_a_positive_angle_puts_the_hip_uphill_of_the_foot():
    assert pose("D", GAIT).hip[0] < 0.0


def test_the_swing_foot_is_as_high_as_the_equations_have_it():
    walker = WALKERS["lab"]
    expected = walker.leg_length * kneed.foot_clearance(walker.body, State(*POSTURE))
    foot = pose(walker, POSTURE).swing.foot
    assert foot[1] - walker.foot_radius == pytest.approx(expected, rel=1e-13)


@pytest.mark.parametrize("angle", [-0.4, 0.0, 0.4])
def test_the_knee_is_behind_the_line_from_hip_to_foot_by_the_foot_angle(angle):
    posture = pose("lab", [angle] * 3 + [0.0] * 3)
    thigh, line = posture.stance.knee - posture.hip, posture.stance.foot - posture.hip
    turn = math.atan2(thigh[0] * line[1] - thigh[1] * line[0], thigh @ line)
    assert turn == pytest.approx(WALKERS["lab"].foot_angle)


def test_a_bent_knee_trails_the_foot():
    straight = pose("lab", [0.0, 0.3, 0.3, 0.0, 0.0, 0.0])
    bent = pose("lab", [0.0, 0.3, -0.3, 0.0, 0.0, 0.0])
    np.testing.assert_array_equal(bent.swing.knee, straight.swing.knee)
    assert bent.swing.foot[0] < straight.swing.foot[0]


def test_a_straight_leg_ignores_its_shank():
    np.testing.assert_array_equal(
        pose("A", POSTURE).swing.foot, pose("A", POSTURE[[0, 1, 1, 3, 4, 5]]).swing.foot
    )


def test_the_stance_foot_rolls_and_never_slips():
    walker = WALKERS["lab"]
    walk = simulate(walker, SLOPE, GAIT, samples=50)
    rolled = -walker.foot_radius * np.diff(walk.states[:, 0])
    np.testing.assert_allclose(np.diff(walk.contact_x), rolled, atol=1e-15)
    # The point of the sole that is on the ground stands still: a small roll moves it by a cycloid.
    before, roll = -0.1, 1e-3
    first = pose(walker, [before] * 3 + [0.0] * 3).stance.foot
    second = pose(walker, [before - roll] * 3 + [0.0] * 3, walker.foot_radius * roll).stance.foot
    below = np.array([0.0, -walker.foot_radius])
    turned = below @ np.array([[math.cos(roll), -math.sin(roll)], [math.sin(roll), math.cos(roll)]])
    np.testing.assert_allclose(second + turned, first + below, atol=walker.foot_radius * roll**2)
    np.testing.assert_allclose((second + turned)[0], (first + below)[0], atol=1e-10)


@pytest.mark.parametrize("name", ["lab", "B", "D"])
def test_a_heelstrike_moves_no_part_of_the_walker(name):
    start = {
        "lab": GAIT,
        "B": [0.23575, -0.23575, -0.23575, -0.76170, -0.69560, -0.69560],
        "D": [0.20031, -0.20031, -0.20031, -0.62589, -0.57633, -0.57633],
    }[name]
    slope = {"lab": SLOPE, "B": 0.01, "D": 0.009}[name]
    walk = simulate(name, slope, start, strides=2, samples=2)
    before = pose(name, walk.states[1], walk.contact_x[1])
    after = pose(name, walk.states[2], walk.contact_x[2])
    np.testing.assert_allclose(before.hip, after.hip, atol=1e-7)
    for old, new in zip(legs_by_identity(before, 0), legs_by_identity(after, 1), strict=True):
        np.testing.assert_allclose(old.knee, new.knee, atol=1e-7)
        np.testing.assert_allclose(old.sole, new.sole, atol=1e-7)
    assert after.contact[0] - pose(name, start).contact[0] == pytest.approx(
        stride(name, slope, start).step_length
    )


def test_the_first_leg_stands_in_even_strides_and_swings_in_odd_ones():
    posture = pose("lab", POSTURE)
    first, other = legs_by_identity(posture, 2)
    assert first is posture.stance and other is posture.swing
    first, other = legs_by_identity(posture, 3)
    assert first is posture.swing and other is posture.stance


def test_many_states_are_posed_as_each_alone():
    walk = simulate("lab", SLOPE, GAIT, samples=4)
    together = pose("lab", walk.states, walk.contact_x)
    assert together.hip.shape == (4, 2)
    for index, (state, contact) in enumerate(zip(walk.states, walk.contact_x, strict=True)):
        alone = pose("lab", state, contact)
        np.testing.assert_allclose(together.swing.sole[index], alone.swing.sole, rtol=1e-14)


def test_downhill_is_right_and_down():
    np.testing.assert_allclose(level([1.0, 0.0], 0.3), [math.cos(0.3), -math.sin(0.3)])
    np.testing.assert_allclose(level([0.0, 1.0], 0.3), [math.sin(0.3), math.cos(0.3)])


def test_a_state_of_another_shape_is_refused():
    with pytest.raises(ValueError, match="state must be"):
        pose("lab", [0.1, -0.1])
