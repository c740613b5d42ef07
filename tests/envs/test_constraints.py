"""The checks of `reality_check` as rules of a scene."""

from __future__ import annotations

import gymnasium as gym
import numpy as np
import pytest

import gym_passive_walker as gpw
from examples.driven_torso import DRIVEN_TORSO
from examples.five_links import FIVE_LINKS
from gym_passive_walker.envs.constraints import READINGS
from gym_passive_walker.envs.registration import ID
from gym_passive_walker.gaits.scenes.checks import CHECKS
from gym_passive_walker.gaits.scenes.scene import make_scene

SLOPES = {"lab": 0.036, "C": 0.03, "A": 0.03, "D": 0.009}
MODELS = SLOPES | {DRIVEN_TORSO: 0.03, FIVE_LINKS: 0.05}


def str_of(walker):
    """Name of a walker in the names of tests."""
    return walker if isinstance(walker, str) else walker.name


def checks(walker, answer="report"):
    """All checks that there are of a walker."""
    there = gpw.as_walker(walker).knees
    return {check: answer for check in CHECKS if there or check != "knee lock"}


def world(walker, **changes):
    """A walker on its passive gait."""
    arguments = {
        "walker": walker,
        "slope": MODELS.get(walker),
        "reset_noise_scale": 0.0,
        "end_on_toe_stub": False,
    }
    return gym.make(ID, **arguments | changes).unwrapped


def walked(env, steps=200, action=0.0, **reset):
    """Infos of steps until a stride or an episode has ended."""
    env.reset(seed=0, **reset)
    infos = []
    for _ in range(steps):
        *_, info = env.step(np.full(env.action_space.shape, action))
        infos.append(info)
        if info["outcome"]:
            break
    return infos


@pytest.mark.parametrize("walker", MODELS, ids=str_of)
def test_readings_of_a_stride_are_those_of_the_reality_check(walker):
    gait = gpw.find_gait(walker, MODELS[walker])
    found = gpw.reality_check(walker, MODELS[walker], gait.state)
    env = world(walker, tick=0.02, tolerance=1e-12, constraints=checks(walker))
    infos = walked(env, 400, options={"state": gait.state})
    units = env.walker.units

    def least(name):
        return min(info[name] for info in infos)

    impulses = [found.heelstrike_impulse]
    if env.walker.knees:
        impulses.append(found.kneestrike_impulse)
        torque = found.stance_knee_torque.value / units.torque
        assert least("stance_knee_torque") == pytest.approx(torque, abs=2e-3)
        assert least("stance_knee_torque") >= torque - 1e-9
        struck = found.stance_knee_at_kneestrike.value, found.stance_knee_at_heelstrike.value
        scale = units.impulse * units.length
        assert least("stance_knee_impulse") == pytest.approx(min(struck) / scale, rel=1e-7)
    normal = min(impulse.normal_impulse for impulse in impulses)
    assert least("normal_impulse") == pytest.approx(normal / units.impulse, rel=1e-7)
    force = found.least_normal_force.value / units.force
    assert least("normal_force") == pytest.approx(force, abs=1e-3)
    assert least("normal_force") >= force - 1e-9
    needed = [found.stance_friction.value, *(impulse.needed_friction.value for impulse in impulses)]
    friction = max(info["friction"] for info in infos)
    assert friction == pytest.approx(max(needed), abs=1e-3)
    assert friction <= max(needed) + 1e-7
    lowest = min(info["clearance"] for info in infos[1:-1])
    passing = min(found.clearance.value, found.release_depth.value) / units.length
    assert lowest == pytest.approx(passing, abs=1e-3) or passing >= 0.0
    assert lowest >= passing - 1e-9


@pytest.mark.parametrize("walker", ["lab", "E", "D"])
def test_what_a_push_off_needs_of_the_leaving_foot_counts(walker):
    slope, push_off = {"lab": 0.03}.get(walker, 0.0), 0.02
    given = gpw.Actuation(push_off=push_off * gpw.WALKERS[walker].units.impulse)
    gait = gpw.find_gait(gpw.stride_map(walker, slope, controller=given))
    found = gpw.reality_check(gait)
    env = world(
        walker, slope=slope, tick=0.02, tolerance=1e-12, constraints=checks(walker),
        actions=("push_off",), max_push_off=push_off,
    )  # fmt: skip
    infos = walked(env, action=1.0, options={"state": gait.state})
    assert infos[-1]["outcome"] == "heelstrike"
    if env.walker.knees:
        scale = env.walker.units.impulse * env.walker.leg_length
        bent = found.stance_knee_at_push_off.value, found.stance_knee_at_heelstrike.value
        least = min(*bent, found.stance_knee_at_kneestrike.value) / scale
        assert infos[-1]["stance_knee_impulse"] >= least - 1e-9
        assert infos[-1]["stance_knee_impulse"] == pytest.approx(min(bent) / scale, rel=1e-6)
    impulses = found.heelstrike_impulse, found.push_off_impulse
    heel, push = (impulse.needed_friction.value for impulse in impulses)
    assert infos[-1]["friction"] >= max(heel, push) - 1e-9
    assert infos[-1]["friction"] == pytest.approx(max(heel, push), abs=0.02)


@pytest.mark.parametrize("walker", MODELS, ids=str_of)
def test_to_look_at_a_walker_changes_no_bit_of_its_walk(walker):
    watched, left = world(walker, constraints=checks(walker)), world(walker)
    watched.reset(seed=1), left.reset(seed=1)
    size = watched.action_space.shape
    for action in np.random.default_rng(0).uniform(-0.3, 0.3, (60, *size)):
        reported, expected = watched.step(action), left.step(action)
        assert reported[1:4] == expected[1:4]
        np.testing.assert_array_equal(watched.state, left.state)
        if reported[2]:
            break


@pytest.mark.parametrize(
    ("walker", "check", "limits", "outcome"),
    [
        ("lab", "friction", ({"friction": 0.51}, {"friction": 0.53}), "slipped"),
        ("lab", "knee lock", ({"knee_latch": 1e-3}, {"knee_latch": 2e-3}), "stance_knee_gave_way"),
        ("A", "scuffing", ({"scuff_depth": 4e-4}, {"scuff_depth": 1e-3}), "scuffed"),
    ],
)
def test_an_episode_ends_where_a_rule_is_broken_and_its_stride_is_worth_nothing(
    walker, check, limits, outcome
):
    broken, kept = (
        walked(world(walker, constraints={check: "end"}, tick=0.02, **limit), options=_gait(walker))
        for limit in limits
    )
    assert broken[-1]["outcome"] == outcome
    assert kept[-1]["outcome"] == "heelstrike"
    assert broken[-1]["strides"] == 0
    assert broken[-1]["episode_distance"] == pytest.approx(0.0, abs=1e-15)
    reported = [info[name] for info in kept for name in READINGS[check]]
    assert np.all(np.isfinite(reported) | (np.array(reported) == np.inf))


def _gait(walker):
    """Options that start a walker on its gait."""
    return {"state": gpw.find_gait(walker, SLOPES[walker]).state}


def test_a_strike_that_slips_ends_the_episode_though_the_foot_came_down():
    gait = gpw.find_gait("A", 0.03)
    needed = gpw.reality_check("A", 0.03, gait.state).heelstrike_impulse.needed_friction.value
    infos = walked(
        world("A", constraints={"friction": "end"}, friction=needed - 1e-3, control="stride"),
        options={"state": gait.state},
    )
    assert infos[-1]["outcome"] == "slipped"
    assert infos[-1]["strides"] == 0 and infos[-1]["distance"] == 0.0
    assert infos[-1]["friction"] == pytest.approx(needed, rel=1e-6)


def test_ground_that_would_have_to_pull_is_left():
    infos = walked(
        world("A", constraints={"contact": "end", "friction": "report"}),
        options={"state": [0.2, -0.2, -0.2, -1.3, -0.2, -0.2]},  # in walker A's units, too fast
    )
    assert infos[-1]["outcome"] == "lost_contact"
    assert infos[-1]["normal_force"] < 0.0
    assert infos[-1]["friction"] == np.inf


def test_what_the_ground_gives_at_a_strike_is_what_changes_the_momentum_push_off_included():
    """The simplest walker is a mass at its hip: its momentum and the push-off give the impulse."""
    env = world(
        "D", constraints={"contact": "report", "friction": "report"}, actions=("push_off",),
        control="stride", tolerance=1e-12,
    )  # fmt: skip
    plain = world("D", actions=("push_off",), control="stride", tolerance=1e-12)
    for push in (0.0, 0.3):
        info = walked(env, action=push)[-1]
        walked(plain, action=0.0)
        # Without a push-off the rate after is the old one times cos(2 angle).
        angle, rate = plain.batch.records[0, 0]["state"][[0, 3]]
        before = rate / np.cos(2.0 * angle)
        impulse = env.scene.max_push_off * push
        after = env.batch.records[0, 0]["state"][3]

        def velocity(angle, rate):
            return np.array([rate * np.cos(angle), -rate * np.sin(angle)])

        given = velocity(angle, after) - velocity(-angle, before)
        given -= impulse * np.array([np.sin(-angle), np.cos(angle)])
        assert info["normal_impulse"] == pytest.approx(given[1], rel=1e-8)
        assert info["friction"] >= abs(given[0] / given[1]) * (1.0 - 1e-9)


def test_straight_legs_have_no_knee_to_lock():
    with pytest.raises(ValueError, match="'knee lock' is a check of walkers with knees"):
        world("A", constraints={"knee lock": "end"})


def test_clearance_is_measured_over_the_lower_of_two_footholds():
    """Where the ground steps down there is that much more room; where it steps up, no more."""
    gait = gpw.find_gait("C", 0.03)
    reported = []
    for rise in (0.0, -0.01, 0.01):
        ahead = {"footholds": {"heights": [0.0, rise, rise]}}
        env = world("C", tick=0.02, terrain=ahead, constraints=checks("C"))
        infos = walked(env, steps=40, options={"state": gait.state})
        reported.append(np.array([info["clearance"] for info in infos[:30]]))
    smooth, down, up = reported
    np.testing.assert_allclose(down, smooth + 0.01, atol=1e-12)
    np.testing.assert_allclose(up, smooth, atol=1e-12)


def test_a_constraint_that_is_ignored_is_as_one_that_is_not_named():
    scene = make_scene(constraints={"contact": "ignore", "friction": "report"})
    assert scene == make_scene(constraints={"friction": "report"})
    assert make_scene(constraints={"contact": "ignore"}) == make_scene()
    assert make_scene("level", constraints={"knee lock": "ignore"}) == make_scene("level")


@pytest.mark.parametrize(
    ("answers", "outcome"),
    [
        ({"contact": "end", "friction": "end"}, "lost_contact"),
        ({"friction": "end", "contact": "end"}, "lost_contact"),
        ({"contact": "report", "friction": "end"}, "slipped"),
        ({"contact": "end", "friction": "report"}, "lost_contact"),
        ({"friction": "end"}, "slipped"),
    ],
)
def test_of_constraints_that_are_broken_at_once_the_most_severe_ends_the_episode(answers, outcome):
    """Ground that would have to pull bears no friction either."""
    state = [0.2, -0.2, -0.2, -1.3, -0.2, -0.2]
    infos = walked(world("A", constraints=answers), options={"state": state})
    assert infos[-1]["outcome"] == outcome
    names = {name for check in answers for name in READINGS[check]}
    assert names <= infos[-1].keys() and not ({"clearance"} & infos[-1].keys())
    assert infos[-1]["friction"] == np.inf
