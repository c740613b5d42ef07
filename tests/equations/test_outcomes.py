"""A stride from any state ends in bounded time, with a known outcome and a finite state."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from gym_passive_walker import WALKERS, Outcome, Walker, WalkerError, stride
from gym_passive_walker.engine.run import advance, new_records
from gym_passive_walker.models.model import bodies
from tests.equations.examples import KNEED, LONG_GAITS, MASSIVE

STRAIGHT_OUT = [0.2, -0.2, -0.2]


def state(angles, *rates):
    """A state of walker D, E or the like: rates in units of sqrt(g/l), straight legs."""
    rates = [*rates, rates[-1]] if len(rates) == 2 else rates
    return np.array([*angles, *(np.sqrt(9.81) * np.array(rates))])


def test_a_walker_pushed_a_little_strikes_its_heel():
    assert stride("E", 0.01, LONG_GAITS["E"].state).outcome == Outcome.HEELSTRIKE


@pytest.mark.parametrize("name", WALKERS)
def test_a_walker_that_is_held_back_falls_backward(name):
    fallen = stride(name, 0.0, LONG_GAITS[name].state * [1.0, 1.0, 1.0, 0.0, 0.0, 0.0])
    assert fallen.outcome in (Outcome.FELL_BACKWARD, Outcome.SWING_OVERROTATION)
    still = stride("E", 0.0, state([0.5, -0.5, -0.5], 0.5, 0.5))
    assert still.outcome == Outcome.FELL_BACKWARD
    assert still.state[0] == pytest.approx(0.5 * np.pi, abs=1e-14)


@pytest.mark.parametrize("name", ["A", "B", "D", "E", "F"])
def test_a_walker_with_a_leg_that_hangs_back_falls_forward(name):
    fallen = stride(name, 0.0, LONG_GAITS[name].state * [1.0, 1.0, 1.0, 3.0, -0.5, -0.5])
    assert fallen.outcome == Outcome.FELL_FORWARD
    assert fallen.state[0] == pytest.approx(-0.5 * np.pi, abs=1e-14)
    assert np.isnan(fallen.step_length)
    assert np.isnan(fallen.kneestrike_time)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("name", WALKERS)
def test_a_leg_that_is_thrown_hard_goes_over_the_top(name, sign):
    thrown = stride(name, 0.0, state(STRAIGHT_OUT, 0.0, 30.0 * sign))
    assert thrown.outcome == Outcome.SWING_OVERROTATION
    assert abs(thrown.state[1]) == pytest.approx(np.pi, abs=1e-14)


@pytest.mark.parametrize("name", KNEED)
def test_a_shank_that_is_thrown_up_goes_over_the_top(name):
    thrown = stride(name, 0.0, state(STRAIGHT_OUT, 0.0, 0.0, -30.0))
    assert thrown.outcome == Outcome.SWING_OVERROTATION
    assert thrown.state[2] == pytest.approx(-np.pi, abs=1e-14)


@pytest.mark.parametrize("name", KNEED)
def test_a_knee_that_snaps_shut_at_once_stubs_the_toe_where_that_is_a_rule(name):
    """Pulled back by the thigh, the shank closes while the leg is still behind the other."""
    walker, gait = WALKERS[name], LONG_GAITS[name]
    pull = {"hip_torque": -0.04 * walker.units.torque}
    free = stride(walker, gait.slope, gait.state, **pull)
    ruled = stride(walker, gait.slope, gait.state, end_on_toe_stub=True, **pull)
    assert ruled.outcome == Outcome.STUBBED_TOE
    assert free.outcome != Outcome.STUBBED_TOE
    assert 0.0 < ruled.kneestrike_time <= ruled.duration < free.duration


@pytest.mark.parametrize("name", KNEED)
def test_an_ordinary_gait_stubs_no_toe(name):
    gait = LONG_GAITS[name]
    ruled = stride(name, gait.slope, gait.state, end_on_toe_stub=True)
    usual = stride(name, gait.slope, gait.state)
    assert ruled.outcome == Outcome.HEELSTRIKE
    np.testing.assert_array_equal(ruled.state, usual.state)


@pytest.mark.parametrize("name", [name for name in WALKERS if name not in KNEED])
def test_straight_legs_always_scuff_so_no_rule_forbids_it(name):
    gait = LONG_GAITS[name]
    ruled = stride(name, gait.slope, gait.state, end_on_toe_stub=True)
    assert ruled.outcome == Outcome.HEELSTRIKE


def test_a_knee_that_is_late_meets_the_ground_bent():
    """The foot is in front and below the ground when the knee locks."""
    gait = LONG_GAITS["C"]
    late = stride("C", gait.slope, gait.state * [1.0, 1.0, 1.0, 1.4, 1.0, 2.0])
    assert late.outcome == Outcome.KNEE_NOT_LOCKED
    assert late.kneestrike_time == late.duration
    assert late.kneestrike_loss > 0.0
    assert np.isnan(late.step_length)
    stance, thigh, shank = late.state[:3]
    assert stance < 0.0 > stance + thigh
    assert thigh == shank


@pytest.mark.parametrize("name", ["B", "D", "E", "F"])
def test_a_walker_that_stands_still_has_stalled(name):
    still = stride(name, 0.0, np.zeros(6), max_stride_time=20.0)
    assert still.outcome == Outcome.STALLED
    assert still.duration == pytest.approx(20.0 * WALKERS[name].time_unit, rel=1e-15)
    np.testing.assert_array_equal(still.state, 0.0)


def test_a_motion_beyond_all_numbers_diverges():
    thrown = stride("lab", 0.0, [0.2, -0.2, -0.2, 1e200, -1e200, 1e200])
    assert thrown.outcome == Outcome.DIVERGED
    assert np.all(np.isfinite(thrown.state))


@pytest.mark.parametrize(
    ("angles", "outcome"),
    [
        ([-0.5 * np.pi, 0.0, 0.0], Outcome.FELL_FORWARD),
        ([0.5 * np.pi, 0.0, 0.0], Outcome.FELL_BACKWARD),
        ([-2.0, 0.0, 0.0], Outcome.FELL_FORWARD),
        ([9.0, 0.0, 0.0], Outcome.FELL_BACKWARD),
        ([0.0, np.pi, 0.0], Outcome.SWING_OVERROTATION),
        ([0.0, -np.pi, 0.0], Outcome.SWING_OVERROTATION),
        ([0.0, 0.0, np.pi], Outcome.SWING_OVERROTATION),
        ([0.0, 0.0, -4.0], Outcome.SWING_OVERROTATION),
    ],
)
def test_a_walker_that_lies_there_already_has_fallen_at_once(angles, outcome):
    start = np.array([*angles, -1.0, 0.5, 0.5])
    fallen = stride("lab", 0.0, start)
    assert fallen.outcome == outcome
    assert fallen.duration == 0.0
    np.testing.assert_allclose(fallen.state, start, rtol=1e-15)


@pytest.mark.parametrize(
    ("name", "moved"),
    [*((name, [1, 2]) for name in WALKERS), *((name, [2]) for name in KNEED)],
)
def test_the_impacts_that_a_stride_starts_from_do_not_end_it(name, moved):
    """Rounding may put the new swing foot, or a straight knee, on either side of its event."""
    gait = LONG_GAITS[name]
    exact = stride(name, gait.slope, gait.state)
    for nudge in (1e-17, -1e-17, 1e-13, -1e-13):
        nudged = stride(name, gait.slope, gait.state + nudge * np.eye(6)[moved].sum(axis=0))
        assert nudged.outcome == Outcome.HEELSTRIKE
        np.testing.assert_allclose(nudged.state, exact.state, rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("name", ["A", "B", "D", "E", "F"])
def test_feet_together_are_not_a_step(name):
    """Leaving the ground together, the swing leg must first come round to the front."""
    found = stride(name, 0.02, [0.0, 0.0, 0.0, -0.5, -0.5, -0.5])
    assert found.outcome in (Outcome.HEELSTRIKE, Outcome.FELL_FORWARD)
    assert found.duration > 0.1 * WALKERS[name].time_unit


@pytest.mark.parametrize("name", MASSIVE)
def test_a_swing_foot_that_comes_up_in_front_has_not_struck(name):
    """Only coming down in front is a heelstrike; through the ground and up again is a scuff."""
    system, own = WALKERS[name].equations(), bodies(WALKERS[name])
    records = new_records(np.array([[-0.1, 0.08, 0.08, -0.3, 0.5, 0.5]]), 0.0)
    records["phase"] = len(system.phases) - 1
    (record,) = advance(system, own, records, tolerance=1e-10, from_section=False)[:, 0]
    came_up = 0.02 / 0.2
    assert record["time"] > 2.0 * came_up
    assert record["outcome"] == Outcome.HEELSTRIKE


ANY = st.floats(allow_nan=False, allow_infinity=False)
ORDINARY = st.floats(-10.0, 10.0)
SLOPE = st.floats(-0.5 * math.pi, 0.5 * math.pi, exclude_min=True, exclude_max=True)


def assert_ends(walker, slope, start, torque, **options) -> None:
    """A stride has a known outcome, a finite state and a permitted duration."""
    found = stride(walker, slope, start, hip_torque=torque, **options)
    assert found.outcome in set(Outcome) - {Outcome.RUNNING, Outcome.KNEESTRIKE}
    assert np.all(np.isfinite(found.state))
    assert 0.0 <= found.duration <= 100.0 * walker.time_unit * (1.0 + 1e-15)
    assert (found.outcome == Outcome.HEELSTRIKE) == np.isfinite(found.step_length)
    assert found.heelstrike_loss >= 0.0
    # One with all of its mass at its foot may whirl too fast to be followed, and stalls at once.
    if found.outcome == Outcome.STALLED and walker in WALKERS.values():
        assert found.duration == pytest.approx(100.0 * walker.time_unit)


@pytest.mark.parametrize("end_on_toe_stub", [False, True])
@pytest.mark.parametrize("name", WALKERS)
@given(slope=SLOPE, start=st.tuples(*[ORDINARY] * 6), torque=ORDINARY)
def test_any_throw_ends(name, end_on_toe_stub, slope, start, torque):
    assert_ends(WALKERS[name], slope, start, torque, end_on_toe_stub=end_on_toe_stub)


@pytest.mark.parametrize("name", WALKERS)
@given(slope=SLOPE, start=st.tuples(*[ANY] * 6), torque=ANY)
@example(slope=0.0, start=(0.1, 0.1, 0.1, 0.0, 0.0, 0.0), torque=1e308)
@example(slope=0.0, start=(0.1, 0.1, 0.1, 1e308, -1e308, 1e308), torque=0.0)
@example(slope=0.0, start=(0.0, 0.0, 0.0, 0.0, 2e-311, 2e-311), torque=0.0)
@example(slope=0.0, start=(5e-324, -5e-324, 5e-324, 5e-324, 0.0, -5e-324), torque=5e-324)
def test_numbers_of_any_size_end(name, slope, start, torque):
    with np.errstate(all="ignore"):
        found = stride(name, slope, start, hip_torque=torque)
    assert found.outcome in set(Outcome) - {Outcome.RUNNING, Outcome.KNEESTRIKE}
    assert np.all(np.isfinite(found.state))


@st.composite
def walkers(draw) -> Walker:
    """Walkers of any shape, also unrealistic ones."""
    size, share, fraction = st.floats(1e-3, 1e3), st.floats(0.0, 1.0), st.floats(-2.0, 2.0)
    knees = draw(st.booleans())
    thigh, shank = draw(size), draw(size)
    foot = draw(st.floats(0.0, 0.999)) * shank
    limit = math.asin(min(1.0, (shank - foot) / thigh))
    return Walker(
        thigh_length=thigh,
        thigh_offset=draw(fraction) * thigh,
        thigh_mass=draw(share),
        thigh_gyration=draw(share) * thigh,
        thigh_com=draw(fraction) * thigh,
        shank_length=shank,
        shank_offset=draw(fraction) * shank,
        shank_mass=draw(st.floats(1e-6, 1.0)),
        shank_gyration=draw(st.floats(1e-3, 2.0)) * shank,
        shank_com=draw(fraction) * shank,
        foot_radius=foot,
        foot_angle=draw(st.floats(-0.99, 0.99)) * limit,
        hip_mass=draw(share),
        knees=knees,
        gravity=draw(size),
    )


@given(walker=walkers(), slope=SLOPE, start=st.tuples(*[ORDINARY] * 6), torque=ORDINARY)
@settings(max_examples=300)
def test_a_walker_of_any_shape_ends(walker, slope, start, torque):
    assert_ends(walker, slope, start, torque)


GOOD = {"walker": "lab", "slope": 0.03, "state": LONG_GAITS["lab"].state}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"walker": "Lab"}, "no walker 'Lab'.*lab-straight"),
        ({"walker": None}, "no walker None"),
        ({"slope": np.nan}, "slope must be"),
        ({"slope": np.inf}, "slope must be"),
        ({"slope": 0.5 * np.pi}, "slope must be .*pi/2"),
        ({"slope": -2.0}, "slope must be"),
        ({"slope": [0.1, np.nan]}, "slope must be"),
        ({"state": [0.2, -0.2, -1.0, -0.3]}, r"shape \(6,\) or \(n, 6\), not \(4,\)"),
        ({"state": 0.2}, "state must be"),
        ({"state": [0.2, -0.2, np.nan, -1.0, -0.3, -0.3]}, "state must be .*finite"),
        ({"state": [0.2, -0.2, -0.2, -np.inf, -0.3, -0.3]}, "state must be .*finite"),
        ({"hip_torque": np.nan}, "hip_torque must be .*finite"),
        ({"hip_torque": -np.inf}, "hip_torque must be .*finite"),
        ({"tolerance": 0.0}, "tolerance must be "),
        ({"tolerance": 1e-16}, "tolerance must be "),
        ({"tolerance": 1.0}, "tolerance must be "),
        ({"tolerance": np.nan}, "tolerance must be "),
        ({"slope": "steep"}, "slope must be an angle.*not 'steep'"),
        ({"slope": True}, "slope must be an angle"),
        ({"slope": 0.1 + 0.1j}, "slope must be an angle"),
        ({"slope": None}, "slope must be an angle"),
        ({"slope": [[0.1], [0.1, 0.2]]}, "slope must be an angle"),
        ({"state": "upright"}, "state must be .*not 'upright'"),
        ({"state": [0.2, -0.2, "-0.2", -1.0, -0.3, -0.3]}, "state must be"),
        ({"state": [0.2, -0.2, 1j, -1.0, -0.3, -0.3]}, "state must be"),
        ({"hip_torque": "strong"}, "hip_torque must be .*not 'strong'"),
        ({"tolerance": "fine"}, "tolerance must be "),
        ({"tolerance": None}, "tolerance must be "),
        ({"tolerance": [1e-6, 1e-8]}, "tolerance must be "),
        ({"max_stride_time": "for ever"}, "max_stride_time must be one number"),
        ({"max_stride_time": 0.0}, "max_stride_time must be a number above 0"),
        ({"max_stride_time": np.inf}, "max_stride_time must be a finite number above 0"),
        ({"max_stride_time": np.nan}, "max_stride_time must be a finite number above 0"),
        ({"state": np.zeros((3, 6)), "slope": np.zeros(2)}, r"\(2,\).*states \(3,\) do not fit"),
        ({"hip_torque": np.zeros(2), "slope": np.zeros(3)}, "do not fit together"),
    ],
)
def test_what_cannot_be_walked_is_refused_with_a_reason(changes, message):
    arguments = {**GOOD, **changes}
    walker, slope, start = (arguments.pop(name) for name in ("walker", "slope", "state"))
    with pytest.raises(ValueError, match=message):
        stride(walker, slope, start, **arguments)


def test_an_unknown_walker_is_a_walker_error():
    with pytest.raises(WalkerError):
        stride("nobody", 0.0, np.zeros(6))


@pytest.mark.parametrize("shape", [(), (1,), (5,), (2, 3)])
def test_results_have_the_shape_of_what_was_given(shape):
    gait = LONG_GAITS["lab"]
    starts = np.broadcast_to(gait.state, (*shape, 6))
    found = stride("lab", gait.slope, starts)
    assert found.state.shape == (*shape, 6)
    for name in ("duration", "outcome", "step_length", "hip_work", "collision_loss"):
        assert np.shape(getattr(found, name)) == shape
    spread = stride("lab", np.full(shape, gait.slope), gait.state, hip_torque=np.zeros(shape))
    assert spread.state.shape == (*shape, 6)
    np.testing.assert_array_equal(spread.state, found.state)


def test_nobody_takes_no_stride():
    found = stride("lab", 0.036, np.zeros((0, 6)))
    assert found.state.shape == (0, 6)
    assert found.outcome.shape == (0,)


def test_a_stride_leaves_its_arguments_alone():
    gait = LONG_GAITS["A"]
    start = np.stack([gait.state, gait.state + 0.01])
    before = start.copy()
    stride("A", gait.slope, start)
    np.testing.assert_array_equal(start, before)


def test_a_walker_need_not_have_a_name():
    gait = LONG_GAITS["lab"]
    named = stride("lab", gait.slope, gait.state)
    given_ = stride(replace(WALKERS["lab"]), gait.slope, gait.state)
    np.testing.assert_array_equal(given_.state, named.state)
