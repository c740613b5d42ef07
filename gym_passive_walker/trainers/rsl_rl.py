"""Walkers for rsl_rl: `OnPolicyRunner(RslRlWalkers(64), ...)`."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import torch
from rsl_rl.env import VecEnv  # type: ignore[import-not-found]
from tensordict import TensorDict  # type: ignore[import-not-found]
from torch import Tensor

from gym_passive_walker.envs.registration import MAX_EPISODE_STEPS
from gym_passive_walker.torch.environment import PassiveWalkerTorchEnv


class RslRlWalkers(VecEnv):
    """Walkers as rsl_rl takes them.

    Timeouts are told apart from falls (``extras["time_outs"]``), and what an episode came to is
    logged. rsl_rl bootstraps a timeout by the value of the step's own observation.

    Args:
        num_envs: How many walkers.
        max_episode_steps: Steps after which an episode is truncated.
        seed: Seeds the walkers with seed, seed + 1, ...
        envs: What makes them; `gpu.environment.PassiveWalkerGpuEnv` for some on the device.
        **scene: As of the walkers.
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
        self.walkers = envs(num_envs, max_episode_steps=max_episode_steps, **scene)
        self.num_envs, self.num_actions, self.device = num_envs, 1, self.walkers.device
        self.max_episode_length = max_episode_steps
        self.episode_length_buf = torch.zeros(num_envs, dtype=torch.long, device=self.device)
        self.cfg: dict[str, Any] = {"seed": seed, **scene}
        self._observations, _ = self.walkers.reset(seed=seed)

    def get_observations(self) -> TensorDict:
        """What the walkers see; nothing moves."""
        return TensorDict({"policy": self._observations}, batch_size=[self.num_envs])

    def step(self, actions: Tensor) -> tuple[TensorDict, Tensor, Tensor, dict[str, Any]]:
        """A step of every walker; who has ended begins anew."""
        self._observations, rewards, fell, late, info = self.walkers.step(actions)
        done = fell | late
        self.episode_length_buf = torch.where(done, 0, self.episode_length_buf + 1)
        extras: dict[str, Any] = {"time_outs": late & ~fell}
        if done.any():
            extras["log"] = {"/distance": info["episode_distance"][done]}
        return self.get_observations(), rewards.float(), done.long(), extras
