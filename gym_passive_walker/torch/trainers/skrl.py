"""A vectorized environment for skrl: `SkrlWalkers(64)` in place of `wrap_env(...)`."""

from __future__ import annotations

from typing import Any

from gymnasium.spaces import Dict
from skrl.envs.wrappers.torch import Wrapper  # type: ignore[import-not-found]
from torch import Tensor

from gym_passive_walker.envs.seeds import training_seeds
from gym_passive_walker.torch.environment import PassiveWalkerTorchEnv
from gym_passive_walker.torch.trainers import check_arguments


class SkrlWalkers(Wrapper):
    """Walkers as a skrl `Wrapper`: tensors only, with rewards and flags of shape (n, 1).

    Like skrl's own wrapper of vector environments, the first `reset` resets all walkers. Afterwards
    each walker is reset when its episode ends. Where the scene's observation has "policy" and
    "critic", these are the observations and the states of skrl.

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
        super().__init__(PassiveWalkerTorchEnv(num_envs, **scene))
        self._seeds = training_seeds(seed, num_envs)
        self._begun: Any = None

    def reset(self) -> tuple[Tensor, dict[str, Any]]:
        """Reset all walkers on the first call; later calls return the current observations."""
        if self._begun is None:
            self._begun = self._env.reset(seed=self._seeds)[0]
        return _of(self._begun, "policy"), {}

    def step(self, actions: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor, dict[str, Any]]:
        """Step every walker; finished episodes are reset."""
        observations, rewards, fell, late, info = self._env.step(actions)
        self._begun = observations
        rewards, fell, late = (x[:, None] for x in (rewards.float(), fell, late))
        return _of(observations, "policy"), rewards, fell, late, info

    def state(self) -> Tensor | None:
        """Return what the critic sees, (n, k); None where it sees what the actor sees."""
        return self._begun["critic"] if isinstance(self._begun, dict) else None

    @property
    def observation_space(self) -> Any:
        """What the actor sees."""
        return _of(self._env.observation_space, "policy")

    @property
    def state_space(self) -> Any:
        """What the critic sees; None where it sees what the actor sees."""
        space = self._env.observation_space
        return space["critic"] if isinstance(space, Dict) else None

    def render(self, *_: Any, **__: Any) -> Any:
        """Return a frame of each walker."""
        return self._env.render()

    def close(self) -> None:
        """Close the environment and its windows."""
        self._env.close()


def _of(seen: Any, group: str) -> Any:
    """Return a group of observations or of their space; all, if there are none."""
    return seen[group] if isinstance(seen, dict | Dict) else seen
