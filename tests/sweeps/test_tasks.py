"""Rows of sweeps have the numbers of the analyses that they name."""

import inspect
import math
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest

import gym_passive_walker as gpw
from gym_passive_walker.apps.sweeps.tasks import ANALYSES, flat, task
from gym_passive_walker.envs.evaluation import walks
from gym_passive_walker.gaits.scenes.scene import make_scene
from tests.own.statements import STRAIGHT

LAB = {"walker": "lab", "slope": 0.036}


def row(analysis, **given):
    """The row of a task."""
    return flat(task(analysis, given)())


def expect(of_sweep, /, **expected):
    """A row has these columns and no other."""
    assert of_sweep.keys() == expected.keys()
    for name, value in expected.items():
        found = of_sweep[name]
        assert found == value or (math.isnan(value) and math.isnan(found)), name


@pytest.mark.parametrize(
    ("kind", "slope", "changes"),
    [
        ("long", 0.036, {}),
        ("short", 0.05, {}),
        ("long", 0.036, {"foot_radius": 0.22}),
        ("long", 0.036, {"knees": "held"}),
    ],
)
def test_a_gait_has_its_measures(kind, slope, changes):
    gait = gpw.find_gait(replace(gpw.WALKERS["lab"], **changes), slope, kind)
    expect(
        row("gait", walker="lab", slope=slope, kind=kind, **changes),
        found=True,
        stable=gait.stable,
        multiplier=abs(gait.multipliers[0]),
        stance_angle=gait.stance_angle,
        step_period=gait.step_period,
        step_length=gait.step_length,
        froude_speed=gait.froude_speed,
        cost_of_transport=gait.cost_of_transport,
    )


def test_a_gait_that_is_not_found_has_no_measures():
    found = row("gait", walker="lab", slope=-0.01)
    assert not found.pop("found") and not found.pop("stable")
    assert all(math.isnan(value) for value in found.values()) and len(found) == 6


@pytest.mark.parametrize("held", ["hip_torque", "ankle_torque", "push_off"])
def test_a_gait_under_a_held_motor_is_that_of_its_stride_map(held):
    motor = {held: {"hip_torque": 0.002, "ankle_torque": 0.001, "push_off": 0.01}[held]}
    gait = gpw.find_gait(gpw.stride_map("D", 0.009, controller=gpw.Actuation(**motor)))
    assert row("gait", walker="D", slope=0.009, **motor)["stance_angle"] == gait.stance_angle
    assert gait.stance_angle != gpw.find_gait("D", 0.009).stance_angle


def test_a_gait_of_two_strides_is_found_where_it_is_asked_for():
    gait = next(each for each in gpw.find_gaits("D", 0.016, period=2) if each.stable)
    found = row("gait", walker="D", slope=0.016, period=2)
    assert found["found"] and found["multiplier"] == pytest.approx(abs(gait.multipliers[0]))


def test_a_family_has_its_ends_folds_and_stable_range():
    lab = gpw.gait_family("lab", 0.015, 0.06)
    first, last = lab.ends
    found = row("family", walker="lab", slope_min=0.015, slope_max=0.06)
    stable = lab.slope[lab.stable]
    expect(
        found,
        gaits=len(lab),
        first_end=first.value,
        first_reason=first.reason,
        last_end=last.value,
        last_reason=last.reason,
        folds=len(lab.folds),
        period_doubling=min(lab.period_doublings, default=math.nan),
        stable_from=stable.min(),
        stable_to=stable.max(),
        fastest=lab.froude_speed.max(),
    )
    short = row("family", walker="lab", slope_min=0.03, slope_max=0.05, kind="short")
    assert math.isnan(short["stable_from"]) and math.isnan(short["stable_to"])
    assert short["gaits"] == len(gpw.gait_family("lab", 0.03, 0.05, "short"))


def test_a_family_s_first_period_doubling_is_the_one_at_the_lowest_slope():
    found = row("family", walker="D", slope_min=0.005, slope_max=0.02)
    family = gpw.gait_family("D", 0.005, 0.02)
    assert found["period_doubling"] == min(family.period_doublings) < found["last_end"]
    assert found["stable_to"] < found["last_end"] and found["stable_from"] == family.slope.min()


def test_an_attractor_has_its_period_and_its_range():
    found = row("bifurcation", walker="D", slope=0.0165, n_transient=2000, n_recorded=40)
    diagram = gpw.bifurcation_diagram("D", [0.0165], n_transient=2000, n_recorded=40)
    angles = diagram.stance_angle[0]
    expect(
        found, walks=True, period=2, least_angle=angles.min(), greatest_angle=angles.max(),
    )  # fmt: skip
    assert found["least_angle"] < found["greatest_angle"] - 1e-3
    assert not row("bifurcation", walker="D", slope=0.03)["walks"]


def test_a_basin_has_its_shares():
    found = row("basin", **LAB, resolution=24, strides=60)
    basin = gpw.basin_of_attraction("lab", 0.036, resolution=24, strides=60)
    expect(
        found,
        gaits=len(basin.gaits),
        walks=basin.walks.mean(),
        settles=np.isin(basin.settled, range(len(basin.gaits))).mean(),
    )
    assert 0.0 < found["settles"] <= found["walks"] < 1.0
    few = row("basin", **LAB, resolution=24, strides=3)
    assert few["settles"] < few["walks"]


def test_a_check_has_its_items_and_hears_the_friction():
    for friction in (0.8, 0.02):
        check = gpw.reality_check(gpw.find_gait("lab", 0.036), friction=friction)
        items = {name.replace(" ", "_"): holds for name, holds in check.passed.items()}
        expect(row("check", **LAB, friction=friction), holds=check.holds, **items)
    assert not items["friction"]
    one, other = (row("check", controller="lqr", scene=scene) for scene in ("steep", "lab"))
    assert one != other


def test_robustness_has_the_weakest_push_of_each_direction():
    options = {"walkers": 40, "strides": 12, "starts": 16, "seed": 3}
    found = row("robustness", **LAB, **options)
    tests = gpw.robustness("lab", slope=0.036, **options)
    expect(
        found,
        first_passage=tests.first_passage.mean,
        first_passage_error=tests.first_passage.error,
        sensitivity=tests.sensitivity,
        step_up=tests.step_up,
        step_down=tests.step_down,
        recovered=tests.recovered,
        recovered_error=tests.recovered_error,
        recovery=tests.recovery,
        push_forward=min(tests.push_forward),
        push_backward=min(tests.push_backward),
    )
    assert found["push_forward"] != found["push_backward"]


def test_an_optimal_gait_has_its_costs():
    scene = {"scene": "lab", "control": "stride", "slope": 0.03}
    gait = gpw.optimal_gait(make_scene(**scene), 0.16).dimensionless
    names = ("cost_of_transport", "hip_cost", "ankle_cost", "push_off_cost", "froude_speed")
    names += ("step_period", "step_length", "stable", "stubs")
    known = {name: getattr(gait, name) for name in names} | {"push_off": gait.controller.push_off}
    expect(row("optimal", **scene, speed=0.16), **known)


def test_an_evaluation_is_that_of_the_same_walks():
    given = {"controller": "steep-ppo", "episodes": 3, "seed": 5}
    arena = gym.make_vec("PassiveWalker-v0", num_envs=3, scene="steep")
    expected = walks.simulate_episodes(gpw.load_policy("steep-ppo"), arena, seed=5).summary()
    expect(row("evaluation", **given), **flat(expected))


def test_every_analysis_is_compared_here_with_what_it_names():
    source = inspect.getsource(inspect.getmodule(row))
    assert all(f'row("{name}"' in source for name in ANALYSES)


@pytest.mark.parametrize(
    ("analysis", "given"),
    [
        ("gait", {}),
        ("family", {"slope": None, "slope_min": 0.02, "slope_max": 0.021}),
        ("bifurcation", {"n_transient": 20, "n_recorded": 33}),
        ("basin", {"resolution": 6, "strides": 6}),
        ("check", {}),
        ("optimal", {"speed": 0.18, "control": "stride"}),
        ("evaluation", {"controller": "passive", "episodes": 2, "reset_noise_scale": 0.0}),
    ],
)
def test_a_compass_of_one_s_own_has_the_rows_of_the_package_s(analysis, given):
    arguments = {
        name: value for name, value in ({"slope": 0.02} | given).items() if value is not None
    }
    own, known = (
        row(analysis, walker=walker, **arguments)
        for walker in ("tests.own.statements:DRIVEN", STRAIGHT)
    )
    known.pop("gaits" * (analysis == "family"), None)  # steps of a continuation may differ
    for name in own.keys() & known.keys():
        if isinstance(known[name], float) and not math.isnan(own[name]):
            assert own[name] == pytest.approx(known[name], rel=1e-3), name
        elif not isinstance(known[name], float):
            assert own[name] == known[name], name
    assert len(own.keys() & known.keys()) >= 3
