"""The native batch as a vectorized environment of stable-baselines3.

    from stable_baselines3 import PPO
    from gym_passive_walker.envs.sb3 import PassiveWalkerVecEnv

    PPO("MlpPolicy", PassiveWalkerVecEnv(64)).learn(1_000_000)

Its results are those of a `DummyVecEnv` of monitored single environments, at the cost of one kernel
call. The step that ends an episode returns the first observation of the next one. The `info` of
that environment then has "terminal_observation", "TimeLimit.truncated" and "episode".
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from gymnasium.error import ResetNeeded
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker.envs import interface, task
from gym_passive_walker.envs.batch import UNFINISHED
from gym_passive_walker.envs.one_thread import one_thread
from gym_passive_walker.envs.registration import MAX_EPISODE_STEPS
from gym_passive_walker.envs.scene import Scene
from gym_passive_walker.envs.vector_env import PassiveWalkerVectorEnv
from gym_passive_walker.extras import extra
from gym_passive_walker.walkers import Walker, WalkerLike

with extra("train"):
    from stable_baselines3.common.vec_env import VecEnv


class Lane:
    """Access to one of the walkers, for `get_attr` and `env_method`."""

    def __init__(self, vec_env: PassiveWalkerVecEnv, index: int) -> None:
        self._vec_env, self._index = vec_env, index

    def set_scene(self, scene: Any = None, **changes: Any) -> None:
        """Change the scene of all walkers; see `PassiveWalkerVectorEnv.set_scene`."""
        self._vec_env.set_scene(scene, **changes)

    @property
    def walker(self) -> Walker:
        """The walker of this episode."""
        return self._vec_env.batch.walkers[self._index]

    @property
    def slope(self) -> float:
        """The slope of this episode, in rad."""
        return float(self._vec_env.batch.ledger["slope"][self._index])

    @property
    def state(self) -> NDArray[np.float64]:
        """Angles in rad and angular velocities in the walker's units, (6,).

        Of a `System` the coordinates and their rates, (2 m,).
        """
        return self._vec_env.envs.states[self._index]

    def set_energy_cost(self, energy: str | None) -> None:
        """Set the work that the energy term counts, for all walkers; see `PassiveWalkerEnv`."""
        self._vec_env.set_energy_cost(energy)

    def render(self) -> NDArray[np.uint8] | None:
        """Return a picture of the walker; None without a render mode."""
        return self._vec_env.get_images()[self._index]


class PassiveWalkerVecEnv(interface.Adapter, VecEnv):
    """A batch of walkers as a `VecEnv` of stable-baselines3.

    Args:
        num_envs: Number of walkers.
        scene: A scene, its name, or its arguments; see `PassiveWalkerEnv`.
        seed: Seed of the first reset; `seed()` sets those of later resets.
        max_episode_steps: As for `PassiveWalkerVectorEnv`, as are the next four.
        walkers: Walkers of one kind, (num_envs,), instead of the scene's.
        slopes: Slopes in rad, (num_envs,), instead of the scene's.
        threads: Number of threads for large batches; numba's number when None.
        render_mode: "rgb_array", or None.
        **changes: Arguments of the scene to change; see `PassiveWalkerEnv`.

    Attributes:
        envs: The vector environment of the walkers.
    """

    def __init__(
        self,
        num_envs: int = 1,
        scene: Scene | str | Mapping[str, Any] = "level",
        *,
        seed: int | None = None,
        max_episode_steps: int | None = MAX_EPISODE_STEPS,
        walkers: Sequence[WalkerLike] | None = None,
        slopes: Sequence[float] | None = None,
        threads: int | None = None,
        render_mode: str | None = None,
        **changes: Any,
    ) -> None:
        self.envs = PassiveWalkerVectorEnv(
            num_envs, scene, max_episode_steps=max_episode_steps, autoreset_mode="SameStep",
            walkers=walkers, slopes=slopes, threads=threads, render_mode=render_mode, **changes,
        )  # fmt: skip
        self.batch = self.envs.batch
        self.token = self.batch.token
        num_envs = self.envs.num_envs
        self.lanes = [Lane(self, i) for i in range(num_envs)]
        spaces = self.envs.single_observation_space, self.envs.single_action_space
        super().__init__(num_envs, *spaces)
        metadata: dict[str, Any] = self.metadata
        metadata["render_fps"] = self.scene.frames_per_second
        if seed is not None:
            self.seed(seed)
        self._actions = np.zeros(num_envs * len(self.scene.actions))
        self._born = time.perf_counter()

    def reset(self) -> NDArray[np.float32]:
        """Begin an episode in every environment, with the seeds and options set before.

        Returns:
            Observations, (num_envs, k) with k = 8 by default.
        """
        names = set().union(*self._options)
        for name in names:
            if not all(name in options for options in self._options):
                raise ValueError(f"set option {name!r} for all environments or for none")
        common = {name: [options[name] for options in self._options] for name in names}
        seeds = None if all(seed is None for seed in self._seeds) else self._seeds
        observations, _ = self.envs.reset(seed=seeds, options=common)
        self.reset_infos = self._infos(np.zeros(self.num_envs, bool))
        self._reset_seeds()
        self._reset_options()
        return observations

    def step_async(self, actions: NDArray) -> None:
        """Set the actions of the next step, (num_envs, actions of the scene).

        Raises:
            ValueError: if the actions have another shape.
        """
        actions = interface.numbers(actions, self.scene.actions)
        if actions.shape != self.envs.action_space.shape:
            shape = self.envs.action_space.shape
            raise ValueError(f"actions must have shape {shape}, not {actions.shape}")
        self._actions = actions.reshape(-1)

    @one_thread
    def step_wait(
        self,
    ) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.bool_], list[dict[str, Any]]]:
        """Step every environment, and begin the next episode of those that end.

        Returns:
            Observations (num_envs, k), rewards and ends of episodes, each (num_envs,), and infos.
        """
        observations = np.empty((self.num_envs, self.batch.observation_size), np.float32)
        rewards = np.empty(self.num_envs)
        dones, truncated = np.empty((2, self.num_envs), bool)
        flat = observations.reshape(-1)
        if self.batch.unfinished:
            raise ResetNeeded(UNFINISHED)
        _, endings = self.batch.step(self._actions, flat, rewards, dones, truncated)
        infos = self._infos(np.ones(self.num_envs, bool))
        for info in infos:
            info["TimeLimit.truncated"] = False
        if endings:
            terminated = dones
            dones = terminated | truncated
            lanes = np.flatnonzero(dones).tolist()
            for i in lanes:
                infos[i] |= self._last_info(i, observations[i].copy(), bool(terminated[i]))
            self.envs.renew()
            self.batch.start(lanes, flat)
        self.batch.unfinished = False
        return observations, rewards.astype(np.float32), dones, infos

    def _infos(self, stepped: NDArray[np.bool_]) -> list[dict[str, Any]]:
        """Return the info of each environment; `stepped` as for `Batch.reported`."""
        steps, (strides, outcomes), measures = self.batch.reported(stepped)
        others = self.batch.info_values(stepped)
        columns = dict(zip(task.EVERY_STEP, (*steps, strides), strict=True)) | others
        blank = dict.fromkeys((*task.EVERY_STEP, *task.EVERY_STRIDE, *others), 0.0)
        blank["outcome"] = ""
        infos = []
        for row in zip(*(column.tolist() for column in columns.values()), strict=True):
            infos.append(blank.copy())  # most have no other entries
            infos[-1].update(zip(columns, row, strict=True))
        for i in np.flatnonzero(outcomes).tolist():
            infos[i] |= zip(task.EVERY_STRIDE, measures[:, i].tolist(), strict=True)
            infos[i]["outcome"] = interface.OUTCOMES[outcomes[i]]
        return infos

    def _last_info(
        self, lane: int, observation: NDArray[np.float32], terminated: bool
    ) -> dict[str, Any]:
        """Return the entries that the last info of an episode has besides those of every step."""
        row = self.batch.ledger[lane]
        return {
            "TimeLimit.truncated": bool(row["truncated"]) and not terminated,
            "terminal_observation": observation,
            "episode": {
                "r": round(float(row["total"]), 6),
                "l": int(row["steps"]),
                "t": round(time.perf_counter() - self._born, 6),
            },
        }

    def close(self) -> None:
        """Close the renderers."""
        self.envs.close()

    def get_images(self) -> Sequence[NDArray[np.uint8] | None]:
        """Return a picture of each walker; None without a render mode."""
        frames = self.envs.render()
        return [None] * self.num_envs if frames is None else list(frames)

    def get_attr(self, attr_name: str, indices: int | Iterable[int] | None = None) -> list[Any]:
        """Return an attribute of some environments, from `Lane` or from the vector environment."""
        lanes = [self.lanes[i] for i in self._get_indices(indices)]
        return [
            getattr(lane if hasattr(lane, attr_name) else self.envs, attr_name) for lane in lanes
        ]

    def set_attr(
        self, attr_name: str, value: Any, indices: int | Iterable[int] | None = None
    ) -> None:
        """Set a new attribute of some environments; attributes of the simulation are read-only.

        Raises:
            AttributeError: if the walkers or the vector environment have a read-only attribute of
                that name.
        """
        if hasattr(self.envs, attr_name):
            raise AttributeError(f"{attr_name} cannot be set: it belongs to the environment")
        for i in self._get_indices(indices):
            setattr(self.lanes[i], attr_name, value)

    def env_method(
        self,
        method_name: str,
        *method_args: Any,
        indices: int | Iterable[int] | None = None,
        **method_kwargs: Any,
    ) -> list[Any]:
        """Call a method of `Lane` for some environments."""
        return [
            getattr(self.lanes[i], method_name)(*method_args, **method_kwargs)
            for i in self._get_indices(indices)
        ]

    def env_is_wrapped(
        self, wrapper_class: type, indices: int | Iterable[int] | None = None
    ) -> list[bool]:
        """Return False for each environment: none of them is wrapped."""
        return [False for _ in self._get_indices(indices)]

    def set_slopes(
        self, slopes: ArrayLike, mask: NDArray[np.bool_] | None = None
    ) -> NDArray[np.float32]:
        """Set the slopes of strides that begin; see `PassiveWalkerVectorEnv.set_slopes`."""
        return self.envs.set_slopes(slopes, mask)
