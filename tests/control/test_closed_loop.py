"""What a policy does to the walker."""

import numpy as np
import pytest

import agents
import gym_passive_walker as gpw
from gym_passive_walker.control.baselines import (
    ConstantTorque,
    LinearFeedback,
    Optimal,
    Passive,
)
from gym_passive_walker.control.closed_loop import closed_loop_gait, policy_strides
from gym_passive_walker.gaits.drive import to_own
from gym_passive_walker.gaits.section import Section
from gym_passive_walker.units import units_of


def test_without_a_motor_it_is_the_passive_gait():
    closed, passive = closed_loop_gait(Passive(), "lab"), gpw.find_gait("lab", 0.036)
    assert closed.speed == pytest.approx(passive.froude_speed, rel=1e-6)
    assert np.abs(closed.multipliers) == pytest.approx(np.abs(passive.multipliers), abs=1e-4)
    assert closed.cost_of_transport == pytest.approx(np.sin(0.036), rel=1e-5)
    assert closed.hip_cost == 0.0 and closed.stable


@pytest.mark.parametrize("scene", ["steep", "level"])
def test_feedback_has_the_multipliers_that_it_was_designed_for(scene):
    policy = LinearFeedback(scene)
    closed = closed_loop_gait(policy, scene)
    designed = np.sort(np.abs(np.linalg.eigvals(policy.closed_loop)))[::-1]
    assert np.abs(closed.multipliers) == pytest.approx(designed, abs=2e-3)


def test_an_unstable_gait_is_found_near_its_start():
    closed = closed_loop_gait(Passive(), "steep")
    assert not closed.stable
    assert abs(closed.multipliers[0]) == pytest.approx(2.21, abs=0.01)


def test_on_level_ground_the_motor_pays_for_everything():
    closed = closed_loop_gait(ConstantTorque(0.0025, "level"), "level")
    assert closed.gravity_cost == pytest.approx(0.0, abs=1e-8)
    assert closed.cost_of_transport == pytest.approx(closed.hip_cost)
    assert closed.net_hip_cost < closed.positive_hip_cost < closed.hip_cost
    assert closed.hip_cost == pytest.approx(0.0051, abs=1e-4)
    assert closed.torques == pytest.approx(0.0025)


def test_the_portrait_goes_from_heelstrike_to_heelstrike():
    closed = closed_loop_gait(Passive(), "lab")
    assert closed.times[0] == 0.0
    assert closed.times[-1] == pytest.approx(closed.step_period)
    first, last = closed.states[0], closed.states[-1]
    assert first[0] == -first[1] == pytest.approx(-last[0], abs=1e-6)
    assert last[1] == pytest.approx(first[0], abs=1e-6)


def test_feedback_widens_the_basin_of_a_gait():
    areas = [
        closed_loop_gait(policy, "steep").basin(resolution=24, reach=1.5).survived.mean()
        for policy in (Passive(), LinearFeedback("steep"))
    ]
    assert areas[0] < 0.01 < areas[1]


def test_a_cell_of_a_basin_says_what_walking_from_it_does():
    """Rows are rates and columns angles; the swing leg's rates go with the stance leg's."""
    policy = LinearFeedback("steep")
    gait = closed_loop_gait(policy, "steep")
    basin = gait.basin(resolution=20, reach=1.4, strides=6)
    assert not np.array_equal(basin.survived, basin.survived.T)
    for row, rate in zip(basin.survived, basin.stance_rates, strict=True):
        points = np.tile(gait.point * rate / gait.point[1], (20, 1))
        points[:, 0] = basin.stance_angles
        ends = policy_strides(policy, gait.scene, gait.slope, points, 6).ends
        np.testing.assert_array_equal(row, np.isfinite(ends).all(axis=1))


def test_a_gait_of_two_strides_is_the_passive_gait_of_two_strides():
    passive = gpw.find_gait("D", 0.016, period=2)
    units = units_of(passive.walker)
    start = Section(walker=passive.walker).points_at(passive.state)[0]
    scene = {"walker": "D", "slope": 0.016}
    closed = closed_loop_gait(Passive(), scene, period=2, start=start)
    assert closed.step_length * units.length == pytest.approx(passive.step_length, rel=1e-6)
    assert closed.step_period * units.time == pytest.approx(passive.step_period, rel=1e-6)
    known = np.sort(np.abs(passive.multipliers))
    np.testing.assert_allclose(np.sort(np.abs(closed.multipliers)), known, rtol=2e-2, atol=1e-3)
    assert closed.speed == pytest.approx(passive.froude_speed, rel=1e-6)
    assert closed.cost_of_transport == pytest.approx(np.sin(0.016), rel=1e-5)
    assert closed.stable


def test_a_gait_over_a_range_of_slopes_is_that_of_its_middle():
    closed = closed_loop_gait(LinearFeedback("rolling"), "rolling")
    assert closed.slope == pytest.approx(0.03) and closed.stable
    assert closed.cost_of_transport == pytest.approx(np.sin(0.03), rel=1e-3)


def test_what_a_gait_costs_does_not_hang_on_what_its_motor_is_charged_for():
    policy = ConstantTorque(0.0025, "level")
    absolute, net = (closed_loop_gait(policy, {"energy": energy}) for energy in ("absolute", "net"))
    assert net.hip_cost == absolute.hip_cost > net.net_hip_cost == absolute.net_hip_cost


def test_the_portrait_tells_the_torque_of_each_tick():
    policy = Optimal("level")
    closed = closed_loop_gait(policy, "level")
    for time, torque in zip(closed.times[1:], closed.torques[1:], strict=True):
        ticks = time / closed.scene.tick  # the last one reaches to the heelstrike
        tick = min(int(np.ceil(ticks - 1e-9)), len(policy.gait.torques)) - 1
        assert torque == pytest.approx(policy.gait.torques[tick], abs=2e-4)
    assert len(np.unique(closed.torques)) > 10
    first, last = closed.states[0], closed.states[-1]
    assert last[[1, 0]] == pytest.approx(first[:2], abs=1e-5)


class Held:
    """What does the same all along, as shares of the largest torques and push-off."""

    name = "held"

    def __init__(self, *shares: float) -> None:
        self.shares = np.array(shares, np.float32)

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        """The same for each."""
        return np.tile(self.shares, (len(observation), 1)), state


@pytest.mark.parametrize(
    ("name", "drive"),
    [
        ("F", gpw.Drive(push_off=0.05)),
        ("D", gpw.Drive(ankle_torque=0.01)),
        ("E", gpw.Drive(hip_torque=0.004, ankle_torque=0.002, push_off=0.02)),
    ],
)
def test_every_motor_pays_its_part(name, drive):
    """Held all along, they are a driven gait's, whose books are known."""
    units = units_of(gpw.WALKERS[name])
    own = to_own(units, drive)
    gait = gpw.find_gait(name, 0.0, drive=own)
    scene = {
        "walker": name, "slope": 0.0, "control": "stride", "energy": "net",
        "actions": ("ankle", "push_off", "hip"), "max_hip_torque": 0.02,
        "max_ankle_torque": 0.02, "max_push_off": 0.1,
    }  # fmt: skip
    policy = Held(drive.ankle_torque / 0.02, drive.push_off / 0.1, drive.hip_torque / 0.02)
    start = Section(walker=gait.walker).points_at(gait.state)[0]
    closed = closed_loop_gait(policy, scene, start=start)
    walk, work = gait.stride, units.energy * gait.step_length / units.length
    paid = {
        "hip_cost": walk.hip_work_absolute, "net_hip_cost": walk.hip_work,
        "ankle_cost": walk.ankle_work_absolute, "net_ankle_cost": walk.ankle_work,
        "push_off_cost": walk.push_off_work,
    }  # fmt: skip
    for cost, of_stride in paid.items():
        assert getattr(closed, cost) == pytest.approx(float(of_stride) / work, rel=1e-4, abs=1e-9)
    motors = closed.hip_cost + closed.ankle_cost + closed.push_off_cost
    assert closed.cost_of_transport == pytest.approx(motors + closed.gravity_cost)
    assert closed.cost_of_transport > 1e-3
    np.testing.assert_allclose(closed.torques, drive.hip_torque, atol=1e-8)
    np.testing.assert_allclose(closed.ankle_torques, drive.ankle_torque, atol=1e-8)
    first, last = closed.states[0], closed.states[-1]
    assert last[[1, 0]] == pytest.approx(first[:2], abs=1e-5)


def test_legs_together_are_no_gait():
    """A stride as small as rounding closes whatever the policy does."""
    scene = {"walker": "B", "slope": 0.0, "control": "stride", "actions": ("push_off",)}
    gait = gpw.find_gait("B", 0.01)
    point = Section(walker=gait.walker).points_at(gait.state)[0]
    with pytest.raises(gpw.GaitNotFound, match="longer steps"):
        closed_loop_gait(Held(0.5), scene, start=1e-6 * point)


def test_a_walker_that_only_falls_has_no_gait():
    with pytest.raises(gpw.GaitNotFound, match="constant torque"):
        closed_loop_gait(ConstantTorque(-0.05, "level"), "level")


def test_the_package_and_its_agents_tell_the_same_gait():
    assert agents.closed_loop_gait is gpw.closed_loop_gait is closed_loop_gait


def test_periods_are_positive():
    with pytest.raises(ValueError, match="period must be a whole number from 1 on"):
        closed_loop_gait(Passive(), "lab", period=0)
