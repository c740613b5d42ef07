"""What a gait or a map supplies to analyses, and what replaces it; texts and tables of strides."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest

import gym_passive_walker as gpw
from gym_passive_walker import (
    WALKERS,
    Actuation,
    find_gait,
    reality_check,
    simulate,
    stride,
    stride_jacobian,
    stride_map,
)
from gym_passive_walker.gaits.actuation import one_actuation, to_dimensionless, to_own
from gym_passive_walker.gaits.stride import Stride, together

WALKER = WALKERS["E"]
HELD = Actuation(hip_torque=0.02, ankle_torque=-0.01, push_off=0.05)


@pytest.fixture(scope="module")
def gait():
    return find_gait(stride_map(WALKER, 0.01, controller=HELD))


def of_stride(*given, **motors):
    return stride(*given, **motors).state


def of_simulation(*given, **motors):
    return simulate(*given, strides=2, samples=5, **motors).states


def of_derivative(*given, **motors):
    return stride_jacobian(*given, **motors)


def of_check(*given, hip_torque=None, **_):
    return np.array(reality_check(*given, hip_torque=hip_torque).columns()["value"])


PARTS = Actuation._fields
ANALYSES = [of_stride, of_simulation, of_derivative]


@pytest.mark.parametrize("analysis", ANALYSES)
def test_a_gait_supplies_its_slope_state_and_motors(analysis, gait):
    whole = analysis(WALKER, 0.01, gait.state, **HELD._asdict())
    np.testing.assert_allclose(analysis(gait), whole, rtol=1e-7, atol=1e-9)
    np.testing.assert_allclose(analysis(gait.stride_map, None, gait.state), whole, rtol=1e-7,
                               atol=1e-9)  # fmt: skip


@pytest.mark.parametrize("analysis", ANALYSES)
@pytest.mark.parametrize("part", PARTS)
def test_one_motor_that_is_given_replaces_the_gait_s_and_leaves_the_others(analysis, part, gait):
    """Zero too is a value."""
    for value in (0.0, 0.7 * getattr(HELD, part)):
        whole = analysis(WALKER, 0.01, gait.state, **(HELD._asdict() | {part: value}))
        found = analysis(gait, **{part: value})
        np.testing.assert_allclose(found, whole, rtol=1e-9, atol=1e-12)
        assert np.abs(found - analysis(gait)).max() > 1e-6


@pytest.mark.parametrize("analysis", ANALYSES)
def test_a_slope_or_a_state_that_is_given_replaces_the_gait_s(analysis, gait):
    held, state = HELD._asdict(), 1.01 * gait.state
    for found, whole in (
        (analysis(gait, 0.012), analysis(WALKER, 0.012, gait.state, **held)),
        (analysis(gait, None, state), analysis(WALKER, 0.01, state, **held)),
        (analysis(gait, 0.012, state), analysis(WALKER, 0.012, state, **held)),
    ):
        np.testing.assert_allclose(found, whole, rtol=1e-9, atol=1e-12)


def test_a_check_takes_the_hip_torque_that_is_given_and_the_gait_s_period():
    gait = find_gait(stride_map("lab", 0.03, controller=Actuation(hip_torque=0.01)))
    for torque in (None, 0.0, 0.02):
        given = 0.01 if torque is None else torque
        whole = reality_check("lab", 0.03, gait.state, hip_torque=given).columns()["value"]
        found = reality_check(gait, hip_torque=torque).columns()["value"]
        np.testing.assert_allclose(found, whole, rtol=1e-6, atol=1e-9)
    two = find_gait("D", 0.016, period=2)
    assert reality_check(two, strides=1).strides == 1 and reality_check(two).strides == 2


def test_motors_of_a_controller_or_a_terrain_are_its_own():
    policy = stride_map(controller="lqr", scene="steep")
    stairs = stride_map("lab", 0.03, terrain=gpw.stairs(-0.001))
    state = find_gait("lab", 0.036).state
    for strides, name in ((policy, "LQR"), (stairs, "this map")):
        for part in PARTS:
            with pytest.raises(ValueError, match=f"{name} works these motors: leave hip_torque"):
                stride(strides, None, state, **{part: 0.0})
        with pytest.raises(ValueError, match="has its own rules: leave max_stride_time"):
            stride(strides, None, state, end_on_toe_stub=True)


REFUSED = {
    "slope_change must be an angle in rad between -pi and pi, not 4": dict(slope_change=4.0),
    "height_change": dict(height_change=np.nan),
    "max_stride_time": dict(max_stride_time=0.0),
    "end_on_toe_stub": dict(end_on_toe_stub=1),
    "threads": dict(threads=0),
    "backend must be a function, such as gpu.advance, not 3": dict(backend=3),
    "push_off must not be negative": dict(push_off=[0.0, -1e-9]),
    r"hip_torque \(3,\).*do not fit together": dict(hip_torque=np.zeros(3), push_off=np.ones(2)),
    "hip_torque": dict(hip_torque="strong"),
    "ankle_torque needs point feet: .*foot_radius of this walker is 0.2": dict(ankle_torque=0.1),
}


@pytest.mark.parametrize("message", REFUSED)
def test_a_wrong_argument_of_a_stride_is_named(message):
    with pytest.raises(ValueError, match=message):
        stride("lab", 0.036, find_gait("lab", 0.036).state, **REFUSED[message])


def test_actuation_in_other_units_and_of_single_numbers():
    walker = gpw.Walker(**{**{f: getattr(WALKER, f) for f in vars(WALKER) if f != "title"},
                           "gravity": 3.0, "hip_mass": 2.0})  # fmt: skip
    units, weight, length = walker.units, 3.0 * 3.0, 1.0
    scaled = to_dimensionless(units, Actuation(1.0, 2.0, 3.0))
    expected = (1.0 / weight / length, 2.0 / weight / length, 3.0 / (3.0 * np.sqrt(3.0)))
    np.testing.assert_allclose(scaled, expected)
    np.testing.assert_allclose(to_own(units, scaled), (1.0, 2.0, 3.0))
    simplest = to_dimensionless(WALKERS["D"].units, Actuation(1.0, 0.0, 0.0))
    assert simplest.hip_torque == pytest.approx(1.0 / 9.81)
    with pytest.raises(ValueError, match="of single numbers"):
        one_actuation(WALKER, Actuation(hip_torque=np.zeros(2)))
    for part in PARTS:
        held = Actuation(**{part: 0.1})
        assert not held.passive and not Actuation(**{part: np.array([0.0, 0.1])}).passive
        assert held.using == (() if part == "hip_torque" else ("ankle", "push_off"))
    assert Actuation().passive and Actuation(np.zeros(2), 0.0, 0.0).passive


FIELDS = [name for name in Stride._fields if name != "walker"]


def test_many_strides_are_those_of_each_walker_alone_in_every_field(gait):
    """Slopes, motors and footholds are each walker's own."""
    close = partial(np.testing.assert_allclose, rtol=1e-9, atol=1e-12)  # of equations with steps
    states = gait.state * np.array([1.0, 1.01, 0.99, 1.02])[:, None]
    own = dict(
        slope=[0.01, 0.011, 0.012, 0.0], hip_torque=[0.02, 0.0, -0.01, 0.03],
        ankle_torque=[0.0, -0.01, 0.01, 0.0], push_off=[0.05, 0.04, 0.0, 0.06],
        height_change=[0.0, -0.001, 0.0, 0.001], slope_change=[0.0, 0.001, -0.001, 0.0],
    )  # fmt: skip
    many = stride(WALKER, state=states, **own)
    table = many.columns()
    for i, state in enumerate(states):
        one = stride(WALKER, state=state, **{name: values[i] for name, values in own.items()})
        for name in FIELDS:
            close(getattr(many, name)[i], getattr(one, name), err_msg=name)
        for name in FIELDS[1:]:
            np.testing.assert_array_equal(table[name][i], getattr(many, name)[i], name)
        np.testing.assert_array_equal([table[x][i] for x in list(table)[:6]], many.state[i])
    singles = [
        stride(WALKER, state=state, **{name: values[i] for name, values in own.items()})
        for i, state in enumerate(states)
    ]
    joined = together(singles)
    for name in FIELDS:
        close(getattr(joined, name), getattr(many, name), err_msg=name)
    assert joined.weight == many.weight == pytest.approx(9.81 * WALKER.total_mass)


def test_a_stride_s_facts_are_its_energies():
    springy = gpw.Walker(**{**{f: getattr(WALKER, f) for f in vars(WALKER) if f != "title"},
                            "hip_stiffness": 0.02, "hip_friction": 0.001})  # fmt: skip
    one = stride(springy, 0.012, find_gait(springy, 0.012).state, hip_torque=0.01)
    distance = 9.81 * springy.total_mass * one.step_length
    spent = one.gravity_work + one.hip_work_absolute
    facts = one.facts()
    assert facts.pop("ends") == "heelstrike"
    numbers = {name: float(said.split(" ")[0]) for name, said in facts.items()}
    units = springy.units
    assert numbers == pytest.approx({
        "duration": one.duration / units.time, "step length": one.step_length / units.length,
        "cost of transport": spent / distance, "gravity work": one.gravity_work / units.energy,
        "hip work": one.hip_work / units.energy, "kneestrike loss": 0.0,
        "heelstrike loss": one.heelstrike_loss / units.energy,
        "spring work": one.spring_work / units.energy,
        "friction loss": one.friction_loss / units.energy,
    }, rel=1e-5)  # fmt: skip
    plain = stride(WALKER, 0.01, find_gait(WALKER, 0.01).state)
    assert "spring work" not in plain.facts() and "friction loss" not in plain.facts()
    fall = stride(WALKER, 0.01, [0.3, -0.3, -0.3, -0.1, 0.0, 0.0])
    assert fall.facts()["ends"] == "fell backward" and np.isnan(fall.step_length)


def test_states_that_are_given_do_not_change(gait):
    state = np.array(gait.state)
    state.flags.writeable = False
    for analysis in ANALYSES:
        analysis(gait, None, state)
    np.testing.assert_array_equal(state, gait.state)
    found = gpw.largest_push(gait, strides=2)
    assert found == gpw.largest_push(gait, strides=2)
    np.testing.assert_array_equal(state, gait.state)
