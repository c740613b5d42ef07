"""Walkers for skrl: `SkrlWalkers(64)` in place of `wrap_env(...)`."""

from __future__ import annotations

from typing import Any

from skrl.envs.wrappers.torch import Wrapper  # type: ignore[import-not-found]
from torch import Tensor

from gym_passive_walker.torch.environment import PassiveWalkerTorchEnv


class SkrlWalkers(Wrapper):
    """Walkers as skrl takes them: tensors all the way, rewards and endings in columns.

    Like skrl's own wrapper of vector environments it begins all episodes once, and from then on
    each where it ends.

    Args:
        num_envs: How many walkers.
        seed: Seeds the walkers with seed, seed + 1, ...
        **scene: As of `PassiveWalkerTorchEnv`.
    """

    def __init__(self, num_envs: int = 64, *, seed: int | None = None, **scene: Any) -> None:
        super().__init__(PassiveWalkerTorchEnv(num_envs, **scene))
        self._seed = seed
        self._begun: Tensor | None = None

    def reset(self) -> tuple[Tensor, dict[str, Any]]:
        """Begin all episodes, the first time; later they go on."""
        begun = self._begun
        if begun is None:
            begun = self._begun = self._env.reset(seed=self._seed)[0]
        return begun, {}

    def step(self, actions: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor, dict[str, Any]]:
        """A step of every walker; who has ended begins anew."""
        observations, rewards, fell, late, info = self._env.step(actions)
        self._begun = observations
        rewards, fell, late = (x[:, None] for x in (rewards.float(), fell, late))
        return observations, rewards, fell, late, info

    def state(self) -> Tensor | None:
        """Nothing more than what is observed."""
        return None

    def render(self, *_: Any, **__: Any) -> Any:
        """A picture of each walker."""
        return self._env.render()

    def close(self) -> None:
        """Close what draws."""
        self._env.close()
