"""What else an agent may act by: the push-off and the ankle beside the hip."""

from __future__ import annotations

import gymnasium as gym
import numpy as np
import pytest

import gym_passive_walker as gpw
from gym_passive_walker.gaits.control.baselines import ConstantTorque
from gym_passive_walker.gaits.scenes.scene import make_scene

KINDS = {"straight": ("E", 0.01), "simplest": ("D", 0.009)}
ALL = ("push_off", "ankle", "hip")


def world(kind: str, **changes):
    """A world in which a stride is a step, and an action is everything at once."""
    walker, slope = KINDS[kind]
    start = tuple(gpw.find_gait(walker, 0.01).state)
    start = (*start[:3], *(np.array(start[3:]) * gpw.WALKERS[walker].units.time).tolist())
    arguments = {
        "walker": walker, "slope": slope, "control": "stride", "actions": ALL,
        "reset_noise_scale": 0.0, "tolerance": 1e-12, "end_on_toe_stub": False, "start": start,
    }  # fmt: skip
    return gym.make("PassiveWalker-v0", **arguments | changes).unwrapped


@pytest.mark.parametrize("kind", KINDS)
def test_a_stride_by_all_actions_is_the_stride_map_and_pays_for_each(kind):
    env = world(kind)
    env.reset(seed=0)
    units, state = env.walker.units, env.state
    _, reward, _, _, info = env.step(np.array([0.2, 0.1, -0.1]))
    walk = gpw.stride(
        env.walker, env.slope, state, tolerance=1e-12,
        push_off=0.2 * 0.2 * units.impulse, ankle_torque=0.1 * 0.05 * units.energy,
        hip_torque=-0.1 * 0.03 * units.torque,
    )  # fmt: skip
    assert info["outcome"] == "heelstrike"
    np.testing.assert_allclose(env.state, walk.state, rtol=1e-12)
    way = walk.weight * walk.step_length
    assert info["push_off_cost"] == pytest.approx(walk.push_off_work / way, rel=1e-10)
    assert info["ankle_cost"] == pytest.approx(walk.ankle_work_absolute / way, rel=1e-10)
    assert info["net_ankle_cost"] == pytest.approx(walk.ankle_work / way, rel=1e-10)
    assert info["hip_cost"] == pytest.approx(walk.hip_work_absolute / way, rel=1e-10, abs=1e-15)
    spent = walk.push_off_work + walk.ankle_work_absolute + walk.hip_work_absolute
    assert info["energy"] == pytest.approx(spent / units.energy, rel=1e-10)
    assert reward == pytest.approx(info["distance"] - 10.0 * info["energy"], rel=1e-12)
    whole = sum(info[f"{name}_cost"] for name in ("gravity", "hip", "ankle", "push_off"))
    assert info["cost_of_transport"] == pytest.approx(whole, rel=1e-12)


def test_of_a_stride_s_push_offs_the_last_one_counts():
    walks = []
    for shares in ((0.0, 0.3), (0.3, 0.3)):
        env = gym.make(
            "PassiveWalker-v0", walker="D", slope=0.009, actions=("push_off",),
            reset_noise_scale=0.0,
            tick=0.5,
        ).unwrapped  # fmt: skip
        env.reset(seed=0)
        info, steps = {}, 0
        while not info.get("outcome"):
            early = env.batch.records["time"][0, 0] < 1.0
            *_, info = env.step(np.array([shares[0] if early else shares[1]]))
            steps += 1
        walks.append((steps, env.state, info["push_off_cost"]))
    assert walks[0][0] > 2
    np.testing.assert_array_equal(walks[0][1], walks[1][1])
    assert walks[0][2] == walks[1][2] > 0.0


def test_without_action_it_is_the_passive_walk():
    """The code for all motors, at rest, and that of the hip alone: to the last bit."""
    observations = []
    for actions in (("hip",), ("hip", "push_off")):
        scene = make_scene("lab", actions=actions, reset_noise_scale=0.0)
        env = gym.make("PassiveWalker-v0", scene=scene)
        seen, _ = env.reset(seed=1)
        for _ in range(60):
            action, _ = ConstantTorque(0.0, scene).predict(seen)
            seen, *_ = env.step(action)
        observations.append(seen)
    np.testing.assert_array_equal(*observations)
