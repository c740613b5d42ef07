"""Gaits of least cost of transport, and the policy that plays them."""

import re
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest

import gym_passive_walker as gpw
from examples.five_links import FIVE_LINKS
from gym_passive_walker import closed_loop_gait
from gym_passive_walker.envs.evaluation.walks import TIME_LIMIT, simulate_episodes
from gym_passive_walker.envs.vector_env import PassiveWalkerVectorEnv
from gym_passive_walker.gaits.actuation import Actuation, to_own
from gym_passive_walker.gaits.control import optimal
from gym_passive_walker.gaits.control.baselines import ConstantTorque, LinearFeedback, Optimal
from gym_passive_walker.gaits.control.optimum import Problem
from gym_passive_walker.gaits.control.ticks import ticked_stride
from gym_passive_walker.gaits.measures import cost_of_transport
from gym_passive_walker.gaits.scenes.checks import SceneError
from gym_passive_walker.gaits.scenes.scene import make_scene
from gym_passive_walker.gaits.section import Section
from tests.own.statements import COMPASS, DRIVEN, STRAIGHT

SCENES = sorted(path.stem for path in optimal.STORE.glob("*.json"))


def problem_of(gait, further=0, **changes):
    """The problem that a gait of "level" solves, with further ticks, in a changed scene."""
    ticks = len(gait.controller.hip_torque) + further
    return Problem(make_scene("level", **changes), gait.froude_speed, ticks)


def test_a_motor_that_pushes_both_ways_at_once_is_not_paid_for_it(monkeypatch):
    gait = optimal.load("level")[5]
    problem = problem_of(gait)
    alone = problem.begun_at(gait)
    both = alone.copy()
    for parts in problem.parts(both):
        parts += 0.01
    np.clip(both, *problem.box.T, out=both)
    monkeypatch.setattr(problem, "_minimised", lambda z, *_: z)
    found = problem.solve(both)
    assert not np.minimum(*problem.parts(found)).any()
    assert problem.at(found)[0] == pytest.approx(problem.at(alone)[0], rel=1e-2)
    assert problem.at(both)[0] > 1.5 * problem.at(alone)[0]


def stiff() -> optimal.OptimalGait:
    """An initial guess in which the swing leg, held back at first, passes through the ground."""
    gait = optimal.load("level")[5]
    locked_at_once = np.array([[0.25, -0.30, -0.21, -0.41]])
    state = Section(walker=gait.walker).states_at(locked_at_once)[0]
    torques = to_own(gait.units, Actuation(np.array([-0.05, -0.05, 0.0]), np.zeros(3), 0.0))
    longer = gait.mean._replace(duration=3.15 * gait.units.time)
    return replace(gait, state=state, controller=torques, mean=longer)


@pytest.mark.parametrize("actions", [("hip",), ("hip", "push_off")])
def test_how_far_the_toe_clears_the_ground_is_known_with_its_derivatives(actions):
    gait = optimal.load("level")[5]
    problem = problem_of(gait, 3, actions=actions)
    problem.clears = True
    z = problem.begun_at(gait)
    z[6:20] += 0.01
    room, by = problem.room(z)
    shifts = 1e-6 * np.eye(len(z))
    ahead, behind = (np.array([problem.room(z + s * x)[0] for x in shifts]) for s in (1.0, -1.0))
    np.testing.assert_allclose(by, (ahead - behind).T / 2e-6, atol=1e-7)
    assert np.all(room > 0.0)
    assert np.all(np.abs(by).max(axis=1) > 1.0)


def test_a_stiff_leg_through_the_ground_is_allowed_only_without_the_rule():
    for end_on_toe_stub in (True, False):
        problem = Problem(make_scene("level", end_on_toe_stub=end_on_toe_stub), 0.1, 48)
        problem.clears = True
        z = problem.begun_at(stiff())
        assert problem.measured(z).stubs
        assert problem.allowed(z) is not end_on_toe_stub
        assert problem.room(z)[0].min() < 0.0
        assert problem.allowed(problem.begun_at(optimal.load("level")[5]))


@pytest.mark.parametrize("end_on_toe_stub", [True, False])
def test_a_search_for_a_clear_toe_keeps_a_gait_that_clears_and_refuses_one_that_stubs(
    end_on_toe_stub, monkeypatch
):
    """Of the gait with which the search ends."""
    gait = optimal.load("level")[5]
    problem = problem_of(gait, end_on_toe_stub=end_on_toe_stub)
    problem.clears = True
    z = problem.begun_at(gait)
    monkeypatch.setattr(problem, "_minimised", lambda z, *_: z)
    np.testing.assert_allclose(problem.solve(z), z, atol=1e-8)
    monkeypatch.setattr(problem, "_stubs", lambda z: True)
    if end_on_toe_stub:
        with pytest.raises(gpw.GaitNotFound, match="toe clears"):
            problem.solve(z)
    else:
        np.testing.assert_allclose(problem.solve(z), z, atol=1e-8)


@pytest.mark.slow
def test_the_toe_clears_the_ground_where_the_scene_asks_for_it():
    found = optimal.optimal_gait("level", 0.10, start=stiff())
    assert not found.stubs
    assert found.motor_cost > 0.00318
    # Which of several such gaits is found depends on rounding. The closed loop has that one.
    closed = closed_loop_gait(Optimal("level", found), "level")
    assert closed.hip_cost == pytest.approx(found.hip_cost, rel=1e-3)


@pytest.mark.slow
def test_without_the_rule_a_stiff_leg_walks_for_less():
    problem = Problem(make_scene("level", end_on_toe_stub=False), 0.1, 48)
    found = problem.measured(problem.solve(problem.begun_at(stiff())))
    assert found.stubs and found.motor_cost < 0.003


@pytest.mark.slow
def test_uphill_the_search_finds_the_ticks_in_which_torques_are_cheapest():
    """The cost that starts nearby come to; from a constant torque alone it is up to 1 % more."""
    found = optimal.optimal_gait(make_scene("level", slope=-0.02), 0.08)
    assert found.motor_cost < 0.048026


@pytest.mark.parametrize("scene", SCENES)
def test_stored_costs_are_those_of_the_stored_gaits_and_finer(scene):
    gaits, costs = optimal.load(scene), optimal.stored_costs(scene)
    apart = np.diff([speed for speed, _ in costs if scene != "lab" or speed < 0.217])
    assert apart.max() < 1.3e-3  # faster walks of `lab` have no optimum at some speeds
    for gait in gaits:
        assert optimal.least_cost(scene, gait.froude_speed) == pytest.approx(gait.cost_of_transport)
    (low, _), *_, (high, _) = costs
    for beyond in (low - 1e-6, high + 1e-6):
        with pytest.raises(ValueError, match=f"speeds from {low:g} to {high:g} .*, not at"):
            optimal.least_cost(scene, beyond)


@pytest.mark.parametrize("speed", [0.088125, 0.165625])
def test_midway_between_stored_costs_the_optimum_is_known_within_a_thousandth(speed):
    start = min(optimal.load("level"), key=lambda gait: abs(gait.froude_speed - speed))
    found = optimal.optimal_gait("level", speed, start=start)
    assert optimal.least_cost("level", speed) == pytest.approx(found.cost_of_transport, rel=1e-3)


def test_costs_between_gaits_given_are_interpolated_smoothly():
    """Stored gaits are ten times as far apart as stored costs."""
    gaits = optimal.load("level")
    for speed in (0.074, 0.135, 0.157):
        assert optimal.least_cost(gaits, speed) == pytest.approx(
            optimal.least_cost("level", speed), rel=7e-3
        )
    assert optimal.least_cost(gaits[:1], gaits[0].froude_speed) == pytest.approx(
        gaits[0].cost_of_transport
    )
    with pytest.raises(ValueError, match=r"from 0\.05 to 0\.05 .*, not at 0\.1"):
        optimal.least_cost(gaits[:1], 0.1)
    for speed in (float("nan"), "0.1", None):
        with pytest.raises(ValueError, match="speed must be"):
            optimal.least_cost(gaits, speed)
    with pytest.raises(ValueError, match="at least one gait"):
        optimal.least_cost([], 0.1)


def test_a_scene_without_stored_costs_is_named(tmp_path, monkeypatch):
    with pytest.raises(ValueError, match=r"no levle \(level\?\); it has lab, level, steep"):
        optimal.least_cost("levle", 0.1)
    monkeypatch.setattr(optimal, "COSTS", tmp_path / "costs.json")
    gaits = optimal.load("steep")
    optimal.save_costs("moon", gaits)
    optimal.save_costs("sun", gaits[:3])
    assert optimal.stored_costs("moon") == [(g.froude_speed, optimal.charged(g)) for g in gaits]
    assert len(optimal.stored_costs("sun")) == 3
    optimal.stored_costs.cache_clear()


def test_level_walking_at_a_tenth_costs_a_third_of_a_percent():
    gaits = optimal.load("level")
    assert optimal.least_cost(gaits, 0.10) <= 0.00319
    assert optimal.least_cost(gaits, 0.15) <= 0.01317
    with pytest.raises(ValueError, match="optimal_gait"):
        optimal.least_cost(gaits, 0.4)


@pytest.mark.parametrize("name", ["lab", "steep"])
def test_at_its_own_speed_the_passive_gait_is_the_optimum(name):
    scene = make_scene(name)
    gait = gpw.find_gait(scene.walker, scene.slope)
    cost = optimal.least_cost(optimal.load(name), gait.froude_speed)
    assert cost == pytest.approx(np.sin(scene.slope), rel=1e-6)


def test_a_gait_is_found_from_its_neighbour():
    start = next(gait for gait in optimal.load("level") if gait.froude_speed > 0.055)
    found = optimal.optimal_gait("level", 0.055, start=start)
    assert found.froude_speed == pytest.approx(0.055) and found.violation < 1e-9
    assert found.optimality < 0.01
    assert found.hip_cost == pytest.approx(optimal.least_cost("level", 0.055), rel=1e-3)


def test_the_optimum_costs_less_than_a_constant_torque():
    constant = closed_loop_gait(ConstantTorque(0.0025, "level"), "level")
    assert (
        optimal.least_cost(optimal.load("level"), constant.froude_speed) < 0.7 * constant.hip_cost
    )


def test_a_passive_gait_is_its_own_optimum_without_a_motor():
    gait = gpw.find_gait("lab", 0.036)
    scene = make_scene("lab", control="stride")
    found = optimal.optimal_gait(scene, gait.froude_speed)
    assert found.hip_cost == pytest.approx(0.0, abs=1e-9)
    assert found.cost_of_transport == pytest.approx(np.sin(0.036))
    assert abs(found.multipliers[0]) == pytest.approx(abs(gait.multipliers[0]), rel=1e-6)


def test_optima_at_several_speeds_are_those_that_are_stored():
    found = optimal.optimal_gaits("steep", [0.33, 0.32])
    passive = gpw.find_gait("C", 0.11).froude_speed
    assert [gait.froude_speed for gait in found] == pytest.approx([0.32, passive, 0.33])
    for gait in found:
        stored = min(
            optimal.load("steep"), key=lambda other: abs(other.froude_speed - gait.froude_speed)
        )
        assert gait.hip_cost == pytest.approx(stored.hip_cost, abs=1e-7)
    speeds, costs = np.array([(gait.froude_speed, gait.cost_of_transport) for gait in found]).T
    assert optimal.least_cost(found, speeds[1]) == pytest.approx(costs[1], rel=1e-12)
    for beyond in (speeds[0] - 1e-6, speeds[-1] + 1e-6):
        with pytest.raises(ValueError, match="known at speeds"):
            optimal.least_cost(found, beyond)


@pytest.mark.parametrize("costs", [(3.0, 2.0, 1.0), (1.0, 2.0, 3.0)])
def test_of_two_optima_at_one_speed_the_cheaper_is_kept(costs, monkeypatch):
    """One is found from a slower gait on the way out, and one from a faster on the way back."""
    left = iter(costs)

    def found(scene, speed, *, start):
        mean = start.mean._replace(step_length=speed * start.units.speed * start.step_period)
        return replace(start, mean=mean, charged_cost=next(left))

    monkeypatch.setattr(optimal, "optimal_gait", found)
    _, slower, faster = optimal.optimal_gaits("steep", [0.33, 0.335])
    assert [g.froude_speed for g in (slower, faster)] == pytest.approx([0.33, 0.335])
    assert (slower.charged_cost, faster.charged_cost) == (min(costs[0], costs[2]), costs[1])


@pytest.mark.parametrize("energy", ["absolute", "positive", "net"])
def test_the_motor_of_an_optimal_gait_is_charged_as_its_scene_says(energy):
    scene = make_scene("lab", control="stride", slope=0.03, energy=energy)
    gait = optimal.optimal_gait(scene, 0.16)
    torque, point = gait.dimensionless.controller.hip_torque, gait.point.values[0]
    walked = ticked_stride(scene.walker, 0.03, point, torque, tick=np.inf)
    absolute, net = np.abs(torque) @ walked.turn, torque @ walked.swing
    work = {"absolute": absolute, "positive": 0.5 * (absolute + net), "net": net}[energy]
    assert gait.charged_cost == pytest.approx(work / walked.length, rel=1e-9)
    assert cost_of_transport(gait, energy) == pytest.approx(np.sin(0.03) + gait.charged_cost)
    assert optimal.charged(gait) == pytest.approx(cost_of_transport(gait, energy), rel=1e-9)
    assert gait.hip_cost == pytest.approx(absolute / walked.length, rel=1e-9)
    assert not net == pytest.approx(absolute, rel=1e-3)


def test_the_optimal_policy_plays_its_gait_and_returns_to_it():
    policy = Optimal("level")
    closed = closed_loop_gait(policy, "level")
    assert closed.froude_speed == pytest.approx(policy.gait.froude_speed, rel=1e-6)
    assert closed.hip_cost == pytest.approx(policy.gait.hip_cost, rel=1e-3)
    assert closed.stable
    arena = gym.make_vec("PassiveWalker-v0", num_envs=8)
    walks, others = (simulate_episodes(p, arena, seed=3) for p in (policy, LinearFeedback("level")))
    assert walks.endings == [TIME_LIMIT] * 8
    assert np.mean(walks.reward) > np.mean(others.reward)


def test_stored_gaits_belong_to_a_scene_however_it_is_named():
    gaits = [Optimal(scene).gait.to_json() for scene in (make_scene("steep"), "steep")]
    assert gaits[0] == gaits[1]
    with pytest.raises(ValueError, match="optimal_gait"):
        Optimal(make_scene("level", slope=0.001))
    with pytest.raises(ValueError, match="optimal_gait"):
        Optimal(make_scene("steep", walker=gpw.tune("C")))
    with pytest.raises(ValueError, match="played at the hip alone"):
        Optimal(make_scene("level", actions=("hip", "push_off")))


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("rolling", 0.1), "choose one by"),
        (("level", -0.1), "speed must be a .*number above 0"),
        (("level", float("nan")), "speed must be a .*number above 0"),
    ],
)
def test_what_has_no_optimum_is_refused(arguments, words):
    with pytest.raises(ValueError, match=words):
        optimal.optimal_gait(*arguments)


def test_a_reward_without_weights_is_refused_as_by_a_scene():
    with pytest.raises(SceneError, match="reward must have weights of some of distance"):
        optimal.optimal_gait({"slope": 0.03, "control": "stride"}, reward={})


def test_where_the_gait_that_a_search_begins_with_needs_more_than_the_scene_permits_none_is_found():
    scene = {"slope": -0.03, "control": "stride", "max_hip_torque": 0.001}
    with pytest.raises(gpw.GaitNotFound, match=r"scene permits .*hip_torque=.*: try larger motors"):
        optimal.optimal_gait(scene, 0.1)


def test_a_speed_out_of_reach_is_said_to_be():
    scene = make_scene("level", control="stride")
    with pytest.raises(
        gpw.GaitNotFound,
        match=r"^no gait at speed 1\.5 by motors of .* was found; there are gaits at speed 0\.\d+ ",
    ) as said:
        optimal.optimal_gait(scene, 1.5)
    speed = float(re.search(r"at speed (0\.\d+)", str(said.value))[1])
    assert optimal.optimal_gait(scene, speed).froude_speed == pytest.approx(speed)


def test_the_speeds_of_stored_gaits_are_said_where_a_search_finds_none():
    gait = optimal.load("level")[0]
    said = optimal._known_speeds(make_scene("pushed"), gait)
    assert "speeds from 0.05 to 0.2 √(g l)" in said and "optimal_gaits(scene, speeds)" in said


def test_scenes_without_stored_gaits_say_how_to_get_them():
    with pytest.raises(ValueError, match=r"train\.py optimal"):
        optimal.load("moon")


def test_gaits_at_many_speeds_are_of_one_slope_too():
    with pytest.raises(ValueError, match="choose one by"):
        optimal.optimal_gaits("rolling", [0.1])


def test_the_simplest_walker_s_optimal_push_off_makes_good_its_heelstrike():
    """On level ground P = v tan(alpha), 2 alpha between the legs (Kuo 2002)."""
    gait = gpw.find_gait(gpw.stride_map("D", 0.0, controller=Actuation(push_off=0.05)))
    found = optimal.optimal_gait("push-off", gait.froude_speed)
    assert found.froude_speed == pytest.approx(gait.froude_speed, rel=1e-9)
    angle, rate = found.point.values[0, :2]
    walked = found.dimensionless
    push_off = walked.controller.push_off
    assert push_off == pytest.approx(-rate * np.tan(angle), rel=1e-8)
    assert found.push_off_cost == pytest.approx(optimal.charged(found), rel=1e-14)
    assert found.cost_of_transport == pytest.approx(found.push_off_cost, rel=1e-12)
    assert found.push_off_cost == pytest.approx(0.5 * push_off**2 / walked.step_length)
    units = gait.walker.units
    longer = float(gait.stride.push_off_work) / (units.energy * gait.step_length)
    assert found.push_off_cost < longer  # shorter steps at the same speed cost less


def test_with_every_motor_a_gait_and_its_energy_balance_close():
    """Point feet, uphill: what hip, ankle and push-off give is what a plain stride says they do."""
    actions, slope = ("hip", "ankle", "push_off"), -0.005
    scene = make_scene("level", walker="E", slope=slope, control="stride", actions=actions)
    found = optimal.optimal_gait(scene, 0.15)
    (hip,), (ankle,), push_off = found.controller
    walked = gpw.stride(
        scene.walker, slope, found.state, hip_torque=hip, ankle_torque=ankle, push_off=push_off
    )
    np.testing.assert_allclose(walked.state, found.state, atol=1e-8)
    for name in ("hip_cost", "ankle_cost", "push_off_cost", "collision_cost", "gravity_cost"):
        assert getattr(walked, name) == pytest.approx(getattr(found, name), abs=1e-9)
    assert found.charged_cost == pytest.approx(found.motor_cost, rel=1e-9)
    assert push_off > 0.0


def test_in_ticks_the_push_off_is_cheaper_than_the_hip():
    """As Kuo found it for the simplest walker, so it is for one with knees."""
    pushing = optimal.optimal_gait(make_scene("level", actions=("push_off",)), 0.15)
    assert pushing.optimality < 1e-8
    assert pushing.charged_cost < 0.25 * optimal.least_cost(optimal.load("level"), 0.15)


@pytest.mark.parametrize(("scene", "speed"), [("level", 0.08), ("lab", 0.17)])
def test_an_optimum_in_no_corner_is_one_to_rounding(scene, speed):
    """What was set aside on the way has come back: no torque would pay."""
    assert optimal.optimal_gait(scene, speed).optimality < 1e-6


@pytest.mark.parametrize(
    "other",
    [
        {"walker": "A"}, {"slope": 0.001}, {"tick": 0.2}, {"max_hip_torque": 0.06},
        {"energy": "positive"}, {"actions": ("hip", "push_off")}, {"control": "stride"},
    ],
    ids=lambda other: next(iter(other)),
)  # fmt: skip
def test_stored_gaits_are_of_their_own_walker_slope_motor_and_charge(other):
    assert optimal.stored_name(make_scene("level")) == "level"
    assert optimal.stored_name(make_scene("level", reset_noise_scale=0.2)) == "level"
    with pytest.raises(ValueError, match="no optimal gaits of this scene are stored"):
        optimal.stored_name(make_scene("level", **other))


def test_optima_of_a_system_are_kept_by_its_start_and_its_mass():
    shifted = replace(DRIVEN, start=(0.25, -0.25, -0.31, -0.17))
    plain, centre = (
        DRIVEN.hybrid._replace(momentum=None, ground_force=None),
        lambda body, state: (0.0, 1.0),
    )
    given = (
        gpw.System.of(plain, DRIVEN.body, mass=mass, start=DRIVEN.start, centre=centre)
        for mass in (1.0, 2.0)
    )
    scenes = [make_scene(system=x, control="stride") for x in (DRIVEN, shifted, *given)]
    assert len({optimal._cache_name(scene, 0.2) for scene in scenes}) == 4


def test_the_optimal_policy_takes_the_stored_gaits_of_a_scene_however_it_is_named():
    named, made = (Optimal(scene) for scene in ("pushed", make_scene("pushed")))
    assert named.actions.tobytes() == made.actions.tobytes()
    with pytest.raises(ValueError, match=r"the optimal gait needs .*: choose a scene"):
        Optimal(make_scene("level", max_hip_torque=0.001), made.gait)


def test_a_push_off_s_work_is_net_work_too():
    """All of it is work done, so what is charged in full and what is net are the same."""
    policy = gpw.load_policy("push-off-ppo")
    scene = make_scene(policy.scene, actions=("push_off",))

    class Pusher:
        """Pushes off, and does nothing else."""

        name = "pusher"

        def predict(self, seen, memory=None, *_, **__):
            """See `policies.Policy`."""
            return np.full((len(seen), 1), 0.3, np.float32), memory

    walks = simulate_episodes(Pusher(), PassiveWalkerVectorEnv(4, scene), seed=0)
    assert (walks.motor_work[walks.strides > 0] > 0.0).all() and (walks.strides > 0).any()
    np.testing.assert_allclose(walks.net_work, walks.motor_work, rtol=1e-12)


@pytest.mark.parametrize("control", ["stride", "tick"])
def test_the_optimum_of_a_compass_stated_by_its_masses_is_the_package_s_own(control):
    alike = {"slope": 0.02, "max_hip_torque": 0.1, "control": control, "tick": 0.1}
    scenes = {"system": DRIVEN} | alike, {"walker": STRAIGHT} | alike
    own, known = (gpw.optimal_gait(scene, 0.185) for scene in scenes)
    assert known.charged_cost > 1e-4 and own.optimality < 1e-6
    assert own.charged_cost == pytest.approx(known.charged_cost, rel=1e-9)
    assert own.cost_of_transport == pytest.approx(known.cost_of_transport, rel=1e-9)
    np.testing.assert_allclose(
        own.controller["hip"], known.dimensionless.controller.hip_torque, atol=1e-6
    )
    there = gpw.find_gait(gpw.stride_map(controller=own, scene=scenes[0]), guess=own.state)
    assert there.motor_cost == pytest.approx(own.motor_cost, rel=1e-9)


@pytest.mark.slow
def test_five_links_walk_by_their_four_optimal_torques():
    scene = {"system": FIVE_LINKS, "slope": 0.05, "control": "tick", "tick": 0.2}
    speed = 1.03 * gpw.find_gait(FIVE_LINKS, 0.05).speed
    found = gpw.optimal_gait(scene, speed)
    assert found.froude_speed == pytest.approx(speed) and 0.0 < found.motor_cost < 4e-4
    assert found.held.keys() == {*FIVE_LINKS.controls}
    walked = gpw.find_gait(gpw.stride_map(controller=found, scene=scene), guess=found.state)
    assert walked.motor_cost == pytest.approx(found.motor_cost, rel=1e-9)


def test_where_a_system_has_no_optimal_gait_an_error_says_why():
    with pytest.raises(ValueError, match="'compass' has none: give it a control"):
        gpw.optimal_gait({"system": COMPASS, "slope": 0.02}, 0.18)
    with pytest.raises(gpw.GaitNotFound, match="no passive gait of system 'compass'"):
        gpw.optimal_gait({"system": DRIVEN, "slope": -0.02}, 0.18)
    gait = gpw.optimal_gait({"system": DRIVEN, "slope": 0.02, "control": "stride"}, 0.18)
    with pytest.raises(ValueError, match="this function needs a walker"):
        gait.to_json()
