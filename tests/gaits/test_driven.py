"""Gaits and families under motors that do the same in every stride."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gym_passive_walker import (
    WALKERS,
    Actuation,
    GaitNotFound,
    find_gait,
    find_gaits,
    gait_family,
    parameter_family,
    stride,
    stride_map,
)
from gym_passive_walker.gaits.branches.continuation import LOST, TANGENTIAL
from gym_passive_walker.gaits.control.feedback import powered_gait

LEVEL = {
    "A": Actuation(push_off=0.05), "C": Actuation(push_off=0.05), "E": Actuation(ankle_torque=0.01),
    "D": Actuation(ankle_torque=0.01), "F": Actuation(push_off=0.05),
    "B": Actuation(hip_torque=0.01),
}  # fmt: skip


def own(name: str, drive: Actuation) -> Actuation:
    """A dimensionless drive in a walker's own units."""
    units = WALKERS[name].units
    scale = (units.torque, units.energy, units.impulse)
    return Actuation(*(part * unit for part, unit in zip(drive, scale, strict=True)))


@pytest.mark.parametrize("name", LEVEL)
def test_on_level_ground_motors_pay_for_what_strikes_lose(name):
    gait = find_gaits(stride_map(name, 0.0, controller=own(name, LEVEL[name])))[0]
    walk, units = gait.stride, gait.walker.units
    np.testing.assert_allclose(walk.state, gait.state, rtol=1e-10)
    paid = walk.hip_work + walk.ankle_work + walk.push_off_work
    assert paid / units.energy == pytest.approx(gait.collision_loss / units.energy, abs=1e-14)
    assert paid > 0.0


@pytest.mark.parametrize("name", ["A", "D"])
def test_a_drive_that_does_nothing_leaves_the_passive_gait(name):
    slope = 0.009
    passive, driven = (
        find_gait(stride_map(name, slope, controller=d))
        for d in (Actuation(), Actuation(0.0, 0.0, 0.0))
    )
    np.testing.assert_array_equal(passive.state, driven.state)
    assert driven.controller is None


@pytest.mark.parametrize(
    ("torque", "steepest", "end"), [(0.02, -0.0180160, TANGENTIAL), (0.05, -0.0418362, LOST)]
)
def test_a_family_climbs_as_steep_as_its_torque_allows_and_turns_back_there(torque, steepest, end):
    family = gait_family(
        stride_map("C", controller=own("C", Actuation(hip_torque=torque))), -0.05, 0.01
    )
    assert family.folds[0] == pytest.approx(steepest, abs=1e-6)
    assert family.slope.min() == pytest.approx(steepest, abs=1e-5)
    assert family.ends[0].reason.startswith(end)
    assert family.controller.hip_torque > 0.0
    # It is the same curve as is found at one slope alone.
    near = find_gait(stride_map("C", -0.01, controller=family.controller))
    upper = (family.slope > -0.0175) & (family.stance_angle > 0.12)  # this side of the fold
    expected = np.interp(-0.01, family.slope[upper], family.stance_angle[upper])
    assert near.stance_angle == pytest.approx(expected, rel=1e-2)


def test_walkers_push_off_from_soft_to_hard():
    """On level ground, with Kuo's spring: harder pushes make longer steps."""
    walker = replace(WALKERS["D"], hip_stiffness=2.5127 * 9.81)
    unit = walker.units.impulse
    family = parameter_family(
        stride_map(walker, controller=Actuation(push_off=0.1877 * unit)),
        "push_off",
        0.1 * unit,
        0.3 * unit,
        slope=0.0,
    )
    assert np.all(np.diff(family.stance_angle) >= 0.0)
    ends = family.value[[0, -1]] / unit
    np.testing.assert_allclose(ends, [0.1, 0.3], rtol=1e-12)
    for push, angle, state in zip(
        family.value[::6], family.stance_angle[::6], family.state[::6], strict=True
    ):
        speed = -state[3] * walker.time_unit
        assert push / unit == pytest.approx(speed * np.tan(angle), abs=1e-12)
        again = stride(walker, 0.0, state, push_off=push, tolerance=1e-12)
        np.testing.assert_allclose(again.state, state, rtol=1e-9)


def test_a_torque_family_begins_with_the_passive_gait():
    units = WALKERS["C"].units
    family = parameter_family("C", "hip_torque", 0.0, 0.05 * units.torque, slope=0.03)
    assert family.value[0] == 0.0
    assert family.stance_angle[0] == pytest.approx(find_gait("C", 0.03).stance_angle, rel=1e-9)
    assert family.stance_angle[-1] > family.stance_angle[0]


def test_a_powered_gait_is_found_where_the_way_to_it_is_lost():
    """Walker C climbs 0.018 rad; followed from downhill it got lost at 0.006."""
    for slope in (-0.006, -0.015):
        gait = powered_gait(WALKERS["C"], slope)
        np.testing.assert_allclose(stride(gait).state, gait.state, rtol=1e-8)
        assert gait.controller.hip_torque > 0.0


def test_a_slope_that_is_too_steep_to_climb_raises_an_error():
    with pytest.raises(GaitNotFound, match="under Actuation"):
        find_gait(stride_map("C", -0.1, controller=own("C", Actuation(hip_torque=0.01))))
    with pytest.raises(ValueError, match="only motors"):
        gait_family("C", -0.01, 0.01)
    with pytest.raises(ValueError, match="one Actuation, of single numbers"):
        find_gait(stride_map("C", 0.01, controller=Actuation(hip_torque=[0.1, 0.2])))


@pytest.mark.parametrize("period", [1, 2])
@pytest.mark.parametrize("name", ["B", "D", "E", "F"])
def test_what_is_found_under_a_push_off_steps_and_repeats(name, period):
    """Legs that hardly open lose at each strike what the push-off gives, and walk nowhere."""
    units = WALKERS[name].units
    for push in (0.001, 0.01, 0.05, 0.2):
        for gait in find_gaits(
            stride_map(name, 0.0, controller=Actuation(push_off=push)), period=period
        ):
            assert gait.stance_angle > 0.1 * np.sqrt(push / units.impulse)
            assert gait.cost_of_transport < 0.01
            end = gait.stride.state
            if period == 2:
                end = stride(name, 0.0, end, push_off=push, tolerance=1e-13).state
            scale = np.abs(gait.state).max()
            np.testing.assert_allclose(end / scale, gait.state / scale, atol=1e-11)


def test_a_guess_with_legs_together_leads_to_no_gait():
    drive = Actuation(push_off=0.05)
    gait = find_gaits(stride_map("B", 0.0, controller=drive))[0]
    for shrunk in (1e-3, 1e-5, 1e-7):
        state = gait.state * shrunk
        assert all(
            g.stance_angle > 0.01
            for g in find_gaits(stride_map("B", 0.0, controller=drive), guess=state)
        )
    with pytest.raises(GaitNotFound, match="only a long-step gait"):
        find_gait(stride_map("B", 0.0, controller=drive), None, "short")


@pytest.mark.parametrize(
    ("name", "slope", "push", "count"),
    [("F", -0.0005, 0.5, 2), ("A", -8e-5, 0.1, 2), ("C", -0.001, 0.5, 2), ("E", -4.8e-5, 0.1, 4)],
)
def test_push_offs_carry_uphill_as_far_as_the_family_goes(name, slope, push, count):
    drive = Actuation(push_off=push)
    gaits = find_gaits(stride_map(name, slope, controller=drive))
    assert len(gaits) == count
    family = gait_family(stride_map(name, controller=drive), -0.05, 0.02)
    assert family.slope.min() < slope
    same = gait_family(name, -0.05, 0.02, start=gaits[0])
    assert same.folds[0] == pytest.approx(family.folds[0], rel=1e-6)
    for gait in gaits:
        assert gait.stride.push_off_work > gait.collision_loss


def test_a_family_ends_on_the_level_where_its_steps_vanish():
    """Uphill, the shortest steps are as long as the slope is steep."""
    family = gait_family(stride_map("B", controller=Actuation(push_off=0.1)), -0.05, 0.02)
    assert family.ends[0].reason == "the step length goes to zero"
    assert family.ends[0].value == pytest.approx(0.0, abs=1e-12)
    ratio = family.stance_angle[:3] / family.slope[:3]
    np.testing.assert_allclose(ratio, ratio[0], rtol=1e-2)


@pytest.mark.parametrize("push", [-1e-9, -0.02, [0.02, -0.02], np.array(-0.02)], ids=str)
@pytest.mark.parametrize("name", ["lab", "D"])
def test_a_push_off_that_pulls_is_refused_however_it_is_given(name, push):
    state = find_gait(name, 0.009 if name == "D" else 0.036).state
    with pytest.raises(ValueError, match="push_off must not be negative"):
        stride(name, 0.02, state, push_off=push)
    with pytest.raises(ValueError, match="push_off must not be negative"):
        stride_map(name, 0.02, controller=Actuation(push_off=push))
