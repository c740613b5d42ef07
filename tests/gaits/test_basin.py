"""From where walkers find their gait, and how hard a push they survive."""

import numpy as np
import pytest

import gym_passive_walker as gpw
from gym_passive_walker import (
    GaitNotFound,
    Outcome,
    basin_of_attraction,
    find_gait,
    find_gaits,
    largest_push,
    stride,
)
from gym_passive_walker.gaits.robust import basin as basin_module
from gym_passive_walker.gaits.robust.basin import FELL, UNSETTLED, other_attractors
from gym_passive_walker.gaits.stride_map import StrideMap


@pytest.fixture(scope="module")
def basin():
    return basin_of_attraction("lab", 0.036, resolution=60)


def state_at(walker, slope, angle, rate):
    """The state at a cell of the simplest walker's slice, where heelstrike sets the swing rate."""
    swing = np.cos(2.0 * angle) * rate
    return np.array([angle, -angle, -angle, rate, swing, swing])


def test_every_cell_has_fallen_or_settled(basin):
    assert basin.settled.shape == basin.outcome.shape == basin.strides.shape == (60, 60)
    np.testing.assert_array_equal(basin.settled == FELL, basin.outcome != Outcome.HEELSTRIKE)
    assert not np.any(basin.settled == UNSETTLED)
    assert 0.02 < basin.walks.mean() < 0.5


def test_the_gait_lies_in_its_own_basin(basin):
    (gait,) = basin.gaits
    assert gait.stable
    angle = np.argmin(np.abs(basin.stance_angle - gait.stance_angle))
    rate = np.argmin(np.abs(basin.stance_rate - gait.state[3]))
    assert basin.settled[rate, angle] == 0


def test_too_slow_a_walker_falls_back_and_one_without_a_step_forward(basin):
    assert basin.outcome[-1, -1] == Outcome.FELL_BACKWARD
    assert Outcome.FELL_FORWARD in basin.outcome


def walked(name, slope, gaits, angle, rate, near=1e-4):
    """Strides until a walk has come to one of some gaits or fallen, and which, or how it fell."""
    walker_map = StrideMap.of(name)
    places = []
    for index, gait in enumerate(gaits):
        state = gait.state
        for _ in range(gait.period):
            places.append((index, walker_map.points(state).search[0]))
            state = stride(name, slope, state, tolerance=1e-12).state
    state = state_at(name, slope, angle, rate)
    for count in range(300):
        end = stride(name, slope, state, tolerance=1e-8)
        if end.outcome != Outcome.HEELSTRIKE:
            return count, FELL, end.outcome
        state = end.state
        u = walker_map.points(state).search[0]
        for index, place in places:
            if np.abs(u - place).max() < near:
                return count + 1, index, Outcome.HEELSTRIKE
    return 300, UNSETTLED, Outcome.HEELSTRIKE


@pytest.mark.parametrize("slope", [0.009, 0.0125])
def test_a_cell_tells_how_many_strides_lead_where(slope):
    """Also to a gait of three strides, by whichever of them a walk comes to first."""
    angles, rates = np.linspace(0.17, 0.27, 9), np.linspace(-0.75, -0.5, 12)
    basin = basin_of_attraction("D", slope, stance_angles=angles, stance_rates=rates)
    assert basin.settled.shape == (12, 9)
    for (row, column), settled in np.ndenumerate(basin.settled):
        count, index, outcome = walked("D", slope, basin.gaits, angles[column], rates[row])
        assert basin.strides[row, column] == pytest.approx(count, abs=1)  # near the near
        assert (settled, basin.outcome[row, column]) == (index, outcome)
    exact = [
        basin.strides[i] == walked("D", slope, basin.gaits, angles[i[1]], rates[i[0]])[0]
        for i in np.ndindex(basin.settled.shape)
    ]
    assert np.mean(exact) > 0.97


def test_a_cell_is_what_it_is_however_many_there_are():
    angles, rates = np.linspace(0.01, 0.45, 220), np.linspace(-1.6, -0.1, 320)
    many = basin_of_attraction("D", 0.009, stance_angles=angles, stance_rates=rates)
    few = basin_of_attraction("D", 0.009, stance_angles=angles[::20], stance_rates=rates[9::10])
    assert many.settled.size > 1 << 16
    for name in ("settled", "outcome", "strides"):
        np.testing.assert_array_equal(getattr(many, name)[9::10, ::20], getattr(few, name))


def test_a_walk_that_never_settles_walks():
    basin = basin_of_attraction("D", 0.0188, resolution=12, strides=6)
    assert basin.gaits == () and np.any(basin.settled == UNSETTLED)
    np.testing.assert_array_equal(basin.walks, basin.outcome == Outcome.HEELSTRIKE)


def test_a_slice_by_ratios_starts_with_each_rate_in_its_ratio():
    angles, rates = np.linspace(0.15, 0.35, 5), np.linspace(-2.0, -0.5, 8)
    basin = basin_of_attraction(
        "lab", 0.036, stance_angles=angles, stance_rates=rates, ratios=(0.25, 1.5), strides=1
    )
    for (row, column), outcome in np.ndenumerate(basin.outcome):
        angle, rate = angles[column], rates[row]
        swing = 0.25 * rate, 1.5 * rate
        assert outcome == stride("lab", 0.036, [angle, -angle, -angle, rate, *swing]).outcome
    assert len(np.unique(basin.outcome)) > 2


def test_two_stable_gaits_share_a_basin_s_picture():
    angles, rates = np.linspace(0.19, 0.26, 80), np.linspace(-0.75, -0.62, 80)
    basin = basin_of_attraction("D", 0.0125, stance_angles=angles, stance_rates=rates)
    assert [gait.period for gait in basin.gaits] == [1, 3]
    assert np.any(basin.settled == 0) and np.any(basin.settled == 1)


@pytest.mark.parametrize(("slope", "period"), [(0.009, 1), (0.0165, 2)])
def test_a_gait_that_nobody_knows_is_found_by_walks_that_settle_on_it(slope, period):
    stride_map = StrideMap.of("D")
    gait = next(x for x in find_gaits("D", slope, period=period) if x.stable)
    found = other_attractors(stride_map, slope, 1.0001 * gait.point.values, [])
    assert [x.period for x in found] == [period]
    np.testing.assert_allclose(found[0].stride.step_length.sum(), gait.stride.step_length.sum())


def test_where_there_is_no_gait_a_slice_must_be_given():
    with pytest.raises(GaitNotFound, match="give stance_angles"):
        basin_of_attraction("lab", 0.001)
    basin = basin_of_attraction(
        "lab", 0.001, stance_angles=[0.1, 0.2], stance_rates=[-1.0, -0.5], ratios=(0.3, 1.4)
    )
    assert basin.gaits == () and not np.any(basin.walks)


def test_rates_of_the_literature_are_noticed():
    """Garcia, Chatterjee, Coleman and Ruina (1998) state them in units of sqrt(g/l)."""
    angles, rates = np.linspace(0.15, 0.25, 10), np.linspace(-0.25, -0.15, 10)
    with pytest.warns(UserWarning, match="multiplied by 3.132"):
        empty = basin_of_attraction("D", 0.009, stance_angles=angles, stance_rates=rates)
    assert not empty.walks.any()
    rates *= np.sqrt(9.81)
    assert basin_of_attraction("D", 0.009, stance_angles=angles, stance_rates=rates).walks.any()


@pytest.mark.parametrize("bad", [{"stance_angles": [0.0]}, {"stance_rates": [[1.0]]}])
def test_a_senseless_slice_is_refused(bad):
    with pytest.raises(ValueError, match="stance_"):
        basin_of_attraction("D", 0.009, **bad)


@pytest.mark.parametrize(("name", "slope"), [("D", 0.009), ("lab", 0.036)])
def test_the_largest_push_is_survived_and_a_larger_one_is_not(name, slope):
    gait, push = find_gait(name, slope), largest_push(name, slope)
    assert push.forward > 0.0 and push.backward > 0.0
    for change in (-push.forward, push.backward):
        for factor, walks in ((1.0 - 1e-6, True), (1.0 + 1e-6, False)):
            state = gait.state.copy()
            state[3] += factor * change
            for _ in range(60):
                end = stride(name, slope, state)
                state = end.state
                if end.outcome != Outcome.HEELSTRIKE:
                    break
            assert (end.outcome == Outcome.HEELSTRIKE) == walks


def test_an_unstable_gait_survives_no_push():
    gait = find_gait("E", 0.01, "short")
    push = largest_push("E", 0.01, gait=gait)
    assert min(push.forward, push.backward) < 1e-6


@pytest.mark.slow
def test_cells_of_several_batches_walk_as_often_as_those_of_one():
    many, few = (basin_of_attraction("lab", 0.036, resolution=n) for n in (300, 100))
    assert many.settled.size == 90_000 > 1 << 16
    assert many.walks.mean() == pytest.approx(few.walks.mean(), abs=2e-3)
    assert 0.1 < few.walks.mean() < 0.2


def test_only_a_gait_of_the_walker_at_the_slope_is_perturbed():
    gait = find_gait("E", 0.01)
    for walker, slope in ((gait, 0.011), ("F", 0.01)):
        with pytest.raises(ValueError, match="its strides do not repeat there"):
            largest_push(walker, slope, gait=gait)


def test_a_gait_stands_for_its_map_in_analyses():
    gait = find_gait("E", 0.01, "short")
    assert largest_push(gait) == largest_push("E", 0.01, gait=gait)
    found = find_gait(gait, guess=gait.state)
    np.testing.assert_array_equal(found.state, find_gait("E", 0.01, guess=gait.state).state)
    given, named = (basin_of_attraction(x, 0.01, resolution=5, strides=20) for x in (gait, "E"))
    np.testing.assert_array_equal(given.settled, named.settled)


@pytest.mark.parametrize(
    ("walker", "slope", "given"),
    [("E", 0.0, {"controller": gpw.Actuation.dimensionless(push_off=0.05)}),
     ("lab", 0.036, {"terrain": gpw.stairs(-0.002)})],
)  # fmt: skip
def test_a_slice_passes_through_the_gait_under_motors_and_on_steps(walker, slope, given):
    strides = gpw.stride_map(walker, slope, **given)
    gait = find_gait(strides)
    angle, rate = gait.point.values[:, 0], gait.point.values[:, 1]
    points = basin_module._slice(strides, gait, angle, rate, None)
    np.testing.assert_allclose(points, gait.point.values, rtol=1e-7)


def test_a_gait_that_attracts_slowly_is_listed_once():
    basin = basin_of_attraction("D", 0.0149, resolution=20)
    assert [gait.period for gait in basin.gaits] == [1] and (basin.settled == 0).any()
