"""What is said of a scene is what its environment does; scenes of environments change."""

import re

import gymnasium
import numpy as np
import pytest

import gym_passive_walker as gpw
from gym_passive_walker.envs.checks import SceneError
from gym_passive_walker.envs.explain import as_rows, as_text
from gym_passive_walker.envs.interface import OUTCOMES
from gym_passive_walker.envs.registration import ID
from gym_passive_walker.envs.sb3 import PassiveWalkerVecEnv
from gym_passive_walker.envs.scene import SCENES, make_scene
from gym_passive_walker.envs.vector_env import PassiveWalkerVectorEnv

WEIGHTS = {"distance": 1.0, "alive": 0.1, "action": -0.2}


def far(step):
    return step.distance > 10.0


@pytest.mark.parametrize("scene", SCENES)
def test_a_scene_is_explained_as_its_spaces_are(scene):
    env, found = gymnasium.make(ID, scene=scene), as_rows(scene)
    seen, acts = found["observation"], found["action"]
    np.testing.assert_array_equal([row["min"] for row in seen], env.observation_space.low)
    np.testing.assert_array_equal([row["max"] for row in seen], env.observation_space.high)
    np.testing.assert_array_equal([row["min"] for row in acts], env.action_space.low)
    assert as_rows(env) == found == as_rows(make_scene(scene)) == as_rows(SCENES[scene] | {})
    for rows in found.values():
        for row in rows:
            assert all(str(cell) in as_text(scene) for cell in row.values() if cell == str(cell))


@pytest.mark.parametrize("make", [PassiveWalkerVectorEnv, PassiveWalkerVecEnv])
def test_what_is_seen_and_paid_now_is_part_of_it(make):
    env = make(3, "commanded", reward_terms=True)
    assert "now" not in as_rows(env)["observation"][0]
    env.reset()
    observations, rewards, *_ = env.step(np.full((3, 1), 0.3))
    found = as_rows(env)
    np.testing.assert_allclose([row["now"] for row in found["observation"]], observations[0])
    assert sum(row["last"] for row in found["reward"]) == pytest.approx(rewards[0])


def test_explain_prints_the_tables(capsys):
    gpw.explain(make_scene(reward=WEIGHTS, terminated=far, constraints={"friction": "end"}))
    said = capsys.readouterr().out
    assert re.search(r"action +-0.2 times sum of the squares of the actions", said)
    assert re.search(r"stopped +far holds", said) and re.search(r"slipped .* 0.8 ", said)
    assert re.search(r"4000 steps +truncated", said)
    gpw.explain(make_scene(observation=lambda step: (step.time, step.slope)))
    assert re.findall(r"<lambda>\[(\d)\]", capsys.readouterr().out) == ["0", "1"]


def test_every_outcome_that_ends_an_episode_is_explained():
    rules = dict.fromkeys(("contact", "friction", "knee lock", "scuffing"), "end")
    rows = as_rows(make_scene(constraints=rules, terminated=far))["episode end"]
    reported = {row["outcome"] for row in rows if row["outcome"]}
    assert reported == {*OUTCOMES} - {None, "heelstrike", "kneestrike"}


def test_what_is_no_environment_of_this_package_is_refused():
    with pytest.raises(TypeError, match="explain takes an environment of this package or a scene"):
        gpw.explain(gymnasium.make("CartPole-v1"))
    with pytest.raises(SceneError, match="no scene"):
        gpw.explain("moon")


def test_the_terms_of_a_reward_are_in_info_on_request():
    for scene in ({}, {"command": 0.15}, {"reward": WEIGHTS}, {"terrain": "stairs:rise=-0.001"}):
        env = gymnasium.make(ID, reward_terms=True, **scene)
        env.reset(seed=0)
        for _ in range(30):
            _, reward, _, _, info = env.step(np.array([0.2], np.float32))
            terms = {name: x for name, x in info.items() if name.startswith("reward_")}
            assert sum(terms.values()) == pytest.approx(reward, abs=1e-15)
            own = env.unwrapped.reward_terms
            assert terms == {f"reward_{name}": x for name, x in own.items()}
    with pytest.raises(SceneError, match="reward_terms must be True or False"):
        make_scene(reward_terms=1)


def test_a_changed_scene_is_the_one_of_the_next_episode():
    env, fresh = (gymnasium.make(ID, **of).unwrapped for of in ({}, {"slope": 0.03}))
    env.reset(seed=3)
    env.step(np.zeros(1, np.float32))
    env.set_scene(slope=0.03)
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(np.zeros(1, np.float32))
    for one in (env, fresh):
        one.reset(seed=4)
    for action in np.random.default_rng(0).uniform(-0.1, 0.1, (20, 1)):
        for found, expected in zip(env.step(action), fresh.step(action), strict=True):
            np.testing.assert_equal(found, expected)
    with pytest.raises(SceneError, match="cannot change"):
        env.set_scene(command=0.1)
    assert env.scene.slope == 0.03 and env.step(np.zeros(1))[1] != 0.0


@pytest.mark.parametrize("mode", ["NextStep", "SameStep", "Disabled"])
def test_the_walkers_of_a_vector_environment_go_over_to_a_changed_scene_together(mode):
    env = PassiveWalkerVectorEnv(4, autoreset_mode=mode, slope=0.02, max_episode_steps=500)
    fresh = PassiveWalkerVectorEnv(4, autoreset_mode=mode, slope=0.04, max_episode_steps=500)
    env.reset(seed=0)
    for _ in range(200):  # until some walkers, not all, have just ended
        _, _, terminated, truncated, _ = env.step(np.tile([[0.9], [0.0]], (2, 1)))
        if (terminated | truncated).any():
            break
    assert not terminated.all()
    env.set_scene(slope=0.03)
    env.set_scene(slope=0.04)
    assert env.scene.slope == 0.02
    if mode == "Disabled":
        with pytest.raises(gymnasium.error.ResetNeeded, match="reset all"):
            env.reset(options={"reset_mask": terminated})
    else:
        observations, _, terminated, truncated, _ = env.step(np.zeros((4, 1)))
        assert truncated.all() and not terminated.any()
        if mode == "NextStep":
            assert not np.allclose(observations[:, 7], 0.04)
            observations, rewards, terminated, truncated, _ = env.step(np.ones((4, 1)))
            assert not (rewards.any() or terminated.any() or truncated.any())
        np.testing.assert_allclose(observations[:, 7], 0.04)
    assert env.scene.slope == (0.04 if mode != "Disabled" else 0.02)
    for one in (env, fresh):
        one.reset(seed=5)
    for actions in np.random.default_rng(0).uniform(-1.0, 1.0, (60, 4, 1)):
        (*found, _), (*expected, _) = env.step(actions), fresh.step(actions)
        for part, other in zip(found, expected, strict=True):
            np.testing.assert_array_equal(part, other)
        if mode == "Disabled" and (found[2] | found[3]).any():
            break
    assert env.scene.slope == 0.04
    assert env.get_state()["scene"] == fresh.get_state()["scene"]


def test_episodes_of_a_changed_scene_are_truncated_after_the_same_number_of_steps():
    envs = PassiveWalkerVectorEnv(2, max_episode_steps=5, autoreset_mode="SameStep")
    envs.reset(seed=0)
    envs.set_scene(energy_weight=2.0)
    truncated = [envs.step(np.zeros((2, 1)))[3].tolist() for _ in range(11)]
    ends = [True, False, False, False, False, True, False, False, False, False, True]
    assert truncated == [[end] * 2 for end in ends]


def test_learners_of_stable_baselines3_go_over_to_a_changed_scene():
    env = PassiveWalkerVecEnv(3, "pushed", seed=0)
    env.reset()
    env.env_method("set_scene", indices=[0], energy_weight=2.0)
    *_, dones, infos = env.step(np.zeros((3, 1)))
    assert dones.all() and all(info["TimeLimit.truncated"] for info in infos)
    assert env.scene.energy_weight == 2.0 == env.get_attr("scene")[0].energy_weight
    *_, dones, _ = env.step(np.zeros((3, 1)))
    assert not dones.any()


def test_footholds_ahead_are_numbered_from_the_next_one():
    names = [row["observation"] for row in as_rows(make_scene("rough"))["observation"]]
    ahead = [name for name in names if "foothold" in name]
    assert [int(re.search(r"foothold (\d+) ahead", name)[1]) for name in ahead] == [1, 2]
