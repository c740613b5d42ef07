"""An environment's pictures show what its infos report."""

import itertools

import gymnasium as gym
import numpy as np
import pytest

import gym_passive_walker as gpw
from gym_passive_walker.envs import frames
from gym_passive_walker.envs.walker_env import PassiveWalkerEnv
from gym_passive_walker.render import tiled

pytest.importorskip("pygame")


class Listener:
    """A screen that keeps what it was asked to draw."""

    def draw(self, state, slope, contact_x, strides, **given):
        """Keep it."""
        self.given = {"state": state, "slope": slope, "strides": strides, **given}
        left, right = given["notes"]
        self.said = " | ".join((*left, *right))


def walked(steps, share=0.4, **scene):
    """An environment after some steps with a share of the torque, and what happened in them."""
    env = PassiveWalkerEnv(**scene)
    env.reset(seed=1)
    infos = []
    for _ in range(steps):
        *_, terminated, _, info = env.step(np.array([share], np.float32))
        infos.append(info)
        if terminated:
            break
    listener = Listener()
    frames.frame(env.batch, 0, listener)
    return env, infos, listener


def test_time_speed_and_cost_are_those_of_the_episode():
    _, infos, heard = walked(5, 0.05, scene="lab", control="stride")
    time, way = sum(i["step_period"] for i in infos), infos[-1]["episode_distance"]  # of the hip
    cost = sum(i["cost_of_transport"] * i["step_length"] for i in infos) / way
    assert f"time {time:.1f} √(l/g)" in heard.said
    assert f"speed {way / time:.3f} √(g l)" in heard.said
    assert f"cost of transport {cost:.4f}" in heard.said
    assert f"stride {len(infos) + 1}" in heard.said


def test_slope_and_torque_are_shown_and_the_arrow_is_a_share_of_the_largest():
    env, _, heard = walked(3, scene="lab")
    assert "walker lab" in heard.said and "slope 0.036 rad" in heard.said
    assert heard.given["torque"] == pytest.approx(0.4)
    assert f"hip torque {0.4 * env.scene.max_hip_torque:+.3f} m g l" in heard.said


def test_a_push_is_shown_in_the_step_in_which_it_comes():
    env, _, heard = walked(0, scene="lab", pushes={"rate": 0.5, "impulse": (-0.004, 0.002)})
    shown = []
    for _ in range(40):
        *_, info = env.step(np.zeros(1, np.float32))
        frames.frame(env.batch, 0, heard)
        shown.append((heard.given["push"], info["push_work"]))
    pushes, works = np.transpose(shown)
    np.testing.assert_array_equal(pushes != 0.0, works != 0.0)
    assert (pushes != 0.0).sum() >= 3 and np.abs(pushes).max() <= 1.0


def test_a_fall_is_shown_in_words():
    _env, infos, heard = walked(400, scene="lab")
    assert heard.given["warning"] == infos[-1]["outcome"].replace("_", " ") != ""


def test_a_walker_that_has_not_moved_has_no_speed_and_no_cost():
    _, _, heard = walked(0, scene="lab")
    assert "speed –" in heard.said and "cost of transport –" in heard.said


def test_frames_of_many_make_one_picture_of_a_film_s_size():
    envs = gym.make_vec("PassiveWalker-v0", num_envs=10, scene="rolling", render_mode="rgb_array")
    envs.reset(seed=0)
    envs.step(envs.action_space.sample())
    pictures = envs.render()
    assert len(pictures) == 10 and all(np.shape(p) == np.shape(pictures[0]) for p in pictures)
    height, width, _ = tiled(pictures).shape
    assert 1500 <= width <= 1600 and height % 2 == width % 2 == 0
    assert any((a != b).any() for a, b in itertools.pairwise(pictures))
    envs.close()


def test_gymnasium_s_wrappers_film_one_walker_and_many(tmp_path):
    pytest.importorskip("moviepy")
    from gymnasium.wrappers import RecordVideo, vector

    if not hasattr(vector, "RecordVideo"):
        pytest.skip("this Gymnasium records no vector environments")

    one = gym.make("PassiveWalker-v0", scene="lab", render_mode="rgb_array")
    one = RecordVideo(one, str(tmp_path / "one"), episode_trigger=lambda _: True)
    many = gym.make_vec("PassiveWalker-v0", num_envs=4, scene="lab", render_mode="rgb_array")
    many = vector.RecordVideo(many, str(tmp_path / "many"), episode_trigger=lambda _: True)
    for envs in (one, many):
        envs.reset(seed=0)
        for _ in range(3):
            envs.step(envs.action_space.sample() * 0.0)
        envs.close()
    for folder in ("one", "many"):
        (video,) = (tmp_path / folder).glob("*.mp4")
        assert video.stat().st_size > 1000


def test_pictures_change_no_walk():
    drawn, blind = (PassiveWalkerEnv("lab", render_mode=mode) for mode in ("rgb_array", None))
    for env in (drawn, blind):
        env.reset(seed=2)
    for _ in range(20):
        action = np.array([0.2], np.float32)
        seen, *_ = drawn.step(action)
        drawn.render()
        np.testing.assert_array_equal(seen, blind.step(action)[0])


def test_the_name_of_a_walker_is_shown():
    _, _, heard = walked(1, walker=gpw.tune("C"), slope=0.05)
    assert "walker C (tuned)" in heard.said
