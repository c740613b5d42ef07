"""A vector environment whose observations, rewards and endings are torch tensors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import torch
from gymnasium.vector import AutoresetMode
from torch import Tensor

from gym_passive_walker.envs import interface
from gym_passive_walker.envs.scene import Scene
from gym_passive_walker.envs.vector_env import PassiveWalkerVectorEnv


class PassiveWalkerTorchEnv:
    """`PassiveWalkerVectorEnv` for learners that live on tensors: the same walks to the last bit.

    Walkers are carried on the CPU. There tensors share the memory of the environment's arrays and
    cost no copy; on another device they are moved to and fro. What is different from the vector
    environment: an episode's last observation is told for all walkers as one tensor, `info` as
    tensors without masks, and the default is to begin the next episode in the step that ends one,
    as trainers of this kind expect.

    Args:
        num_envs: How many walkers.
        scene: As of `PassiveWalkerEnv`.
        device: Where tensors are wanted.
        autoreset_mode: "SameStep" (the default), "NextStep" or "Disabled", as of the vector
            environment.
        **changes: As of `PassiveWalkerVectorEnv`.

    Attributes:
        envs: The vector environment.
        device: Where tensors are.
    """

    def __init__(
        self,
        num_envs: int = 1,
        scene: Scene | str | Mapping[str, Any] = "level",
        *,
        device: torch.device | str = "cpu",
        autoreset_mode: str | AutoresetMode = AutoresetMode.SAME_STEP,
        **changes: Any,
    ) -> None:
        self.device = torch.device(device)
        self.envs = PassiveWalkerVectorEnv(
            num_envs, scene, autoreset_mode=autoreset_mode, **changes
        )

    @classmethod
    def around(
        cls, envs: PassiveWalkerVectorEnv, device: torch.device | str = "cpu"
    ) -> PassiveWalkerTorchEnv:
        """The walkers of a vector environment, on tensors: both step the same ones."""
        self = cls.__new__(cls)
        self.device, self.envs = torch.device(device), envs
        return self

    @property
    def num_envs(self) -> int:
        """How many walkers."""
        return self.envs.num_envs

    @property
    def observation_space(self) -> Any:
        """Of one walker."""
        return self.envs.single_observation_space

    @property
    def action_space(self) -> Any:
        """Of one walker."""
        return self.envs.single_action_space

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Tensor, dict[str, Any]]:
        """Begin episodes; as of the vector environment, but that "reset_mask" may be a tensor.

        Returns:
            Observations, (num_envs, 8), and an empty dictionary.
        """
        if options and isinstance(options.get("reset_mask"), Tensor):
            options = options | {"reset_mask": options["reset_mask"].cpu().numpy()}
        observations, _ = self.envs.reset(seed=seed, options=options)
        return self._tensor(observations), {}

    def step(self, actions: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor, dict[str, Any]]:
        """A step of every walker.

        Args:
            actions: Shape (num_envs, 1).

        Returns:
            Observations (num_envs, 8); rewards, terminated and truncated (num_envs,); and what the
            step tells: the numbers of `info`, zero where there is nothing to tell, "outcome" as an
            `Outcome`'s number (0 where nothing has ended), and, where episodes end and begin
            within a step, "final_obs" (num_envs, 8): observations before the new beginnings.

        Raises:
            ValueError: as of the vector environment.
            ResetNeeded: likewise.
        """
        observations, rewards, terminated, truncated, told = self.envs.step(
            actions.detach().cpu().numpy()
        )
        infos = {}
        if "final_obs" in told:
            ended, last = told["_final_obs"], observations.copy()
            last[ended] = np.stack(told["final_obs"][ended])
            infos["final_obs"] = self._tensor(last)
            told = _joined(ended, told["final_info"], told)
        for name, values in told.items():
            if name == "outcome":
                values = _numbered(values)
            if not name.startswith("_"):
                infos[name] = self._tensor(values)
        return (
            self._tensor(observations), self._tensor(rewards),
            self._tensor(terminated), self._tensor(truncated), infos,
        )  # fmt: skip

    def _tensor(self, array: np.ndarray) -> Tensor:
        return torch.from_numpy(array).to(self.device)

    def get_state(self) -> dict[str, Any]:
        """As of the vector environment."""
        return self.envs.get_state()

    def set_state(self, state: Mapping[str, Any]) -> None:
        """As of the vector environment."""
        self.envs.set_state(state)

    def set_energy_cost(self, energy: str | None) -> None:
        """As of the vector environment."""
        self.envs.set_energy_cost(energy)

    def render(self) -> Any:
        """As of the vector environment."""
        return self.envs.render()

    def close(self) -> None:
        """Close what draws."""
        self.envs.close()


def _numbered(outcomes: np.ndarray) -> np.ndarray:
    """Outcomes by their numbers; most walkers have none."""
    numbers = np.zeros(len(outcomes), np.int8)
    for i in np.flatnonzero(outcomes):
        numbers[i] = interface.OUTCOMES.index(outcomes[i])
    return numbers


def _joined(ended: np.ndarray, last: dict[str, Any], rest: dict[str, Any]) -> dict[str, Any]:
    """What is told of those whose episode has ended, and of the others, as one."""
    joined = {}
    for name in (last | rest).keys() - {"final_obs", "final_info"}:
        if not name.startswith("_"):
            some = last[name] if name in last else rest[name]
            nothing = np.full(ended.shape, None if some.dtype == object else 0, some.dtype)
            joined[name] = np.where(ended, last.get(name, nothing), rest.get(name, nothing))
    return joined
