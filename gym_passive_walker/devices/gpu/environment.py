"""A vector environment with walkers and tensors on a GPU."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from gym_passive_walker._tools.extras import extra
from gym_passive_walker.devices.gpu.batch import DeviceBatch
from gym_passive_walker.devices.gpu.device import SIMULATED, cuda
from gym_passive_walker.envs import interface, task
from gym_passive_walker.envs.one_thread import Token, one_thread
from gym_passive_walker.envs.registration import MAX_EPISODE_STEPS
from gym_passive_walker.envs.transitions import TIMED_OUT
from gym_passive_walker.gaits.scenes.scene import SceneLike

with extra("train"):
    import torch
    from torch import Tensor


class PassiveWalkerGpuEnv:
    """A vector environment with torch tensors that simulates its walkers on a GPU.

    A step transfers nothing to the CPU, and does not synchronize. The step that ends an episode
    begins the next one. The rules are those of `PassiveWalkerVectorEnv`. Random numbers differ:
    they are functions of a walker's key. Draws of domain randomization are equal, with the pool of
    `batch.scene`.

    Args:
        num_envs: Number of walkers.
        scene: A scene, its name, or its arguments; see `PassiveWalkerEnv`.
        max_episode_steps: Steps after which an episode is truncated; None or -1 never truncates.
        seed: Seed of the first walker; the others use seed + 1, seed + 2, ...
        **changes: Arguments of the scene to change; see `PassiveWalkerEnv`.

    Attributes:
        batch: The batch of walkers.
        device: Device of the tensors.

    Raises:
        NoDevice: if there is no GPU.
        ImportError: if torch is not installed.
    """

    def __init__(
        self,
        num_envs: int = 1,
        scene: SceneLike = "level",
        *,
        max_episode_steps: int | None = MAX_EPISODE_STEPS,
        seed: int = 0,
        **changes: Any,
    ) -> None:
        limit, self.token = interface.step_limit(max_episode_steps), Token()
        self.batch = DeviceBatch(num_envs, scene, step_limit=limit, seed=seed, **changes)
        self.device = torch.device("cpu" if SIMULATED else "cuda")
        self.num_envs = num_envs
        self.observation_space = interface.observation_space(self.batch.scene, self.batch.custom)
        self.action_space = interface.action_space(self.batch.scene)
        here = self.batch.arrays
        names = (
            "actions", "shown", "last", "rewards", "terminated", "truncated", "reported_draw",
        )  # fmt: skip
        self._at = {name: _tensor(getattr(here, name)) for name in names}
        self._draws = {
            name: torch.as_tensor(x, device=self.device) for name, x in self.batch.drawn.items()
        }
        self._reported, self._steps = _tensor(here.reported.words), _tensor(here.ledger["steps"])

    @one_thread
    def reset(self, *, seed: int | Sequence[int] | None = None) -> tuple[Tensor, dict[str, Any]]:
        """Begin an episode of every walker.

        Args:
            seed: Seed of the first walker, the others use seed + 1, ...; or one for each. None
                begins each walker's next episode.

        Returns:
            Observations, (num_envs, k), and `info` as from `step`, with zeros where there is no
            value yet.
        """
        if seed is not None:
            self.batch.seed(seed)
        self.batch.reset(stream=_stream())
        infos = self._infos()
        infos |= {name: torch.zeros_like(x) for name, x in infos.items() if name != "randomized"}
        infos["final_obs"] = self._rows("shown")
        return self._rows("shown"), infos

    @one_thread
    def step(self, actions: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor, dict[str, Any]]:
        """Step every walker.

        Args:
            actions: Actions on the GPU, (num_envs, actions of the scene). A non-finite action
                leaves its walker unchanged, and its reward is NaN.

        Returns:
            Observations (num_envs, k); rewards, terminated and truncated, each (num_envs,); and
            `info`: the measures of the step and of its stride, "outcome", and with
            `domain_randomization` "randomized", as in `PassiveWalkerTorchEnv`. Its entries of
            commands, pushes, constraints and terms of the reward are not there. "final_obs",
            (num_envs, k), are the observations before new episodes began.

        Raises:
            ValueError: if the actions have another shape.
        """
        wanted = self.num_envs, len(self.batch.scene.actions)
        if actions.shape != wanted:
            raise ValueError(f"actions must have shape {wanted}, not {tuple(actions.shape)}")
        self._at["actions"].copy_(actions.detach().T)
        self.batch.step(stream=_stream())
        rewards, terminated, late = (
            self._at[name].clone() for name in ("rewards", "terminated", "truncated")
        )
        infos = self._infos()
        infos["outcome"] = torch.where(late & ~terminated, TIMED_OUT, infos["outcome"])
        return self._rows("shown"), rewards, terminated, late, infos

    def _infos(self) -> dict[str, Any]:
        """Return the infos of the last step; outcomes without the time limit."""
        reported = self._reported.clone()
        infos: dict[str, Any] = {
            name: reported[_row(name)] for name in (*task.EVERY_STEP, *task.EVERY_STRIDE)
        }
        whole = reported.view(torch.int64)
        infos |= {name: whole[_row(name)] for name in ("strides", "outcome")}
        infos["final_obs"] = self._rows("last")
        if self._draws:
            rows = self._at["reported_draw"]
            infos["randomized"] = {name: x[rows] for name, x in self._draws.items()}
        return infos

    @one_thread
    def set_energy_cost(self, energy: str | None) -> None:
        """Set the work that the energy term counts, from the next step on; see `DeviceBatch`."""
        self.batch.set_energy_cost(energy)

    @property
    def elapsed_steps(self) -> Tensor:
        """Number of steps of each walker's episode, (num_envs,)."""
        return self._steps.clone()

    @one_thread
    def set_elapsed_steps(self, steps: Tensor) -> None:
        """Set the number of steps of each walker's episode; see `PassiveWalkerVectorEnv`."""
        limit = self.batch.step_limit
        found = interface.elapsed_steps(steps.cpu().numpy(), self.num_envs, limit)
        self._steps.copy_(torch.from_numpy(found))

    def _rows(self, name: str) -> Tensor:
        """Return a copy with a row for each walker."""
        return self._at[name].T.clone(memory_format=torch.contiguous_format)


def _row(name: str) -> int:
    """Return the row of a field of the ledger, in words of 8 bytes."""
    return task.LEDGER.fields[name][1] // 8  # type: ignore[index]


def _tensor(array: Any) -> Tensor:
    """Return a tensor that shares the memory of an array on the GPU."""
    return torch.from_numpy(array) if SIMULATED else torch.as_tensor(array, device="cuda")


def _stream() -> Any:
    """Return torch's current stream."""
    if SIMULATED:
        return 0
    found = torch.cuda.current_stream().cuda_stream
    return cuda.external_stream(found) if found else 0
