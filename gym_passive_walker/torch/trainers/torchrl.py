"""A vectorized environment for torchrl: an `EnvBase` over a batch of walkers."""

from __future__ import annotations

from typing import Any

import torch
from gymnasium.spaces import Dict
from tensordict import TensorDict, TensorDictBase  # type: ignore[import-not-found]
from torchrl.data import Binary, Bounded, Composite, Unbounded  # type: ignore[import-not-found]
from torchrl.envs import EnvBase  # type: ignore[import-not-found]

from gym_passive_walker.envs.seeds import training_seeds
from gym_passive_walker.torch.environment import PassiveWalkerTorchEnv
from gym_passive_walker.torch.trainers import check_arguments


class TorchRlWalkers(EnvBase):
    """Walkers as a torchrl `EnvBase`.

    torchrl resets finished episodes itself, by a mask, so autoreset is disabled in the environment
    below. Observations are under "observation", or under "policy" and "critic" where the scene's
    observation has these.

    Args:
        num_envs: Number of walkers.
        seed: Seed of the training, from which the seeds of the walkers are drawn; see
            `training_seeds`.
        **scene: Further arguments of `PassiveWalkerTorchEnv`, such as the scene.

    Raises:
        ValueError: if `autoreset_mode` is given.
    """

    def __init__(self, num_envs: int = 64, *, seed: int | None = None, **scene: Any) -> None:
        check_arguments(scene)
        self.walkers = PassiveWalkerTorchEnv(num_envs, autoreset_mode="Disabled", **scene)
        super().__init__(device=self.walkers.device, batch_size=torch.Size([num_envs]))
        size, one = (num_envs,), torch.Size((num_envs, 1))
        flag = Binary(n=1, shape=one, dtype=torch.bool)
        space = self.walkers.observation_space
        groups = space.spaces if isinstance(space, Dict) else {"observation": space}
        seen = {name: _bounded(each, num_envs) for name, each in groups.items()}
        self.observation_spec = Composite(seen, shape=size)
        self.action_spec = _bounded(self.walkers.action_space, num_envs)
        self.reward_spec = Unbounded(shape=one, dtype=torch.float32)
        self.done_spec = Composite(done=flag, terminated=flag, truncated=flag, shape=size)
        self._set_seed(seed)

    def _reset(self, tensordict: TensorDictBase | None = None) -> TensorDict:
        options = {}
        if tensordict is not None and "_reset" in tensordict.keys():
            options["reset_mask"] = tensordict["_reset"].reshape(self.batch_size)
        observations, _ = self.walkers.reset(seed=self._next_seeds, options=options)
        self._next_seeds = None
        return TensorDict(_groups(observations), batch_size=self.batch_size)

    def _step(self, tensordict: TensorDictBase) -> TensorDict:
        observations, rewards, fell, late, _ = self.walkers.step(tensordict["action"])
        results = {"reward": rewards.float(), "terminated": fell, "truncated": late}
        results |= {"done": fell | late}
        results = {name: values[:, None] for name, values in results.items()}
        return TensorDict(_groups(observations) | results, batch_size=self.batch_size)

    def _set_seed(self, seed: int | None) -> None:
        self._next_seeds = training_seeds(seed, self.walkers.num_envs)


def _bounded(space: Any, count: int) -> Bounded:
    """Return the specification of a space for `count` walkers."""
    low, high = (torch.tensor(end).repeat(count, 1) for end in (space.low, space.high))
    return Bounded(low=low, high=high)


def _groups(observations: Any) -> dict[str, Any]:
    """Return observations by the names of their entries."""
    return observations if isinstance(observations, dict) else {"observation": observations}
