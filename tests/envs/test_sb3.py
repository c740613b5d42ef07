"""The adapter for stable-baselines3 acts as its own vectorized environments."""

import numpy as np
import pytest

pytest.importorskip("stable_baselines3")
from stable_baselines3 import PPO, SAC
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import (
    DummyVecEnv,
    SubprocVecEnv,
    VecMonitor,
    VecNormalize,
)

from gym_passive_walker import WALKERS
from gym_passive_walker.envs import task
from gym_passive_walker.envs.registration import ID
from gym_passive_walker.envs.sb3 import PassiveWalkerVecEnv
from gym_passive_walker.envs.vector_env import PassiveWalkerVectorEnv


def actions(count, steps, seed=0):
    rng = np.random.default_rng(seed)
    return rng.uniform(-1.0, 1.0, (steps, count, 1)).astype(np.float32)


def zeros(count):
    return np.zeros((count, 1), np.float32)


def test_a_time_limit_and_a_heelstrike_may_coincide():
    env = PassiveWalkerVecEnv(
        1, "lab", control="stride", reset_noise_scale=0.0, max_episode_steps=3
    )
    env.reset()
    for _ in range(3):
        _, _, done, infos = env.step(zeros(1))
    assert done[0] and infos[0]["outcome"] == "time_limit" and infos[0]["strides"] == 3


def test_a_fall_in_the_last_step_is_a_fall():
    def fallen(limit):
        env = PassiveWalkerVecEnv(1, max_episode_steps=limit, seed=0)
        env.reset()
        steps = 0
        while True:
            _, _, done, infos = env.step(np.ones((1, 1)))
            steps += 1
            if done[0]:
                return steps, infos[0]

    steps, expected = fallen(4000)
    assert expected["outcome"] != "time_limit"
    again, found = fallen(steps)
    assert again == steps and found["outcome"] == expected["outcome"]
    assert found["TimeLimit.truncated"] is False


def test_what_others_write_into_infos_stays_there():
    env = PassiveWalkerVecEnv(3)
    env.reset()
    infos = env.step(zeros(3))[-1]
    infos[1]["mine"] = 1
    later = env.step(zeros(3))[-1]
    assert not any("mine" in info for info in later) and infos[1]["mine"] == 1
    assert len({id(info) for info in later}) == 3


def test_a_seed_is_used_once_and_makes_runs_alike():
    runs = []
    for _ in range(2):
        env = PassiveWalkerVecEnv(4, seed=5, max_episode_steps=20)
        walk = [env.reset()]
        walk += [env.step(act)[0] for act in actions(4, 50)]
        walk.append(env.reset())
        runs.append(walk)
    np.testing.assert_array_equal(*runs)
    assert not np.array_equal(runs[0][0], runs[0][-1])


def test_options_go_to_the_next_reset_only():
    env = PassiveWalkerVecEnv(2, "rolling")
    state = [0.2, -0.2, -0.25, -1.0, -0.5, -1.0]
    env.set_options({"slope": 0.03, "state": state})
    env.reset()
    assert env.get_attr("slope") == [0.03, 0.03]
    np.testing.assert_allclose(env.get_attr("state"), [state, state])
    env.reset()
    assert 0.03 not in env.get_attr("slope")
    env.set_options([{"slope": 0.03}, {}])
    with pytest.raises(ValueError, match="for all environments or for none"):
        env.reset()


def test_attributes_are_read_and_set():
    env = PassiveWalkerVecEnv(3, walkers=["C", "lab", "C"], slope=0.036)
    env.reset()
    assert env.get_attr("walker", indices=[1, 2]) == [WALKERS["lab"], WALKERS["C"]]
    with pytest.raises(AttributeError, match="no 'num_envs' of its own: use that of all"):
        env.get_attr("num_envs", indices=0)
    assert env.has_attr("slope") and not env.has_attr("wings")
    env.set_attr("note", "mine", indices=1)
    assert env.get_attr("note", indices=1) == ["mine"]
    assert [hasattr(lane, "note") for lane in env.lanes] == [False, True, False]
    env.set_attr("note", "later")
    assert env.get_attr("note") == ["later"] * 3
    with pytest.raises(AttributeError):
        env.env_method("fly")


def test_pictures_are_tiled():
    pytest.importorskip("pygame")
    env = PassiveWalkerVecEnv(2, render_mode="rgb_array")
    env.reset()
    frames = env.get_images()
    assert len(frames) == 2 and env.env_method("render", indices=1)[0].shape == frames[1].shape
    assert env.render().shape[0] == 2 * frames[0].shape[0]
    env.close()


def test_actions_are_checked():
    env = PassiveWalkerVecEnv(2)
    env.reset()
    with pytest.raises(ValueError, match="must have shape"):
        env.step(np.zeros(2))
    with pytest.raises(ValueError, match="finite number"):
        env.step(np.full((2, 1), np.nan))


def test_monitor_and_normalisation_wrap_it():
    with pytest.warns(UserWarning, match="already wrapped with a `Monitor`"):  # as single ones are
        monitored = VecMonitor(PassiveWalkerVecEnv(4, max_episode_steps=20, seed=0))
    env = VecNormalize(monitored)
    env.reset()
    ended = []
    for act in actions(4, 60):
        _, _, done, infos = env.step(act)
        for i in np.flatnonzero(done):
            ended.append(infos[i])
            back = env.unnormalize_obs(infos[i]["terminal_observation"])
            assert env.observation_space.contains(back.astype(np.float32))
    assert len(ended) > 4 and all(info["episode"]["l"] <= 20 for info in ended)


def test_its_state_can_be_saved():
    env = PassiveWalkerVecEnv(3, max_episode_steps=15, seed=0)
    env.reset()
    env.step(zeros(3))
    saved = env.get_state()
    first = [env.step(act)[0] for act in actions(3, 40)]
    env.set_state(saved)
    np.testing.assert_array_equal(first, [env.step(act)[0] for act in actions(3, 40)])


def test_ppo_takes_it_from_a_seed_to_the_same_policy():
    def learned():
        env = VecNormalize(PassiveWalkerVecEnv(8))
        model = PPO("MlpPolicy", env, n_steps=32, batch_size=64, n_epochs=2, seed=3, device="cpu")
        model.learn(1024)
        assert len(model.ep_info_buffer) > 0
        return model.predict(np.zeros((1, 8), np.float32), deterministic=True)[0]

    np.testing.assert_array_equal(learned(), learned())


def test_sac_takes_it_and_bootstraps_at_time_limits():
    env = PassiveWalkerVecEnv(8, "lab", max_episode_steps=20)
    small = {"net_arch": [16]}
    model = SAC("MlpPolicy", env, learning_starts=100, seed=0, device="cpu", policy_kwargs=small)
    model.learn(300)
    buffer = model.replay_buffer
    stored = slice(0, buffer.pos)
    assert buffer.timeouts[stored].sum() > 0
    assert np.all(buffer.dones[stored] >= buffer.timeouts[stored])
    ends = buffer.dones[stored] > 0
    after = np.roll(buffer.observations[stored], -1, axis=0)
    assert not np.array_equal(buffer.next_observations[stored][ends], after[ends])


def test_evaluation_counts_its_episodes():
    env = PassiveWalkerVecEnv(4, "lab", reset_noise_scale=0.0, max_episode_steps=30, seed=0)
    model = PPO("MlpPolicy", env, n_steps=8, batch_size=32, device="cpu")
    returns, lengths = evaluate_policy(model, env, 6, return_episode_rewards=True, warn=False)
    assert len(returns) == 6 and set(lengths) == {30}


@pytest.mark.slow
def test_the_plain_path_works_too():
    for vec_env in (DummyVecEnv, SubprocVecEnv):
        env = make_vec_env(f"gym_passive_walker:{ID}", n_envs=2, vec_env_cls=vec_env, seed=0)
        native = PassiveWalkerVecEnv(2, seed=0)
        np.testing.assert_array_equal(env.reset(), native.reset())
        env.env_method("set_energy_cost", "net")
        assert [env.get_attr(name) for name in ("energy_cost", "slope")] == [["net"] * 2, [0.0] * 2]
        model = PPO("MlpPolicy", env, n_steps=16, batch_size=32, device="cpu")
        model.learn(64)
        assert model.num_timesteps == 64
        env.close()


@pytest.mark.learning
def test_ppo_walks_away_from_the_passive_walker():
    env = VecNormalize(PassiveWalkerVecEnv(64), gamma=0.99)
    model = PPO(
        "MlpPolicy", env, n_steps=128, batch_size=2048, learning_rate=1e-3, seed=0, device="cpu"
    )
    model.learn(400_000)
    env.training = False
    seen, walked = env.reset(), []
    while len(walked) < 64:
        seen, _, _, infos = env.step(model.predict(seen, deterministic=True)[0])
        walked += [info["episode_distance"] for info in infos if "episode" in info]
    assert np.median(walked) > 30.0


def test_methods_and_attributes_of_some_environments_are_of_those_alone():
    env = PassiveWalkerVecEnv(4, "rolling", seed=1)
    env.reset()
    slopes = [float(slope) for slope in env.envs.slopes]
    assert len({*slopes}) == 4
    for indices in ([2], [3, 0], [1, 2, 3]):
        expected = [slopes[i] for i in indices]
        assert env.get_attr("slope", indices=indices) == expected
        np.testing.assert_array_equal(env.get_attr("state", indices), env.envs.states[indices])
        assert env.env_is_wrapped(Monitor, indices=indices) == [True] * len(indices)
        with pytest.warns(UserWarning, match="render_mode"):
            assert env.env_method("render", indices=indices) == [None] * len(indices)
    assert env.get_attr("slope", indices=2) == [slopes[2]]
    env.set_attr("note", [1], indices=[0, 3])
    assert [hasattr(lane, "note") for lane in env.lanes] == [True, False, False, True]
    for name in ("slope", "state", "walker", "scene", "batch"):
        with pytest.raises(AttributeError, match=name):
            env.set_attr(name, 1.0)


def test_slopes_of_some_environments_are_set_before_their_stride():
    env = PassiveWalkerVecEnv(3, "lab", seed=0)
    env.reset()
    seen = env.set_slopes([0.01, 0.02, 0.03], np.array([True, False, True]))
    np.testing.assert_array_equal(seen[:, 7], np.float32([0.01, 0.036, 0.03]))
    assert env.get_attr("slope") == [0.01, 0.036, 0.03]
    np.testing.assert_array_equal(env.set_slopes(0.05)[:, 7], np.float32([0.05] * 3))


@pytest.mark.parametrize("scene", [{"scene": "lab"}, {"tick": 0.5}, {"control": "stride"}])
def test_videos_have_the_frame_rate_of_the_scene(scene):
    env = PassiveWalkerVecEnv(2, **scene)
    assert env.metadata["render_fps"] == env.scene.frames_per_second


def test_seeds_are_those_of_single_environments_one_after_another():
    env, envs = PassiveWalkerVecEnv(3, "rolling", seed=11), PassiveWalkerVectorEnv(3, "rolling")
    expected = envs.reset(seed=[11, 12, 13])[0]
    np.testing.assert_array_equal(env.reset(), expected)
    assert all(not any(info.values()) for info in env.reset_infos)
    assert all(info.keys() == {*task.EVERY_STEP, *task.EVERY_STRIDE, "outcome"}
               for info in env.reset_infos)  # fmt: skip
    env.seed(11)
    np.testing.assert_array_equal(env.reset(), expected)
    later = env.reset()
    assert not (later == expected).all(axis=1).any()
    np.testing.assert_array_equal(later, envs.reset()[0])


def test_ends_of_episodes_are_reported_to_those_that_end():
    """Terminal observations are copies, and the first ones of the next episodes follow."""
    env = PassiveWalkerVecEnv(3, max_episode_steps=9, seed=0, reward_terms=True, command=0.15)
    envs = PassiveWalkerVectorEnv(
        3, max_episode_steps=9, reward_terms=True, command=0.15, autoreset_mode="SameStep"
    )
    env.reset(), envs.reset(seed=0)
    kept, total = [], np.zeros(3)
    for k, act in enumerate(actions(3, 20)):
        seen, rewards, dones, infos = env.step(0.1 * act)
        expected, paid, _, truncated, other = envs.step(0.1 * act)
        np.testing.assert_array_equal(seen, expected)
        assert seen.dtype == rewards.dtype == np.float32 and dones.dtype == bool
        total += paid
        assert dones.all() == ((k + 1) % 9 == 0) == truncated.all()
        for i, info in enumerate(infos):
            last = other.get("final_info", other)
            names = {*task.EVERY_STEP, *task.EVERY_STRIDE, "command", "reward_distance"}
            names |= {"reward_energy", "reward_command", "outcome"}
            more = {"terminal_observation", "episode"} if dones[i] else set()
            assert info.keys() == names | more | {"TimeLimit.truncated"}
            for name in names:
                assert info[name] == last[name][i]
            if not dones[i]:
                assert info["TimeLimit.truncated"] is False
                continue
            np.testing.assert_array_equal(info["terminal_observation"], other["final_obs"][i])
            assert info["TimeLimit.truncated"] is True and info["outcome"] == "time_limit"
            assert info["episode"]["r"] == pytest.approx(total[i], abs=2e-6)
            assert info["episode"]["l"] == 9 and info["episode"]["t"] >= 0.0
            kept.append((info["terminal_observation"], info["terminal_observation"].copy()))
            total[i] = 0.0
    assert len(kept) == 6
    for now, then in kept:
        np.testing.assert_array_equal(now, then)
