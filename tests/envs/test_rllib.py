"""RLlib's own sampler runs the native batch; environments restart at the step after an end.

RLlib pins an older Gymnasium, so this has an extra of its own: `pip install -e ".[rllib]" torch`.
"""

import numpy as np
import pytest

pytest.importorskip("ray.rllib.algorithms.ppo", exc_type=ImportError)

from ray.rllib.algorithms.ppo import PPOConfig
from ray.rllib.env.single_agent_env_runner import SingleAgentEnvRunner


def sampled(mode, steps=600, **scene):
    """Episodes that RLlib collects with random actions from four walkers."""
    config = (
        PPOConfig()
        .environment("gym_passive_walker:PassiveWalker-v0", env_config=scene)
        .env_runners(num_env_runners=0, num_envs_per_env_runner=4, gym_env_vectorize_mode=mode)
        .debugging(seed=1)
    )
    runner = SingleAgentEnvRunner(config=config)
    runner.env.action_space.seed(2)
    episodes = runner.sample(num_timesteps=steps, random_actions=True)
    runner.stop()
    return episodes


@pytest.mark.parametrize("scene", ["level", "rolling"])
def test_it_collects_the_episodes_of_single_environments(scene):
    native, single = (sampled(mode, scene=scene) for mode in ("vector_entry_point", "sync"))
    assert len(native) == len(single) > 8
    for one, other in zip(native, single, strict=True):
        assert one.is_terminated == other.is_terminated
        np.testing.assert_array_equal(one.get_observations(), other.get_observations())
        np.testing.assert_array_equal(one.get_rewards(), other.get_rewards())


def test_an_episode_begins_at_a_start_and_has_no_step_of_the_one_before():
    start = (0.2, -0.2, -0.2, -0.3, -0.1, -0.4)
    episodes = sampled("vector_entry_point", start=start, reset_noise_scale=0.0)
    ended = [episode for episode in episodes if episode.is_done]
    assert len(ended) > 4
    for episode in ended:
        seen = episode.get_observations()
        np.testing.assert_allclose(seen[0, :6], start, rtol=1e-6)
        assert len(seen) == len(episode.get_rewards()) + 1
        assert np.all(np.any(seen[1:, :6] != seen[0, :6], axis=1))
