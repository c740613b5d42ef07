"""Plans of a stride, gains, and stored optimal gaits, against plain computations."""

from __future__ import annotations

import json
import math
from dataclasses import fields, replace
from types import SimpleNamespace

import numpy as np
import pytest
import scipy

import gym_passive_walker as gpw
from examples.torso import TORSO
from gym_passive_walker.gaits.actuation import Actuation, to_own
from gym_passive_walker.gaits.control import optimal
from gym_passive_walker.gaits.control.baselines import (
    BASELINES,
    CONSTANT_TORQUE,
    ConstantTorque,
    LinearFeedback,
    Optimal,
    Passive,
    Schedule,
    StrideFeedback,
)
from gym_passive_walker.gaits.control.controllers import acting
from gym_passive_walker.gaits.control.feedback import deadbeat, first_driven, gains, powered_gait
from gym_passive_walker.gaits.control.maps import calm, map_in
from gym_passive_walker.gaits.control.optimum import OptimalGait, Problem
from gym_passive_walker.gaits.control.policy import FunctionPolicy
from gym_passive_walker.gaits.gait import GaitNotFound
from gym_passive_walker.gaits.measures import MEASURES
from gym_passive_walker.gaits.scenes.scene import make_scene

LEVEL = make_scene("level")


def observed(angle, rates=(-0.4, -0.2, -0.3), lead=0.0, shank=0.0):
    """An observation of a walker: dimensionless state, what is left of it, and the slope."""
    return [angle, -angle + lead, -angle + lead + shank, *rates, 0.0, 0.0]


def planned(point, rows, actions, seen):
    """Actions of each control step and motor, one number after the other."""
    plan = np.empty(actions.shape)
    deviation = [seen[0] - point[0], *(seen[3 + i] - point[1 + i] for i in range(3))]
    for t in range(actions.shape[0]):
        for a in range(actions.shape[1]):
            change = sum(rows[t, a, i] * deviation[i] for i in range(4))
            plan[t, a] = min(1.0, max(-1.0, actions[t, a] - change))
    return plan


@pytest.fixture
def feedback():
    """Three control steps of two motors, each with rows of its own; some actions are clipped."""
    random = np.random.default_rng(5)
    scene = make_scene("level", actions=("hip", "push_off"), max_push_off=0.1)
    point = np.array([0.3, -0.4, -0.2, -0.35])
    actions, rows = random.uniform(-0.9, 0.9, (3, 2)), random.normal(size=(3, 2, 4)) * 3.0
    return StrideFeedback("ours", scene, point, actions, rows)


def test_a_plan_is_taken_step_by_step_and_its_last_action_is_held(feedback):
    starts = [observed(0.3), observed(0.25), observed(0.33, (-0.45, -0.1, -0.3))]
    plans = [planned(feedback.point, feedback.rows, feedback.actions, x) for x in starts]
    np.testing.assert_allclose(
        feedback.plan(np.array(starts)[:, [0, 3, 4, 5]], 0.0), plans, rtol=1e-14
    )
    assert np.abs(plans).max() == 1.0
    action, memory = feedback.predict(np.array(starts))
    assert action.shape == (3, 2) and action.dtype == np.float32
    np.testing.assert_allclose(action, [plan[0] for plan in plans], rtol=1e-6)
    for step in (1, 2, 2, 2):
        seen = np.array([observed(0.2 - 0.02 * step, lead=0.05) for _ in starts])
        action, memory = feedback.predict(seen, memory)
        np.testing.assert_allclose(action, [plan[step] for plan in plans], rtol=1e-6)


@pytest.mark.parametrize("begins", ["mirrored", "swapped", "said", "no"])
def test_a_walker_begins_a_stride_by_any_of_three_signs(feedback, begins):
    """The other walker of the batch goes on with its own plan."""
    start = observed(0.3)
    mid, late = observed(-0.2, lead=0.05), observed(-0.25, lead=0.05)
    now = {
        "mirrored": observed(0.28), "swapped": observed(0.28, lead=0.02),
        "said": observed(-0.22, lead=0.06), "no": observed(-0.22, lead=0.06),
    }[begins]  # fmt: skip
    _, memory = feedback.predict(np.array([start, start]))
    _, memory = feedback.predict(np.array([mid, mid]), memory)
    said = np.array([begins == "said", False])
    action, (_, step, states) = feedback.predict(np.array([now, late]), memory, said)
    old = planned(feedback.point, feedback.rows, feedback.actions, start)
    new = planned(feedback.point, feedback.rows, feedback.actions, now)
    expected = old[2] if begins == "no" else new[0]
    np.testing.assert_allclose(action, [expected, old[2]], rtol=1e-6)
    assert step.tolist() == [2 if begins == "no" else 0, 2]
    np.testing.assert_array_equal(states, [now[:7], late[:7]])


def test_a_memory_is_not_what_was_passed_in(feedback):
    seen = np.array([observed(0.3)])
    _, memory = feedback.predict(seen)
    seen[:] = 0.0
    assert memory[2][0, :2].tolist() == [0.3, -0.3]
    one, _ = feedback.predict(np.array(observed(0.3)))
    assert one.shape == (2,)


def test_with_one_action_a_stride_each_observation_begins_one():
    scene = make_scene("steep")
    policy = StrideFeedback("ours", scene, np.zeros(4), np.array([0.1]), np.ones((1, 4)) * 0.1)
    memory = None
    for angle in (0.3, 0.2, 0.25):
        seen = np.array([observed(angle, lead=0.05)])
        action, memory = policy.predict(seen, memory)
        assert action[0, 0] == pytest.approx(0.1 - 0.1 * (angle - 0.9), rel=1e-5)


@pytest.mark.parametrize("slope", [0.0, 0.02])
def test_derivatives_of_a_plan_by_the_point_and_the_slope(feedback, slope):
    points = np.array([[0.3, -0.4, -0.2, -0.35], [0.36, -0.5, -0.2, -0.3]])
    by_point, by_slope = feedback.plan_by(points, slope)
    assert by_point.shape == (2, 3, 2, 4) and by_slope.shape == (2, 3, 2)
    for i in range(4):
        h = 1e-6 * np.eye(4)[i]
        by = (feedback.plan(points + h, slope) - feedback.plan(points - h, slope)) / 2e-6
        np.testing.assert_allclose(by_point[..., i], by, atol=1e-7)
    np.testing.assert_array_equal(by_slope, 0.0)


@pytest.mark.parametrize("torque", [0.0, 0.01, -0.02, 9.0, -9.0])
def test_a_constant_torque_is_a_share_of_the_largest(torque):
    scene = make_scene("level", actions=("ankle", "hip"), walker="E", max_ankle_torque=0.01)
    policy = ConstantTorque(torque, scene)
    for shape in ((8,), (3, 8)):
        action, memory = policy.predict(np.zeros(shape), "memory")
        share = min(1.0, max(-1.0, torque / scene.max_hip_torque))
        assert action.dtype == np.float32 and memory == "memory"
        np.testing.assert_allclose(action, np.broadcast_to([0.0, share], (*shape[:-1], 2)))
    assert policy.torque == torque and policy.name == "constant torque"


def test_baselines_are_what_their_names_say():
    assert list(BASELINES) == ["passive", "constant", "lqr", "deadbeat", "optimal"]
    assert BASELINES["constant"](LEVEL).torque == CONSTANT_TORQUE == 0.0025
    names = [BASELINES[name](LEVEL).name for name in BASELINES]
    assert names == ["passive", "constant torque", "LQR", "deadbeat", "optimal"]
    assert LinearFeedback("level", pieces=2).name == "LQR, two torques"
    assert Passive().predict(np.zeros((2, 8)))[0].tolist() == [[0.0], [0.0]]
    both = make_scene("level", actions=("hip", "push_off"), max_push_off=0.1)
    assert Passive(both).predict(np.zeros(8))[0].tolist() == [0.0, 0.0]


@pytest.mark.parametrize("pieces", [1, 2])
@pytest.mark.parametrize("method", ["lqr", "deadbeat"])
def test_the_closed_loop_is_the_derivative_of_the_map_under_the_feedback(pieces, method):
    policy = LinearFeedback("level", method, pieces=pieces, torque_weight=3.0)
    strides = gpw.stride_map(controller=policy)
    point = strides.points_at(policy.gait.state)
    np.testing.assert_allclose(strides.apply(point, 0.0).ends, point, rtol=1e-9)
    _, change = strides.linearize(point, 0.0)
    np.testing.assert_allclose(change.ends[0], policy.closed_loop, rtol=1e-6, atol=1e-8)


def test_the_weight_of_torques_makes_gains_smaller():
    small, large = (LinearFeedback("level", torque_weight=weight) for weight in (1.0, 1e4))
    assert np.abs(small.rows).max() > 1.5 * np.abs(large.rows).max()
    small, large = (Optimal("level", torque_weight=weight) for weight in (1.0, 1e4))
    assert np.abs(small.rows).max() > 1.5 * np.abs(large.rows).max()
    default = Optimal("level", torque_weight=10.0)
    np.testing.assert_array_equal(default.rows, Optimal("level").rows)
    default = LinearFeedback("level", torque_weight=100.0)
    np.testing.assert_array_equal(default.rows, LinearFeedback("level").rows)


@pytest.mark.parametrize("weight", [0.1, 10.0])
@pytest.mark.parametrize("forgotten", [0, 1])
def test_lqr_gains_are_the_limit_of_riccati_s_recursion(weight, forgotten):
    random = np.random.default_rng(8)
    a, b = random.normal(size=(4, 4)) * 0.6, random.normal(size=(4, 2)) * 0.05
    if forgotten:
        a[:, 3] = 0.0
    found = gains(a, b, "lqr", torque_weight=weight)
    assert found.shape == (2, 4)
    if forgotten:
        np.testing.assert_allclose(found[:, 3], 0.0, atol=1e-10)
    else:
        scale = np.abs(b).max()
        p, u = np.eye(4), b / scale
        for _ in range(2000):
            k = np.linalg.solve(weight * np.eye(2) + u.T @ p @ u, u.T @ p @ a)
            p = np.eye(4) + a.T @ p @ (a - u @ k)
        np.testing.assert_allclose(found, k / scale, rtol=1e-7)
    assert np.abs(np.linalg.eigvals(a - b @ found)).max() < 1.0


@pytest.mark.parametrize(("size", "motors"), [(2, 1), (3, 1), (4, 2), (4, 3), (3, 3)])
def test_deadbeat_rests_after_as_few_steps_as_there_are_states_for_each_motor(size, motors):
    random = np.random.default_rng(size + motors)
    a, b = random.normal(size=(size, size)), random.normal(size=(size, motors))
    closed = a - b @ deadbeat(a, b)
    steps = math.ceil(size / motors)
    assert np.abs(np.linalg.matrix_power(closed, steps)).max() < 1e-9
    if steps > 1:
        assert np.abs(np.linalg.matrix_power(closed, steps - 1)).max() > 1e-6
    found = a - b @ gains(a, b, "deadbeat")
    np.testing.assert_allclose(found, closed, atol=1e-7)


@pytest.mark.parametrize("motors", [1, 2, 3])
def test_deadbeat_does_not_answer_to_a_direction_that_a_stride_forgets(motors):
    """It needs no stride more for it; torques act where strides end."""
    random = np.random.default_rng(motors)
    forgotten = random.normal(size=4)
    forgotten /= np.linalg.norm(forgotten)
    a = random.normal(size=(4, 4))
    a -= np.outer(a @ forgotten, forgotten)
    b = a @ random.normal(size=(4, motors))
    found = gains(a, b, "deadbeat")
    np.testing.assert_allclose(found @ forgotten, 0.0, atol=1e-9)
    closed = np.linalg.matrix_power(a - b @ found, math.ceil(3 / motors))
    np.testing.assert_allclose(closed, 0.0, atol=1e-9)


@pytest.mark.parametrize("slope", [0.02, 0.001, 0.0, -0.003])
def test_a_powered_gait_has_the_torque_that_replaces_gravity(slope):
    walker = gpw.WALKERS["E"]
    gait = powered_gait(walker, slope)
    if slope > 0.0:
        np.testing.assert_array_equal(gait.state, gpw.find_gait(walker, slope).state)
        assert gait.controller is None
        return
    known = gpw.find_gait(walker, 0.005)
    missing = math.sin(0.005) - math.sin(slope)
    torque = 1.0 * 9.81 * known.step_length * missing / (4.0 * known.stance_angle)
    assert gait.controller.hip_torque == pytest.approx(torque, rel=1e-12)
    end = gpw.stride(walker, slope, gait.state, hip_torque=torque, tolerance=1e-12)
    np.testing.assert_allclose(end.state, gait.state, rtol=1e-8)


def test_a_simplest_walker_is_not_driven_by_its_hip():
    with pytest.raises(GaitNotFound, match="no torque drives the simplest walker"):
        powered_gait(gpw.WALKERS["D"], 0.0)


def test_the_first_amount_that_drives_a_walker_is_taken():
    walker, unit = gpw.WALKERS["E"], gpw.WALKERS["E"].units.impulse
    gait = first_driven(walker, 0.0, "push_off", iter([0.0, 0.02, 0.05]))
    assert gait.controller == gpw.Actuation(push_off=pytest.approx(0.02 * unit))
    assert first_driven(walker, 0.0, "push_off", [0.0]) is None


UNIT = gpw.WALKERS["C"].units
SCENES = sorted(path.stem for path in optimal.STORE.glob("*.json"))


@pytest.mark.parametrize("name", SCENES)
def test_a_stored_gait_reports_what_its_torques_do_in_its_scene(name):
    """By the strides of its stride map, tick by tick."""
    scene = make_scene(name)
    for gait in optimal.load(name):
        strides = gpw.stride_map(controller=gait, scene=name)
        torques = np.abs(gait.dimensionless.controller.hip_torque)
        assert torques.max() <= scene.max_hip_torque * (1.0 + 1e-12) and not gait.stubs
        end = strides.stride(gait.state)
        np.testing.assert_allclose(end.state, gait.state, atol=1e-7)
        for each in MEASURES:
            if each.name != "duration":
                found, known = getattr(gait, each.name), getattr(end, each.name)
                assert found == pytest.approx(known, rel=1e-6, abs=1e-9), each.name
        assert gait.cost_of_transport == pytest.approx(math.sin(gait.slope) + gait.hip_cost)
        _, change = strides.linearize(strides.points_at(gait.state), gait.slope)
        moduli = sorted(np.abs(np.linalg.eigvals(change.ends[0])), reverse=True)
        np.testing.assert_allclose(np.abs(gait.multipliers), moduli, atol=1e-5)
        assert gait.stable == (max(moduli) < 1.0)
        if scene.control == "tick":
            ticks = math.ceil(gait.dimensionless.step_period / scene.tick)
            assert len(gait.controller.hip_torque) == ticks


@pytest.mark.parametrize("energy", ["absolute", "positive", "net"])
def test_the_gradient_of_the_cost_and_the_constraints_is_that_of_differences(energy):
    scene = make_scene("level", energy=energy)
    gait = optimal.load("level")[4]
    problem = Problem(scene, gait.froude_speed * 0.99, len(gait.controller.hip_torque) + 2)
    random = np.random.default_rng(0)
    z = problem.begun_at(gait)
    inside = slice(problem.m, len(z))
    z[inside] = np.clip(z[inside], 0.02, 0.5) + random.uniform(0.0, 0.05, len(z) - problem.m)
    cost, gradient, gap, by_gap = problem.at(z)
    assert np.isfinite(cost) and len(gap) == problem.m + 1
    for i in [*range(problem.m), *random.choice(np.arange(problem.m, len(z)), 8, replace=False)]:
        h = 1e-6 * np.eye(len(z))[i]
        up, down = problem.at(z + h), problem.at(z - h)
        assert gradient[i] == pytest.approx((up[0] - down[0]) / 2e-6, rel=1e-4, abs=1e-8)
        np.testing.assert_allclose(by_gap[:, i], (up[2] - down[2]) / 2e-6, rtol=1e-4, atol=1e-8)


def test_torques_of_hip_and_ankle_are_each_a_share_of_their_own_largest():
    scene = make_scene("level", walker="E", actions=("ankle", "hip", "push_off"),
                       max_push_off=0.2, max_ankle_torque=0.03)  # fmt: skip
    problem = Problem(scene, 0.1, 4)
    hip, ankle = [0.01, -0.02], [-0.003, 0.0, 0.006]
    z = problem.begun([0.2, -0.3, -0.1], {"hip": hip, "ankle": ankle, "push_off": 0.05})
    np.testing.assert_allclose(
        problem.torques(z), [[0.01, -0.02, -0.02, -0.02], [-0.003, 0.0, 0.006, 0.006]]
    )
    assert problem.push_off(z) == pytest.approx(0.05)
    np.testing.assert_array_equal(z[:3], [0.2, -0.3, -0.1])
    assert problem.box.shape == (len(z), 2) and len(z) == 3 + 4 * 4 + 1
    beyond = problem.begun([0.2, -0.3, -0.1], {"hip": [9.0], "ankle": [-9.0], "push_off": 9.0})
    np.testing.assert_allclose(problem.torques(beyond)[0], scene.max_hip_torque)
    np.testing.assert_allclose(problem.torques(beyond)[1], -0.03)
    assert problem.push_off(beyond) == pytest.approx(0.2)


def some(speed, cost=0.01, *, hip=(0.0,), ankle=(0.0,), push_off=0.0, **changes):
    """A gait with dimensionless torques and push-off."""
    gait = optimal.load("level")[3]
    length = speed * gait.units.speed * gait.step_period
    held = to_own(gait.units, Actuation(np.array(hip), np.array(ankle), push_off))
    mean = gait.mean._replace(step_length=length, **changes)
    return replace(gait, mean=mean, charged_cost=cost, controller=held)


def test_saved_gaits_are_loaded_with_every_field(tmp_path, monkeypatch):
    given = [replace(some(0.1, ankle=[0.1, 0.2], push_off=0.4), on_edge=True), some(0.2, 1.0 / 3.0)]
    monkeypatch.setattr(optimal, "STORE", tmp_path)
    optimal.save_gaits(tmp_path / "ours.json", given)
    assert [gait.to_json() for gait in optimal.load("ours")] == [gait.to_json() for gait in given]
    assert {*given[0].to_json()} == {each.name for each in fields(OptimalGait)}
    with pytest.raises(ValueError, match=r"of scene 'level' are stored, only those of: ours; .*"
                       "--scene level"):  # fmt: skip
        optimal.load("level")


def test_saved_costs_replace_those_of_their_scene_alone(tmp_path, monkeypatch):
    monkeypatch.setattr(optimal, "COSTS", tmp_path / "costs.json")
    optimal.stored_costs.cache_clear()
    try:
        optimal.save_costs("b", [some(0.1, 0.02), some(0.2, 0.04)])
        optimal.save_costs("a", [some(0.3, 0.05)])
        assert optimal.stored_costs("b") == [(0.1, 0.02), (0.2, 0.04)]
        optimal.save_costs("b", [some(0.1, 0.03)])
        assert optimal.stored_costs("b") == [(0.1, 0.03)]
        assert optimal.stored_costs("a") == [(0.3, 0.05)]
        assert list(json.loads((tmp_path / "costs.json").read_text())) == ["a", "b"]
        with pytest.raises(ValueError, match="has no c; it has a, b"):
            optimal.stored_costs("c")
    finally:
        monkeypatch.undo()
        optimal.stored_costs.cache_clear()


def test_least_costs_between_gaits_are_interpolated_by_their_logarithm():
    speeds, costs = np.array([0.1, 0.12, 0.15, 0.2]), np.array([0.01, 0.02, 0.025, 0.1])
    gaits = [some(v, c) for v, c in zip(speeds, costs, strict=True)]
    curve = scipy.interpolate.PchipInterpolator(speeds, np.log(costs))
    for speed in (0.1, 0.11, 0.149, 0.2):
        assert optimal.least_cost(gaits, speed) == pytest.approx(math.exp(curve(speed)), rel=1e-9)
    assert optimal.least_cost(gaits[::-1], 0.11) == optimal.least_cost(gaits, 0.11)
    for beyond in (0.0999, 0.2001):
        with pytest.raises(ValueError, match=r"from 0\.1 to 0\.2 .*, not at"):
            optimal.least_cost(gaits, beyond)
    assert optimal.least_cost(gaits[:1], 0.1) == 0.01
    free = [some(0.1, 0.0), some(0.2, 0.02)]
    assert optimal.least_cost(free, 0.15) == pytest.approx(0.01)
    with pytest.raises(ValueError, match="known at speeds"):
        optimal.least_cost(free, 0.21)


def test_torques_are_shifted_by_a_tick_each_way_and_none_is_lost():
    gait = some(0.1, hip=[1.0, 2.0, 3.0], ankle=[4.0, 5.0, 6.0])
    later, earlier = (x.dimensionless.controller for x in optimal._shifted(gait))
    np.testing.assert_allclose(later[:2], [[1.0, 1.0, 2.0, 3.0], [4.0, 4.0, 5.0, 6.0]])
    np.testing.assert_allclose(earlier[:2], [[2.0, 3.0], [5.0, 6.0]])
    _, earlier = optimal._shifted(some(0.1, hip=[1.0]))
    np.testing.assert_allclose(earlier.dimensionless.controller[:2], [[1.0], [0.0]])


@pytest.mark.parametrize(
    ("time", "tick", "edges"),
    [(math.nan, 0.1, []), (1.23, math.inf, []), (1.23, 0.1, [12, 13]), (1.2, 0.1, [12]),
     (1.2003, 0.1, [12])],
)  # fmt: skip
def test_a_kneestrike_is_tried_at_the_ends_of_the_ticks_around_it(time, tick, edges):
    found = optimal._edges(some(0.1, kneestrike_time=time * UNIT.time), tick)
    np.testing.assert_allclose(found, [edge * 0.1 for edge in edges])


def test_a_schedule_plays_hip_ankle_and_push_off_each_to_its_own_motor():
    scene = make_scene("level", walker="E", actions=("push_off", "ankle", "hip"),
                       max_push_off=0.2, max_ankle_torque=0.03)  # fmt: skip
    gait = some(0.1, hip=[0.01, -0.02], ankle=[0.003, 0.006], push_off=0.05)
    played = Schedule(scene, gait)
    largest = scene.max_hip_torque
    expected = [[0.25, 0.1, 0.01 / largest], [0.25, 0.2, -0.02 / largest]]
    np.testing.assert_allclose(played.actions, expected)
    assert not played.rows.any() and played.name == "schedule"
    for less in ({"actions": ("push_off", "hip")}, {"max_push_off": 0.01}):
        with pytest.raises(ValueError, match=r"optimal gait needs 0\.0.*: choose a scene"):
            Schedule(make_scene(scene, **less), gait)


def test_controllers_are_found_in_each_form_with_their_scene():
    policy, scene = acting("lqr", "steep", slope=0.1)
    assert policy.scene == scene == make_scene("steep", slope=0.1)
    policy, scene = acting("passive")
    assert scene == LEVEL
    held = LinearFeedback("steep")
    assert acting(held) == (held, held.scene)
    assert acting(held, "level") == (held, LEVEL)
    _, there = acting(held, slope=0.1)
    assert there == make_scene("steep", slope=0.1)
    with pytest.raises(ValueError, match="say in which scene this policy acts, by scene="):
        acting(lambda seen: seen[:, :1])
    assert isinstance(acting(lambda seen: seen, LEVEL)[0], FunctionPolicy)
    for wrong in (3, None, object()):
        with pytest.raises(ValueError, match="a policy acts by predict"):
            acting(wrong)


def test_a_function_acts_in_double_precision_and_returns_its_memory():
    def ours(seen):
        return [[2, 1]]

    policy = FunctionPolicy(ours)
    action, memory = policy.predict(np.zeros((1, 8)), "memory", np.array([True]))
    assert (action.tolist(), action.dtype, memory) == ([[2.0, 1.0]], float, "memory")
    assert repr(policy) == "FunctionPolicy(ours)" and policy.name == "ours" and policy.double


REFUSED = {
    "stride_map needs a walker, a scene, or a policy": lambda: gpw.stride_map(),
    "say in which scene": lambda: acting(some(0.1)),
    "the walker 'lab' has no knee; it has hip_torque, ankle": lambda: gpw.stride_map(
        "lab", 0.0, controller={"knee": 1.0}
    ),
    "an Actuation needs a walker with two legs": lambda: gpw.stride_map(
        TORSO, 0.0, controller=gpw.Actuation(hip_torque=1.0)
    ),
    "an Actuation needs a walker": lambda: gpw.stride(TORSO, 0.0, TORSO.start, hip_torque=1.0),
    "needs 0.5 of the action 'ankle', and the scene's largest is 0": lambda: acting(
        gpw.Actuation(ankle_torque=0.5 * 9.81), {"walker": "E"}
    ),
    "a stride map is of ground that repeats": lambda: gpw.stride_map(
        "lab", 0.03, terrain=gpw.rough(0.01)
    ),
    "speed must lie between 0 and 2": lambda: gpw.optimal_gait("level", 2.0),
    "speed must be": lambda: gpw.optimal_gait("level", 0.0),
    "a gait is of one slope, and this scene has those from 0.01 to 0.02": lambda: gpw.optimal_gait(
        {"slope": (0.01, 0.02)}, 0.1
    ),
    "start must be": lambda: gpw.optimal_gait("level", 0.1, start=3),
    "speeds must be speeds .* in a row": lambda: gpw.optimal_gaits("level", 0.1),
    r"speeds\[1\]": lambda: gpw.optimal_gaits("level", [0.1, -0.1]),
    'method must be "lqr" or "deadbeat"': lambda: gains(np.eye(2), np.ones((2, 1)), "fast"),
    'pieces must be 1, or 2 with control="tick", not 2': lambda: LinearFeedback("steep", pieces=2),
    "action_delay=2 carries actions over": lambda: map_in(
        make_scene("level", action_delay=2), Passive()
    ),
    "optimal gaits are played at the hip alone": lambda: Optimal(
        make_scene("level", actions=("hip", "push_off")), optimal.load("level")[0]
    ),
    "commands vary in this scene": lambda: map_in(
        make_scene("level", command=(0.1, 0.2)), Passive()
    ),
}


@pytest.mark.parametrize("message", REFUSED)
def test_what_is_refused_is_named(message):
    with pytest.raises(ValueError, match=message):
        REFUSED[message]()


def test_actuators_too_weak_to_walk_are_named_with_what_was_tried():
    weak = make_scene("push-off", slope=-0.2, max_push_off=1e-4, actions=("push_off",))
    with pytest.raises(
        gpw.GaitNotFound, match=r"none with a constant push_off of 0\.1 to 1 of the largest"
    ):
        gpw.optimal_gait(weak, 0.1)


def test_a_scene_without_disturbances_keeps_all_else():
    scene = make_scene(
        "level", slope=(0.01, 0.03), reset_noise_scale=0.1, energy="net", command=(0.1, 0.2),
        domain_randomization={"thigh_mass": 0.1}, randomization_pool=3, observation_noise=0.01,
        action_noise=0.1,
        max_hip_torque=0.07, tick=0.21, terrain=gpw.rough(0.01), terrain_lookahead=2,
    )  # fmt: skip
    quiet = calm(scene)
    assert (quiet.slope, quiet.command) == (pytest.approx(0.02), pytest.approx(0.15))
    assert (quiet.reset_noise_scale, quiet.energy) == (0.0, "absolute")
    assert (quiet.observation_noise, quiet.action_noise) == (0.0, 0.0)
    assert not quiet.domain_randomization and quiet.terrain.smooth
    assert quiet.terrain_lookahead == 2
    assert (quiet.max_hip_torque, quiet.tick, quiet.walker) == (0.07, 0.21, scene.walker)


def test_maps_take_slope_walker_and_gait_s_own_slope():
    assert gpw.stride_map(scene="steep").slope == make_scene("steep").slope
    assert gpw.stride_map(scene={"slope": (0.01, 0.04)}).slope == pytest.approx(0.025)
    assert gpw.stride_map(scene="steep", slope=0.02).slope == 0.02
    assert gpw.stride_map("E", scene="steep").walker == gpw.WALKERS["E"]
    gait = optimal.load("steep")[0]
    assert gpw.stride_map(controller=gait, scene="steep").slope == gait.slope
    assert gpw.stride_map(controller=gait, scene="steep", slope=0.1).slope == 0.1
    made = gpw.stride_map(controller="lqr", scene="steep", slope=0.1)
    assert made.agent.scene.slope == made.slope == 0.1
    other = gpw.stride_map("A", controller="lqr", scene="steep", tolerance=1e-9)
    assert other.walker == other.agent.scene.walker == gpw.WALKERS["A"]
    assert other.tolerance == 1e-9


def test_actions_of_a_wrong_shape_or_size_are_refused_by_the_controller_s_name():
    def ours(seen):
        return np.zeros((len(seen), 2))

    strides = gpw.stride_map(controller=ours, scene="level")
    with pytest.raises(ValueError, match=r"ours must return actions of shape \(1, 1\), .*of hip"):
        strides.apply(np.array([[0.3, -0.4, -0.2, -0.35]]), 0.0)
    assert strides.controller_name == "ours"
    named = SimpleNamespace(predict=lambda *_, **__: (np.full((1, 1), np.nan), None))
    with pytest.raises(ValueError, match=r"SimpleNamespace must return actions .*all finite"):
        gpw.stride_map(controller=named, scene="level").apply(np.full((1, 4), 0.3), 0.0)
