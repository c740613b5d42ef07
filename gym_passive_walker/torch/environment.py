"""A vector environment with torch tensors as observations, rewards and termination flags."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
import torch
from gymnasium.vector import AutoresetMode
from torch import Tensor

from gym_passive_walker.envs import interface
from gym_passive_walker.envs.infos import Infos
from gym_passive_walker.envs.vector_env import PassiveWalkerVectorEnv
from gym_passive_walker.gaits.scenes.scene import SceneLike


def _where(mask: np.ndarray, some: Mapping[str, Any], others: Mapping[str, Any]) -> dict[str, Any]:
    """Return infos that are of `some` where the mask holds, and else of `others`.

    All are of `some` when the scene has changed: its entries may differ, and all episodes end.
    """
    if mask.all():
        return {**some}
    return {
        name: _where(mask, x, others[name])
        if isinstance(x, Mapping)
        else np.where(mask, x, others[name])
        for name, x in some.items()
    }


def _replaced(observations: Any, lanes: np.ndarray, rows: np.ndarray) -> Any:
    """Return a copy of observations, or of each group, with other rows of some walkers."""
    if isinstance(observations, Mapping):
        return {
            name: _replaced(x, lanes, np.array([row[name] for row in rows]))
            for name, x in observations.items()
        }
    found = observations.copy()
    found[lanes] = np.stack(list(rows))
    return found


class PassiveWalkerTorchEnv(interface.Adapter):
    """`PassiveWalkerVectorEnv` with torch tensors: trajectories are bitwise equal.

    The CPU integrates the walkers. CPU tensors share the memory of the environment's arrays; for
    another device they are copied. Differences from the vector environment:

    - "final_obs" is one tensor for all walkers.
    - The entries of `info` are tensors without masks. With "SameStep", those of an episode's last
      step are of that step, and "final_obs" is there in every step.
    - By default the step that ends an episode also begins the next one, as trainers of this kind
      expect.

    Args:
        num_envs: Number of walkers.
        scene: A scene, its name, or its arguments; see `PassiveWalkerEnv`.
        device: Device of the tensors.
        autoreset_mode: "SameStep" (the default), "NextStep" or "Disabled"; see
            `PassiveWalkerVectorEnv`.
        **changes: Further arguments of `PassiveWalkerVectorEnv`.

    Attributes:
        envs: The vector environment.
        device: Device of the tensors.
    """

    def __init__(
        self,
        num_envs: int = 1,
        scene: SceneLike = "level",
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
        """Wrap a vector environment; steps of either one advance the same walkers."""
        self = cls.__new__(cls)
        self.device, self.envs = torch.device(device), envs
        return self

    @property
    def num_envs(self) -> int:
        """Number of walkers."""
        return self.envs.num_envs

    @property
    def observation_space(self) -> Any:
        """Observation space of one walker."""
        return self.envs.single_observation_space

    @property
    def action_space(self) -> Any:
        """Action space of one walker."""
        return self.envs.single_action_space

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Any, dict[str, Any]]:
        """Begin episodes.

        Args:
            seed: Seed of the first environment, the others use seed + 1, ...; or one for each.
            options: Options of `PassiveWalkerVectorEnv.reset`; "reset_mask" may be a tensor.

        Returns:
            Observations, (num_envs, k) with k = 8 by default, or one tensor for each group of the
            scene's observation; and `info` as from `step`.
        """
        if options and isinstance(options.get("reset_mask"), Tensor):
            options = options | {"reset_mask": options["reset_mask"].cpu().numpy()}
        observations, infos = self.envs.reset(seed=seed, options=options)
        return self._tensors(observations), self._infos(infos)

    def step(self, actions: Tensor) -> tuple[Any, Tensor, Tensor, Tensor, dict[str, Any]]:
        """Advance all walkers by one step.

        Args:
            actions: Shape (num_envs, actions of the scene).

        Returns:
            Observations (num_envs, k), with k = 8 by default; rewards, terminated and truncated,
            each (num_envs,); and `info`, tensors that are zero where an entry has no value.
            "outcome" is the index of a name in `interface.OUTCOMES`: up to 9 an `Outcome`, 0 where
            no stride or episode ended. With "SameStep", "final_obs" (num_envs, k) are the
            observations before the resets.

        Raises:
            ValueError: if the actions have another shape, or one is not finite.
            ResetNeeded: if an environment must be reset first.
        """
        observations, rewards, terminated, truncated, results = self.envs.step(
            actions.detach().cpu().numpy()
        )
        ended = terminated | truncated
        infos = Infos(distance=self._tensors(results["distance"]))
        if self.envs.autoreset_mode == AutoresetMode.SAME_STEP:
            last = self._tensors(observations)
            if ended.any():
                lanes = np.flatnonzero(ended)
                last = self._tensors(_replaced(observations, lanes, results["final_obs"][lanes]))
                results = _where(ended, results["final_info"], results)
                infos["distance"] = self._tensors(results["distance"])
            infos["final_obs"] = last
        infos.make = partial(self._infos, results)
        return (
            self._tensors(observations), self._tensors(rewards),
            self._tensors(terminated), self._tensors(truncated), infos,
        )  # fmt: skip

    @property
    def elapsed_steps(self) -> Tensor:
        """Number of steps of each walker's episode, (num_envs,)."""
        return self._tensors(self.envs.elapsed_steps)

    def set_elapsed_steps(self, steps: Tensor) -> None:
        """Set the number of steps of each walker's episode; see `PassiveWalkerVectorEnv`."""
        self.envs.set_elapsed_steps(steps.cpu().numpy())

    def _infos(self, infos: dict[str, Any]) -> dict[str, Tensor]:
        """Return infos as tensors without masks, and outcomes as numbers."""
        numbers = np.zeros(self.num_envs, np.int8)
        for i in np.flatnonzero(infos["outcome"]):
            numbers[i] = interface.OUTCOMES.index(infos["outcome"][i])
        return self._tensors({**infos, "outcome": numbers})

    def _tensors(self, part: Any) -> Any:
        """Return an array as a tensor, and a dictionary as one of tensors without masks."""
        if isinstance(part, Mapping):
            return {name: self._tensors(x) for name, x in part.items() if not name.startswith("_")}
        return torch.from_numpy(part).to(self.device)

    def render(self) -> Any:
        """Return a picture of each walker, or None without a render mode."""
        return self.envs.render()
