"""Makes `gymnasium.make` and `gymnasium.make_vec` know the environments."""

from __future__ import annotations

from gymnasium.envs.registration import register as _register
from gymnasium.envs.registration import registry

ID = "PassiveWalker-v0"

MAX_EPISODE_STEPS = 4000
"""Steps after which an episode is truncated: a hundred strides and more of ticks."""

REWARD_THRESHOLD = 47.3
"""Mean return from which the default task counts as solved.

It is nine tenths of the way from the passive walker's return, 6.3, to that of the optimal gait,
51.9: means of 100 episodes, which a test computes.
"""


def register() -> None:
    """Register the environments; again does nothing."""
    if ID not in registry:
        _register(
            id=ID,
            entry_point="gym_passive_walker.envs.walker_env:PassiveWalkerEnv",
            vector_entry_point="gym_passive_walker.envs.vector_env:PassiveWalkerVectorEnv",
            max_episode_steps=MAX_EPISODE_STEPS,
            reward_threshold=REWARD_THRESHOLD,
        )
