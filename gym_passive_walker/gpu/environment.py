"""A vector environment with walkers and tensors that never leave the device."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from gym_passive_walker.envs import interface, task
from gym_passive_walker.envs.one_thread import Token, one_thread
from gym_passive_walker.envs.registration import MAX_EPISODE_STEPS
from gym_passive_walker.envs.scene import Scene
from gym_passive_walker.extras import extra
from gym_passive_walker.gpu.batch import DeviceBatch
from gym_passive_walker.gpu.device import SIMULATED, cuda

with extra("train"):
    import torch
    from torch import Tensor


class PassiveWalkerGpuEnv:
    """A vector environment with torch tensors that simulates its walkers on a GPU.

    A step moves nothing to the CPU and waits for nothing: it only launches kernels on the GPU
    next. An episode that ends begins again in the same step. Walkers follow the rules of
    `PassiveWalkerVectorEnv`; their random numbers are others: functions of a walker's key.

    Args:
        num_envs: How many walkers.
        scene: As for `PassiveWalkerEnv`.
        max_episode_steps: Steps after which an episode is truncated; -1 or None for never.
        seed: Of the first walker; the next have those that follow.
        **changes: As for `PassiveWalkerEnv`.

    Attributes:
        batch: The batch on the device.
        device: Where tensors are.

    Raises:
        NoDevice: if there is no device.
        ImportError: if torch is not installed.
    """

    def __init__(
        self,
        num_envs: int = 1,
        scene: Scene | str | Mapping[str, Any] = "level",
        *,
        max_episode_steps: int | None = MAX_EPISODE_STEPS,
        seed: int = 0,
        **changes: Any,
    ) -> None:
        limit, self.token = interface.step_limit(max_episode_steps), Token()
        self.batch = DeviceBatch(num_envs, scene, step_limit=limit, seed=seed, **changes)
        self.device = torch.device("cpu" if SIMULATED else "cuda")
        self.num_envs = num_envs
        self.observation_space = interface.observation_space(
            self.batch.scene, self.batch.custom.observation_size
        )
        self.action_space = interface.action_space(self.batch.scene)
        self._buffers = self.batch.buffers._make(map(_tensor, self.batch.buffers))
        self._reported = _tensor(self.batch.walkers.reported.view(np.float64)).view(num_envs, -1)

    @one_thread
    def reset(self, *, seed: int | None = None) -> tuple[Tensor, dict[str, Any]]:
        """Begin an episode of every walker.

        Args:
            seed: Begin all over, with this seed; else with each walker's next episode.

        Returns:
            Observations, (num_envs, seen), and an empty dictionary.
        """
        if seed is not None:
            self.batch.seed(seed)
        self.batch.reset(stream=_stream())
        return self._rows(self._buffers.observations), {}

    @one_thread
    def step(self, actions: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor, dict[str, Any]]:
        """A step of every walker.

        Args:
            actions: On the device, (num_envs, actions of the scene). A walker stays as it is
                without a finite action, and its reward is not a number.

        Returns:
            Observations (num_envs, seen); rewards, terminated and truncated (num_envs,); and what
            infos, as in `PassiveWalkerTorchEnv`: also "final_obs", the observations
            before other episodes began.
        """
        buffers = self._buffers
        buffers.actions.copy_(actions.detach().reshape(-1))
        self.batch.step(stream=_stream())
        reported = self._reported.clone()
        infos = {
            name: reported[:, _column(name)] for name in (*task.EVERY_STEP, *task.EVERY_STRIDE)
        }
        whole = reported.view(torch.int64)
        infos |= {name: whole[:, _column(name)] for name in ("strides", "outcome")}
        infos["final_obs"] = self._rows(buffers.last)
        endings = buffers.terminated.clone(), buffers.truncated.clone()
        return self._rows(buffers.observations), buffers.rewards.clone(), *endings, infos

    @one_thread
    def set_energy_cost(self, energy: str | None) -> None:
        """Charge all motors for another kind of work, from the next step on; see `DeviceBatch`."""
        self.batch.set_energy_cost(energy)

    def _rows(self, flat: Tensor) -> Tensor:
        return flat.view(self.num_envs, -1).clone()


def _column(name: str) -> int:
    """Which word of its row in the ledger a field is."""
    return task.LEDGER.fields[name][1] // 8  # type: ignore[index]


def _tensor(array: Any) -> Tensor:
    """A device's array as a tensor: the same memory."""
    return torch.from_numpy(array) if SIMULATED else torch.as_tensor(array, device="cuda")


def _stream() -> Any:
    """The stream that torch works behind."""
    if SIMULATED:
        return 0
    found = torch.cuda.current_stream().cuda_stream
    return cuda.external_stream(found) if found else 0
