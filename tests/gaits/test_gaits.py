"""Every gait is found without a guess, exact, and known from the literature where it is known."""

from dataclasses import asdict, replace

import numpy as np
import pytest

from gym_passive_walker import (
    WALKERS,
    GaitNotFound,
    Walker,
    WalkerError,
    find_gait,
    find_gaits,
    gait_family,
    interpolate,
    lab_walker_from_parts,
    nearest_gait,
    stride,
    tune,
)
from gym_passive_walker.gaits.find.search import seek
from gym_passive_walker.gaits.flow import flow

CASES = [
    (name, slope, kind)
    for name, slopes in {
        "A": (0.002, 0.03),
        "B": (0.001, 0.03),
        "C": (0.005, 0.03),
        "D": (1e-8, 0.00747, 0.009, 0.05, 0.23),
        "E": (1e-8, 1e-4, 0.01),
        "F": (1e-8, 1e-4, 0.01),
        "lab": (0.04, 0.05),
        "lab-straight": (0.07, 0.2),
    }.items()
    for slope in slopes
    for kind in ("long", "short")
]


@pytest.mark.parametrize(("name", "slope", "kind"), CASES)
def test_a_gait_comes_back_to_itself_and_costs_the_sine_of_the_slope(name, slope, kind):
    gait = find_gait(name, slope, kind)
    end = stride(name, slope, gait.state, tolerance=1e-14)
    np.testing.assert_allclose(end.state, gait.state, rtol=2e-12)
    assert gait.cost_of_transport == pytest.approx(np.sin(slope), rel=1e-12, abs=1e-12)
    assert gait.kind == kind
    assert gait.beyond_fold == (kind == "short")


def test_gravity_pays_for_the_friction_of_a_hip_as_for_collisions():
    walker, slope = replace(WALKERS["lab"], hip_friction=0.02), 0.036
    step = stride(walker, slope, find_gait(walker, slope).state)
    assert step.friction_loss > 0.01
    assert step.cost_of_transport == pytest.approx(np.sin(slope), rel=1e-9)


@pytest.mark.parametrize(
    ("name", "slope"), [("F", 1.4e-7), ("F", 1.76e-8), ("E", 1.12e-8), ("E", 7.23e-8)]
)
def test_newtons_method_does_not_stand_still_in_the_valley_of_a_shallow_slope(name, slope):
    long, short = find_gaits(name, slope)
    assert long.kind == "long" and short.kind == "short"
    assert long.stance_angle == pytest.approx(np.cbrt(slope), rel=0.15)


@pytest.mark.parametrize("name", ["A", "C"])
@pytest.mark.parametrize("slope", [1e-8, 1e-6, 1e-4])
def test_tuned_walkers_walk_at_the_smallest_slopes(name, slope):
    long, short = find_gaits(tune(WALKERS[name]), slope)
    assert (long.kind, short.kind) == ("long", "short")
    for gait in (long, short):
        end = stride(gait.walker, slope, gait.state, tolerance=1e-14)
        np.testing.assert_allclose(end.state, gait.state, rtol=1e-11)
        assert gait.cost_of_transport == pytest.approx(slope, rel=1e-10)


def test_the_simplest_walker_at_009_is_that_of_the_literature():
    long, short = find_gaits("D", 0.009)
    assert long.state[[0, 3]] * [1, WALKERS["D"].time_unit] == pytest.approx(
        [0.20031090, -0.19983247], abs=5e-9
    )
    assert short.state[[0, 3]] * [1, WALKERS["D"].time_unit] == pytest.approx(
        [0.19393737, -0.20386693], abs=5e-9
    )
    assert long.multipliers[0] == pytest.approx(-0.190 + 0.558j, abs=5e-4)
    assert short.multipliers[:2] == pytest.approx([4.00, 0.459], abs=5e-3)
    assert long.stable and not short.stable


def test_the_simplest_walker_s_small_steps_obey_the_series_of_the_literature():
    long, short = find_gaits("D", 1e-9)
    assert long.stance_angle / 1e-3 == pytest.approx(0.970956, abs=2e-6)
    assert short.stance_angle / 1e-3 == pytest.approx(0.943976, abs=2e-6)
    unit = WALKERS["D"].time_unit
    assert long.step_period / unit == pytest.approx(3.812092, abs=2e-6)
    assert short.step_period / unit == pytest.approx(np.pi, abs=2e-6)


def test_a_gait_that_few_starts_lead_to_is_found_by_a_second_look():
    gait = find_gait("C", 0.002)
    assert gait.kind == "long" and np.abs(gait.multipliers).max() < 1.0
    end = stride("C", 0.002, gait.state).state
    np.testing.assert_allclose(end, gait.state, atol=1e-9)


def test_the_compass_gait_is_that_of_the_literature():
    compass = Walker(
        thigh_length=0.5, thigh_mass=5.0, thigh_com=0.5, shank_length=0.5, shank_mass=0.0,
        hip_mass=10.0, knees=False, gravity=9.8,
    )  # fmt: skip
    gait = find_gait(compass, np.radians(3.0))
    assert np.degrees(gait.stance_angle) == pytest.approx(15.53, abs=0.02)
    assert gait.step_period == pytest.approx(0.7347, abs=2e-4)
    assert gait.stable


def test_the_lab_walker_s_own_fixed_point_is_found():
    # Appendix 4.10.1, to the accuracy of its computation; its angles are relative, so
    # theta1dot + theta2dot is the thigh's rate.
    gait = find_gait(lab_walker_from_parts(), 0.036)
    rates = np.cumsum([-1.04911493167539, 0.74757611863057, -1.18161338966657])
    np.testing.assert_allclose(gait.stance_angle, 0.24395121657117, atol=5e-6)
    np.testing.assert_allclose(gait.state[3:], rates, atol=5e-5)


def random_walkers(count):
    """Tuned walkers with every proportion a tenth or two off a published one."""
    random = np.random.default_rng(7)
    while count:
        base = tune(WALKERS[str(random.choice(["A", "B", "C", "E", "F"]))])
        values = {
            name: value * np.exp(0.15 * random.standard_normal())
            for name, value in asdict(base).items()
            if name not in ("knees", "gravity")
        }
        values["hip_mass"] += random.uniform(0.0, 0.5) * base.total_mass
        try:
            yield tune(replace(base, **values)), float(np.exp(random.uniform(-6.0, -3.0)))
        except WalkerError:
            continue
        count -= 1


@pytest.mark.parametrize(("walker", "slope"), list(random_walkers(12)), ids=range(12))
def test_a_user_s_walker_is_solved_without_a_guess(walker, slope):
    for kind in ("long", "short"):
        gait = find_gait(walker, slope, kind)
        end = stride(walker, slope, gait.state, tolerance=1e-14)
        np.testing.assert_allclose(end.state, gait.state, rtol=1e-11)


def test_a_tuned_lab_walker_walks_on_steep_slopes_only():
    # Tuning conditions are necessary, not sufficient: C differs from it in its gyration too.
    tuned = tune("lab")
    assert find_gaits(tuned, 0.02) == []
    halfway = replace(tuned, thigh_gyration=0.1882, shank_gyration=0.1226)
    assert len(find_gaits(halfway, 0.02)) == 2
    steep = gait_family(tuned, 0.2, 0.4)
    assert steep.folds == pytest.approx((0.24076687,), abs=1e-7)


@pytest.mark.parametrize(
    ("slope", "fraction"), [(1e-6, 0.260997), (1e-3, 0.258570), (0.02, 0.221198)]
)
def test_on_the_way_to_the_tuned_lab_walker_the_gaits_of_c_meet_and_end(slope, fraction):
    tuned, lab = tune("C"), tune("lab")
    long, short = find_gaits(interpolate(tuned, lab, fraction - 1e-4), slope)
    assert (long.kind, short.kind) == ("long", "short")
    assert short.stance_angle > 0.9 * long.stance_angle
    assert find_gaits(interpolate(tuned, lab, fraction + 1e-4), slope) == []


def changed_walkers(count):
    """Walkers with every parameter up to a quarter off a published one's, tuned or not, by name."""
    random = np.random.default_rng(11)
    for i in range(count):
        name = ("lab", "C", "lab-straight", "A", "E", "B")[i % 6]
        values = {
            key: value * random.uniform(0.75, 1.25)
            for key, value in asdict(WALKERS[name]).items()
            if key not in ("knees", "gravity")
        }
        yield name, replace(WALKERS[name], **values)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "walker"), list(changed_walkers(12)), ids=range(12))
def test_what_a_gait_becomes_as_its_walker_is_changed_is_found_without_a_guess(name, walker):
    slope = {"lab": 0.036, "lab-straight": 0.06}.get(name, 0.02)
    for gait in find_gaits(name, slope):
        for fraction in np.linspace(0.0, 1.0, 21)[1:]:
            changed = interpolate(WALKERS[name], walker, fraction)
            near = find_gaits(changed, slope, guess=gait.state)
            if not near or abs(np.log(near[0].stance_angle / gait.stance_angle)) > 0.2:
                break  # it has ended on the way
            gait = near[0]
        else:
            found = [other.stance_angle for other in find_gaits(walker, slope)]
            assert np.abs(np.array(found) / gait.stance_angle - 1.0).min() < 1e-9


def test_a_doubled_gait_repeats_after_two_strides_and_no_sooner():
    gait = find_gait("D", 0.016, period=2)
    once = stride("D", 0.016, gait.state, tolerance=1e-13)
    twice = stride("D", 0.016, once.state, tolerance=1e-13)
    np.testing.assert_allclose(twice.state, gait.state, rtol=1e-11)
    assert abs(once.state[0] - gait.state[0]) > 1e-3
    assert gait.cost_of_transport == pytest.approx(np.sin(0.016), rel=1e-12)
    assert gait.stable and not find_gait("D", 0.016).stable
    assert gait.step_period == pytest.approx(0.5 * float(once.duration + twice.duration), rel=1e-9)


@pytest.mark.parametrize("slope", [0.012, 0.016])
def test_a_gait_of_one_stride_is_none_of_two(slope):
    """Also where it is found from its own state, as one that has come back after two strides."""
    gait = find_gait("D", slope)
    assert find_gaits("D", slope, period=2, guess=gait.state) == []
    for found in find_gaits("D", slope, period=2):
        once = stride("D", slope, found.state, tolerance=1e-13)
        assert abs(once.state[0] - found.state[0]) > 1e-3


def test_gaits_of_one_orbit_are_one_gait():
    gaits = find_gaits("D", 0.018, period=4)
    angles = [gait.stance_angle for gait in gaits]
    for gait in gaits:
        state, orbit = gait.state, []
        for _ in range(4):
            state = stride("D", 0.018, state, tolerance=1e-12).state
            orbit.append(state[0])
        assert sum(np.isclose(angle, orbit, rtol=1e-6).any() for angle in angles) == 1


def test_of_guesses_at_both_gaits_the_kind_asked_for_is_taken():
    states = [gait.state for gait in find_gaits("E", 0.01)]
    for kind in ("long", "short"):
        assert find_gait("E", 0.01, kind, guess=states).kind == kind


def test_a_guess_is_followed_to_the_gait_beside_it():
    short = find_gait("E", 0.01, "short")
    assert find_gait("E", 0.01, guess=1.002 * short.state).kind == "short"


def test_a_gait_that_is_not_there_says_what_was_tried():
    with pytest.raises(GaitNotFound) as caught:
        find_gait("lab", 0.001)
    message = str(caught.value)
    assert "walker 'lab'" in message and "0.001 rad" in message
    assert "starts ended so" in message and "HEELSTRIKE" in message


@pytest.mark.parametrize("name, slope, kind", [("lab", 0.001, "long"), ("lab", 0.03, "short")])
def test_a_search_that_fails_looks_nowhere_else(name, slope, kind, monkeypatch):
    """Its strides are those of the search itself, and its message names what would look further."""
    calls = []

    def counted(*arguments, **options):
        calls.append(arguments)
        return flow(*arguments, **options)

    monkeypatch.setattr("gym_passive_walker.gaits.stride_map.flow", counted)
    assert seek(name, slope, kind).gait is None
    needed = len(calls)
    with pytest.raises(GaitNotFound, match=r"; gpw\.nearest_gait\(walker, slope\) looks for"):
        find_gait(name, slope, kind)
    assert len(calls) == 2 * needed > 0


def test_the_nearest_slope_with_a_gait_is_a_fold_of_its_family():
    for slope in (0.001, 0.015):
        near = nearest_gait("lab", slope)
        assert near.walker == WALKERS["lab"]
        assert near.slope == pytest.approx(0.0191229, rel=1e-3)
        again = find_gait("lab", near.slope)
        np.testing.assert_allclose(again.state, near.state, rtol=1e-9)
    # From steeper ground the gaits beyond the gap are the nearer ones.
    assert nearest_gait("lab", 0.1).slope == pytest.approx(0.16372248, rel=1e-3)


def test_the_nearest_walker_with_a_gait_lies_on_the_way_from_a_preset():
    tuned = tune("lab")
    near = nearest_gait(tuned, 0.036, keep="slope")
    assert near.slope == 0.036 and near.walker != tuned
    again = find_gait(near.walker, 0.036)
    np.testing.assert_allclose(again.state, near.state, rtol=1e-9)
    moved = near.walker.thigh_offset / tuned.thigh_offset
    assert moved == pytest.approx(0.22, abs=5e-3)
    between = interpolate("lab", tuned, moved)
    assert asdict(near.walker) == pytest.approx(asdict(between), rel=1e-12)


def test_where_there_is_a_gait_it_is_the_nearest():
    for kind in ("long", "short"):
        near, there = nearest_gait("E", 0.01, kind), find_gait("E", 0.01, kind)
        assert near.state.tolist() == there.state.tolist()


def test_a_gait_of_gentler_slopes_is_followed_to_where_no_search_finds_it():
    with pytest.raises(GaitNotFound):
        find_gait("D", 0.5)
    near = nearest_gait("D", 0.5)
    assert near.slope == 0.5 and near.kind == "long" and near.violation < 1e-11


def test_a_walker_of_another_size_has_its_nearest_gaits_at_the_same_slope_and_shape():
    giant = replace(
        tune("lab"),
        **{
            name: 10.0 * value
            for name, value in asdict(tune("lab")).items()
            if name.endswith(("length", "offset", "gyration", "com", "radius", "mass"))
        },
        gravity=1.6,
    )
    small, large = nearest_gait(tune("lab"), 0.036), nearest_gait(giant, 0.036)
    assert large.slope == pytest.approx(small.slope, rel=1e-9)
    small, large = (nearest_gait(x, 0.036, keep="slope") for x in (tune("lab"), giant))
    for name, value in asdict(small.walker).items():
        sizes = {"foot_angle": value, "knees": value, "gravity": 1.6}
        assert getattr(large.walker, name) == pytest.approx(sizes.get(name, 10.0 * value)), name


def test_where_no_walker_and_no_slope_has_a_gait_one_sentence_says_so(monkeypatch):
    with pytest.raises(GaitNotFound, match=r"slope 0 rad, and none of another walker either$"):
        nearest_gait("lab", 0.0, keep="slope")
    monkeypatch.setattr("gym_passive_walker.gaits.find.nearest._STEEPEST", 0.01)
    with pytest.raises(GaitNotFound, match=r"and none at another slope either$"):
        nearest_gait("lab", 0.001, keep="walker")
    with pytest.raises(GaitNotFound, match=r"none at another slope or of another walker either$"):
        nearest_gait("lab", 0.0)


def test_if_no_slope_has_a_gait_another_walker_is_tried(monkeypatch):
    monkeypatch.setattr("gym_passive_walker.gaits.find.nearest._STEEPEST", 0.01)
    near = nearest_gait("lab", 0.009)
    assert near.slope == 0.009 and near.walker != WALKERS["lab"]


def test_a_long_search_says_on_stderr_what_it_does(capsys, monkeypatch):
    monkeypatch.setattr("gym_passive_walker._tools.progress._UNSAID", 0.0)
    nearest_gait("lab", 0.001)
    said = "looking for the long-step gait nearest to slope 0.001 rad"
    assert said in capsys.readouterr().err


def test_a_missing_kind_says_which_gait_there_is():
    with pytest.raises(GaitNotFound, match="only a long-step gait was found"):
        find_gait("lab", 0.03, "short")


@pytest.mark.parametrize("slope", [0.0, -0.01])
def test_no_passive_gait_walks_on_the_level_or_uphill(slope):
    assert find_gaits("E", slope) == []
    # The nearest ground on which it walks is gentle and goes down.
    assert 0.0 < nearest_gait("E", slope).slope < 0.001


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"slope": np.nan}, "slope must be an angle"),
        ({"slope": 2.0}, "slope must be an angle"),
        ({"kind": "medium"}, 'kind must be "long" or "short"'),
        ({"period": 0}, "period must be a whole number"),
        ({"period": 1.5}, "period must be a whole number"),
        ({"guess": [0.1, 0.2]}, "guess must be"),
        ({"guess": [-0.1, 0.1, 0.1, -0.1, 0.0, 0.0]}, "stance angle is positive"),
    ],
)
def test_what_makes_no_sense_is_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        find_gait(**{"walker": "E", "slope": 0.01, **arguments})


def test_an_unknown_walker_is_refused():
    with pytest.raises(WalkerError, match="no walker 'Z'"):
        find_gait("Z", 0.01)
