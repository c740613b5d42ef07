"""Strides under a torque that changes from tick to tick, and their derivatives."""

import numpy as np
import pytest

import gym_passive_walker as gpw
from gym_passive_walker.control.feedback import powered_gait
from gym_passive_walker.control.optimum import Problem
from gym_passive_walker.control.ticks import ticked_stride
from gym_passive_walker.envs.scene import make_scene
from gym_passive_walker.gaits.section import Section
from gym_passive_walker.gaits.stability import NoStride
from gym_passive_walker.units import units_of

WALKER = gpw.WALKERS["C"]
TICK, TICKS = 0.1, 32


@pytest.fixture(scope="module")
def level():
    """Where walker C's gait under a constant torque starts on level ground."""
    return Section(walker=WALKER).points_at(powered_gait(WALKER, 0.0).state)[0]


def walk(point, torques):
    """A stride's end and measures in one array, and their derivatives."""
    walked = ticked_stride(WALKER, 0.0, point, torques, tick=TICK)
    measures = [walked.duration, walked.length, *walked.swing, *walked.turn, walked.kneestrike]
    return np.concatenate([walked.end, measures]), walked.by


def test_derivatives_are_those_of_the_stride(level):
    rng = np.random.default_rng(0)
    torques = 0.0025 + rng.normal(0.0, 0.002, TICKS)
    direction = np.concatenate([rng.normal(0.0, 1e-6, 4), rng.normal(0.0, 1e-8, TICKS)])
    ahead, _ = walk(level + direction[:4], torques + direction[4:])
    behind, _ = walk(level - direction[:4], torques - direction[4:])
    _, by = walk(level, torques)
    assert 0.5 * (ahead - behind) == pytest.approx(by @ direction, abs=1e-8 * 1e-6 + 1e-12)


def test_equal_ticks_are_one_torque(level):
    gait = powered_gait(WALKER, 0.0)
    unit = WALKER.total_mass * WALKER.gravity * WALKER.leg_length
    walked = ticked_stride(WALKER, 0.0, level, np.full(TICKS, gait.hip_torque / unit), tick=TICK)
    assert walked.end == pytest.approx(level, abs=1e-9)
    whole = gpw.stride(WALKER, 0.0, gait.state, hip_torque=gait.hip_torque)
    assert walked.duration * WALKER.time_unit == pytest.approx(float(whole.duration))
    assert gait.hip_torque * walked.turn.sum() == pytest.approx(float(whole.hip_work_absolute))
    assert gait.hip_torque * walked.swing.sum() == pytest.approx(float(whole.hip_work))


@pytest.fixture(scope="module")
def stubbing():
    """A point and a torque whose stride stubs its toe, if that is a rule."""
    random, section, units = np.random.default_rng(0), Section(walker=WALKER), units_of(WALKER)
    point = section.points_at(gpw.find_gait(WALKER, 0.02).state)[0]
    points = point * (1.0 + 0.3 * random.uniform(-1.0, 1.0, (4000, 4)))
    torques = random.uniform(-0.05, 0.05, 4000)
    strides = [
        gpw.stride(
            WALKER, 0.02, section.states_at(points), hip_torque=torques * units.torque, stub=stub
        )
        for stub in (False, True)
    ]
    walks, stubs = (strike.outcome for strike in strides)
    both = (walks == gpw.Outcome.HEELSTRIKE) & (stubs == gpw.Outcome.STUBBED_TOE)
    which = np.flatnonzero(both)[0]
    return points[which], np.array([torques[which]])


def test_a_stubbed_toe_ends_a_stride_where_that_is_a_rule(stubbing):
    ticked_stride(WALKER, 0.02, *stubbing, tick=TICK)
    with pytest.raises(NoStride, match="STUBBED_TOE"):
        ticked_stride(WALKER, 0.02, *stubbing, tick=TICK, stub=True)


def test_a_gait_says_whether_its_toe_would_stub(stubbing):
    point, torque = stubbing
    problem = Problem(make_scene("level", slope=0.02), 0.1, 1, 4)
    assert problem.measured(problem.guess(point, torque)).stubs
    gait = gpw.find_gait(WALKER, 0.02)
    point = Section(walker=WALKER).points_at(gait.state)[0]
    assert not problem.measured(problem.guess(point, [0.0])).stubs


def test_torques_after_the_heelstrike_have_no_effect(level):
    walked = ticked_stride(WALKER, 0.0, level, np.full(TICKS, 0.0025), tick=TICK)
    taken = int(np.ceil(walked.duration / TICK))
    assert np.all(walked.by_torque[:, taken:] == 0.0) and np.all(walked.turn[taken:] == 0.0)
    assert np.all(np.abs(walked.by_torque[:, :taken]).max(axis=0) > 0.0)


@pytest.mark.parametrize("name", ["lab", "lab-straight"])
def test_a_section_point_is_its_state(name):
    walker = gpw.WALKERS[name]
    state = gpw.find_gait(walker, 0.02).state
    rates = np.array([1.0] * 3 + [walker.time_unit] * 3)
    section = Section(walker=walker)
    assert section.state(section.points_at(state)[0]) == pytest.approx(state * rates)


def test_a_fall_is_no_stride(level):
    with pytest.raises(NoStride, match="FELL"):
        ticked_stride(WALKER, 0.0, level * 0.1, np.full(TICKS, -0.05), tick=TICK)
