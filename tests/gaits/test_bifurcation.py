"""What becomes of a gait that loses its stability."""

import numpy as np
import pytest

import gym_passive_walker as gpw
from gym_passive_walker import (
    WALKERS,
    GaitNotFound,
    Walker,
    bifurcation_diagram,
    crisis,
    doubling_cascade,
    find_gait,
    find_gaits,
    gait_family,
    lyapunov_exponents,
    stride,
    tune,
)
from gym_passive_walker.gaits.branches.bifurcation import nearest_on, period_of
from gym_passive_walker.gaits.branches.doubling import FEIGENBAUM


@pytest.fixture(scope="module")
def cascade():
    return doubling_cascade("D", 0.012, 0.02)


def test_the_simplest_walker_first_doubles_where_it_is_known_to(cascade):
    assert cascade.periods == (1, 2, 4, 8, 16)
    assert cascade.slopes[0] == pytest.approx(0.0150884379, abs=1e-10)


def test_no_doubling_is_looked_for_beyond_the_steepest_slope(cascade):
    for beyond, periods in ((-1e-5, (1,)), (1e-5, (1, 2))):
        short = doubling_cascade("D", 0.012, cascade.slopes[1] + beyond, doublings=2)
        assert short.periods == periods
        assert short.slopes == pytest.approx(cascade.slopes[: len(periods)], rel=1e-9)


def test_tuned_c_first_doubles_below_the_printed_slope():
    # Print has "about 0.084", for the table's rounded parameters read off a plot.
    cascade = doubling_cascade(tune(WALKERS["C"]), 0.06, 0.1, doublings=1)
    assert cascade.slopes == pytest.approx((0.0768533651,), abs=1e-10)


def test_each_doubling_gait_has_a_multiplier_at_minus_one(cascade):
    for gait in cascade.gaits:
        assert np.abs(gait.multipliers + 1.0).min() < 1e-8


def test_a_doubling_is_where_the_gait_of_that_period_loses_its_stability(cascade):
    for gait in cascade.gaits[1:3]:
        for side in (-1e-6, 1e-6):
            near = find_gait("D", gait.slope + side, period=gait.period, guess=gait.state)
            assert near.period == gait.period and near.stable == (side < 0)


def test_distances_between_doublings_shrink_by_feigenbaum_s_number(cascade):
    assert cascade.ratios[0] == pytest.approx(FEIGENBAUM, rel=0.15)
    assert cascade.ratios[-1] == pytest.approx(FEIGENBAUM, rel=2e-3)
    assert cascade.limit == pytest.approx(0.0182934, abs=1e-6)


def test_walks_settle_on_the_period_that_the_cascade_predicts(cascade):
    bounds = [0.014, *cascade.slopes[:4]]
    slopes = 0.5 * (np.array(bounds[:-1]) + bounds[1:])
    diagram = bifurcation_diagram("D", slopes)
    np.testing.assert_array_equal(diagram.period, [1, 2, 4, 8])


def test_rows_of_a_diagram_s_table_number_the_strides_of_each_slope():
    diagram = bifurcation_diagram(
        "D", [0.005, 0.017, 0.01], n_transient=200, n_recorded=4, longest_period=2
    )
    rows = diagram.columns()
    for place in range(12):
        angles = diagram.stance_angle[diagram.slope == rows["slope"][place]][0]
        assert rows["stance_angle"][place] == angles[rows["stride"][place]]
    assert np.ptp(diagram.stance_angle[1]) > 0.01  # each stride of a walk on 0.017 rad is another


def test_beyond_the_crisis_walkers_fall():
    diagram = bifurcation_diagram("D", [0.0185, 0.0195])
    np.testing.assert_array_equal(diagram.walks, [True, False])
    assert np.all(np.isnan(diagram.stance_angle[1])) and diagram.period[1] == 0


def test_a_sweep_keeps_to_the_walk_it_is_on():
    start = find_gait("D", 0.0125, period=3)
    sweep = bifurcation_diagram(
        "D",
        np.linspace(0.0125, 0.0124, 5),
        start=start.state,
        sweep=True,
        n_transient=150,
        n_recorded=40,
    )
    np.testing.assert_array_equal(sweep.period, 3)
    np.testing.assert_array_equal(
        bifurcation_diagram("D", sweep.slope, n_transient=150, n_recorded=40).period, 1
    )


def test_a_sweep_is_one_walk_over_ground_that_tilts():
    slopes, state = [0.0125, 0.0128, 0.0122], find_gait("D", 0.0125, period=3).state
    sweep = bifurcation_diagram(
        "D", slopes, start=state, sweep=True, n_transient=4, n_recorded=5, longest_period=3
    )
    for i, slope in enumerate(slopes):
        angles = []
        for _ in range(9):
            state = stride("D", slope, state).state
            angles.append(state[0])
        assert sweep.stance_angle[i] == pytest.approx(angles[4:], rel=1e-8)
        assert sweep.state[i] == pytest.approx(state, rel=1e-8)


def test_a_sweep_that_fell_begins_again_beside_the_next_gait():
    sweep = bifurcation_diagram(
        "D", [0.0185, 0.0195, 0.012], sweep=True, n_transient=300, n_recorded=40
    )
    np.testing.assert_array_equal(sweep.walks, [True, False, True])
    angle = find_gait("D", 0.012).stance_angle
    assert sweep.stance_angle[2] == pytest.approx(angle, rel=1e-8)


def test_a_walk_that_falls_after_a_while_has_no_angles():
    state = bifurcation_diagram("D", [0.0185]).state[0]
    fall = bifurcation_diagram("D", [0.0195], start=state, n_transient=0, n_recorded=200)
    assert np.isfinite(stride("D", 0.0195, state).step_length)
    assert np.all(np.isnan(fall.stance_angle)) and not fall.walks[0]


def test_where_a_family_passes_a_slope_twice_walks_begin_beside_its_stabler_gait():
    family = gait_family("lab", 0.03, 0.3)
    slopes = np.array([0.045, 0.05])
    for slope, state in zip(slopes, nearest_on(family, slopes), strict=True):
        long, short = find_gaits("lab", slope)
        assert long.stable and not short.stable
        gap = np.abs(state - long.state).max()
        assert gap < 0.02 * np.abs(state - short.state).max()
    assert np.all(np.isnan(nearest_on(family, np.array([0.02]))))


def test_the_simplest_walker_has_a_stable_gait_of_three_strides():
    # Howell and Baillieul (1998), beside the stable gait of one stride.
    gait = find_gait("D", 0.0125, period=3)
    assert gait.stable and find_gait("D", 0.0125).stable
    walk = bifurcation_diagram(
        "D", [0.0125], start=gait.state * 1.0005, n_transient=300, n_recorded=40
    )
    assert walk.period[0] == 3
    family = gait_family("D", 0.012, 0.0135, start=gait)
    # Born in a fold, it doubles to period six.
    assert 0.0120 < family.folds[0] < 0.0125 < family.period_doublings[-1] < 0.0130


def test_the_largest_exponent_is_zero_at_a_doubling_and_positive_in_chaos(cascade):
    slopes = [cascade.slopes[1], 0.0188]
    at_doubling, chaos = lyapunov_exponents("D", slopes, strides=1500)[:, 0]
    assert abs(at_doubling) < 0.02
    assert 0.2 < chaos < 0.5


def test_a_walker_that_falls_has_no_exponent_and_does_not_change_those_of_others():
    slopes, start = [0.0125, 0.0195, 0.0135, 0.009], find_gait("D", 0.0125).state
    found = lyapunov_exponents("D", slopes, start=start, n_transient=0, strides=100, count=2)
    assert np.isnan(found[1]).all() and np.isfinite(found[[0, 2, 3]]).all()
    for slope, exponents in zip(slopes, found, strict=True):
        alone = lyapunov_exponents("D", slope, start=start, n_transient=0, strides=100, count=2)
        np.testing.assert_array_equal(exponents, alone[0])


def test_two_neighbouring_walks_part_as_the_exponent_says():
    slope, gap, count = 0.0188, 1e-9, 40
    start = bifurcation_diagram("D", [slope]).state[0]
    noise = np.random.default_rng(0).normal(size=(count, 1))
    places = bifurcation_diagram("D", [slope] * count, start=start * (1 + 1e-6 * noise)).state
    places = places[np.all(np.isfinite(places), axis=1)]
    starts = np.concatenate([places, places * np.array([1 + gap, 1 + gap, 1 + gap, 1, 1, 1])])
    walks = bifurcation_diagram(
        "D", [slope] * len(starts), start=starts, n_transient=0, n_recorded=40, tolerance=1e-13
    ).stance_angle
    first, second = walks.reshape(2, len(places), -1)
    apart = np.nanmean(np.log(np.abs(second - first)), axis=0)
    rate = np.polyfit(np.arange(5, 40), apart[5:], 1)[0]
    assert rate == pytest.approx(lyapunov_exponents("D", slope, strides=3000)[0, 0], abs=0.05)


@pytest.mark.slow
def test_the_cascade_of_the_tuned_kneed_walker_is_universal_too():
    cascade = doubling_cascade(tune(WALKERS["C"]), 0.06, 0.12, doublings=6)
    assert cascade.periods == (1, 2, 4, 8, 16, 32)
    assert cascade.ratios[-1] == pytest.approx(FEIGENBAUM, rel=1e-3)


@pytest.mark.parametrize("period", [1, 2, 3, 7])
def test_a_sequence_s_period_is_its_smallest(period):
    values = np.tile(np.arange(1.0, period + 1.0), 24)[:24]
    assert period_of(values[:, None], 10) == period
    assert period_of((values + np.linspace(0.0, 1e-3, 24))[:, None], 10) == 0
    for longest in (0, 24):
        with pytest.raises(ValueError, match=f"a period from 1 to below 24, not {longest}"):
            period_of(values[:, None], longest)


@pytest.mark.parametrize("size", [1e-6, 1.0, 1e6])
def test_a_period_does_not_depend_on_the_size_of_numbers(size):
    """Two values repeat to a share of the larger one, which is just below or above what counts."""
    for off, period in ((0.9, 2), (1.1, 0)):
        values = np.tile([1.0, 0.5], 12)
        values[-1] += off * 1e-4
        assert period_of(size * values[:, None], 10, 1e-4) == period


def test_what_makes_no_sense_is_refused():
    with pytest.raises(GaitNotFound, match="does not double"):
        doubling_cascade("D", 0.01, 0.012)
    with pytest.raises(ValueError, match="n_recorded must be above"):
        bifurcation_diagram("D", [0.01], n_recorded=10)
    with pytest.raises(ValueError, match="values must be"):
        bifurcation_diagram("D", [-0.01])
    with pytest.raises(ValueError, match="count must be"):
        lyapunov_exponents("D", 0.01, count=4)
    with pytest.raises(ValueError, match="doublings must be"):
        doubling_cascade("D", 0.01, 0.02, doublings=0)
    with pytest.raises(ValueError, match="has not ended"):
        crisis("D", 0.01, 0.012, strides=200, walkers=4)
    with pytest.raises(ValueError, match="0 < low < high"):
        crisis("D", 0.0, 0.012)


@pytest.mark.parametrize("accuracy", [1e-2, 1e-3, 1e-5])
def test_a_crisis_is_found_to_the_accuracy_that_is_asked_for(accuracy):
    """Also where the range is hardly wider than that."""
    found = crisis("D", 0.0125, 0.03, strides=200, walkers=4, accuracy=accuracy)
    assert found == pytest.approx(0.01905, abs=max(accuracy, 4e-4))


def test_walkers_make_as_many_strides_as_a_crisis_demands_and_no_more():
    few, more = (crisis("D", 0.0125, 0.03, strides=n, walkers=8) for n in (10, 50))
    assert few > more


def test_a_crisis_beyond_the_range_is_refused_however_far_its_walkers_are_moved():
    """In one step to the steepest slope they fall; in small steps they walk on beyond it."""
    walker = Walker(
        thigh_length=0.6, shank_length=0.6, thigh_mass=0.5, thigh_com=0.5, thigh_gyration=0.2,
        shank_mass=0.0, foot_radius=0.2, hip_mass=1.0, knees=False, gravity=1.0,
    )  # fmt: skip
    with pytest.raises(ValueError, match=r"walking has not ended at slope 0\.06"):
        crisis(walker, 0.01, 0.06, strides=300, walkers=16, accuracy=1e-4)


def test_walks_under_twice_the_gravity_are_the_same_over_their_units():
    found = bifurcation_diagram(
        "lab", [9.81, 19.62], parameter="gravity", slope=0.036, n_transient=50, n_recorded=33
    )
    np.testing.assert_allclose(*found.dimensionless.state, rtol=1e-9)
    np.testing.assert_allclose(found.state[1, 3:], np.sqrt(2.0) * found.state[0, 3:], rtol=1e-9)


def test_stairs_down_carry_walkers_at_slopes_of_zero():
    stairs = gpw.stride_map("lab", terrain=gpw.stairs(-0.01))
    found = bifurcation_diagram(stairs, [0.0, 0.005], n_transient=50, n_recorded=33)
    assert found.walks.all()
