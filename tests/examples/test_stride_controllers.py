"""One decision a stride: what it does to a walker's speed, and how soon a gait is met again."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import gymnasium
import numpy as np
import pytest
from scipy.optimize import brentq

from examples import stride_controllers
from examples.stride_controllers import (
    ActuationFeedback,
    SpeedControl,
    kuo_gait,
    midstance_speed,
    placement,
    speed_of,
)
from gym_passive_walker import WALKERS, Actuation, Outcome, find_gait, stride, stride_map
from gym_passive_walker.envs.evaluation.walks import TIME_LIMIT, simulate_episodes
from gym_passive_walker.gaits.scenes.scene import make_scene
from gym_passive_walker.gaits.section import Section
from tests.instants import states_at

D = WALKERS["D"]
KUO = kuo_gait().walker
PUSH = 0.1877


def scene(walker, action, slope=0.0, **others):
    """A scene of strides with one action, or several."""
    return make_scene(walker=walker, slope=slope, control="stride", actions=action, **others)


def points_of(walker, states):
    """Dimensionless points of the section."""
    return Section(walker=walker).points_at(states)


def walk(policy, slopes, points, count):
    """Points of walkers under a policy after each of some strides, (count + 1, n, 3)."""
    walker, path = policy.scene.walker, [points]
    units, section = walker.units, Section(walker=walker)
    scale = {"hip_torque": units.torque, "push_off": units.impulse}
    for _ in range(count):
        chosen = policy.actuation(path[-1], slopes).T
        own = {
            part: scale[part] * values for part, values in zip(policy.parts, chosen, strict=True)
        }
        walked = stride(walker, slopes, section.states_at(path[-1]), tolerance=1e-13, **own)
        path.append(section.points_at(walked.state))
    return np.array(path)


def test_mid_stance_speed_is_the_hip_s_where_the_leg_stands_along_the_normal():
    gait = find_gait(D, 0.009)
    speed = midstance_speed(points_of(D, gait.state), 0.009)[0]
    times = np.linspace(0.0, 0.7 * gait.step_period, 2001)
    states, _ = states_at(D, 0.009, gait.state, times, tolerance=1e-13)
    passes = np.interp(0.0, -states[:, 0], -states[:, 3]) * D.units.time
    assert speed == pytest.approx(passes, rel=1e-6)
    assert np.isnan(midstance_speed(np.array([[0.3, -0.1, -0.1], [0.1, 0.5, 0.5]]), 0.0)).all()


def test_speed_keeps_with_the_push_off_v_tan_alpha():
    """Kuo's law on level ground: v is the speed before the strike, 2 alpha the legs' angle."""
    gait = kuo_gait()
    start = np.repeat(points_of(KUO, gait.state), 5, axis=0)
    start[:, 1] *= [0.9, 0.95, 1.0, 1.05, 1.1]
    for point in start:
        speed = midstance_speed(point[None], 0.0)
        policy = SpeedControl(scene(KUO, "push_off"), speed[0])
        path = walk(policy, 0.0, point[None], 1)
        assert midstance_speed(path[1], 0.0) == pytest.approx(speed, abs=1e-12)
        angle = path[1][:, 0]
        before = np.sqrt(speed**2 + 2.0 * (1.0 - np.cos(angle)))
        push = policy.actuation(point[None], 0.0)[:, 0]
        np.testing.assert_allclose(push, before * np.tan(angle), rtol=0.0, atol=1e-12)


def test_kuo_s_gait_is_what_speed_control_keeps():
    gait = kuo_gait()
    point = points_of(KUO, gait.state)
    policy = SpeedControl(scene(KUO, "push_off"), speed_of(gait))
    assert policy.actuation(point, 0.0)[0, 0] == pytest.approx(PUSH, abs=1e-12)


@pytest.mark.parametrize("stiffness", [0.0, 1.0, 2.5127, 6.0])
def test_the_spring_sets_the_period_of_small_steps(stiffness):
    """Linear legs on level ground: tan(w T/2) = -w (3 + 2 k) tanh(T/2), w the swing's frequency."""
    frequency = np.sqrt(1.0 + stiffness)

    def closes(time):
        half = 0.5 * time
        swing = frequency * (3.0 + 2.0 * stiffness) * np.tanh(half)
        return np.sin(frequency * half) + swing * np.cos(frequency * half)

    expected = brentq(closes, 1.01 * np.pi / frequency, 1.9 * np.pi / frequency)
    walker = replace(D, hip_stiffness=stiffness * D.gravity)
    units = walker.units
    near, far = (
        find_gait(
            stride_map(walker, 0.0, controller=Actuation(push_off=push * units.impulse))
        ).step_period
        / units.time
        for push in (1e-4, 4e-4)
    )
    # Corrections go with the square of the step, and that with the push-off.
    assert (4.0 * near - far) / 3.0 == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("decay", [0.0, 0.5])
@pytest.mark.parametrize("action", ["hip", "push_off"])
def test_deviations_of_the_speed_shrink_by_the_given_factor(action, decay):
    if action == "hip":
        walker, slope, most = D, 0.009, {"max_hip_torque": 1.0}
        gait = find_gait(walker, slope)
    else:
        walker, slope, most = KUO, 0.0, {"max_push_off": 0.5}
        gait = kuo_gait()
    point = points_of(walker, gait.state)
    speed = midstance_speed(point, slope)[0]
    policy = SpeedControl(scene(walker, action, slope, **most), speed, decay=decay)
    start = np.repeat(point, 3, axis=0)
    start[:, 1] *= [0.97, 1.02, 1.05]
    path = walk(policy, slope, start, 3)
    off = np.array([midstance_speed(points, slope) - speed for points in path])
    assert np.abs(off[0]).min() > 1e-3
    np.testing.assert_allclose(off[1:], decay * off[:-1], rtol=0.0, atol=1e-9)


def foot_placement(decay=0.0):
    """Bhounsule's and Zamani's law for the simplest walker at 0.009; and where its gait is."""
    point = points_of(D, find_gait(D, 0.009).state)
    speed = midstance_speed(point, 0.009)[0]
    return SpeedControl(scene(D, "hip", 0.009, max_hip_torque=2.0), speed, decay=decay), point


def survivors(policy, points, slopes):
    """How many walkers make a stride on each of some slopes, (strides, n); None: without motors."""
    section, going = Section(walker=D), np.arange(len(points))
    for slope in slopes:
        here = np.broadcast_to(slope, slopes.shape[1:])[going] if slopes.ndim > 1 else slope
        torque = 0.0 if policy is None else policy.actuation(points, here)[:, 0]
        walked = stride(D, here, section.states_at(points), hip_torque=torque * D.units.torque)
        on = walked.outcome == Outcome.HEELSTRIKE
        going, points = going[on], section.points_at(walked.state[on])
    return len(going)


def test_placing_the_foot_widens_the_basin_by_an_order_of_magnitude():
    policy, _ = foot_placement()
    angle, rate = np.meshgrid(np.linspace(0.01, 0.45, 50), np.linspace(-0.5, -0.01, 50))
    starts = np.stack([angle, rate, np.cos(2.0 * angle) * rate], axis=-1).reshape(-1, 3)
    slopes = np.full(12, 0.009)
    passive, held = survivors(None, starts, slopes), survivors(policy, starts, slopes)
    assert held > 10 * passive > 0


def test_placing_the_foot_carries_walkers_over_rough_ground():
    policy, point = foot_placement()
    slopes = np.random.default_rng(0).normal(0.009, 0.0014, (60, 20))
    starts = np.repeat(point, 20, axis=0)
    assert survivors(None, starts, slopes) < 10
    assert survivors(policy, starts, slopes) == 20


def test_the_quickest_answer_to_a_kick_takes_the_least_work():
    works = []
    for decay in (0.0, 0.3, 0.6):
        policy, point = foot_placement(decay)
        start = np.repeat(point, 3, axis=0)
        start[:, 1:] *= np.array([[0.97], [1.05], [1.1]])
        path, work = walk(policy, 0.009, start, 30), 0.0
        for points, after in pairwise(path):
            # The hip opens from two of one angle behind to two of the next in front.
            work = work + abs(policy.actuation(points, 0.009)[:, 0]) * (points[:, 0] + after[:, 0])
        works.append(work)
    assert np.all(np.diff(works, axis=0) > 0.0)


def test_a_foot_lands_where_the_next_speed_wants_it():
    """The place is found from energies alone; where no step is quick enough, it is the best."""
    policy, point = foot_placement()
    angle = placement(np.array([policy.speed]), policy.speed, 0.009)[0]
    assert angle == pytest.approx(point[0, 0], abs=1e-11)
    quick = placement(np.full(3, policy.speed), np.array([0.08, 0.2, 0.3]), 0.009)
    assert quick[0] < angle
    assert quick[1] == quick[2]  # out of reach: as quick as can be


@pytest.mark.parametrize(
    ("actions", "strides"), [(("push_off",), 2), ("hip", 2), (("hip", "push_off"), 1)]
)
def test_one_motor_is_back_on_the_gait_in_two_strides_and_two_motors_are_in_one(actions, strides):
    walker, slope, gait = (
        (D, 0.009, find_gait(D, 0.009)) if actions == "hip" else (KUO, 0.0, kuo_gait())
    )
    policy = ActuationFeedback(scene(walker, actions, slope, max_hip_torque=1.0), gait)
    power = np.linalg.matrix_power(policy.closed_loop, strides)
    assert np.abs(power).max() < 1e-9 < 1e-3 < np.abs(gait.multipliers[0])
    left = []
    for size in (1e-4, 1e-5):
        start = policy.point + size * np.array([1.0, -1.0, 0.0])
        start[2] = np.cos(2.0 * start[0]) * start[1]  # as a strike leaves it
        end = walk(policy, slope, start[None], strides)[-1]
        left.append(np.abs(end - policy.point).max())
    assert left[1] < 0.03 * left[0]  # of second order
    assert left[1] < 1e-6


@pytest.mark.parametrize("action", ["push_off", "hip"])
def test_a_controller_of_once_a_stride_walks_in_the_environment(action):
    walker, slope = (KUO, 0.0) if action == "push_off" else (D, 0.009)
    gait = kuo_gait() if action == "push_off" else find_gait(walker, slope)
    chosen = scene(
        walker, action, slope, max_hip_torque=1.0, max_push_off=0.5, reset_noise_scale=0.02,
        start=tuple(walker.units.to_dimensionless(gait.state)),
    )  # fmt: skip
    # Kuo's normal gait is near a fold: a little slower he walks from farther away.
    speed = midstance_speed(points_of(walker, gait.state), slope)[0] * (0.8 if slope == 0.0 else 1)
    policies = {SpeedControl(chosen, speed): chosen}
    near = make_scene(chosen, reset_noise_scale=0.002)
    methods = ("lqr",) if action == "push_off" else ("lqr", "deadbeat")
    policies |= {ActuationFeedback(near, gait, m, torque_weight=1.0): near for m in methods}
    for policy, where in policies.items():
        arena = gymnasium.make_vec(
            "PassiveWalker-v0", num_envs=8, scene=where, max_episode_steps=50
        )
        assert simulate_episodes(policy, arena, seed=1).endings == [TIME_LIMIT] * 8
        section = Section(walker=walker)
        if isinstance(policy, SpeedControl):
            speeds = midstance_speed(
                section.points_at(arena.unwrapped.states),  # type: ignore[attr-defined]
                slope,
            )
            np.testing.assert_allclose(speeds, speed, rtol=1e-5)


def test_the_map_under_linear_feedback_is_exact_and_has_the_closed_loop_s_derivative():
    gait = find_gait(D, 0.009)
    policy = ActuationFeedback(scene(D, "hip", 0.009, max_hip_torque=1.0), gait, "lqr")
    strides = stride_map(controller=policy)
    assert strides.exact and strides.slope == 0.009
    _, change = strides.linearize(policy.point[None])
    np.testing.assert_allclose(change.ends[0], policy.closed_loop, rtol=0.0, atol=1e-9)
    held = find_gait(strides, guess=gait.state)
    np.testing.assert_allclose(held.state, gait.state, rtol=0.0, atol=1e-9)


def test_speed_control_of_the_hip_leaves_no_multiplier():
    """The speed is back after one stride, and with it the placement of the foot."""
    gait = find_gait(D, 0.009)
    policy = SpeedControl(scene(D, "hip", 0.009, max_hip_torque=1.0), speed_of(gait))
    held = find_gait(stride_map(controller=policy), guess=gait.state)
    assert abs(held.multipliers[0]) < 0.01 < 0.5 < abs(gait.multipliers[0])


def test_a_scene_of_control_steps_becomes_one_of_strides():
    policy = SpeedControl({"walker": D, "control": "tick"}, 0.2)
    assert policy.scene.control == "stride"


def test_controllers_that_cannot_act_are_refused():
    gait = kuo_gait()
    with pytest.raises(ValueError, match="simplest walker"):
        SpeedControl(scene("E", "hip"), 0.2)
    with pytest.raises(ValueError, match="push_off"):
        SpeedControl(scene(D, ("hip", "push_off")), 0.2)
    with pytest.raises(ValueError, match="push_off"):
        ActuationFeedback(scene(KUO, "hip"), gait)
    with pytest.raises(ValueError, match="method"):
        ActuationFeedback(scene(KUO, "push_off"), gait, "best")  # type: ignore[arg-type]


def test_the_example_prints_its_table(capsys):
    stride_controllers.main()
    rows = [line.rsplit(maxsplit=2) for line in capsys.readouterr().out.splitlines()[3:]]
    multipliers = {name: float(multiplier) for name, multiplier, _ in rows}
    assert len(multipliers) == 7
    assert multipliers["D, passive"] == pytest.approx(0.58911, abs=1e-5)
    assert multipliers["D, hip torque: deadbeat"] == 0.0
    assert multipliers["Kuo, hip, push-off: deadbeat"] == 0.0
