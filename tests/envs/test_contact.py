"""Where feet touch the ground, and what friction they need, by statics and kinematics of school.

A foot that rolls without slipping has its contact for its centre of rotation, so the hip moves
across the line from there; and over all strikes the hip is where it was.
"""

import math

import numpy as np
import pytest

import gym_passive_walker as gpw
from gym_passive_walker.envs.vector_env import PassiveWalkerVectorEnv
from gym_passive_walker.pictures.pose import pose

GROUNDS = {
    "smooth": None,
    "turned": gpw.footholds(slopes=[0.0, 0.02, -0.015, 0.01, 0.0, 0.02, 0.0, 0.01]),
    "stairs": gpw.stairs(-0.002),
    "rough": gpw.rough(0.001, 0.01),
}
SPIN = np.array([[0.0, -1.0], [1.0, 0.0]])  # a quarter turn, against the clock


def moves(hips, contacts, rates, spans):
    """Demand that hips go where rotations about the contacts take them."""
    ways = np.diff(hips, axis=0)
    before, after = (rates[i][:, None] * ((hips - contacts)[i] @ SPIN.T) for i in
                     (slice(None, -1), slice(1, None)))  # fmt: skip
    smooth = np.abs(after - before).max(axis=1) < 0.05  # else there was a strike
    assert smooth.mean() > 0.9
    expected = 0.5 * spans[:, None] * (before + after)
    np.testing.assert_allclose(ways[smooth], expected[smooth], atol=2e-5)
    # Over a strike the hip goes on from where it was.
    bound = 1.5 * spans * np.abs(np.concatenate([before, after], axis=1)).max(axis=1) + 1e-9
    assert np.all(np.linalg.norm(ways, axis=1) <= bound)


@pytest.mark.parametrize("ground", GROUNDS)
@pytest.mark.parametrize("walker", ["lab", "B", "E"])
def test_a_simulated_foot_rolls_forwards_on_ground_as_it_lies(walker, ground):
    slope = {"lab": 0.036, "B": 0.03, "E": 0.03}[walker]
    start = gpw.find_gait(walker, slope).state
    walk = gpw.simulate(
        walker, slope, start, 5, samples=200, terrain=GROUNDS[ground], terrain_seed=3
    )
    at = pose(walker, walk.states, walk.contact_x, walk.contact_y, walk.tilts)
    contacts = np.column_stack([walk.contact_x, walk.contact_y])
    moves(np.asarray(at.hip), contacts, walk.states[:, 3], np.diff(walk.times))
    assert len(walk.outcomes) >= 3 and walk.contact_x[-1] > 2.0 * walk.states[0, 0]


@pytest.mark.parametrize("ground", GROUNDS)
@pytest.mark.parametrize("walker", ["lab", "B", "E"])
def test_a_foot_in_the_environment_rolls_forwards_on_ground_as_it_lies(walker, ground):
    slope = {"lab": 0.036, "B": 0.03, "E": 0.03}[walker]
    env = PassiveWalkerVectorEnv(
        2, walker=walker, slope=slope, terrain=GROUNDS[ground], tick=0.01, max_hip_torque=0.0,
        reset_noise_scale=0.0,
    )  # fmt: skip
    env.reset(seed=1)
    one, rows, elapsed = env.walkers[1], [], 0.0
    for _ in range(1400):
        contact = env.batch.contact(1)
        hip = pose(one, env.states[1], contact.x, contact.y, contact.tilt).hip
        rows.append((*hip, contact.x, contact.y, env.states[1, 3], elapsed))
        before = env.batch.records["time"][1, 0]
        infos = env.step(np.zeros((2, 1), np.float32))[-1]
        if infos["outcome"][1]:
            if infos["outcome"][1] != "heelstrike":
                break
            elapsed += (infos["step_period"][1] - before) * one.time_unit
        else:
            elapsed += (env.batch.records["time"][1, 0] - before) * one.time_unit
    table = np.array(rows)
    assert len(table) > 500
    moves(table[:, :2], table[:, 2:4], table[:, 4], np.diff(table[:, 5]))


def pushed_by(stance, friction=0.8, rate=-0.3):
    """A step of a mass on a leg without any, which stands at an angle: its info and outcome."""
    env = PassiveWalkerVectorEnv(
        1, walker="D", slope=0.009, tick=1e-3, max_hip_torque=0.0, friction=friction,
        constraints={"friction": "end", "contact": "report"},
    )  # fmt: skip
    state = [stance, -0.4, -0.4, rate, 0.1, 0.1]
    env.reset(seed=0, options={"state": state})
    *_, fell, _, infos = env.step(np.zeros((1, 1), np.float32))
    return infos["friction"][0], bool(fell[0]), infos["outcome"][0]


@pytest.mark.parametrize("stance", [0.3, 0.1, -0.1, -0.3])
def test_friction_is_needed_along_the_leg_before_mid_stance_as_after_it(stance):
    """A leg without mass bears force along itself alone: the ratio is the tangent of its angle."""
    needed, fell, _ = pushed_by(stance)
    assert needed == pytest.approx(abs(math.tan(stance)), rel=1e-2) and not fell
    limit = abs(math.tan(stance))
    assert pushed_by(stance, friction=0.98 * limit)[1:] == (True, "slipped")
    assert not pushed_by(stance, friction=1.02 * limit)[1]


@pytest.mark.parametrize("share", [0.997, 1.003])
def test_a_gait_s_friction_is_that_of_its_steepest_leg_at_either_end(share):
    """Of a step that begins steeper than it ends the start counts, else the end."""
    gait = gpw.find_gait("D", 0.009)
    start = gait.state * np.array([share, share, share, 1.0, 1.0, 1.0])
    ended = gpw.stride("D", 0.009, start)
    assert ended.outcome == gpw.Outcome.HEELSTRIKE
    found = gpw.reality_check("D", 0.009, start)
    steepest = max(start[0], float(ended.state[0]))
    assert (ended.state[0] > start[0]) == (share < 1.0)
    assert found.stance_friction.value == pytest.approx(math.tan(steepest), rel=1e-6)
    held, slips = (gpw.reality_check("D", 0.009, start, friction=x * math.tan(steepest))
                   for x in (1.01, 0.99))  # fmt: skip
    assert not slips.passed["friction"]
    assert held.stance_friction.value < held.friction
