"""Samples of a walk lie on the motion that the stride map integrates."""

import numpy as np
import pytest

import gym_passive_walker as gpw
from gym_passive_walker import Outcome, stride
from gym_passive_walker.gaits.look.trajectory import simulate
from gym_passive_walker.models.equations.hybrid import Stage
from tests.before_impact import just_before
from tests.instants import states_at

SLOPE = 0.036
GAIT = np.array([0.24395, -0.24395, -0.24395, -1.0491, -0.3015, -1.4831])


def test_a_walk_starts_at_the_given_state():
    walk = simulate("lab", SLOPE, GAIT, samples=5)
    assert walk.times[0] == 0.0 and walk.contact_x[0] == 0.0
    np.testing.assert_allclose(walk.states[0], GAIT, rtol=1e-15)


def test_each_stride_starts_where_the_stride_map_says():
    walk = simulate("lab", SLOPE, GAIT, strides=3, samples=6)
    ends = stride("lab", SLOPE, GAIT)
    np.testing.assert_allclose(walk.states[6], ends.state, rtol=1e-14)
    assert walk.times[6] == ends.duration
    assert walk.contact_x[6] == ends.step_length
    assert list(walk.outcomes) == [Outcome.HEELSTRIKE] * 3
    assert list(walk.stride_index) == [0] * 6 + [1] * 6 + [2] * 6


def test_a_stride_ends_just_before_its_heelstrike():
    walk = simulate("lab", SLOPE, GAIT, samples=4)
    after = stride("lab", SLOPE, GAIT).state
    np.testing.assert_allclose(walk.states[-1, :3], -after[:3], atol=1e-8)
    assert abs(walk.states[-1, 3] - after[4]) > 0.1  # the collision is still to come


def test_a_sample_does_not_depend_on_the_others():
    few = simulate("lab", SLOPE, GAIT, samples=3)
    many = simulate("lab", SLOPE, GAIT, samples=201)
    np.testing.assert_array_equal(few.states[1], many.states[100])


def test_samples_follow_the_rates():
    walk = simulate("lab", SLOPE, GAIT, samples=2001)
    smooth = walk.phases[2:] == walk.phases[:-2]  # rates jump at kneestrike
    steps = (walk.times[2:] - walk.times[:-2])[:, None]
    differences = (walk.states[2:, :3] - walk.states[:-2, :3]) / steps
    np.testing.assert_allclose(differences[smooth], walk.states[1:-1, 3:][smooth], atol=1e-4)


def test_the_knee_is_free_first_and_locked_thereafter():
    walk = simulate("lab", SLOPE, GAIT, samples=50)
    locked = walk.times > stride("lab", SLOPE, GAIT).kneestrike_time
    np.testing.assert_array_equal(walk.phases, np.where(locked, Stage.LOCKED, Stage.FREE))
    np.testing.assert_array_equal(walk.states[locked, 1], walk.states[locked, 2])


def test_a_fall_ends_the_walk():
    walk = simulate("lab", SLOPE, [0.3, -0.3, -0.3, -0.1, 0.0, 0.0], strides=4, samples=7)
    assert list(walk.outcomes) == [Outcome.FELL_BACKWARD]
    assert walk.states.shape == (7, 6)
    assert walk.states[-1, 0] == pytest.approx(0.5 * np.pi, abs=1e-6)


def test_each_stride_has_its_own_torque():
    walk = simulate("lab", SLOPE, GAIT, strides=2, samples=3, hip_torque=[0.0, 0.02])
    second = stride("lab", SLOPE, walk.states[3], hip_torque=0.02)
    assert walk.times[-1] - walk.times[3] == pytest.approx(second.duration, rel=1e-8)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"state": np.tile(GAIT, (2, 1))}, "one walker"),
        ({"strides": 0}, "strides"),
        ({"samples": 1}, "samples"),
        ({"tolerance": 1e-3}, "tolerance"),
        ({"hip_torque": np.nan}, "hip_torque"),
    ],
)
def test_what_cannot_be_followed_is_refused(change, message):
    arguments = {"walker": "lab", "slope": SLOPE, "state": GAIT} | change
    with pytest.raises(ValueError, match=message):
        simulate(**arguments)


def test_states_can_be_had_at_any_instants_in_any_order():
    walk = simulate("lab", SLOPE, GAIT, samples=5)
    states, phases = states_at("lab", SLOPE, GAIT, walk.times[::-1])
    np.testing.assert_array_equal(states[::-1], walk.states)
    np.testing.assert_array_equal(phases[::-1], walk.phases)


@pytest.mark.parametrize("name", ["lab", "A", "D"])
def test_the_verge_of_heelstrike_has_the_angles_of_the_next_section(name):
    state = np.array([0.2, -0.2, -0.2, -0.95, -0.8, -0.8]) if name != "lab" else GAIT
    state = state * ([1, 1, 1, 0.67, 0.72, 0.72] if name == "D" else 1.0)
    end = stride(name, 0.01 if name != "lab" else SLOPE, state, tolerance=1e-13)
    verge = just_before(name, 0.01 if name != "lab" else SLOPE, state, end.duration)
    np.testing.assert_allclose(verge[:3], -end.state[:3], rtol=1e-12)


@pytest.mark.parametrize("torques", [{"hip_torque": 0.05}, {"ankle_torque": 0.002}])
def test_the_verge_of_a_strike_is_reached_under_the_torques_that_are_held(torques):
    state = np.array([0.2, -0.2, -0.2, -0.95, -0.8, -0.8]) * [1, 1, 1, 0.67, 0.72, 0.72]
    end = stride("D", 0.01, state, tolerance=1e-13, **torques)
    verge = just_before("D", 0.01, state, end.duration, **torques)
    np.testing.assert_allclose(verge[:3], -end.state[:3], rtol=1e-11)
    near = end.duration - np.array([1e-4, 2e-4, 3e-4])
    near, _ = states_at("D", 0.01, state, near, tolerance=1e-13, **torques)
    np.testing.assert_allclose(verge, 3.0 * near[0] - 3.0 * near[1] + near[2], atol=1e-9)


def test_rates_on_the_verge_of_a_strike_lie_on_the_line_that_leads_there():
    strike = float(stride("lab", SLOPE, GAIT, tolerance=1e-13).kneestrike_time)
    verge = just_before("lab", SLOPE, GAIT, strike)
    assert verge[1] == pytest.approx(verge[2], abs=1e-13)
    near, _ = states_at("lab", SLOPE, GAIT, strike - np.array([1e-4, 2e-4, 3e-4]), tolerance=1e-13)
    beyond = 3.0 * near[0] - 3.0 * near[1] + near[2]  # extrapolates through three samples
    np.testing.assert_allclose(verge, beyond, atol=1e-9)
    assert verge[5] > verge[4]  # the shank is still swinging forward


def test_a_controller_that_looks_ahead_sees_the_next_footholds():
    heights = np.array([0.0, 0.001, 0.0005, 0.0013, 0.0015, 0.0011, 0.0012, 0.0015])
    seen = []

    def look(observations):
        seen.append(observations[0, -4:].copy())
        return np.zeros((len(observations), 1))

    scene = {
        "walker": "lab", "slope": 0.036, "control": "stride", "terrain": gpw.rough(0.001),
        "terrain_lookahead": 2,
    }  # fmt: skip
    strides = gpw.stride_map(controller=look, scene=scene)
    start = gpw.find_gait("lab", 0.036).state
    gpw.simulate(strides, 0.036, start, strides=4, terrain=gpw.footholds(heights=heights))
    rises = np.diff(heights)
    expected = [[rises[k], 0.0, rises[k + 1], 0.0] for k in range(4)]
    np.testing.assert_allclose(seen[:4], expected, atol=1e-7)
