"""The native batch as a vectorized environment of stable-baselines3.

    from stable_baselines3 import PPO
    from gym_passive_walker.envs.sb3 import PassiveWalkerVecEnv

    PPO("MlpPolicy", PassiveWalkerVecEnv(64)).learn(1_000_000)

It does what a `DummyVecEnv` of as many monitored single environments does, at the cost of one
kernel call: the step that ends an episode returns the next one's first observation, and the info of
that environment holds "terminal_observation", "TimeLimit.truncated" and the "episode".
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker.envs import interface, task
from gym_passive_walker.envs.one_thread import one_thread
from gym_passive_walker.envs.registration import MAX_EPISODE_STEPS
from gym_passive_walker.envs.scene import Scene
from gym_passive_walker.envs.vector_env import PassiveWalkerVectorEnv
from gym_passive_walker.extras import extra
from gym_passive_walker.walkers import Walker, WalkerLike

with extra("train"):
    from stable_baselines3.common.vec_env import VecEnv


class Lane:
    """One of the walkers, for `get_attr` and `env_method`."""

    def __init__(self, vec_env: PassiveWalkerVecEnv, index: int) -> None:
        self._vec_env, self._index = vec_env, index

    def set_scene(self, scene: Any = None, **changes: Any) -> None:
        """Change the scene of all walkers; see `PassiveWalkerVectorEnv`."""
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
        """Angles and rates in the walker's own units."""
        return self._vec_env.envs.states[self._index]

    def set_energy_cost(self, energy: str | None) -> None:
        """Charge the motors of all walkers for another kind of work; see `PassiveWalkerEnv`."""
        self._vec_env.set_energy_cost(energy)

    def render(self) -> NDArray[np.uint8] | None:
        """A picture of the walker."""
        return self._vec_env.get_images()[self._index]


class PassiveWalkerVecEnv(interface.Adapter, VecEnv):
    """A batch of walkers as a `VecEnv` of stable-baselines3.

    Args:
        num_envs: How many walkers.
        scene: As for `PassiveWalkerEnv`.
        max_episode_steps: Steps after which an episode is truncated; -1 or None for never.
        seed: Seeds the first reset; a later one is seeded with `seed()`.
        walkers: As for `PassiveWalkerVectorEnv`.
        slopes: As for `PassiveWalkerVectorEnv`.
        threads: As for `PassiveWalkerVectorEnv`.
        render_mode: "rgb_array", or None.
        **changes: As for `PassiveWalkerEnv`.

    Attributes:
        envs: The vector environment that carries them.
    """

    def __init__(
        self,
        num_envs: int = 1,
        scene: Scene | str | Mapping[str, Any] = "level",
        *,
        max_episode_steps: int | None = MAX_EPISODE_STEPS,
        seed: int | None = None,
        walkers: Sequence[WalkerLike] | None = None,
        slopes: Sequence[float] | None = None,
        threads: int | None = None,
        render_mode: str | None = None,
        **changes: Any,
    ) -> None:
        self.envs = PassiveWalkerVectorEnv(
            num_envs,
            scene,
            max_episode_steps=max_episode_steps,
            walkers=walkers,
            slopes=slopes,
            threads=threads,
            render_mode=render_mode,
            autoreset_mode="SameStep",
            **changes,
        )
        self.batch = self.envs.batch
        self.token = self.batch.token
        num_envs = self.envs.num_envs
        self.lanes = [Lane(self, i) for i in range(num_envs)]
        super().__init__(
            num_envs,
            self.envs.single_observation_space,
            interface.action_space(self.scene),
        )
        metadata: dict[str, Any] = self.metadata
        metadata["render_fps"] = self.scene.frames_per_second
        if seed is not None:
            self.seed(seed)
        self._blank: list[dict[str, Any]] = [{} for _ in range(num_envs)]
        self._actions = np.zeros(num_envs * len(self.scene.actions))
        self._born = time.perf_counter()

    def reset(self) -> NDArray[np.float32]:
        """Begin an episode in every environment, with the seeds and options that were set."""
        options = self._common_options()
        seeds = None if all(seed is None for seed in self._seeds) else self._seeds
        observations, _ = self.envs.reset(seed=seeds, options=options)
        self.reset_infos = [{} for _ in range(self.num_envs)]
        self._reset_seeds()
        self._reset_options()
        return observations

    def _common_options(self) -> dict[str, Any]:
        """The options of all environments, one array for each."""
        names = set().union(*self._options)
        for name in names:
            if not all(name in options for options in self._options):
                raise ValueError(f"set option {name!r} for all environments or for none")
        return {name: [options[name] for options in self._options] for name in names}

    def step_async(self, actions: NDArray) -> None:
        """Take note of the actions, shape (num_envs, actions of the scene)."""
        actions = interface.numbers(actions, self.scene.actions)
        shape = (self.num_envs, len(self.scene.actions))
        if actions.shape != shape:
            raise ValueError(f"actions must have shape {shape}, not {actions.shape}")
        self._actions = actions.reshape(-1)

    @one_thread
    def step_wait(
        self,
    ) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.bool_], list[dict[str, Any]]]:
        """A step of every environment, and the next episode's start where one has ended."""
        observations = np.empty((self.num_envs, self.batch.observation_size), np.float32)
        rewards = np.empty(self.num_envs)
        dones, truncated = np.empty((2, self.num_envs), bool)
        flat = observations.reshape(-1)
        _, endings = self.batch.step(self._actions, flat, rewards, dones, truncated)
        if any(self._blank):  # someone has written into an info: it is theirs now
            self._blank = [info and {} for info in self._blank]
        infos = self._blank.copy()
        if endings:
            terminated = dones
            dones = terminated | truncated
            lanes = np.flatnonzero(dones).tolist()
            for i in lanes:
                infos[i] = self._last_info(i, observations[i].copy(), bool(terminated[i]))
            self.envs.renew()
            self.batch.start(lanes, flat)
        return observations, rewards.astype(np.float32), dones, infos

    def _last_info(
        self, lane: int, observation: NDArray[np.float32], terminated: bool
    ) -> dict[str, Any]:
        """The info of an environment at the end of its episode."""
        row = self.batch.ledger[lane]
        ended = interface.OUTCOMES[row["ending"]] if terminated else "time_limit"
        info: dict[str, Any] = {name: row[name].item() for name in task.EVERY_STEP}
        info |= {name: column[lane].item() for name, column in self.batch.info_values().items()}
        info["outcome"] = ended
        info["TimeLimit.truncated"] = bool(row["truncated"]) and not terminated
        info["terminal_observation"] = observation
        info["episode"] = {
            "r": round(float(row["total"]), 6),
            "l": int(row["steps"]),
            "t": round(time.perf_counter() - self._born, 6),
        }
        return info

    def close(self) -> None:
        """Close what draws."""
        self.envs.close()

    def get_images(self) -> Sequence[NDArray[np.uint8] | None]:
        """A picture of each walker."""
        frames = self.envs.render()
        return [None] * self.num_envs if frames is None else list(frames)

    def get_attr(self, attr_name: str, indices: int | Iterable[int] | None = None) -> list[Any]:
        """An attribute of some environments: one of `Lane`, or else of the vector environment."""
        lanes = [self.lanes[i] for i in self._get_indices(indices)]
        return [
            getattr(lane if hasattr(lane, attr_name) else self.envs, attr_name) for lane in lanes
        ]

    def set_attr(
        self, attr_name: str, value: Any, indices: int | Iterable[int] | None = None
    ) -> None:
        """Note something with some environments; what is simulated cannot be changed so.

        Raises:
            AttributeError: if it is an attribute of the walkers or of the vector environment.
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
        """No environment here is wrapped."""
        return [False for _ in self._get_indices(indices)]

    def set_slopes(
        self, slopes: ArrayLike, mask: NDArray[np.bool_] | None = None
    ) -> NDArray[np.float32]:
        """Give the strides that begin slopes of their own; see `PassiveWalkerVectorEnv`."""
        return self.envs.set_slopes(slopes, mask)
