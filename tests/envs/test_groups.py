"""Observations of actor and critic: `observation={"policy": ..., "critic": ...}`."""

import copy
import pickle
import re

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import gym_passive_walker as gpw
from gym_passive_walker.envs.explain import as_rows
from gym_passive_walker.envs.sb3 import PassiveWalkerVecEnv
from gym_passive_walker.envs.vector_env import PassiveWalkerVectorEnv
from gym_passive_walker.envs.walker_env import PassiveWalkerEnv
from gym_passive_walker.gaits.scenes.named import outside
from gym_passive_walker.gaits.scenes.scene import Scene, SceneError, make_scene, seen_by_policy


def hips(step):
    state = step.state
    return state.stance, state.thigh, state.stance_rate, state.thigh_rate


def ground(step):
    return step.slope


def shaken(step):
    """Cannot be traced: a condition on a number."""
    return 1.0 if step.push > 0.0 else -1.0


RANDOM = {"domain_randomization": {"foot_radius": 0.2, "max_hip_torque": (0.5, 1.0)}}
SCENE = {
    "observation": {"policy": hips, "critic": ("default", "randomized", ground)},
    "slope": (0.0, 0.02), "observation_noise": 0.01, **RANDOM,
}  # fmt: skip


def test_each_group_has_its_parts_in_order():
    kinds = SCENE["observation"], None, hips
    env, plain, other = envs = [
        PassiveWalkerEnv(SCENE | {"observation": k, "observation_noise": 0.01 * (k != hips)})
        for k in kinds
    ]
    assert env.observation_space["policy"].shape == (4,)
    assert env.observation_space["critic"].shape == (8 + 2 + 1,)
    (seen, info), (own, _), (state, _) = (each.reset(seed=3) for each in envs)
    low, high = 0.8 * gpw.WALKERS["C"].foot_radius, 1.2 * gpw.WALKERS["C"].foot_radius
    shares = [
        (info["randomized"]["foot_radius"] - low) / (high - low),
        (info["randomized"]["max_hip_torque"] - 0.025) / 0.025,
    ]
    for _ in range(4):
        assert {*seen} == {"policy", "critic"}
        np.testing.assert_array_equal(seen["policy"], state)
        np.testing.assert_array_equal(seen["critic"][:8], own)  # with its noise
        np.testing.assert_allclose(seen["critic"][8:10], 2.0 * np.array(shares) - 1.0, atol=1e-6)
        assert seen["critic"][10] == pytest.approx(env.slope)
        seen, own, state = (each.step(np.full(1, 0.4, np.float32))[0] for each in envs)
    assert plain.observation_space.shape == (8,) and other.observation_space.shape == (4,)


@pytest.mark.filterwarnings("ignore:.*observation space m.*infinity")
def test_gymnasium_finds_its_specification_met():
    check_env(PassiveWalkerEnv(SCENE), skip_render_check=True)


@pytest.mark.filterwarnings("ignore:observation cannot be compiled")
@pytest.mark.parametrize("critic", [ground, shaken, ("default", "randomized", shaken, hips)])
@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
def test_vector_environments_observe_as_single_ones(critic, mode):
    noise = 0.01 * isinstance(critic, tuple)  # of the default part
    scene = SCENE | {
        "observation": {"policy": hips, "critic": critic}, "observation_noise": noise,
    }  # fmt: skip
    many = PassiveWalkerVectorEnv(3, scene, autoreset_mode=mode, max_episode_steps=5)
    singles = gym.vector.SyncVectorEnv(
        [lambda: gym.make("PassiveWalker-v0", scene=scene, max_episode_steps=5)] * 3,
        autoreset_mode=mode,
    )
    seen, known = many.reset(seed=1)[0], singles.reset(seed=1)[0]
    random = np.random.default_rng(0)
    for _ in range(12):
        for name in ("policy", "critic"):
            np.testing.assert_array_equal(seen[name], known[name])
        actions = random.uniform(-1.0, 1.0, (3, 1)).astype(np.float32)
        (seen, *_, infos), (known, *_, others) = many.step(actions), singles.step(actions)
        if "final_obs" in infos:
            for one, other in zip(infos["final_obs"], others["final_obs"], strict=True):
                assert {*one} == {*other}
                assert all(np.array_equal(one[name], other[name]) for name in one)


def test_stable_baselines3_gets_groups():
    checked = pytest.importorskip("stable_baselines3.common.env_checker")
    checked.check_env(PassiveWalkerEnv(SCENE), skip_render_check=True)
    envs = PassiveWalkerVecEnv(2, SCENE, seed=0, max_episode_steps=2)
    before = envs.reset()
    assert before["critic"].shape == (2, 11) and before["policy"].shape == (2, 4)
    envs.step(np.zeros((2, 1)))
    seen, _, dones, infos = envs.step(np.zeros((2, 1)))
    assert dones.all() and {*infos[0]["terminal_observation"]} == {"policy", "critic"}
    assert not np.array_equal(infos[0]["terminal_observation"]["policy"], seen["policy"][0])


def test_other_ways_to_observe_have_the_groups():
    env = PassiveWalkerEnv(SCENE)
    seen, _ = env.reset(seed=0)
    twin = pickle.loads(pickle.dumps(env))
    again = env.set_slope(0.013)
    assert again["critic"][7] == again["critic"][10] == pytest.approx(0.013)
    np.testing.assert_array_equal(again["policy"], seen["policy"])
    for each in (twin, copy.deepcopy(twin)):
        step = each.step(np.full(1, 0.3, np.float32))[0]
        assert {*step} == {"policy", "critic"}
    many = PassiveWalkerVectorEnv(2, SCENE)
    learners = PassiveWalkerVecEnv(2, SCENE)
    for envs, call in ((many, many.call), (learners, learners.env_method)):
        envs.reset()
        rows = call("set_slope", 0.013)
        assert [{*row} for row in rows] == [{"policy", "critic"}] * 2
        assert [row["critic"].shape for row in rows] == [(11,)] * 2
        assert {row["critic"][7] for row in rows} == {np.float32(0.013)}
    other = {"policy": hips, "critic": (*SCENE["observation"]["critic"], hips)}
    with pytest.raises(SceneError, match="they cannot change"):
        env.set_scene(observation=other)


def test_bodies_are_observed_where_the_default_is():
    given = {"observe_body": ("foot_radius",), "domain_randomization": {"foot_radius": 0.1}}
    env = PassiveWalkerEnv(observation={"policy": hips, "critic": "default"}, **given)
    seen, _ = env.reset(seed=0)
    assert seen["critic"][8] == pytest.approx(env.walker.foot_radius / env.walker.leg_length)
    with pytest.raises(SceneError, match="observe_body"):
        Scene(observation={"policy": hips, "critic": ground}, **given)


def test_a_policy_acts_in_the_scene_of_its_own_group():
    assert seen_by_policy(Scene(**SCENE)).observation is hips
    given = {"policy": "default", "critic": ("default", "randomized")}
    found = seen_by_policy(Scene(observation=given, **RANDOM))
    assert found.observation is None and found.domain_randomization
    sizes = []

    def act(observation):
        sizes.append(observation.shape)
        return 0.0 * observation[:, :1]

    walks = gpw.evaluate(act, SCENE, episodes=3, max_episode_steps=10, beside=(), time_limit=0.0)
    assert len(walks.walks) == 1 and set(sizes) == {(3, 4)}


def test_a_file_names_functions_of_each_group(tmp_path):
    file = tmp_path / "task.yaml"
    file.write_text(
        "observation:\n  policy: tests.envs.test_groups:hips\n"
        "  critic: [default, randomized, tests.envs.test_groups:ground]\n"
        "domain_randomization: {foot_radius: 0.1}\n",
        encoding="utf-8",
    )
    names = {f"tests.envs.test_groups:{name}": "observation" for name in ("hips", "ground")}
    assert outside(str(file)) == names
    with pytest.raises(SceneError, match="trust"):
        make_scene(file, trust=False)
    found = make_scene(file, trust=True).observation
    assert found["policy"].__name__ == "hips" and found["critic"][:2] == ("default", "randomized")


def test_explain_names_each_group():
    rows = as_rows(Scene(**SCENE))["observation"]
    assert [row["group"] for row in rows] == ["policy"] * 4 + ["critic"] * 11
    assert rows[0]["observation"] == "hips[0]" and rows[14]["observation"] == "ground[0]"
    assert rows[13]["observation"] == "the draw of max_hip_torque"
    (row,) = (r for r in as_rows(Scene(**SCENE))["scene"] if r["argument"] == "observation")
    assert row["value"] == "policy: hips, critic: default and randomized and ground"


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"policy": hips}, 'have "policy" and "critic"'),
        ({"policy": hips, "critic": hips, "teacher": hips}, 'have "policy" and "critic"'),
        ({"policy": hips, "critic": "defalt"}, "'default' or 'randomized', or a row"),
        ({"policy": ("default", hips), "critic": hips}, "a step or 'default', not"),
        ({"policy": "randomized", "critic": hips}, "observation['policy'] must be"),
        ({"policy": hips, "critic": ()}, "observation['critic'] must be"),
        ({"policy": hips, "critic": ("default", "default")}, "each once"),
        ({"policy": hips, "critic": "randomized"}, "this scene draws nothing"),
        ({"policy": hips, "critic": 3}, "observation['critic'] must be"),
    ],
)
def test_other_groups_are_refused(given, said):
    with pytest.raises(SceneError, match=re.escape(said)):
        Scene(observation=given)
