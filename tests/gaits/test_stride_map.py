"""The stride map of the analyses: strides, with derivatives of all results."""

import re
from dataclasses import fields, replace

import numpy as np
import pytest

import gym_passive_walker as gpw
from gym_passive_walker import WALKERS, Outcome, find_gait, stride
from gym_passive_walker.gaits.actuation import Actuation, actuation_units
from gym_passive_walker.gaits.find.newton import newton
from gym_passive_walker.gaits.map_result import Change
from gym_passive_walker.gaits.stride_map import StrideMap
from gym_passive_walker.models.units import unit_of
from tests.before_impact import just_before
from tests.equations.examples import LONG_GAITS
from tests.instants import states_at

NAMES = ["lab", "lab-straight", "B", "D"]
TOLD = [field.name for field in fields(Change)]
STENCIL = {1: 4 / 5, 2: -1 / 5, 3: 4 / 105, 4: -1 / 280}


def beside(name, count=1):
    """A stride map, its slope, and points beside the long-step gait."""
    gait = LONG_GAITS[name]
    walker_map = StrideMap.of(name, tolerance=1e-14)
    return walker_map, gait.slope, walker_map.points_at([gait.state] * count)


def beside_each(name, count):
    """As `beside`, the points each somewhere else."""
    walker_map, slope, points = beside(name, count)
    return walker_map, slope, points * (1.0 + np.linspace(0.0, 0.01, count))[:, None]


@pytest.mark.parametrize("name", NAMES)
def test_a_passage_tells_what_a_stride_tells(name):
    walker_map, slope, points = beside(name)
    torque = 0.001
    passage = replace(walker_map, actuation=Actuation(torque)).apply(points, slope)
    units, state = walker_map.units, walker_map.states_at(points)[0]
    walked = stride(name, slope, state, hip_torque=torque * units.torque, tolerance=1e-14)
    np.testing.assert_allclose(walker_map.states_at(passage.ends)[0], walked.state, rtol=1e-13)
    assert passage.durations[0] * units.time == pytest.approx(float(walked.duration), rel=1e-13)
    assert passage.lengths[0] * units.length == pytest.approx(float(walked.step_length), rel=1e-13)
    assert passage.lost[0] * units.energy == pytest.approx(float(walked.collision_loss), rel=1e-12)
    downhill = np.sin(slope) * walked.step_length * walked.weight + walked.hip_work
    assert passage.supplied[0] * units.energy == pytest.approx(float(downhill), rel=1e-12)


@pytest.mark.parametrize("name", NAMES)
def test_derivatives_are_those_of_all_results(name):
    walker_map, slope, points = beside(name)
    by = ("state", "slope", "hip_torque", "shank_length", "thigh_length")
    driven = replace(walker_map, actuation=Actuation(0.001))
    _, change = driven.linearize(points, slope, strides=2, by=by)
    m = walker_map.dimension

    def moved(column, x):
        shift = x * np.eye(m + 4)[column]
        lengths = {name: shift[i] for name, i in (("shank_length", m + 2), ("thigh_length", m + 3))}
        walker = WALKERS[name]
        walker = replace(walker, **{n: getattr(walker, n) + dx for n, dx in lengths.items()})
        shifted = replace(
            StrideMap.of(walker, tolerance=1e-14), actuation=Actuation(0.001 + shift[m + 1])
        )
        return shifted.apply(points + shift[:m], slope + shift[m], strides=2)

    step = 1e-4
    for column in range(m + 4):
        passages = {k: moved(column, k * step) for k in (*STENCIL, *[-k for k in STENCIL])}
        for what in TOLD:
            expected = sum(
                weight * (getattr(passages[k], what) - getattr(passages[-k], what)) / step
                for k, weight in STENCIL.items()
            )
            found = getattr(change, what)[..., column]
            np.testing.assert_allclose(found, expected, rtol=1e-8, atol=1e-8, err_msg=what)


@pytest.mark.parametrize("name", NAMES)
def test_a_derivative_has_the_same_bits_beside_those_by_constants(name):
    walker_map, slope, points = beside_each(name, 20)
    _, alone = walker_map.linearize(points, slope, by=("state", "slope"))
    _, beside_others = walker_map.linearize(points, slope, by=("state", "slope", "hip_mass"))
    for told in TOLD:
        np.testing.assert_array_equal(getattr(alone, told), getattr(beside_others, told)[..., :-1])


def test_maps_are_equal_only_to_themselves_and_may_be_keys():
    walker_map = StrideMap.of("lab")
    others = [replace(walker_map, actuation=Actuation(0.01)),
              walker_map.with_parameter("shank_length", [0.44, 0.46])]  # fmt: skip
    assert len({walker_map, *others}) == 3


def test_falls_and_strides_have_their_outcomes():
    walker_map, slope, points = beside("E", 6)
    points[1, 1] *= 0.1  # too slow to get over the vertical
    points[2] = np.nan
    for passage in (
        walker_map.apply(points, slope, strides=3),
        walker_map.linearize(points, slope, strides=3)[0],
    ):
        assert passage.alive.tolist() == [True, False, False, True, True, True]
        assert passage.outcomes.tolist()[:3] == [
            Outcome.HEELSTRIKE, Outcome.FELL_BACKWARD, Outcome.DIVERGED
        ]  # fmt: skip
        assert np.all(np.isnan(passage.ends[1:3])) and np.all(np.isnan(passage.lengths[1:3]))


@pytest.mark.parametrize("count", [9, 18])
def test_falls_do_not_change_the_others(count):
    """Each has a body, a slope, a torque and directions of its own, however many still walk."""
    walker_map, _, points = beside("lab", count)
    lengths, slopes = np.linspace(0.44, 0.48, count), np.linspace(0.034, 0.038, count)
    torques = np.linspace(-0.001, 0.001, count)
    points[[0, 4], 1] *= 0.1  # too slow to get over the vertical
    points[2] = np.nan
    torques[6] = -0.01  # brakes, and falls back in its fourth stride
    along = np.random.default_rng(2).standard_normal((count, 4, 2))
    by = ("state", "slope", "shank_length", "hip_torque")
    many = replace(walker_map.with_parameter("shank_length", lengths), actuation=Actuation(torques))
    for strides in (1, 3, 12):
        asked = {"strides": strides, "by": by, "along": along}
        reported = many.linearize(points, slopes, **asked)
        plain = many.apply(points, slopes, strides=strides)
        np.testing.assert_array_equal(plain.outcomes, reported[0].outcomes)
        for i in range(count):
            own = StrideMap.of(replace(WALKERS["lab"], shank_length=lengths[i]), tolerance=1e-14)
            own = replace(own, actuation=Actuation(torques[i]))
            asked = {"strides": strides, "by": by, "along": along[i : i + 1]}
            alone = own.linearize(points[i : i + 1], slopes[i], **asked)
            for mine, its in zip(reported, alone, strict=True):
                for what in TOLD:
                    np.testing.assert_array_equal(getattr(mine, what)[i], getattr(its, what)[0])
            np.testing.assert_allclose(plain.ends[i], alone[0].ends[0], rtol=1e-10)
    assert np.count_nonzero(plain.alive) < count - 3


@pytest.mark.parametrize("count", [1, 30])
def test_a_fall_on_stairs_leaves_each_other_walker_its_own_legs(count):
    stairs = gpw.stride_map("lab", 0.036, terrain=gpw.stairs(-0.001))
    point = gpw.find_gait(stairs).point.values
    shares = np.repeat([0.09, 0.0, 0.09], count)
    masses, lengths = 0.1 + shares, 0.35 + 0.01 * shares
    points = np.repeat(np.concatenate([point, np.nan * point, point]), count, axis=0)
    for name, values in (("hip_mass", masses), ("thigh_length", lengths)):
        there = stairs.with_parameter(name, values)
        passage, change = there.linearize(points, by=("state", name))
        np.testing.assert_allclose(passage.ends, there.apply(points).ends, rtol=1e-13)
        np.testing.assert_array_equal(passage.alive, np.repeat([True, False, True], count))
        alone = stairs.with_walker(stairs.walker.with_parameters(**{name: values[-1]}))
        ends, by = alone.linearize(point, by=("state", name))
        for at in (0, -1):
            np.testing.assert_allclose(passage.ends[at], ends.ends[0], rtol=1e-12)
            np.testing.assert_allclose(change.ends[at], by.ends[0], rtol=1e-9, atol=1e-9)


def test_a_stride_that_takes_longer_than_it_may_is_given_up():
    walker_map, slope, points = beside("lab")
    duration = walker_map.apply(points, slope).durations[0]
    for share, outcome in ((0.99, Outcome.STALLED), (1.01, Outcome.HEELSTRIKE)):
        hasty = StrideMap.of("lab", max_stride_time=share * duration)
        assert hasty.apply(points, slope).outcomes.tolist() == [outcome]


def test_a_toe_may_be_made_to_stub():
    points = beside("C")[2] * (1.0 + 0.3 * np.random.default_rng(0).uniform(-1, 1, (2000, 4)))
    torque = np.random.default_rng(1).uniform(-0.05, 0.05, 2000)
    outcomes = []
    for end_on_toe_stub in (False, True):
        walker_map = StrideMap.of("C", tolerance=1e-10, end_on_toe_stub=end_on_toe_stub)
        units, states = walker_map.units, walker_map.states_at(points)
        walked = stride(
            "C", 0.03, states, hip_torque=torque * units.torque, end_on_toe_stub=end_on_toe_stub
        )
        outcomes.append(
            replace(walker_map, actuation=Actuation(torque)).apply(points, 0.03).outcomes
        )
        np.testing.assert_array_equal(outcomes[-1], walked.outcome)
    assert Outcome.STUBBED_TOE in outcomes[1] and Outcome.STUBBED_TOE not in outcomes[0]


def test_directions_may_be_chosen():
    walker_map, slope, points = beside_each("C", 3)
    directions = np.random.default_rng(2).standard_normal((3, 4, 2))
    _, along = walker_map.linearize(points, slope, along=directions)
    _, change = walker_map.linearize(points, slope)
    np.testing.assert_allclose(along.ends, change.ends @ directions, atol=1e-12)


@pytest.mark.parametrize("name", NAMES)
def test_samples_are_states_inside_the_stride(name):
    walker_map, slope, points = beside_each(name, 3)
    passage = walker_map.apply(points, slope)
    times = passage.durations[:, None] * np.array([0.0, 0.5, 0.99])
    samples = walker_map.sample(points, slope, times)
    units = walker_map.units
    for i, state in enumerate(walker_map.states_at(points)):
        states, phases = states_at(name, slope, state, times[i] * units.time, tolerance=1e-14)
        np.testing.assert_allclose(units.to_own(samples.states[i]), states, atol=1e-13)
        np.testing.assert_array_equal(samples.stages[i], phases)


def test_samples_of_walkers_that_differ_are_each_walkers_own():
    walker_map, slope, points = beside_each("lab", 3)
    lengths, times = np.array([0.44, 0.46, 0.48]), np.tile([0.1, 0.7, 1.2, 2.0], (3, 1))
    samples = walker_map.with_parameter("shank_length", lengths).sample(points, slope, times)
    for i, length in enumerate(lengths):
        own = StrideMap.of(replace(WALKERS["lab"], shank_length=length), tolerance=1e-14)
        alone = own.sample(points[i : i + 1], slope, times[i : i + 1])
        np.testing.assert_array_equal(samples.states[i], alone.states[0])
        np.testing.assert_array_equal(samples.stages[i], alone.stages[0])


def test_the_verge_of_a_strike_is_the_same_in_any_units():
    walker_map, slope, points = beside("lab")
    duration = walker_map.apply(points, slope).durations[0]
    verge = walker_map.before_strike(points[0], slope, duration)
    units, state = walker_map.units, walker_map.states_at(points)[0]
    expected = just_before("lab", slope, state, duration * units.time)
    np.testing.assert_allclose(units.to_own(verge), expected, rtol=1e-12)
    assert verge[0] == pytest.approx(-verge[1], abs=1e-12)


def test_logarithmic_coordinates_come_back_and_have_exact_derivatives():
    section = StrideMap.of("lab")
    points = section.at(np.abs(np.random.default_rng(3).standard_normal((5, 4))))
    back = section.searched(points.search)
    np.testing.assert_allclose(back.values, points.values, rtol=1e-14)
    assert back.search is points.search  # rounded once only
    both = points.in_search(points.by_search)
    np.testing.assert_allclose(both, np.broadcast_to(np.eye(4), (5, 4, 4)), atol=1e-14)


def test_newtons_method_gives_up_alone_where_there_is_no_solution():
    def equations(x):
        return x**2 - np.array([[4.0], [-1.0]])[: len(x)], 2.0 * x[:, :, None]

    found = newton(equations, np.array([[3.0], [1.0]])[:1], accuracy=1e-12, longest=10.0)
    assert found.points[0, 0] == pytest.approx(2.0) and found.sizes[0] <= 1e-12
    lost = newton(lambda x: (x**2 + 1.0, 2.0 * x[:, :, None]), np.ones((1, 1)), accuracy=1e-12)
    assert lost.sizes[0] > 0.5
    leap = newton(equations, np.array([[0.1]]), accuracy=1e-12, longest=1.0, damped=False)
    assert np.isinf(leap.sizes[0])


@pytest.mark.parametrize("shape", [(3,), (2, 4), (5, 1, 3)])
def test_points_of_another_shape_are_refused(shape):
    stride_map = StrideMap.of("lab-straight", slope=0.03)
    for method in (stride_map.apply, stride_map.linearize):
        with pytest.raises(ValueError, match=re.escape(f"shape (n, 3), got {shape}")):
            method(np.zeros(shape))


def test_unknown_derivatives_and_states_of_another_shape_are_refused():
    walker_map, slope, points = beside("lab")
    with pytest.raises(ValueError, match=r"has no foot_radii \(foot_radius\?\)"):
        walker_map.linearize(points, slope, by=("state", "foot_radii"))
    with pytest.raises(ValueError, match=r"states must have shape \(6,\)"):
        walker_map.points_at([0.2, -0.2, -0.2])


@pytest.mark.parametrize("strides", [0, -1, 1.5])
def test_a_map_is_applied_at_least_once(strides):
    walker_map, slope, points = beside_each("lab", 1)
    for method in (walker_map.apply, walker_map.linearize):
        with pytest.raises(ValueError, match="strides must be a whole number from 1 on"):
            method(points, slope, strides=strides)


@pytest.mark.parametrize("name", ["lab", "D"])
def test_units_of_an_actuation_are_those_of_its_parameters(name):
    walker = replace(WALKERS[name], gravity=3.0)
    units = actuation_units(walker.units)._asdict()
    assert units == {part: unit_of(walker, part) for part in units}


def test_a_gait_is_a_point_of_its_map():
    gait = find_gait("C", 0.05)
    point = gait.point
    np.testing.assert_allclose(point.states, gait.state[None], rtol=1e-15)
    np.testing.assert_array_equal(point.values, gait.stride_map.points_at(gait.state))
    np.testing.assert_allclose(point.search[0, 0], np.log(gait.stance_angle), rtol=1e-15)
    ends = gait.stride_map.apply(point).ends
    np.testing.assert_array_equal(ends, gait.stride_map.apply(point.values).ends)
    np.testing.assert_allclose(gait.stride_map.at(ends).search, point.search, rtol=1e-9)


@pytest.mark.parametrize("part", ["thigh", "shank"])
def test_a_state_with_a_bent_leg_is_not_on_the_section(part):
    state = [0.2, -0.2, -0.2, -1.0, -0.5, -0.5]
    state[("stance", "thigh", "shank").index(part)] -= 1e-3
    with pytest.raises(ValueError, match=r"angles of thigh and shank are its opposite"):
        StrideMap.of("lab").points(state)
