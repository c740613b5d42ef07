"""A vectorized environment for rsl_rl: `OnPolicyRunner(RslRlWalkers(64), ...)`."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import torch
from rsl_rl.env import VecEnv  # type: ignore[import-not-found]
from tensordict import TensorDict  # type: ignore[import-not-found]
from torch import Tensor

from gym_passive_walker._tools.arguments import whole
from gym_passive_walker.envs.registration import MAX_EPISODE_STEPS
from gym_passive_walker.envs.seeds import training_seeds
from gym_passive_walker.torch.environment import PassiveWalkerTorchEnv
from gym_passive_walker.torch.trainers import check_arguments


class RslRlWalkers(VecEnv):
    """Walkers as an rsl_rl `VecEnv`.

    ``extras["time_outs"]`` distinguishes timeouts from falls. The distance of each finished episode
    is logged. rsl_rl bootstraps a timeout by the value of the step's own observation. Its
    distributions have no bounds: actions beyond `action_space` are clipped. A scene with an
    observation for "policy" and "critic" has both groups, for the option `obs_groups` of rsl_rl.

    Args:
        num_envs: Number of walkers.
        max_episode_steps: Steps after which an episode is truncated; rsl_rl needs such a limit.
        seed: Seed of the training, from which the seeds of the walkers are drawn; see
            `training_seeds`.
        envs: Class of the environment; `gpu.environment.PassiveWalkerGpuEnv` runs on the GPU.
        **scene: Further arguments of `envs`, such as the scene.

    Attributes:
        observation_space: Observation space of one walker.
        action_space: Action space of one walker.
        episode_length_buf: Number of steps of each walker's episode, (num_envs,). What is written
            here, as rsl_rl does at the beginning of a training, sets them before the next step.

    Raises:
        ValueError: if `max_episode_steps` is no number from 1 on, or `autoreset_mode` is given.
    """

    def __init__(
        self,
        num_envs: int = 64,
        *,
        max_episode_steps: int = MAX_EPISODE_STEPS,
        seed: int | None = None,
        envs: Callable[..., Any] = PassiveWalkerTorchEnv,
        **scene: Any,
    ) -> None:
        check_arguments(scene)
        limit = whole(max_episode_steps, "max_episode_steps")
        self.walkers = envs(num_envs, max_episode_steps=limit, **scene)
        self.observation_space = self.walkers.observation_space
        self.action_space = self.walkers.action_space
        self.num_envs, self.num_actions = num_envs, self.action_space.shape[0]
        self.device = self.walkers.device
        self.max_episode_length = limit
        self.cfg: dict[str, Any] = {"seed": seed, **scene}
        self._observations, _ = self.walkers.reset(seed=training_seeds(seed, num_envs))
        self._count()

    def _count(self) -> None:
        """Read the number of steps of each walker's episode."""
        self._elapsed = self.walkers.elapsed_steps
        self.episode_length_buf = self._elapsed.clone()

    def get_observations(self) -> TensorDict:
        """Current observations by group, of which "policy" is there always; no step is made."""
        seen = self._observations
        groups = seen if isinstance(seen, dict) else {"policy": seen}
        return TensorDict(groups, batch_size=[self.num_envs])

    def step(self, actions: Tensor) -> tuple[TensorDict, Tensor, Tensor, dict[str, Any]]:
        """Step every walker; finished episodes are reset.

        Returns observations, rewards (n,), done flags (n,) and extras.

        Raises:
            ValueError: if `episode_length_buf` has another shape, or a number that is not below the
                time limit.
        """
        if not torch.equal(self.episode_length_buf, self._elapsed):
            self.walkers.set_elapsed_steps(self.episode_length_buf)
        self._observations, rewards, fell, late, info = self.walkers.step(actions)
        done = fell | late
        self._count()
        extras: dict[str, Any] = {"time_outs": late & ~fell}
        if done.any():
            extras["log"] = {"/distance": info["episode_distance"][done]}
        return self.get_observations(), rewards.float(), done.long(), extras
