"""Rows of sweeps by a second way: strides one after another, gaits one by one, closed relations."""

import numpy as np
import pytest

import gym_passive_walker as gpw
from gym_passive_walker.apps.sweeps.quantities import label
from gym_passive_walker.apps.sweeps.tasks import flat, task


def row(analysis, **given):
    """The row of a task."""
    return flat(task(analysis, given)())


def test_a_family_doubles_its_period_where_a_multiplier_passes_minus_one():
    found = row("family", walker="D", slope_min=0.012, slope_max=0.017)
    at = found["period_doubling"]
    least = [gpw.find_gait("D", at + change).multipliers.real.min() for change in (-1e-6, 0, 1e-6)]
    assert least[0] > -1.0 > least[2] and least[1] == pytest.approx(-1.0, abs=1e-6)
    assert (found["first_end"], found["last_end"]) == pytest.approx((0.012, 0.017), rel=1e-12)
    assert found["first_reason"] == found["last_reason"] == "end of the range asked for"
    assert found["stable_from"] == found["first_end"] < found["stable_to"] < at
    assert found["folds"] == 0
    fastest = gpw.find_gait("D", 0.017)
    assert found["fastest"] == pytest.approx(fastest.froude_speed, rel=1e-6)


def test_a_family_has_as_many_folds_as_its_slope_turns_and_ends_where_no_gait_is_near():
    family = gpw.gait_family("lab", 0.01, 0.06)
    found = row("family", walker="lab", slope_min=0.01, slope_max=0.06)
    turns = np.sum(np.diff(np.sign(np.diff(family.slope))) != 0)
    assert found["folds"] == turns == 2
    assert found["first_reason"].startswith("heelstrike becomes tangential")
    assert found["last_reason"] == "kneestrike and heelstrike coincide"
    assert found["first_end"] == pytest.approx(family.slope[0], abs=1e-4)
    assert found["last_end"] == pytest.approx(family.slope[-1], abs=1e-4)
    assert found["first_end"] < found["last_end"]
    for at, stable in ((found["stable_from"], True), (found["stable_to"], True)):
        gait = min(gpw.find_gaits("lab", at), key=lambda gait: abs(gait.multipliers[0]))
        assert gait.stable == stable


@pytest.mark.parametrize(("slope", "period"), [(0.012, 1), (0.0165, 2)])
def test_an_attractor_is_reached_stride_by_stride(slope, period):
    found = row("bifurcation", walker="D", slope=slope, n_transient=600, n_recorded=40)
    state, angles = gpw.find_gait("D", slope).state * 1.0001, []
    for count in range(2040):
        walk = gpw.stride("D", slope, state)
        state = walk.state
        angles += [state[0]] * (count >= 2000)
    assert found["walks"] and found["period"] == period == len({round(x, 6) for x in angles})
    assert found["least_angle"] == pytest.approx(min(angles), abs=2e-6)
    assert found["greatest_angle"] == pytest.approx(max(angles), abs=2e-6)


def test_a_basin_is_walked_stride_by_stride():
    """All states of the simplest walker's section follow from a heelstrike."""
    d, gait = gpw.WALKERS["D"], gpw.find_gait("D", 0.009)
    share = 2.2 * np.arange(1, 21) / 20.0
    angle, rate = (x.ravel() for x in np.meshgrid(share * gait.state[0], share * gait.state[3]))
    swing = rate * np.cos(2.0 * angle)
    states = np.column_stack([angle, -angle, -angle, rate, swing, swing])
    on, near = np.ones(len(states), bool), {}
    for count in range(1, 121):
        walk = gpw.stride(d, 0.009, states[on])
        strikes = walk.outcome == gpw.Outcome.HEELSTRIKE
        states[on] = np.where(strikes[:, None], walk.state, np.nan)
        on[on] = strikes
        off = np.abs(states - gait.state).max(axis=1)
        near[count] = on.mean(), np.mean(off < 1e-6)
    whole = row("basin", walker="D", slope=0.009, resolution=20, strides=120)
    assert whole["walks"] == near[120][0] > 0.0 and whole["gaits"] == 1
    assert whole["settles"] == near[120][1] == whole["walks"]
    cut = row("basin", walker="D", slope=0.009, resolution=20, strides=5)
    assert cut["walks"] == pytest.approx(near[5][0], abs=0.01)
    assert cut["settles"] < cut["walks"]


def test_costs_of_an_optimal_gait_add_up_to_its_cost_of_transport():
    found = row("optimal", scene="lab", control="stride", slope=0.03, speed=0.17)
    costs = np.sin(0.03) + found["hip_cost"] + found["ankle_cost"] + found["push_off_cost"]
    assert found["cost_of_transport"] == pytest.approx(costs, rel=1e-6)
    assert found["step_length"] / found["step_period"] == pytest.approx(0.17, rel=1e-6)
    assert found["hip_cost"] > 0.0 and found["push_off"] == found["ankle_cost"] == 0.0
    assert type(found["stable"]) is bool and type(found["stubs"]) is bool


@pytest.mark.parametrize(
    ("passive", "changes"),
    [(True, {"strides": 9}), (False, {"initial_error": 0.1, "walkers": 20, "seed": 1})],
)
def test_robustness_hears_each_option(passive, changes):
    options = {"walkers": 30, "strides": 12, "starts": 16, "roughness": 4e-4} | changes
    on = {"walker": "D", "slope": 0.009} if passive else {"controller": "lqr", "scene": "steep"}
    subject = ("D",) if passive else ("lqr", "steep")
    tests = gpw.robustness(*subject, **options, **({"slope": 0.009} if passive else {}))
    found = row("robustness", **on, **options)
    assert found["first_passage"] == pytest.approx(tests.first_passage.mean, nan_ok=True)
    assert found["recovered"] == tests.recovered and found["step_up"] == tests.step_up
    assert found["push_forward"] == tests.push_forward.min()
    assert found["push_backward"] == tests.push_backward.min()
    with pytest.raises(ValueError, match="first_passage"):
        row("robustness", **on, **options, first_passage="nothing")


def test_a_check_is_that_of_the_scene():
    one, other = (row("check", controller="lqr", scene=scene) for scene in ("steep", "lab"))
    assert one != other


LABELS = {
    "found": "found", "stable": "stable", "multiplier": "modulus of the largest multiplier",
    "stance_angle": "stance angle θ (rad)", "step_period": "step period / √(l/g)",
    "step_length": "step length / l", "cost_of_transport": "cost of transport",
    "gaits": "gaits", "first_end": "first end (rad)", "first_reason": "first reason",
    "last_end": "last end (rad)", "last_reason": "last reason", "folds": "folds",
    "period_doubling": "period doubling (rad)", "stable_from": "stable from (rad)",
    "stable_to": "stable to (rad)", "fastest": "fastest / √(g l)",
    "walks": "walks", "period": "period", "least_angle": "least angle (rad)",
    "greatest_angle": "greatest angle (rad)", "settles": "settles",
    "first_passage": "first passage (strides)", "recovery": "recovery (strides)",
    "step_up": "step up / l", "step_down": "step down / l",
    "push_forward": "push forward / (m √(g l))", "push_backward": "push backward / (m √(g l))",
    "distance": "distance / l", "roughness": "roughness / l", "seconds": "run time (s)",
    "hip_mass": "hip mass / m", "hip_stiffness": "hip stiffness / (m g l)",
    "hip_friction": "hip friction / (m l √(g l))", "push_off": "push off / (m √(g l))",
    "hip_torque": "hip torque / (m g l)", "ankle_torque": "ankle torque / (m g l)",
    "foot_radius": "foot radius / l", "foot_angle": "foot angle (rad)",
    "gravity": "gravity", "status": "status",
}  # fmt: skip


@pytest.mark.parametrize("name", LABELS)
def test_a_column_has_a_label_with_its_unit(name):
    assert label(name) == LABELS[name]


def test_columns_that_are_also_axes_of_other_pictures_have_their_labels():
    from gym_passive_walker.pictures.axes import ANGLE, SLOPE, SPEED

    assert label("slope") == SLOPE != label("speed") == label("froude_speed") == SPEED
    assert label("stance_angle") == ANGLE
    assert len({label(name) for name in LABELS}) == len(LABELS)


def test_what_is_no_function_of_a_module_is_refused():
    with pytest.raises(ValueError, match=r"'math:pi' is not a function"):
        task("math:pi", {})
    with pytest.raises(ValueError, match=r"'math:pie' cannot be found"):
        task("math:pie", {})
