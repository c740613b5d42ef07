"""Strides under a torque that changes from tick to tick, and their derivatives."""

from dataclasses import replace

import numpy as np
import pytest

import gym_passive_walker as gpw
from gym_passive_walker.gaits.actuation import Actuation
from gym_passive_walker.gaits.control import ticks
from gym_passive_walker.gaits.control.feedback import powered_gait
from gym_passive_walker.gaits.control.optimum import Problem
from gym_passive_walker.gaits.control.ticks import ticked_stride, ticked_strides
from gym_passive_walker.gaits.flow import Walkers, go_on, new_records
from gym_passive_walker.gaits.map_result import NoStride
from gym_passive_walker.gaits.scenes.scene import make_scene
from gym_passive_walker.gaits.section import Section
from gym_passive_walker.gaits.stride_map import StrideMap
from gym_passive_walker.models.equations import legs
from gym_passive_walker.models.equations.hybrid import Outcome

WALKER = gpw.WALKERS["C"]
TICK, TICKS = 0.1, 32
SLOPES = {"D": 0.009, "E": 0.009, "F": 0.009, "lab": 0.036}


@pytest.fixture(scope="module")
def level():
    """Where walker C's gait under a constant torque starts on level ground."""
    return Section(walker=WALKER).points_at(powered_gait(WALKER, 0.0).state)[0]


def walk(point, torques):
    """A stride's end and measures in one array, and their derivatives."""
    walked = ticked_stride(WALKER, 0.0, point, torques, tick=TICK)
    measures = [walked.duration, walked.length, *walked.swing, *walked.turn]
    measures += [walked.push_work, walked.kneestrike]
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
    torque = gait.controller.hip_torque
    unit = WALKER.total_mass * WALKER.gravity * WALKER.leg_length
    walked = ticked_stride(WALKER, 0.0, level, np.full(TICKS, torque / unit), tick=TICK)
    assert walked.end == pytest.approx(level, abs=1e-9)
    whole = gpw.stride(WALKER, 0.0, gait.state, hip_torque=torque)
    assert walked.duration * WALKER.time_unit == pytest.approx(float(whole.duration))
    assert torque * walked.turn.sum() == pytest.approx(float(whole.hip_work_absolute))
    assert torque * walked.swing.sum() == pytest.approx(float(whole.hip_work))


def test_walkers_that_differ_strike_each_in_its_own_time(monkeypatch):
    """The first to strike leaves the others their bodies, slopes and torques.

    So what is followed side by side ends where walkers went, and nobody needs a turn alone.
    """
    reported, followed = ticks._side_by_side, []

    def beside(*arguments):
        followed.append(reported(*arguments))
        return followed[-1]

    monkeypatch.setattr(ticks, "_side_by_side", beside)
    lengths, slopes = np.array([0.40, 0.52, 0.46, 0.55]), np.array([0.04, 0.036, 0.038, 0.03])
    gait = gpw.find_gait("lab", 0.036)
    points = np.repeat(Section(walker=gait.walker).points_at(gait.state), 4, axis=0)
    tick = 0.03  # short, so that some walk on for ticks after the first has struck
    torques = np.random.default_rng(1).normal(0.0, 1e-3, (4, 130))
    walkers = Walkers(walker=gait.walker, parameters={"shank_length": lengths})
    together = ticked_strides(walkers, slopes, points, torques, tick=tick)
    for i, length in enumerate(lengths):
        own = Walkers(walker=replace(gait.walker, shank_length=length))
        alone = ticked_strides(own, slopes[i], points[:1], torques[i : i + 1], tick=tick)
        for mine, its in zip(together[:-1], alone[:-1], strict=True):
            np.testing.assert_allclose(mine[i], its[0], rtol=1e-11, atol=1e-13)
    assert len(np.unique(np.ceil(together.duration / tick))) > 2
    assert len(followed) == 5 and all(alike.all() for _, alike in followed)


@pytest.fixture(scope="module")
def stubbing():
    """A point and a torque for which the stride stubs its toe, if that ends it."""
    random, section, units = np.random.default_rng(0), Section(walker=WALKER), WALKER.units
    point = section.points_at(gpw.find_gait(WALKER, 0.02).state)[0]
    points = point * (1.0 + 0.3 * random.uniform(-1.0, 1.0, (4000, 4)))
    torques = random.uniform(-0.05, 0.05, 4000)
    strides = [
        gpw.stride(
            WALKER,
            0.02,
            section.states_at(points),
            hip_torque=torques * units.torque,
            end_on_toe_stub=end_on_toe_stub,
        )
        for end_on_toe_stub in (False, True)
    ]
    walks, stubs = (strike.outcome for strike in strides)
    both = (walks == gpw.Outcome.HEELSTRIKE) & (stubs == gpw.Outcome.STUBBED_TOE)
    which = np.flatnonzero(both)[0]
    return points[which], np.array([torques[which]])


def test_a_stubbed_toe_ends_a_stride_where_that_is_a_rule(stubbing):
    ticked_stride(WALKER, 0.02, *stubbing, tick=TICK)
    with pytest.raises(NoStride, match="STUBBED_TOE"):
        ticked_stride(WALKER, 0.02, *stubbing, tick=TICK, end_on_toe_stub=True)


def test_a_gait_says_whether_its_toe_would_stub(stubbing):
    point, torque = stubbing
    problem = Problem(make_scene("level", slope=0.02), 0.1, 1)
    assert problem.measured(problem.begun(point, {"hip": torque})).stubs
    gait = gpw.find_gait(WALKER, 0.02)
    point = Section(walker=WALKER).points_at(gait.state)[0]
    assert not problem.measured(problem.begun(point, {})).stubs


def test_torques_after_the_heelstrike_have_no_effect(level):
    walked = ticked_stride(WALKER, 0.0, level, np.full(TICKS, 0.0025), tick=TICK)
    taken = int(np.ceil(walked.duration / TICK))
    assert np.all(walked.by_torque[:, taken:] == 0.0) and np.all(walked.turn[taken:] == 0.0)
    assert np.all(np.abs(walked.by_torque[:, :taken]).max(axis=0) > 0.0)


@pytest.mark.parametrize("longest", [1.0, 0.9])
def test_a_stride_that_lasts_as_long_as_allowed_has_no_further_control_step(level, longest):
    """Whether the longest time is a multiple of a control step, or not."""
    walkers, tick = Walkers(walker=WALKER), 0.25
    state = Section(walker=WALKER).state(level)
    records = new_records(state[None], 0.0)

    def nothing(chosen, found, number, on):
        return ticks.Choice(np.zeros((len(on), 1)))

    steps = ticks.follow(
        walkers, records, nothing, motors=("hip_torque",), tick=tick, max_stride_time=longest
    )
    assert steps.numbers.tolist() == [0, 1, 2, 3]
    assert steps.after["time"][-1, 0] == longest


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


def many(count):
    """Starts around a gait of the laboratory's walker, and torques of each: (n, m) and (n, N)."""
    rng, strides = np.random.default_rng(2), StrideMap.of("lab")
    points = strides.points_at(gpw.find_gait("lab", 0.036).state)
    points = points * (1.0 + 0.01 * rng.uniform(-1.0, 1.0, (count, 4)))
    return points, rng.normal(0.0, 0.003, (count, TICKS))


def test_strides_of_a_batch_are_those_of_each_alone():
    points, torques = many(5)
    points[3, 1] = -0.1  # too slow for the top
    walkers, alone = Walkers(walker=gpw.WALKERS["lab"]), []
    for point, held in zip(points, torques, strict=True):
        alone.append(ticked_strides(walkers, 0.036, point[None], held[None], tick=TICK))
    together = ticked_strides(walkers, 0.036, points, torques, tick=TICK)
    assert together.outcomes.tolist() == [1, 1, 1, Outcome.FELL_BACKWARD, 1]
    for name, values in list(together._asdict().items())[:-1]:
        np.testing.assert_array_equal(values, np.concatenate([getattr(x, name) for x in alone]))
    assert np.isnan(together.by[3]).all() and np.isnan(together.end[3]).all()


@pytest.mark.parametrize("together", [1, 3, 4, 7])
def test_a_crowd_that_is_followed_in_parts_is_the_crowd(together, monkeypatch):
    """With as many walkers at once as fit, fewer, or all."""
    points, torques = many(7)
    walkers = Walkers(walker=gpw.WALKERS["lab"])
    whole = ticked_strides(walkers, 0.036, points, torques, tick=TICK)
    monkeypatch.setattr(ticks, "_TOGETHER", (together, together))
    parts = ticked_strides(walkers, 0.036, points, torques, tick=TICK)
    for name in ("end", "duration", "length", "swing", "turn", "kneestrike", "by"):
        np.testing.assert_array_equal(getattr(parts, name), getattr(whole, name))


def test_under_one_torque_a_stride_in_ticks_has_the_stride_map_s_derivatives():
    """By the start, the torque, the slope and what the walker is made of, each walker its own."""
    points, _ = many(3)
    radii = gpw.WALKERS["lab"].foot_radius * np.array([1.0, 0.98, 1.01])
    slopes, by = np.array([0.036, 0.034, 0.038]), ("slope", "foot_radius", "thigh_com")
    walkers = Walkers(walker=gpw.WALKERS["lab"], parameters={"foot_radius": radii}, tolerance=1e-13)
    held = np.full((3, TICKS), 0.002)
    ticked = ticked_strides(walkers, slopes, points, held, tick=TICK, by=by)
    strides = replace(StrideMap.of("lab"), actuation=Actuation(0.002)).with_parameter(
        "foot_radius", radii
    )
    passage, change = strides.linearize(points, slopes, by=("state", "hip_torque", *by))
    expected = [change.ends, change.durations[:, None], change.lengths[:, None]]
    expected = np.concatenate([*expected, change.knee_times[:, None]], axis=1)
    found = np.concatenate([ticked.by[:, :6], ticked.by[:, -1:]], axis=1)
    torque = found[:, :, 4 : 4 + TICKS].sum(axis=2, keepdims=True)
    found = np.concatenate([found[:, :, :4], torque, found[:, :, 4 + TICKS :]], axis=2)
    np.testing.assert_allclose(ticked.length, passage.lengths, rtol=1e-11)
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("name", gpw.WALKERS)
def test_the_hip_s_way_and_work_in_a_tick_have_their_derivatives(name):
    """Tick by tick through a whole stride, by the state, the slope, the torque and a parameter."""
    walker, slope = gpw.WALKERS[name], SLOPES.get(name, 0.03)
    strides = StrideMap.of(walker)
    start = strides.state(strides.points_at(gpw.find_gait(walker, slope).state))
    by, outcome = ("state", "slope", "hip_torque", "foot_radius"), Outcome.RUNNING
    records, ticks = new_records(start, slope, 0.004), 0

    def reported(inputs):
        """The ledgers of a tick from these records, with other inputs."""
        moved = records.copy()
        moved["state"][0, 0], moved["control"][0, 0] = inputs[:6], inputs[7]
        moved["ground"][0, 0, :2] = np.sin(inputs[6]), np.cos(inputs[6])
        radius = {} if walker.massless_legs else {"foot_radius": inputs[8]}
        walkers = Walkers(walker=walker, parameters=radius, tolerance=1e-13)
        walked = go_on(walkers, moved, by, on_section=ticks == 0)
        return walked, np.concatenate([walked.rows[0], walked.distance])

    way = 0.0
    while outcome == Outcome.RUNNING:
        records["end"] = 0.3 * (ticks + 1)
        records["moved"] = records["turned"] = 0.0
        inputs = np.array([*records["state"][0, 0], slope, 0.004, walker.foot_radius])
        walked, found = reported(inputs)
        scale = np.abs(found[:, 1:]).max()
        for i in range(8 if walker.massless_legs else 9):
            step = 1e-5 * np.eye(9)[i]
            ahead, behind = reported(inputs + step)[1][:, 0], reported(inputs - step)[1][:, 0]
            difference = (ahead - behind) / 2e-5
            # Where the hip hardly turns back, what it turns bends sharply.
            np.testing.assert_allclose(found[:, 1 + i], difference, rtol=0.0, atol=1e-6 * scale)
        records, way, ticks = walked.here.copy(), way + walked.distance[0, 0], ticks + 1
        outcome = walked.outcomes[0]
    assert outcome == Outcome.HEELSTRIKE and ticks > 5
    body, angles = walker.body, (start[0, 0], records["state"][0, 0, 0])
    assert way == pytest.approx(-sum(legs.hip_travel(body, angle) for angle in angles), rel=1e-12)


def test_a_strike_that_grazes_says_so():
    """Towards grazing the rate of fall goes as the root of the distance; derivatives, inversely."""
    strides, walkers = StrideMap.of("D"), Walkers(walker=gpw.WALKERS["D"], tolerance=1e-13)
    point = strides.points_at(gpw.find_gait("D", 0.009).state)

    def walk(share, by=("state",)):
        """A stride that begins at a share of the gait's rate."""
        start = strides.state(point * [1.0, share, 1.0])
        return go_on(walkers, new_records(start, 0.009), by, on_section=True)

    slow, fast = 1.0, 1.2  # too fast, and the swing leg comes too late to catch the walker
    for _ in range(40):
        middle = 0.5 * (slow + fast)
        struck = walk(middle, ()).outcomes[0] == Outcome.HEELSTRIKE
        slow, fast = (middle, fast) if struck else (slow, middle)
    fallen = walk(fast + 1e-9)
    assert fallen.outcomes[0] == Outcome.FELL_FORWARD and np.isnan(fallen.margins[0])
    assert np.all(fallen.rows[:, :, 1:] == 0.0)
    near, nearer = (walk(slow - distance) for distance in (1e-4, 1e-6))
    assert nearer.margins[0] == pytest.approx(0.1 * near.margins[0], rel=2e-2)
    steep, steeper = (np.abs(x.rows[0, :6, 1:]).max() for x in (near, nearer))
    assert steeper == pytest.approx(10.0 * steep, rel=2e-2)
    before_any_strike = new_records(strides.state(point), 0.009, end=1.0)
    assert go_on(walkers, before_any_strike, ("state",)).margins[0] == np.inf


@pytest.mark.parametrize("name", ["A", "lab"])
def test_the_rate_at_which_a_heelstrike_falls_is_the_legs(name):
    walker, slope = gpw.WALKERS[name], SLOPES.get(name, 0.03)
    strides = StrideMap.of(walker)
    point = strides.points_at(gpw.find_gait(walker, slope).state)
    walkers = Walkers(walker=walker)
    walked = go_on(walkers, new_records(strides.state(point), slope, end=9.0))
    at_end = walked.records["time"][0, 0]
    stance, thigh = strides.before_strike(point[0], slope, at_end)[3:5]
    knee = np.inf
    if walker.knees:
        at_lock = strides.before_strike(point[0], slope, walked.records["knee_time"][0, 0])
        knee = abs(at_lock[5] - at_lock[4])
    assert walked.margins[0] == pytest.approx(min(-(stance + thigh), knee), rel=1e-6)


def test_ticks_in_turn_are_those_side_by_side_and_one_does_not_change_the_others(monkeypatch):
    """Where a rounding moves a strike to another tick, that walker alone is followed in turn."""
    points, torques = many(6)
    walkers = Walkers(walker=gpw.WALKERS["lab"])
    beside = ticked_strides(walkers, 0.036, points, torques, tick=TICK)
    reported = ticks._side_by_side

    def astray(*arguments):
        after, alike = reported(*arguments)
        alike[2] = False  # the third walker's first control step
        after["state"][2] = np.nan
        return after, alike

    monkeypatch.setattr(ticks, "_side_by_side", astray)
    again = ticked_strides(walkers, 0.036, points, torques, tick=TICK)
    others = np.arange(6) != 2
    for name in ("end", "duration", "swing", "turn", "kneestrike", "by"):
        found, expected = getattr(again, name), getattr(beside, name)
        np.testing.assert_array_equal(found[others], expected[others])
        np.testing.assert_allclose(found[2], expected[2], rtol=1e-9, atol=1e-11)


def test_derivatives_by_every_motor_are_those_of_the_stride():
    """Hip, ankle and push-off on point feet, against differences."""
    walker, rng = gpw.WALKERS["E"], np.random.default_rng(4)
    walkers = Walkers(walker=walker, using=("ankle_torque", "push_off"), tolerance=1e-13)
    gait = gpw.find_gait(walker, 0.009)
    point = Section(walker=walker).points_at(gait.state)[0]
    torques, push = rng.normal(0.0, 1e-3, (2, 6)), 0.01

    def walked(change):
        held = torques + change[3:-1].reshape(2, 6)
        pushes = np.array([push + change[-1]])
        return ticked_strides(
            walkers, 0.009, (point + change[:3])[None], held[None], tick=0.4, push_offs=pushes
        )

    def reported(of):
        parts = (of.end, of.duration, of.length, of.swing, of.turn, of.push_work, of.kneestrike)
        return np.concatenate([np.ravel(part) for part in parts])

    for column in range(3 + 12 + 1):
        change = 1e-6 * np.eye(16)[column]
        difference = (reported(walked(change)) - reported(walked(-change))) / 2e-6
        by = walked(0.0 * change).by[0, :, column]
        np.testing.assert_allclose(by, difference, rtol=1e-5, atol=1e-7)
    assert np.abs(walked(np.zeros(16)).by[0, :3, -1]).max() > 0.1  # a push-off moves the end
