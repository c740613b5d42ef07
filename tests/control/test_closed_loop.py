"""What a policy does to the walker: its gait, its multipliers, its costs and its basin."""

import numpy as np
import pytest

import gym_passive_walker as gpw
from gym_passive_walker import closed_loop_gait
from gym_passive_walker.gaits.actuation import to_own
from gym_passive_walker.gaits.control.baselines import (
    ConstantTorque,
    LinearFeedback,
    Optimal,
    Passive,
)
from tests.control.in_environment import COSTS, walked


def test_without_a_motor_it_is_the_passive_gait():
    closed, passive = closed_loop_gait(Passive(), "lab"), gpw.find_gait("lab", 0.036)
    np.testing.assert_allclose(closed.state, passive.state, rtol=1e-9)
    assert np.abs(closed.multipliers) == pytest.approx(np.abs(passive.multipliers), abs=1e-4)
    assert closed.cost_of_transport == pytest.approx(np.sin(0.036), rel=1e-9)
    assert closed.hip_cost == 0.0 and closed.stable


@pytest.mark.parametrize("scene", ["steep", "level"])
def test_feedback_has_the_multipliers_that_it_was_designed_for(scene):
    policy = LinearFeedback(scene)
    closed = closed_loop_gait(policy, scene)
    assert closed.stride_map.exact
    designed = np.sort(np.abs(np.linalg.eigvals(policy.closed_loop)))[::-1]
    assert np.abs(closed.multipliers) == pytest.approx(designed, abs=1e-7)


@pytest.mark.parametrize("name", ["lqr", "optimal"])
def test_feedback_is_made_for_the_scene_without_its_disturbances(name):
    scene = {} if name == "optimal" else {"slope": 0.02, "control": "stride"}
    drawn = {"domain_randomization": {"max_hip_torque": 0.2}}
    plain, calmed = (closed_loop_gait(name, {**scene, **more}) for more in ({}, drawn))
    assert calmed.multipliers.tobytes() == plain.multipliers.tobytes()


def test_an_unstable_gait_is_found_near_its_start():
    closed = closed_loop_gait(Passive(), "steep")
    assert not closed.stable
    assert abs(closed.multipliers[0]) == pytest.approx(2.21, abs=0.01)


def test_on_level_ground_the_motor_pays_for_everything():
    closed = closed_loop_gait(ConstantTorque(0.0025, "level"), "level")
    assert closed.gravity_cost == pytest.approx(0.0, abs=1e-12)
    assert closed.cost_of_transport == pytest.approx(closed.hip_cost)
    assert closed.net_hip_cost < closed.positive_hip_cost < closed.hip_cost
    assert closed.hip_cost == pytest.approx(0.0051, abs=1e-4)
    assert closed.net_hip_cost * closed.stride.weight * closed.step_length == pytest.approx(
        closed.collision_loss, rel=1e-9
    )


@pytest.mark.parametrize("name", ["level-ppo", "push-off-ppo", "rough-ppo", "lab-ppo"])
def test_what_a_gait_costs_is_what_the_environment_says(name):
    gait = gpw.find_gait(gpw.stride_map(controller=name))
    strides, units = gait.stride_map, gait.walker.units
    seen = walked(strides, strides.points_at(gait.state))
    assert seen.length[0] * units.length == pytest.approx(gait.step_length, rel=1e-5)
    assert seen.duration[0] * units.time == pytest.approx(gait.step_period, rel=1e-5)
    for cost in COSTS:
        in_environment = seen.works[cost][0] / seen.length[0]
        if strides.scene.energy == "absolute" or not cost.endswith("hip_cost"):
            assert getattr(gait, cost) == pytest.approx(in_environment, rel=2e-4, abs=1e-7), cost
    assert gait.motor_cost > 1e-3


def test_feedback_widens_the_basin_of_a_gait():
    """Of starts beside the gait, those from which the walker makes a hundred strides."""
    areas = []
    for policy in (Passive(), LinearFeedback("steep")):
        strides = gpw.stride_map(controller=policy, scene="steep")
        areas.append(gpw.basin_of_attraction(strides, resolution=24, strides=100).walks.mean())
    assert areas[0] < 0.01 < areas[1]


def test_a_cell_of_a_basin_says_what_walking_from_it_does():
    """Rows are rates and columns angles; in the environment as on the map."""
    strides = gpw.stride_map(controller=LinearFeedback("steep"), scene="steep")
    basin = gpw.basin_of_attraction(strides, resolution=20, ratios=(0.14, 0.14), strides=6)
    assert not np.array_equal(basin.walks, basin.walks.T)
    units = strides.walker.units
    for row, rate in zip(basin.walks, basin.stance_rate * units.time, strict=True):
        points = np.column_stack([basin.stance_angle, *np.full((3, 20), rate)])
        points[:, 2:] *= 0.14
        ends = walked(strides, points, 6).ends
        settled = basin.strides[np.flatnonzero(basin.stance_rate * units.time == rate)[0]] < 6
        walks = np.isfinite(ends).all(axis=1)
        np.testing.assert_array_equal(row[~(settled & row)], walks[~(settled & row)])


def test_a_gait_of_two_strides_is_the_passive_gait_of_two_strides():
    passive = gpw.find_gait("D", 0.016, period=2)
    scene = {"walker": "D", "slope": 0.016}
    closed = closed_loop_gait(Passive(), scene, period=2, guess=passive.state)
    np.testing.assert_allclose(closed.step_length, passive.step_length, rtol=1e-9)
    np.testing.assert_allclose(closed.step_period, passive.step_period, rtol=1e-9)
    known = np.sort(np.abs(passive.multipliers))
    np.testing.assert_allclose(np.sort(np.abs(closed.multipliers)), known, rtol=2e-2, atol=1e-3)
    assert closed.cost_of_transport == pytest.approx(np.sin(0.016), rel=1e-9)
    assert closed.stable and closed.period == 2


def test_a_gait_over_a_range_of_slopes_is_that_of_its_middle():
    closed = closed_loop_gait(LinearFeedback("rolling"), "rolling")
    assert closed.slope == pytest.approx(0.03) and closed.stable
    assert closed.cost_of_transport == pytest.approx(np.sin(0.03), rel=1e-3)


def test_what_a_gait_costs_does_not_hang_on_what_its_motor_is_charged_for():
    policy = ConstantTorque(0.0025, "level")
    absolute, net = (closed_loop_gait(policy, {"energy": energy}) for energy in ("absolute", "net"))
    assert net.hip_cost == absolute.hip_cost > net.net_hip_cost == absolute.net_hip_cost


def test_a_simulation_tells_the_torque_of_each_tick():
    policy = Optimal("level")
    closed = closed_loop_gait(policy, "level")
    walk, units = gpw.simulate(closed, samples=200), closed.walker.units
    held = policy.gait.controller.hip_torque
    for time, torque in zip(walk.times[1:] / units.time, walk.torques[1:, 0], strict=True):
        ticks = time / closed.stride_map.hold  # the last one reaches to the heelstrike
        tick = min(int(np.ceil(ticks - 1e-9)), len(held)) - 1
        assert torque == pytest.approx(held[tick], abs=1e-9 * units.torque)
    assert len(np.unique(walk.torques[:, 0])) > 10
    first, last = walk.states[0], walk.states[-1]
    assert last[[1, 0]] == pytest.approx(first[:2], abs=1e-6)


class Held:
    """What does the same all along, as shares of the largest torques and push-off."""

    name = "held"

    def __init__(self, *shares: float) -> None:
        self.shares = np.array(shares, np.float32)

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        """The same for each."""
        return np.tile(self.shares, (len(observation), 1)), state


@pytest.mark.parametrize(
    ("name", "motors"),
    [
        ("F", gpw.Actuation(push_off=0.05)),
        ("D", gpw.Actuation(ankle_torque=0.01)),
        ("E", gpw.Actuation(hip_torque=0.004, ankle_torque=0.002, push_off=0.02)),
    ],
)
def test_every_motor_pays_its_part(name, motors):
    """Held by a policy, actions have the costs of an `Actuation`, for which they are known."""
    units = gpw.WALKERS[name].units
    gait = gpw.find_gait(gpw.stride_map(name, 0.0, controller=to_own(units, motors)))
    scene = {
        "walker": name, "slope": 0.0, "control": "stride", "energy": "net",
        "actions": ("ankle", "push_off", "hip"), "max_hip_torque": 0.02,
        "max_ankle_torque": 0.02, "max_push_off": 0.1,
    }  # fmt: skip
    policy = Held(motors.ankle_torque / 0.02, motors.push_off / 0.1, motors.hip_torque / 0.02)
    closed = closed_loop_gait(policy, scene, guess=gait.state)
    for cost in COSTS:
        of_held = getattr(gait, cost)
        assert getattr(closed, cost) == pytest.approx(of_held, rel=1e-4, abs=1e-9), cost
    assert closed.cost_of_transport == pytest.approx(closed.motor_cost + closed.gravity_cost)
    assert closed.cost_of_transport == pytest.approx(gait.cost_of_transport, rel=1e-4)
    walk = gpw.simulate(closed)
    own = to_own(units, motors)
    np.testing.assert_allclose(walk.torques[:, 0], own.hip_torque, atol=1e-8 * units.torque)
    np.testing.assert_allclose(walk.torques[:, 1], own.ankle_torque, atol=1e-8 * units.energy)


def test_legs_together_are_no_gait():
    """A stride as small as rounding closes whatever the policy does."""
    scene = {"walker": "B", "slope": 0.0, "control": "stride", "actions": ("push_off",)}
    state = gpw.find_gait("B", 0.01).state
    with pytest.raises(gpw.GaitNotFound, match="guess near the gait"):
        closed_loop_gait(Held(0.5), scene, guess=1e-6 * state)


def test_a_walker_that_only_falls_has_no_gait():
    with pytest.raises(gpw.GaitNotFound, match="under constant torque"):
        closed_loop_gait(ConstantTorque(-0.05, "level"), "level")


def test_a_schedule_of_torques_plays_an_optimal_gait():
    """Without feedback its gait is the optimum's, and its multipliers are those kept there."""
    optimum = gpw.optimal_gait("level", 0.16)
    gait = gpw.find_gait(gpw.stride_map(controller=optimum, scene="level"))
    np.testing.assert_allclose(gait.point.values, optimum.point.values, atol=1e-8)
    assert gait.cost_of_transport == pytest.approx(optimum.cost_of_transport, rel=1e-7)
    assert np.abs(gait.multipliers) == pytest.approx(np.abs(optimum.multipliers), abs=1e-5)
    with pytest.raises(ValueError, match="in which scene"):
        gpw.stride_map(controller=optimum)


def test_errors_of_multipliers_by_differences_are_estimated():
    policy = gpw.load_policy("level-ppo")

    class Outside:
        """The same policy as an object that has no derivative."""

        predict = policy.predict

    def double(observations):
        return policy.linearize(observations)[0]

    exact = gpw.find_gait(gpw.stride_map(controller=policy))
    assert exact.multipliers_error == 0.0 and "±" not in str(exact)
    for controller, least, most in ((Outside(), 1e-4, 0.1), (double, 1e-12, 1e-7)):
        gait = gpw.find_gait(gpw.stride_map(controller=controller, scene=policy.scene))
        off = np.abs(np.abs(gait.multipliers) - np.abs(exact.multipliers)).max()
        assert least < gait.multipliers_error < most
        assert off < 3.0 * gait.multipliers_error
        assert f"± {gait.multipliers_error:.0e}" in str(gait)
