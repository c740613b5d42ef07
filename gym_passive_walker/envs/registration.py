"""Registration of the environments for `gymnasium.make` and `gymnasium.make_vec`."""

from __future__ import annotations

from gymnasium.envs.registration import register as _register
from gymnasium.envs.registration import registry

ID = "PassiveWalker-v0"

MAX_EPISODE_STEPS = 4000
"""Number of control steps after which an episode is truncated; more than a hundred strides."""

REWARD_THRESHOLD = 47.3
"""Mean return from which the default task counts as solved.

It is nine tenths of the way from the passive walker's return, 6.3, to that of the optimal gait,
51.9: means of 100 episodes, which a test computes.
"""

EASY_ID = "PassiveWalkerEasy-v0"
"""`PassiveWalker-v0` with another default scene, for learners with default hyperparameters."""

EASY_SCENE = {"reset_noise_scale": 0.05, "reward": {"distance": 10.0, "energy": -100.0}}
"""The default scene of `EASY_ID`, as changes of "level".

Initial states are nearer to the gait: at 0.10, PPO of stable-baselines3 with default
hyperparameters learns last to start from states with the legs far apart and little speed. These are
rare, and a policy that walks sees an initial state once in 4,000 steps. Rewards are ten times those
of "level", where a control step earns a hundredth: little beside the price of entropy of SAC with
default hyperparameters, which is 1 at first.
"""

EASY_REWARD_THRESHOLD = 476.0
"""`REWARD_THRESHOLD` of `EASY_ID`, between the passive walker's return, 88, and 519."""


MUJOCO_ID = "PassiveWalkerMujoco-v0"
"""The task of `ID` with the dynamics of MuJoCo; needs the extra "mujoco"."""


def register() -> None:
    """Register the environments; a second call does nothing."""
    for name, threshold, kwargs in (
        (ID, REWARD_THRESHOLD, {}),
        (EASY_ID, EASY_REWARD_THRESHOLD, {"scene": EASY_SCENE}),
    ):
        if name not in registry:
            _register(
                id=name,
                entry_point="gym_passive_walker.envs.walker_env:PassiveWalkerEnv",
                vector_entry_point="gym_passive_walker.envs.vector_env:PassiveWalkerVectorEnv",
                max_episode_steps=MAX_EPISODE_STEPS,
                reward_threshold=threshold,
                kwargs=kwargs,
            )
    if MUJOCO_ID not in registry:
        _register(
            id=MUJOCO_ID,
            entry_point="gym_passive_walker.bridge.mujoco:PassiveWalkerMujocoEnv",
            max_episode_steps=MAX_EPISODE_STEPS,
        )
