"""Walking over ground that is not smooth, in the environments."""

from __future__ import annotations

import gymnasium as gym
import numpy as np
import pytest

import gym_passive_walker as gpw

ROUGH = {"walker": "C", "slope": 0.05, "terrain": gpw.rough(0.002, 0.004)}
STRIDES = {**ROUGH, "control": "stride", "max_hip_torque": 0.0, "end_on_toe_stub": False}


def walk(env, steps, seed=3):
    """Observations and rewards of a walk without torque, until it ends."""
    seen, _ = env.reset(seed=seed)
    observations, rewards, infos = [seen], [], []
    for _ in range(steps):
        seen, reward, terminated, truncated, info = env.step(0.0 * env.action_space.sample())
        observations.append(seen)
        rewards.append(reward)
        infos.append(info)
        if np.any(terminated) or np.any(truncated):
            break
    return np.array(observations), np.array(rewards), infos


def test_a_walk_in_the_environment_is_the_walk_over_the_same_footholds():
    env = gym.make("PassiveWalker-v0", **STRIDES, reset_noise_scale=0.0, disable_env_checker=True)
    observations, _, infos = walk(env, 25)
    batch = env.unwrapped.batch
    key = int(batch.disturbances.states["key"][0])
    state, terrain = gpw.find_gait("C", 0.05).state, STRIDES["terrain"]
    trajectory = gpw.simulate("C", 0.05, state, len(infos), terrain=terrain, terrain_seed=key)
    made = sum(info.get("outcome") == "heelstrike" for info in infos)
    assert made >= 5
    first = np.flatnonzero(np.diff(trajectory.stride_index, prepend=-1))[: made + 1]
    own = trajectory.states[first]
    np.testing.assert_allclose(observations[: len(own), :3], own[:, :3], atol=2e-6)
    np.testing.assert_allclose(
        observations[: len(own), 7], 0.05 + trajectory.tilts[first], atol=1e-7
    )


def test_both_legs_meet_at_the_hip_where_a_foot_comes_down_on_a_slope_of_its_own():
    """However the ground tilts there, and wherever a round foot touches it."""
    ground = {"heights": [0.0, 0.002, 0.0, 0.001], "slopes": [0.0, 0.01, -0.01, 0.02]}
    given = STRIDES | {"walker": "lab", "slope": 0.036, "terrain": {"footholds": ground}}
    env = gym.make("PassiveWalker-v0", **given, reset_noise_scale=0.0, disable_env_checker=True)
    env.reset(seed=0)
    batch, body = env.unwrapped.batch, gpw.WALKERS["lab"].body
    radius, leg = body.foot_radius, body.leg
    disturbance, record = batch.disturbances.states[0], batch.records[0, 0]

    def hip(x, y, tilt, angle):
        along, up = -leg * np.sin(angle), radius + leg * np.cos(angle)
        sine, cosine = np.sin(tilt), np.cos(tilt)
        return x + along * cosine + up * sine, y + up * cosine - along * sine

    for _ in range(3):
        began, (x, y, tilt) = (
            record["state"][0],
            (float(disturbance[name]) for name in ("x", "y", "tilt")),
        )
        env.step(np.zeros(1))
        assert record["outcome"] == gpw.Outcome.HEELSTRIKE
        stood = (
            record["state"][1] + tilt - float(disturbance["tilt"])
        )  # on the patch that it leaves
        rolled = radius * (began - stood)
        there = hip(x + rolled * np.cos(tilt), y - rolled * np.sin(tilt), tilt, stood)
        here = hip(*(float(disturbance[name]) for name in ("x", "y", "tilt")), record["state"][0])
        np.testing.assert_allclose(here, there, atol=1e-9)


def test_agents_see_the_footholds_ahead():
    env = gym.make("PassiveWalker-v0", **STRIDES, terrain_lookahead=3)
    observations, _, infos = walk(env, 8)
    key = env.unwrapped.batch.disturbances.states["key"][0]
    terrain = STRIDES["terrain"]
    for place in range(len(infos)):
        ahead = terrain.ground(key, np.arange(place, place + 3))[:, 1:]
        np.testing.assert_allclose(observations[place][8:], ahead.ravel(), rtol=1e-6, atol=1e-9)
    assert env.observation_space.shape == (14,)
    np.testing.assert_allclose(env.observation_space.high[8:], 3 * [1.0, np.pi / 2], rtol=1e-6)
    assert env.observation_space.contains(observations[0])


def test_walkers_of_one_scene_meet_ground_of_their_own():
    many = gym.make_vec("PassiveWalker-v0", num_envs=4, **STRIDES, terrain_lookahead=1)
    seen, _ = many.reset(seed=0)
    assert len({x for x in seen[:, 8].tolist()}) == 4


def test_smooth_terrain_changes_a_walk_by_no_more_than_rounding():
    smooth = {"walker": "C", "slope": 0.05}
    level = walk(gym.make("PassiveWalker-v0", **smooth), 40)[0]
    other = walk(gym.make("PassiveWalker-v0", **smooth, terrain=gpw.rough(0.0)), 40)[0]
    np.testing.assert_allclose(level, other, atol=2e-6)


def test_a_flight_of_stairs_leads_down_as_far_as_a_slope():
    """Downstairs on level ground: what gravity gives is the height of the steps."""
    gait = gpw.find_gait("D", 0.01)
    angles, rates = gait.state[:3] - 0.01, gait.state[3:] * gait.walker.time_unit
    drop = gait.step_length * np.sin(0.01)
    env = gym.make(
        "PassiveWalker-v0", walker="D", slope=0.0, terrain={"stairs": {"rise": -drop}},
        control="stride", max_hip_torque=0.0, reset_noise_scale=0.0,
        start=(*angles, *rates),
    )  # fmt: skip
    _, _, infos = walk(env, 6)
    height = drop / gait.walker.leg_length
    struck = [info for info in infos if info.get("outcome") == "heelstrike"]
    assert struck
    for info in struck:
        assert info["gravity_cost"] * info["step_length"] == pytest.approx(height, rel=1e-6)


def test_a_slope_that_is_set_stays_and_footholds_slope_about_it():
    env = gym.make("PassiveWalker-v0", **STRIDES, reset_noise_scale=0.0, disable_env_checker=True)
    seen, _ = env.reset(seed=3)
    terrain, key = STRIDES["terrain"], int(env.unwrapped.batch.disturbances.states["key"][0])
    tilts = terrain.ground(key, np.arange(4))[:, 0]
    assert seen[7] == pytest.approx(0.05 + tilts[0], abs=1e-7)
    slopes = [env.unwrapped.set_slope(0.052)[7]]
    while len(slopes) < 4:
        slopes.append(env.step(np.zeros(1, np.float32))[0][7])
    assert np.ptp(tilts) > 1e-3
    np.testing.assert_allclose(slopes, 0.052 + tilts, atol=1e-7)
