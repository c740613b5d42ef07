"""The adapter for stable-baselines3 acts as its own vectorized environments."""

import numpy as np
import pytest

pytest.importorskip("stable_baselines3")
from stable_baselines3 import PPO, SAC
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.vec_env import (
    DummyVecEnv,
    SubprocVecEnv,
    VecNormalize,
)

from gym_passive_walker.envs.registration import ID
from gym_passive_walker.envs.sb3 import PassiveWalkerVecEnv


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


def test_slopes_of_some_environments_are_set_before_their_stride():
    env = PassiveWalkerVecEnv(3, "lab", seed=0)
    env.reset()
    seen = env.set_slopes([0.01, 0.02, 0.03], np.array([True, False, True]))
    np.testing.assert_array_equal(seen[:, 7], np.float32([0.01, 0.036, 0.03]))
    assert env.get_attr("slope") == [0.01, 0.036, 0.03]
    np.testing.assert_array_equal(env.set_slopes(0.05)[:, 7], np.float32([0.05] * 3))
