"""Reality checks of subsection 4.3.2."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from gym_passive_walker import (
    WALKERS,
    Actuation,
    collision_matrix,
    find_gait,
    foot_velocity,
    reality_check,
    stride,
    stride_map,
    tune,
)
from gym_passive_walker.gaits.look.dense_stride import Impulse, TimedExtremum, clearance_of
from gym_passive_walker.gaits.look.forces import forces
from gym_passive_walker.gaits.map_result import NoStride
from tests.instants import states_at

SLOPE = 0.036
START = np.array([0.25, -0.25, -0.25, -1.06, -0.35, -1.5])
"""A walk of the lab walker that is no gait."""

GAITS = [
    ("lab", 0.036, "long"),
    ("lab", 0.05, "short"),
    ("C", 0.01, "long"),
    ("C", 0.003, "short"),
    ("A", 0.01, "long"),
    ("lab-straight", 0.036, "long"),
    ("E", 1e-3, "short"),
    ("D", 0.009, "long"),
]


PUSHED = [("lab", 0.03), ("C", 0.0), ("F", 0.0), ("E", 0.0), ("D", 0.0)]
"""Walkers on a slope that walk with a push-off."""


def pushed(name, slope):
    """A gait with a push-off."""
    push_off = 0.02 * WALKERS[name].units.impulse
    return find_gait(stride_map(name, slope, controller=Actuation(push_off=push_off)))


def checked(name, slope, kind="long", **options):
    gait = find_gait(name, slope, kind)
    return reality_check(gait.walker, slope, gait.state, **options)


def looked_at(name, slope, state, count=4001, hip_torque=0.0):
    """A stride's clearance and forces at many instants, its strikes left out."""
    end = stride(name, slope, state, hip_torque=hip_torque)
    times = np.linspace(0.0, 1.0 - 1e-9, count) * end.duration
    states, phases = states_at(name, slope, state, times, hip_torque=hip_torque)
    walker = WALKERS[name]
    carried = forces(walker, slope, states, phases, (hip_torque, 0.0))
    return times, states, phases, clearance_of(walker, states)[0], carried


@pytest.mark.parametrize(
    ("name", "slope", "kind"), [*GAITS, *((*walk, "pushed") for walk in PUSHED)]
)
def test_the_ground_carries_the_weight_over_a_gait(name, slope, kind):
    """A periodic walk keeps its momentum: force and impulses together balance gravity."""
    gait = pushed(name, slope) if kind == "pushed" else find_gait(name, slope, kind)
    check, walker = reality_check(gait), WALKERS[name]
    impulses = check.kneestrike_impulse, check.heelstrike_impulse, check.push_off_impulse
    given = np.nansum(impulses, axis=0)[:2]
    nodes, weights = np.polynomial.legendre.leggauss(40)
    instants = [0.0, float(gait.stride.duration)]
    if walker.knees:
        instants.insert(1, gait.kneestrike_time)
    for start, end in pairwise(instants):
        times = 0.5 * (start + end) + 0.5 * (end - start) * nodes
        states, phases = states_at(name, slope, gait.state, times, tolerance=1e-13)
        carried = forces(walker, slope, states, phases)
        given += 0.5 * (end - start) * np.array([carried.normal, carried.tangential]) @ weights
    weight = walker.total_mass * walker.gravity * float(gait.stride.duration)
    expected = [weight * np.cos(slope), -weight * np.sin(slope)]
    np.testing.assert_allclose(given, expected, rtol=1e-10, atol=1e-10 * weight)


@pytest.mark.parametrize(("name", "slope"), PUSHED)
def test_a_push_off_acts_along_the_leg_and_needs_that_much_friction(name, slope):
    gait = pushed(name, slope)
    check, units = reality_check(gait), gait.walker.units
    given, angle = check.push_off_impulse, gait.stance_angle
    expected = 0.02 * units.impulse * np.array([np.cos(angle), np.sin(angle)])
    np.testing.assert_allclose(given[:2], expected, rtol=1e-9)
    assert given.needed_friction.value == pytest.approx(np.tan(angle), rel=1e-9)
    assert str(check).count("push-off") == 2 and "push-off" not in str(checked("D", 0.009))
    assert not reality_check(gait, friction=0.99 * np.tan(angle)).passed["friction"]


@pytest.mark.parametrize(("name", "slope", "kind"), GAITS)
def test_the_heelstrike_impulse_is_what_the_collision_matrix_gives(name, slope, kind):
    gait = find_gait(name, slope, kind)
    check = reality_check(name, slope, gait.state)
    velocity = np.array(foot_velocity(gait))
    expected = -collision_matrix(name, gait.stance_angle) @ velocity
    found = [check.heelstrike_impulse.tangential_impulse, check.heelstrike_impulse.normal_impulse]
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-12)


def test_the_lab_walker_s_gait_unlocks_its_stance_knee_slightly_at_kneestrike():
    """As the text beside Fig. 4.3 says, which also supposes that the stop is pressed at once."""
    check = checked("lab", SLOPE)
    walker = check.walker
    scale = walker.total_mass * walker.leg_length**2 / walker.time_unit
    assert -0.003 * scale < check.stance_knee_at_kneestrike.value < -0.001 * scale
    assert check.stance_knee_at_heelstrike.value > 0.0
    assert check.stance_knee_torque.value > 0.0
    gait = find_gait("lab", SLOPE)
    after = [gait.kneestrike_time + 1e-6]
    states, phases = states_at("lab", SLOPE, gait.state, after)
    pressed = forces(walker, SLOPE, states, phases).stance_knee[0]
    assert -check.stance_knee_at_kneestrike.value / pressed < 0.02 * gait.step_period
    assert [item for item, passed in check.passed.items() if not passed] == ["knee lock"]
    assert not check.holds


@pytest.mark.parametrize(("name", "slope", "kind"), GAITS)
def test_the_ground_never_pulls_at_a_foot(name, slope, kind):
    """Speeds stay far below sqrt(g l), where tension would be needed."""
    check = checked(name, slope, kind)
    weight = check.walker.total_mass * check.walker.gravity
    assert 0.7 * weight < check.least_normal_force.value < weight * np.cos(slope)
    assert weight * 0.99 < check.greatest_normal_force.value < 1.1 * weight
    assert check.heelstrike_impulse.normal_impulse > 0.0
    assert check.passed["contact"]


@pytest.mark.parametrize(
    ("name", "slope", "kind"), [gait for gait in GAITS if not WALKERS[gait[0]].knees]
)
def test_straight_legs_always_scuff_and_ask_nothing_of_knees(name, slope, kind):
    check = checked(name, slope, kind)
    assert check.clearance.value < 0.0 and not check.passed["scuffing"]
    assert 0.2 < check.clearance.time / check.duration < 0.8
    assert np.isnan(check.stance_knee_torque.value) and check.passed["knee lock"]
    assert np.isnan(check.knee_flexion.value) and check.passed["hyperextension"]
    assert np.isnan(check.kneestrike_impulse.normal_impulse)


def test_the_lab_walker_clears_the_ground_on_its_usual_slope_and_scuffs_on_its_shallowest():
    assert 0.01 < checked("lab", SLOPE).clearance.value / 0.81 < 0.02
    assert checked("lab", 0.02).clearance.value < 0.0


@pytest.mark.parametrize("slope", [0.003, 0.02, 0.05])
@pytest.mark.parametrize("kind", ["long", "short"])
def test_the_foot_of_c_dips_a_little(slope, kind):
    assert -0.008 < checked("C", slope, kind).clearance.value / 0.81 < -0.001


def test_knees_hyperextend_a_little_at_near_zero_slopes():
    """Subsection 4.3.2, item 4."""
    tuned = tune(WALKERS["C"])
    for slope in (1e-4, 1e-3):
        check = checked(tuned, slope, "short")
        assert -1e-3 < check.knee_flexion.value < 0.0
        assert 0.0 < check.knee_flexion.time < 0.1 * check.duration
        assert not check.passed["hyperextension"]
    assert checked(tuned, 0.02, "short").knee_flexion == (0.0, 0.0)


def test_short_steps_on_shallow_slopes_need_more_friction_than_there_is():
    """At heelstrike only, and against what the source says in general."""
    check = checked("E", 1e-3, "short")
    assert check.stance_friction.value < 0.03
    assert check.heelstrike_impulse.needed_friction.value > 2.0
    assert not check.passed["friction"]
    assert checked("E", 1e-3, "short", friction=3.0).passed["friction"]


@pytest.mark.parametrize(("name", "hip_torque"), [("lab", 0.0), ("lab", 0.05), ("A", 0.02)])
def test_extremes_are_the_extremes_of_the_motion(name, hip_torque):
    state = START if name == "lab" else find_gait("A", SLOPE).state
    check = reality_check(name, SLOPE, state, hip_torque=hip_torque)
    times, states, phases, clearance, carried = looked_at(name, SLOPE, state, hip_torque=hip_torque)
    ratio = np.abs(carried.tangential / carried.normal)
    pairs = [
        (check.least_normal_force, carried.normal, np.argmin),
        (check.greatest_normal_force, carried.normal, np.argmax),
        (check.stance_friction, ratio, np.argmax),
    ]
    if name == "lab":
        locked = np.where(phases == 1, carried.swing_knee, np.inf)
        flexion = np.where(phases == 0, states[:, 1] - states[:, 2], np.inf)
        assert flexion.min() >= 0.0 and check.knee_flexion.value == 0.0
        pairs += [
            (check.stance_knee_torque, carried.stance_knee, np.argmin),
            (check.swing_knee_torque, locked, np.argmin),
        ]
    for extreme, values, where in pairs:
        seen = values[where(values)]
        assert extreme.time == pytest.approx(times[where(values)], abs=2.0 * times[1])
        assert extreme.value == pytest.approx(seen, rel=2e-3)
        beyond = extreme.value - seen if where is np.argmax else seen - extreme.value
        assert beyond >= -1e-9 * abs(seen)
    middle = (times > 0.3 * check.duration) & (times < 0.8 * check.duration)
    lowest = clearance[middle].min()
    assert check.clearance.value == pytest.approx(lowest, abs=1e-6)
    assert check.clearance.value <= lowest + 1e-12


def test_a_foot_that_is_not_released_goes_into_the_ground():
    state = np.array([0.32, -0.32, -0.32, -0.92, 2.53, 2.56])
    check = reality_check("lab", SLOPE, state)
    times, _, _, clearance, _ = looked_at("lab", SLOPE, state)
    assert check.release_velocity.value < 0.0 and not check.passed["release"]
    assert check.release_velocity.value == pytest.approx(clearance[1] / times[1], rel=0.01)
    assert check.release_depth.value == pytest.approx(clearance[: len(times) // 3].min(), abs=1e-7)
    assert check.release_depth.value < 0.0
    released = reality_check("lab", SLOPE, START)
    assert released.release_velocity.value > 0.0 and released.release_depth.value == 0.0


LEAST = ("clearance", "stance_knee_torque", "stance_knee_at_kneestrike")
LEAST += ("stance_knee_at_heelstrike", "swing_knee_torque", "least_normal_force")
LEAST += ("knee_flexion", "release_velocity", "release_depth")


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_several_strides_give_the_worst_of_each(side):
    """Beside the gait on either side, so that the worst stride is the first or a later one."""
    gait = find_gait("lab", SLOPE).state
    states, checks, began = [gait + side * (START - gait)], [], [0.0]
    for _ in range(3):
        checks.append(reality_check("lab", SLOPE, states[-1]))
        began.append(began[-1] + checks[-1].duration)
        states.append(stride("lab", SLOPE, states[-1], tolerance=1e-13).state)
    every = reality_check("lab", SLOPE, states[0], strides=3)
    assert every.duration == pytest.approx(began[3], rel=1e-12)
    for name in (*LEAST, "greatest_normal_force", "stance_friction"):
        values = np.array([getattr(check, name).value for check in checks])
        worst = (np.argmin if name in LEAST else np.argmax)(values)
        found = getattr(every, name)
        assert found.value == pytest.approx(values[worst], rel=1e-9, abs=1e-12), name
        if np.ptp(values) > 1e-6:
            when = began[worst] + getattr(checks[worst], name).time
            assert found.time == pytest.approx(when, abs=1e-6), name
    for name in ("kneestrike_impulse", "heelstrike_impulse"):
        frictions = [getattr(check, name).needed_friction.value for check in checks]
        assert getattr(every, name).needed_friction.value == pytest.approx(max(frictions), rel=1e-9)


ITEMS = {
    "clearance": "scuffing",
    "stance_knee_torque": "knee lock",
    "stance_knee_at_kneestrike": "knee lock",
    "stance_knee_at_heelstrike": "knee lock",
    "stance_knee_at_push_off": "knee lock",
    "least_normal_force": "contact",
    "knee_flexion": "hyperextension",
    "release_velocity": "release",
}
"""The item that fails where a quantity is negative."""


@pytest.fixture(scope="module")
def feasible():
    """A check in which every item holds."""
    check = checked("lab", SLOPE)
    return replace(check, stance_knee_at_kneestrike=TimedExtremum(0.001, 0.4))


@pytest.mark.parametrize(("quantity", "item"), ITEMS.items())
def test_a_negative_quantity_fails_its_own_item_and_no_other(quantity, item, feasible):
    assert feasible.holds and all(feasible.passed.values())
    assert replace(feasible, **{quantity: TimedExtremum(0.0, 0.1)}).holds
    check = replace(feasible, **{quantity: TimedExtremum(-1e-9, 0.1)})
    assert [name for name, holds in check.passed.items() if not holds] == [item]
    assert not check.holds and check.facts()[item] == "fails"


@pytest.mark.parametrize(
    "impulse", ["kneestrike_impulse", "heelstrike_impulse", "push_off_impulse"]
)
def test_an_impulse_fails_by_the_friction_that_it_needs_or_by_a_pull(impulse, feasible):
    slips = replace(feasible, **{impulse: Impulse(1.0, 0.81, 0.1)})
    assert [name for name, holds in slips.passed.items() if not holds] == ["friction"]
    assert replace(feasible, **{impulse: Impulse(1.0, -0.79, 0.1)}).holds
    pulls = replace(feasible, **{impulse: Impulse(-1.0, 0.0, 0.1)})
    assert not pulls.passed["friction"]
    assert pulls.passed["contact"] == (impulse == "push_off_impulse")  # along the leg, upwards
    slides = replace(feasible, stance_friction=TimedExtremum(0.81, 0.1))
    assert [name for name, holds in slides.passed.items() if not holds] == ["friction"]


def test_a_walk_far_from_any_gait_can_be_checked_as_well():
    check = reality_check("lab", 0.05, [0.367, -0.367, -0.367, -1.714, -0.816, 4.638])
    assert check.greatest_normal_force.value > check.least_normal_force.value
    assert not check.holds


def test_an_impulse_that_would_pull_needs_friction_without_end():
    assert Impulse(-1.0, 0.2, 0.0).needed_friction.value == np.inf
    assert Impulse(2.0, -0.5, 0.0).needed_friction.value == 0.25


@pytest.mark.parametrize("name", ["lab", "A", "D"])
def test_a_check_prints_as_a_table(name):
    slope = {"lab": SLOPE, "A": 0.01, "D": 0.009}[name]
    check = checked(name, slope)
    lines = str(check).splitlines()
    assert f"walker '{name}'" in lines[0]
    for item, passed in check.passed.items():
        (line,) = [line for line in lines if line.startswith(item)]
        assert line.split(item)[1].split()[0] == ("ok" if passed else "FAILS")
    assert f"{check.least_normal_force.value:.4g}" in str(check)
    assert max(map(len, lines)) <= 100


def test_a_stride_that_fails_cannot_be_checked():
    with pytest.raises(NoStride, match="FELL_BACKWARD"):
        reality_check("lab", SLOPE, [0.3, -0.3, -0.3, -0.1, 0.0, 0.0])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"state": np.tile(START, (2, 1))}, "one walker"),
        ({"strides": 0}, "strides"),
        ({"strides": 1.5}, "strides"),
        ({"slope": np.nan}, "slope"),
    ],
)
def test_what_cannot_be_checked_is_refused(change, message):
    arguments = {"walker": "lab", "slope": SLOPE, "state": START} | change
    with pytest.raises(ValueError, match=message):
        reality_check(**arguments)
