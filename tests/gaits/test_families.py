"""Families of gaits: what was located along them, how they end, and that they are gaits."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

import gym_passive_walker as gpw
from gym_passive_walker import (
    WALKERS,
    Actuation,
    GaitNotFound,
    find_gait,
    find_gaits,
    gait_family,
    parameter_family,
    simulate,
    stride,
    stride_map,
    tune,
)
from gym_passive_walker.gaits.branches.continuation import (
    BOUND,
    KNEE_MEETS_HEEL,
    STANCE_STOPS,
    TANGENTIAL,
    VANISHED,
)
from gym_passive_walker.models.walkers.walker import STATE_NAMES


@pytest.fixture(scope="module")
def lab():
    return gait_family("lab", 0.018, 0.3)


@pytest.fixture(scope="module")
def straight():
    return gait_family("lab-straight", 0.01, 0.3)


def fold_by_search(walker, inside, outside, guess):
    """Where two gaits become one: bisection on whether a gait is found beside the last one."""
    while abs(outside - inside) > 2e-10:
        middle = 0.5 * (inside + outside)
        try:
            gait = find_gait(walker, middle, guess=guess)
        except GaitNotFound:
            outside = middle
        else:
            inside, guess = middle, gait.state
    return 0.5 * (inside + outside)


def test_every_point_of_a_family_is_a_gait(lab):
    ends = stride("lab", lab.slope, lab.state, tolerance=1e-14)
    gap = np.abs(ends.state - lab.state).max(axis=1) / np.abs(lab.state).max(axis=1)
    # Near its end a heelstrike turns tangential, and rounding is carried on by a large multiplier.
    assert np.all(gap < 1e-11 * (3.0 + np.abs(lab.multipliers[:, 0])))
    np.testing.assert_allclose(ends.cost_of_transport, np.sin(lab.slope), rtol=1e-8)


def test_a_family_agrees_with_gaits_found_alone(lab):
    for i in (40, 60, 80):
        gaits = find_gaits("lab", lab.slope[i])
        near = min(gaits, key=lambda gait: abs(gait.stance_angle - lab.stance_angle[i]))
        assert near.stance_angle == pytest.approx(lab.stance_angle[i], rel=1e-11)
        assert near.step_length == pytest.approx(lab.step_length[i], rel=1e-11)
        assert near.step_period == pytest.approx(lab.step_period[i], rel=1e-11)
        np.testing.assert_allclose(near.multipliers, lab.multipliers[i], atol=1e-8)


def test_a_family_measures_its_gaits_as_each_measures_itself(lab):
    for i in (45, 60):
        gait = find_gait("lab", lab.slope[i], guess=lab.state[i])
        assert lab.froude_speed[i] == pytest.approx(gait.froude_speed, rel=1e-9)
        assert lab.speed[i] == pytest.approx(gait.speed, rel=1e-9)


def test_a_family_is_a_sequence_of_its_gaits(lab):
    first, *_, last = lab
    for gait, i in (
        (first, 0),
        (last, -1),
        (lab[3], 3),
        *zip(lab[-4:-1], (-4, -3, -2), strict=True),
    ):
        assert gait.slope == lab.slope[i]
        np.testing.assert_allclose(gait.state, lab.state[i], rtol=1e-9)
        np.testing.assert_allclose(gait.multipliers, lab.multipliers[i], rtol=1e-6, atol=1e-8)
    with pytest.raises(IndexError):
        lab[len(lab)]


def test_beyond_a_fold_a_family_has_two_gaits_at_a_slope():
    found, known = (gait_family("C", 0.0003, 0.05).at(0.03), find_gaits("C", 0.03))
    assert {gait.kind for gait in found} == {"long", "short"}
    for gait in known:
        (same,) = (each for each in found if each.kind == gait.kind)
        np.testing.assert_allclose(same.state, gait.state, rtol=1e-10)
    with pytest.raises(GaitNotFound, match=r"at slope 0\.2: it reaches from 0\.005 to 0\.01"):
        gait_family("D", 0.005, 0.01).at(0.2)


def test_a_family_has_gaits_at_the_ends_of_the_range_that_was_asked_for():
    family = gait_family("D", 0.005, 0.01)
    for end in (0.005, 0.01):
        assert family.at(end)[0].slope == pytest.approx(end, rel=1e-14)


def heavier(mass):
    return WALKERS["lab"].with_parameters(hip_mass=mass)


def pushed(push_off):
    return stride_map("D", 0.0, controller=Actuation(push_off=push_off))


@pytest.mark.parametrize(
    ("varied", "parameter", "low", "high", "make"),
    [
        ("lab", "hip_mass", 0.0, 2.0, heavier),
        (pushed(0.1), "push_off", 0.05, 0.2, pushed),
        (pushed, "impulse", 0.05, 0.2, pushed),
    ],
    ids=["of the walker", "of its actuation", "of a function"],
)
def test_a_gait_at_a_value_of_a_parameter_is_that_of_the_map_there(
    varied, parameter, low, high, make
):
    value, slope = 0.4 * low + 0.6 * high, 0.036 if parameter == "hip_mass" else 0.0
    (gait,) = parameter_family(varied, parameter, low, high, slope=slope).at(value)
    np.testing.assert_allclose(gait.state, find_gait(make(value), slope).state, rtol=1e-10)


def test_no_gait_of_a_family_comes_twice(lab):
    points = np.column_stack([np.log(lab.slope), lab.stance_angle])
    gaps = np.abs(points[:, None] - points).max(axis=2)
    assert np.min(gaps[~np.eye(len(lab), dtype=bool)]) > 1e-9


def test_a_fold_is_where_a_search_stops_to_find_gaits(lab):
    i = int(np.argmax(lab.slope))
    found = fold_by_search("lab", 0.0529, 0.0532, lab.state[i])
    assert lab.folds[-1] == pytest.approx(found, abs=1e-9)
    i = int(np.argmin(lab.slope))
    found = fold_by_search("lab", 0.0195, 0.0190, lab.state[i])
    assert lab.folds[0] == pytest.approx(found, abs=1e-9)


@pytest.mark.parametrize(("name", "low", "high"), [("D", 0.0145, 0.0155), ("F", 0.006, 0.0075)])
def test_a_doubling_is_where_a_multiplier_passes_minus_one(name, low, high):
    located = gait_family(name, low, high).period_doublings
    found = brentq(lambda x: find_gait(name, x).multipliers.real.min() + 1.0, low, high, xtol=1e-12)
    assert located == pytest.approx((found,), abs=1e-9)


def test_stability_changes_at_the_doubling(lab):
    family = gait_family("D", 0.01, 0.02)
    np.testing.assert_array_equal(family.stable, family.slope < family.period_doublings[0])
    assert lab.stable.any() and not lab.stable.all()


def test_the_lab_walker_s_family_ends_as_the_document_says(lab):
    slow, short = lab.ends
    assert short.reason == KNEE_MEETS_HEEL
    # The document stops where the stance leg barely passes the vertical; the curve goes on, with
    # a stance leg that turns back for a while, until the foot glides along the ground.
    assert slow.reason.startswith(TANGENTIAL) and STANCE_STOPS in slow.reason
    assert len(lab.halts) == 1 and 0.0191 < lab.halts[0] < 0.0193


def test_the_straight_lab_walker_s_families_end_as_the_document_says(straight):
    slow, steep = straight.ends
    assert slow.reason.startswith(VANISHED) and STANCE_STOPS in slow.reason
    assert steep == (0.3, BOUND)
    short = gait_family("lab-straight", 0.05, 0.3, "short")
    assert short.ends[0].reason == TANGENTIAL
    assert short.ends[0].value == pytest.approx(0.056118, abs=1e-5)  # "about 0.056"


def test_an_end_does_not_depend_on_where_the_family_was_begun(lab):
    other = gait_family("lab", 0.036, 0.052, "short")
    assert other.ends[0].value == pytest.approx(lab.ends[1].value, abs=1e-9)
    other = gait_family("lab-straight", 0.05, 0.08, "short", resolution=0.02)
    again = gait_family("lab-straight", 0.05, 0.3, "short")
    assert other.ends[0].value == pytest.approx(again.ends[0].value, abs=1e-7)


def test_just_inside_an_end_the_last_margin_is_small(lab):
    gait = find_gait("lab", lab.ends[1].value + 1e-7, "short")
    late = gait.step_period - gait.kneestrike_time
    assert 0.0 < late < 1e-3 * gait.step_period


@pytest.mark.parametrize("name", ["D", "E", "F"])
def test_tuned_walkers_walk_over_the_whole_range_asked_for(name):
    for kind in ("long", "short"):
        family = gait_family(name, 1e-8, 0.1, kind, resolution=0.3)
        assert [end.reason for end in family.ends] == [BOUND, BOUND]
        assert family.slope[[0, -1]] == pytest.approx([1e-8, 0.1], rel=1e-12)


def test_the_table_s_walkers_are_tuned_but_roughly():
    # Rounded to two digits, C's long and short gaits meet in a fold just above zero slope.
    family = gait_family("C", 1e-4, 0.1)
    assert [end.reason for end in family.ends] == [BOUND, BOUND]
    assert len(family.folds) == 1 and family.folds[0] == pytest.approx(3.91174e-4, rel=1e-5)
    assert gait_family(tune(WALKERS["C"]), 1e-6, 0.1).folds == ()


def test_a_family_can_start_from_a_gait_of_any_period():
    start = find_gait("D", 0.016, period=2)
    family = gait_family("D", 0.0152, 0.0185, start=start)
    assert family.period == 2
    assert family.period_doublings == pytest.approx((0.017669374862452,), abs=1e-9)
    i = len(family) // 2
    gait = find_gait("D", family.slope[i], period=2, guess=family.state[i])
    assert gait.step_length == pytest.approx(family.step_length[i], rel=1e-10)
    assert gait.step_period == pytest.approx(family.step_period[i], rel=1e-10)


def test_a_parameter_is_followed_at_a_fixed_slope():
    family = parameter_family("lab", "shank_offset", 0.02, 0.028, slope=0.036)
    assert family.parameter == "shank_offset" and np.all(family.slope == 0.036)
    for i in (0, len(family) // 3, -1):
        walker = replace(WALKERS["lab"], shank_offset=family.value[i])
        end = stride(walker, 0.036, family.state[i], tolerance=1e-14)
        np.testing.assert_allclose(end.state, family.state[i], rtol=1e-9)
        assert end.step_length == pytest.approx(family.step_length[i], rel=1e-9)


def test_the_slope_is_a_parameter_too():
    by_slope = gait_family("lab", 0.036, 0.04)
    for slope in (None, 0.038):
        family = parameter_family("lab", "slope", 0.036, 0.04, slope=slope)
        assert family.parameter == "slope"
        for i in (0, -1):
            np.testing.assert_allclose(family.state[i], by_slope.state[i], rtol=1e-9)


def test_a_length_is_followed_in_the_walker_s_own_units():
    family = parameter_family("E", "shank_length", 0.4, 0.6, slope=0.01)
    for i in (0, -1):
        walker = replace(WALKERS["E"], shank_length=family.value[i])
        gait = find_gait(walker, 0.01, guess=family.state[i])
        assert family.step_period[i] == pytest.approx(gait.step_period, rel=1e-9)
        assert family.step_length[i] == pytest.approx(gait.step_length, rel=1e-9)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"slope_min": 0.1, "slope_max": 0.01}, "slope_min < slope_max"),
        ({"slope_min": 0.0, "slope_max": 0.01}, "slope_min < slope_max"),
        ({"slope_min": 0.02, "slope_max": 0.03, "start": 0.01}, "out of the range"),
    ],
)
def test_a_senseless_range_is_refused(arguments, message):
    if "start" in arguments:
        arguments = {**arguments, "start": find_gait("E", arguments["start"])}
    with pytest.raises(ValueError, match=message):
        gait_family("E", **arguments)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("weight", 0.0, 1.0), "no parameter 'weight'"),
        (("hip_mass", 0.5, 1.0), "give low <="),
        (("foot_radius", -1.0, 1.0), "what a walker can be"),
    ],
)
def test_a_senseless_parameter_is_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        parameter_family("E", *arguments, slope=0.01)


def test_legs_without_mass_have_no_family_over_their_mass():
    """Legs with mass have other equations."""
    for analysis in (
        lambda: parameter_family("D", "shank_mass", 0.0, 0.1, slope=0.009),
        lambda: gpw.bifurcation_diagram("D", [0.05, 0.1], parameter="shank_mass", slope=0.009),
    ):
        with pytest.raises(ValueError, match="a leg has mass with shank_mass"):
            analysis()


def test_a_range_without_gaits_says_so():
    with pytest.raises(GaitNotFound, match="at any of 16 slopes"):
        gait_family("lab", 0.001, 0.002)


def test_a_neighbour_s_gait_starts_the_family_of_the_walker_asked_for():
    heavier = replace(WALKERS["C"], hip_mass=0.2)
    family = gait_family(heavier, 0.02, 0.03, start=find_gait("C", 0.025))
    middle = len(family) // 2
    alone = find_gait(heavier, family.slope[middle], guess=family.state[middle])
    assert family.walker == heavier
    np.testing.assert_allclose(family.state[middle], alone.state, rtol=1e-10)


def test_a_table_s_columns_are_those_of_a_state_by_their_names():
    """Of a family, of a walk and of strides: the same name is the same entry of a state."""
    family = gait_family("lab", 0.02, 0.03)
    walk = simulate("lab", 0.036, find_gait("lab", 0.036).state, 2, samples=5)
    strides = stride("lab", 0.03, family.state[:3])
    for table, states in (
        (family, family.state), (walk, walk.states), (strides, strides.state)
    ):  # fmt: skip
        columns = table.columns()
        named = [name for name in STATE_NAMES if name in columns]
        assert {"stance_angle", "stance_rate", "thigh_rate", "shank_rate"} <= {*named}
        for name in named:
            expected = states[:, STATE_NAMES.index(name)]
            np.testing.assert_array_equal(columns[name], expected)


@pytest.mark.parametrize(("name", "kind"), [("lab", "long"), ("lab", "short"), ("C", "short")])
def test_real_multipliers_whose_product_passes_1_are_no_neimark_sacker_bifurcation(name, kind):
    """A torus needs a complex pair; those of passive walkers stay within the unit circle."""
    family = gait_family(name, 0.003, 0.25, kind=kind)
    pairs = np.triu_indices(family.multipliers.shape[1], 1)
    products = (family.multipliers[:, pairs[0]] * family.multipliers[:, pairs[1]] - 1.0).prod(1)
    assert np.all(np.abs(family.multipliers[family.multipliers.imag != 0.0]) < 1.0)
    assert products.real.min() < 0.0 < products.real.max()
    assert family.neimark_sackers == ()


def braked():
    """A family of walker C with a push-off and a hip that brakes."""
    held = Actuation.dimensionless(hip_torque=-0.001, push_off=0.01)
    return gait_family(stride_map("C", 0.06, controller=held), 0.055, 0.065)


@pytest.mark.parametrize(
    "made",
    [lambda: gait_family("lab", 0.005, 0.1), braked,
     lambda: parameter_family("lab", "shank_length", 0.44, 0.48, slope=0.036)],
    ids=["passive", "braked", "shank"],
)  # fmt: skip
def test_a_family_knows_the_cost_and_the_kind_of_its_gaits(made):
    family = made()
    for i in (0, len(family) // 3, -1):
        gait = family[i]
        assert family.cost_of_transport[i] == pytest.approx(gait.cost_of_transport, rel=1e-9)
        assert family.kind[i] == gait.kind
    columns = family.columns()
    np.testing.assert_array_equal(columns["cost_of_transport"], family.cost_of_transport)
    assert [*columns["kind"]] == [*family.kind]


def test_an_index_of_no_gait_is_refused_in_a_sentence():
    family = gait_family("D", 0.008, 0.01)
    count = len(family)
    for index in (count, -count - 1):
        with pytest.raises(IndexError, match=rf"^this family has {count} gaits: .* not {index}$"):
            family[index]
    for index in ("0", 0.009, None):
        with pytest.raises(TypeError, match=r"^family\[i\] takes a whole number or a slice; "):
            family[index]
    assert family[np.int64(-1)].slope == family[count - 1].slope


def test_on_waves_of_hardly_any_height_a_family_ends_as_on_smooth_ground():
    """Each of the strides of a gait may fail."""
    smooth, waves = (
        gait_family(gpw.stride_map("lab", terrain=terrain), 0.01, 0.3)
        for terrain in (None, gpw.waves(1e-9, 3))
    )
    for end, expected in zip(waves.ends, smooth.ends, strict=True):
        assert end.value == pytest.approx(expected.value, rel=1e-3)
        assert end.reason.partition(" at ")[0] == expected.reason.partition(" at ")[0]
    assert waves.halts == pytest.approx(smooth.halts, rel=1e-6)
    high = gait_family(gpw.stride_map("lab", terrain=gpw.waves(0.0005, 3)), 0.01, 0.3)
    assert high.ends[1].reason == "kneestrike and heelstrike coincide"


def test_a_family_of_round_feet_has_no_ankle_torque():
    held = gpw.stride_map("E", 0.009, controller=gpw.Actuation.dimensionless(ankle_torque=1e-4))
    with pytest.raises(ValueError, match="ankle_torque needs point feet"):
        gpw.parameter_family(held, "foot_radius", 0.0, 0.1)
