"""Makes `gymnasium.make` and `gymnasium.make_vec` know the environments."""

from __future__ import annotations

from gymnasium.envs.registration import register as _register
from gymnasium.envs.registration import registry

ID = "PassiveWalker-v0"

MAX_EPISODE_STEPS = 4000
"""Steps after which an episode is truncated: a hundred strides and more of ticks."""


def register() -> None:
    """Register the environments; again does nothing."""
    if ID not in registry:
        _register(
            id=ID,
            entry_point="gym_passive_walker.envs.walker_env:PassiveWalkerEnv",
            vector_entry_point="gym_passive_walker.envs.vector_env:PassiveWalkerVectorEnv",
            max_episode_steps=MAX_EPISODE_STEPS,
        )
