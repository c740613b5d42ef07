"""An environment's pictures show what its infos report."""

import itertools

import gymnasium as gym
import numpy as np
import pytest

import gym_passive_walker as gpw
from gym_passive_walker.envs import frames
from gym_passive_walker.envs.vector_env import PassiveWalkerVectorEnv
from gym_passive_walker.envs.walker_env import PassiveWalkerEnv
from gym_passive_walker.pictures import ground as drawn_ground
from gym_passive_walker.pictures import tiled
from tests.own.statements import DRIVEN

pytest.importorskip("pygame")


class Listener:
    """A screen that keeps what it was asked to draw."""

    seen = 1.0

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


def heard_of(env, lane=0):
    """What is drawn of one of the walkers of an environment."""
    listener = Listener()
    listener.seen = 3.0
    frames.frame(env.batch, lane, listener)
    return listener


def test_each_picture_of_a_batch_is_of_its_own_walker():
    walkers, slopes = ["C", "lab", "C"], [0.01, 0.036, 0.03]
    env = PassiveWalkerVectorEnv(3, walkers=walkers, slopes=slopes, slope=0.02)
    env.reset(seed=0)
    shares = np.array([[0.1], [-0.2], [0.05]])
    for _ in range(25):
        *_, infos = env.step(shares)
    for lane, (name, slope) in enumerate(zip(walkers, slopes, strict=True)):
        alone = PassiveWalkerEnv(walker=name, slope=slope)
        alone.reset(seed=lane)
        time = 0.0
        for _ in range(25):
            *_, info = alone.step(shares[lane])
            record = alone.batch.records[0, 0]
            time = float(alone.batch.ledger["clock"][0] + record["time"])
        one, other = heard_of(alone), heard_of(env, lane)
        assert f"{lane + 1}: walker {name}" in other.said
        assert other.said.replace(f"{lane + 1}: ", "") == one.said
        assert f"slope {slope:.3f} rad" in other.said
        assert f"speed {infos['episode_distance'][lane] / time:.3f} " in other.said
        assert f"hip torque {0.05 * shares[lane, 0]:+.3f} m g l" in other.said
        assert f"leg length l = {gpw.WALKERS[name].leg_length:.3g}" in other.said
        for key in ("slope", "strides", "push", "torque", "contact_y", "tilt"):
            assert other.given[key] == one.given[key], key
        np.testing.assert_array_equal(other.given["state"], one.given["state"])
        np.testing.assert_allclose(other.given["state"], env.states[lane])
        assert other.given["strides"] == infos["strides"][lane] == info["strides"]
        assert f"stride {info['strides'] + 1} |" in other.said
        assert "1: " not in one.said


def test_two_walkers_are_numbered_and_one_is_not():
    for count in (1, 2):
        env = PassiveWalkerVectorEnv(count)
        env.reset(seed=0)
        said = [heard_of(env, lane).said for lane in range(count)]
        assert [text.startswith(f"{k + 1}: ") for k, text in enumerate(said)] == [count > 1] * count


def test_the_cost_within_a_stride_counts_gravity_up_to_now_and_all_energy():
    """Gravity does the hip's work of the slope over the distance; at heelstrikes it is exact."""
    env = PassiveWalkerEnv("lab", reset_noise_scale=0.0)
    env.reset(seed=0)
    energy = fallen = began = 0.0
    for k in range(60):
        *_, info = env.step(np.array([0.3 * (-1) ** k], np.float32))
        energy += info["energy"]
        if info.get("outcome") == "heelstrike":
            fallen, began = fallen + info["gravity_cost"] * info["step_length"], 0.0
        else:
            began += info["distance"]
        cost = (fallen + np.sin(0.036) * began + energy) / info["episode_distance"]
        assert f"cost of transport {cost:.4f} " in heard_of(env).said + " "
    assert info["strides"] >= 1 and energy > 0.0


@pytest.mark.parametrize(("impulse", "sign"), [(-0.004, -1.0), (0.004, 1.0)])
def test_the_arrow_of_a_push_has_its_direction_and_its_share(impulse, sign):
    ends = min(0.0, impulse), max(0.0, impulse)
    env = PassiveWalkerEnv("lab", pushes={"rate": 2.0, "impulse": ends})
    env.reset(seed=0)
    shown = []
    for _ in range(30):
        env.step(np.zeros(1, np.float32))
        shown.append(heard_of(env).given["push"])
        total = float(env.batch.disturbances.states["impulse"][0])
        assert shown[-1] == pytest.approx(total / max(abs(total), abs(impulse)))
    assert any(shown) and all(push * sign >= 0.0 for push in shown)


def test_torques_are_in_the_unit_of_the_walker_and_of_a_system_its_controls():
    _, _, heard = walked(1, walker="D", slope=0.009, max_hip_torque=0.02)
    assert "hip torque +0.008 g l a foot mass" in heard.said
    env = PassiveWalkerEnv(system=DRIVEN, start=(0.24, -0.24, -0.31, -0.17), max_hip_torque=0.03)
    env.reset(seed=0)
    env.step(np.array([-0.5], np.float32))
    heard = heard_of(env)
    held = -0.5 * env.scene.largest("hip")
    assert heard.said.startswith("walker compass | ") and f"hip {held:+.3f}" in heard.said
    assert "torque" not in heard.said
    assert heard.given["torque"] == 0.0


def test_a_passive_walker_s_torque_is_no_share():
    _, _, heard = walked(2, scene="lab", max_hip_torque=0.0)
    assert heard.given["torque"] == 0.0 and "hip torque +0.000 m g l" in heard.said


@pytest.mark.parametrize("name", ["lab", "E"])
def test_the_ground_in_a_picture_is_the_one_that_was_walked_on(name):
    """Contact, tilt and profile are in the walker's lengths and go through the footholds."""
    ground = {"slope": 0.036 if name == "lab" else 0.009, "reset_noise_scale": 0.0}
    rough = {"rough": {"height_std": 0.0005, "slope_std": 0.002}} if name == "lab" else {
        "rough": {"height_std": 0.0005}}  # fmt: skip
    env = PassiveWalkerEnv(walker=name, terrain=rough, **ground)
    env.reset(seed=1)
    places = []
    for _ in range(120):
        *_, ended, _, _ = env.step(np.zeros(1, np.float32))
        if ended:
            break
        state = env.batch.disturbances.states[0]
        heard = heard_of(env)
        contact = env.batch.contact(0)
        assert heard.given["tilt"] == state["tilt"] == contact.tilt
        assert heard.given["contact_y"] == contact.y
        assert heard.given["slope"] == pytest.approx(ground["slope"], abs=1e-12)
        places.append((float(state["x"]), float(state["y"])))
        profile = np.asarray(heard.given["profile"])
        xs, ys = profile.T
        passed = [place for k, place in enumerate(places) if place not in places[:k]]
        for x, y in passed[-3:]:
            x, y = x * env.walker.leg_length, y * env.walker.leg_length
            if xs.min() < x < xs.max():
                nearest = np.interp(x, xs, ys)
                assert nearest == pytest.approx(y, abs=2e-4 * env.walker.leg_length)
        around = x + 1e-4 * np.array([-1.0, 1.0])  # of the present foothold
        assert np.diff(np.interp(around, xs, ys)) / 2e-4 == pytest.approx(
            -np.tan(contact.tilt), abs=1e-6
        )
    assert len({*places}) >= 3


def test_the_ground_ahead_is_as_far_as_usual_steps_lead(monkeypatch):
    """A usual step is that of the stance angle with which the stride began."""
    asked = []
    monkeypatch.setattr(drawn_ground, "profile", lambda *given: asked.append(given[-1]))
    env, *_ = walked(3, scene="rough")
    angle = env.batch.records["start"][0, 0, 0]
    heard_of(env)
    assert asked[-1] == pytest.approx(2.0 * env.walker.leg_length * abs(float(angle)), rel=1e-12)
    assert asked[-1] > 0.1 * env.walker.leg_length
