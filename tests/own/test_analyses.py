"""Analyses of a user's own system are those of the walker that it states."""

import math
from dataclasses import replace

import numpy as np
import pytest

import gym_passive_walker as gpw
from examples.rimless_wheel import RIMLESS_WHEEL
from examples.unequal_legs import PROSTHESIS, UNEQUAL_LEGS
from tests.own.statements import COMPASS, DRIVEN, STRAIGHT, Legs

SLOPE = 0.03
HEAVY = replace(DRIVEN, name="heavy", body=Legs(*(3.0 * x for x in DRIVEN.body)))


def test_the_largest_push_is_a_change_of_the_stance_leg_s_rate():
    found, expected = (
        gpw.largest_push(walker, SLOPE, accuracy=1e-4) for walker in (COMPASS, STRAIGHT)
    )
    units = gpw.as_walker(STRAIGHT).units
    assert found.forward == pytest.approx(expected.forward * units.time, rel=1e-3)
    assert found.backward == pytest.approx(expected.backward * units.time, rel=1e-3)


@pytest.mark.parametrize("controller", [None, {"hip": 0.01}])
def test_the_cost_of_a_family_is_over_weight(controller):
    def held(mass):
        return None if controller is None else {"hip": mass * controller["hip"]}

    light, heavy = (
        gpw.gait_family(gpw.stride_map(each, SLOPE, controller=held(mass)), 0.02, 0.04)
        for each, mass in ((DRIVEN, 1.0), (HEAVY, 3.0))
    )
    for family in (light, heavy):
        assert family.cost_of_transport[0] == pytest.approx(family[0].cost_of_transport, rel=1e-9)
    assert heavy.cost_of_transport[-1] == pytest.approx(light.cost_of_transport[-1], rel=1e-6)


@pytest.mark.parametrize("walker", [HEAVY, PROSTHESIS])
def test_gravity_supplies_what_a_gait_loses_whatever_its_weight(walker):
    strides = gpw.stride_map(walker, math.radians(3.0))
    point = gpw.find_gait(strides).point.values
    assert abs(strides.apply(point).imbalance[0]) < 1e-9
    name = next(iter(walker.parameters))
    by, value = strides.linearize(point, by=(name,))[1].supplied[0, 0], walker.parameters[name]
    shift = 1e-5 * value
    ends = [strides.with_walker(walker.vary(**{name: value + way * shift})) for way in (1, -1)]
    expected = np.subtract(*(end.apply(point).supplied[0] for end in ends)) / (2.0 * shift)
    assert by == pytest.approx(expected, rel=1e-5, abs=1e-8)


def test_a_wheel_settles_although_its_angle_never_changes():
    start = (math.pi / 8, -2.0)
    early, late = (
        gpw.bifurcation_diagram(
            RIMLESS_WHEEL, [0.08], start=start, n_transient=n, n_recorded=33
        ).period.tolist()
        for n in (0, 200)
    )
    assert (early, late) == ([0], [1])


def test_a_search_far_from_a_gait_says_that_there_is_none():
    """Without a start of its own the system is searched for at no other slope."""
    far = np.array([0.4, -0.4, -0.1, 0.1])
    with pytest.raises(gpw.GaitNotFound, match="give a guess near the gait"):
        gpw.find_gait(replace(UNEQUAL_LEGS, start=None), 0.05, guess=far)


def test_a_stride_under_a_controller_is_checked_and_repeated_as_one_without():
    strides = gpw.stride_map(DRIVEN, SLOPE, controller=lambda seen: 0.0 * seen[:, :1])
    state = gpw.find_gait(DRIVEN, SLOPE).state
    found, expected = (gpw.stride(each, [0.03, 0.031], state) for each in (strides, DRIVEN))
    np.testing.assert_allclose(found.duration, expected.duration, rtol=1e-9)
    with pytest.raises(ValueError, match="may differ in height, not in slope"):
        gpw.stride(strides, None, state, slope_change=0.1)
    with pytest.raises(ValueError, match="slope must be an angle"):
        gpw.stride(strides, 2.0, state)
