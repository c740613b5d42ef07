"""The native batch as a vectorized environment of stable-baselines3.

    from stable_baselines3 import PPO
    from gym_passive_walker.envs.sb3 import PassiveWalkerVecEnv

    PPO("MlpPolicy", PassiveWalkerVecEnv(64)).learn(1_000_000)

Its results are those of a `DummyVecEnv` of monitored single environments, at the cost of one kernel
call. The step that ends an episode returns the first observation of the next one. The `info` of
that environment then has "terminal_observation", "TimeLimit.truncated" and "episode".

A batch has one scene. `set_scene` and `set_energy_cost` therefore act on all environments, and are
refused for some of them. Attributes of the simulation are read-only.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Iterable, Sequence
from dataclasses import fields, replace
from operator import attrgetter
from typing import Any

import gymnasium
import numpy as np
from gymnasium.envs.registration import EnvSpec
from gymnasium.error import ResetNeeded
from gymnasium.wrappers import OrderEnforcing, TimeLimit
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker._tools.extras import extra
from gym_passive_walker.envs import interface, task
from gym_passive_walker.envs.batch import UNFINISHED
from gym_passive_walker.envs.infos import lane_values
from gym_passive_walker.envs.one_thread import one_thread
from gym_passive_walker.envs.registration import ID, MAX_EPISODE_STEPS
from gym_passive_walker.envs.vector_env import PassiveWalkerVectorEnv
from gym_passive_walker.envs.walker_env import PassiveWalkerEnv
from gym_passive_walker.gaits.scenes.scene import Scene, SceneLike
from gym_passive_walker.models.walkers import Walker, WalkerLike

with extra("train"):
    from stable_baselines3.common.monitor import Monitor
    from stable_baselines3.common.vec_env import VecEnv

_ACT_ON_ALL = ("set_scene", "set_energy_cost")  # methods that act on all walkers of a batch
_ARGUMENTS = tuple(field.name for field in fields(Scene))


def _of_all(place: str, about: str) -> Any:
    """Return a property of a `Lane` that all walkers have in common: an attribute of their env."""
    return property(attrgetter(f"_vec_env.{place}"), doc=about)


class Lane:
    """One of the walkers, with attributes and methods of a monitored single environment.

    `get_attr` and `env_method` use it.

    Attributes:
        episode_returns: Sum of the rewards of each finished episode.
        episode_lengths: Number of steps of each finished episode.
        episode_times: Time at its end, in s since the environment was made.
        notes: Attributes of the user's own, by name.
    """

    def __init__(self, vec_env: PassiveWalkerVecEnv, index: int) -> None:
        self._vec_env, self._index = vec_env, index
        self.episode_returns: list[float] = []
        self.episode_lengths: list[int] = []
        self.episode_times: list[float] = []
        self.notes: dict[str, Any] = {}

    def __getattr__(self, name: str) -> Any:
        own = self.__dict__
        if name not in own.get("notes", {}):
            of_all = " of its own: use that of all" * hasattr(own.get("_vec_env"), name)
            raise AttributeError(f"a walker of a batch has no {name!r}{of_all}")
        return own["notes"][name]

    def get_wrapper_attr(self, name: str) -> Any:
        """Return an attribute."""
        return getattr(self, name)

    def has_wrapper_attr(self, name: str) -> bool:
        """Return whether there is an attribute of that name."""
        return hasattr(self, name)

    @property
    def unwrapped(self) -> Lane:
        """This walker."""
        return self

    @property
    def spec(self) -> EnvSpec:
        """The specification of the single environment, for `gymnasium.make`."""
        limit, kwargs = self._vec_env.batch.step_limit, {"scene": self.scene}
        steps = None if limit == np.inf else int(limit)
        return replace(gymnasium.spec(ID), kwargs=kwargs, max_episode_steps=steps)

    render_mode = _of_all("envs.render_mode", "The render mode of all walkers.")
    metadata = _of_all("metadata", "Render modes and frames per second.")
    observation_space = _of_all("observation_space", "Observation space of one walker.")
    action_space = _of_all("action_space", "Action space of one walker.")
    scene = _of_all("scene", "The scene of all walkers.")
    energy_cost = _of_all("envs.energy_cost", "Work that the energy term counts, of all walkers.")
    needs_reset = _of_all(
        "batch.unfinished", "Whether no episode has begun, or a step was interrupted."
    )
    total_steps = _of_all("total_steps", "Number of steps in all episodes.")

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

    @property
    def contact(self) -> float:
        """Contact point of the stance foot along the slope, in the walker's units of length."""
        return self._vec_env.batch.contact(self._index).x

    @property
    def reward_terms(self) -> dict[str, float]:
        """Terms of the last reward by name; the reward is their sum; zero after a reset."""
        terms = self._vec_env.envs.reward_terms
        return {name: float(term[self._index]) for name, term in terms.items()}

    @property
    def np_random(self) -> np.random.Generator:
        """The random generator."""
        return self._vec_env.envs.np_random[self._index]

    def get_total_steps(self) -> int:
        """Return the number of steps in all episodes."""
        return self.total_steps

    def get_episode_rewards(self) -> list[float]:
        """Return the sum of the rewards of each finished episode."""
        return self.episode_returns

    def get_episode_lengths(self) -> list[int]:
        """Return the number of steps of each finished episode."""
        return self.episode_lengths

    def get_episode_times(self) -> list[float]:
        """Return the time at the end of each finished episode, in s."""
        return self.episode_times

    def set_scene(self, scene: Any = None, **changes: Any) -> None:
        """Change the scene of a batch of one; see `PassiveWalkerVectorEnv.set_scene`."""
        self._vec_env.env_method("set_scene", scene, indices=self._index, **changes)

    def set_energy_cost(self, energy: str | None) -> None:
        """Set the work that the energy term counts, in a batch of one; see `PassiveWalkerEnv`."""
        self._vec_env.env_method("set_energy_cost", energy, indices=self._index)

    def set_slope(self, slope: float) -> NDArray[np.float32]:
        """Set the slope of the stride that begins; see `PassiveWalkerEnv.set_slope`."""
        mask = np.zeros(self._vec_env.num_envs, bool)
        mask[self._index] = True
        return lane_values(self._vec_env.set_slopes(slope, mask), self._index)

    def render(self) -> NDArray[np.uint8] | None:
        """Return a picture of the walker; None without a render mode."""
        return self._vec_env.get_images()[self._index]

    def close(self) -> None:
        """Close the renderers of all walkers."""
        self._vec_env.close()


class PassiveWalkerVecEnv(interface.Adapter, VecEnv):
    """A batch of walkers as a `VecEnv` of stable-baselines3.

    Args:
        num_envs: Number of walkers.
        scene: A scene, its name, or its arguments; see `PassiveWalkerEnv`.
        seed: Seed of the first reset, as for `seed()`, which sets those of later resets.
        max_episode_steps: As for `PassiveWalkerVectorEnv`, as are the next four.
        walkers: Walkers of the scene's kind, (num_envs,), instead of the scene's.
        slopes: Slopes in rad, (num_envs,), instead of the scene's.
        threads: Most threads, with at least 512 walkers each; all free CPUs' when None.
        render_mode: "rgb_array", or None.
        **changes: Arguments of the scene to change; see `PassiveWalkerEnv`.

    Attributes:
        envs: The vector environment of the walkers.
    """

    def __init__(
        self,
        num_envs: int = 1,
        scene: SceneLike = "level",
        *,
        seed: int | Sequence[int | None] | None = None,
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
        fps = {"render_fps": self.scene.frames_per_second}
        self.metadata: dict[str, Any] = PassiveWalkerEnv.metadata | fps
        limited = self.batch.step_limit != np.inf
        self._wrappers = (Monitor, OrderEnforcing, *[TimeLimit] * limited)  # what they do is done
        self.total_steps = 0
        if seed is not None:
            self.seed(seed)
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
        self.metadata["render_fps"] = self.scene.frames_per_second  # it may be a new scene
        self.reset_infos = self._infos(np.zeros(self.num_envs, bool))
        self._reset_seeds()
        self._reset_options()
        return observations

    def seed(self, seed: int | Sequence[int | None] | None = None) -> Sequence[int | None]:
        """Set the seeds of the next reset.

        Args:
            seed: Seed of the first environment, the others use seed + 1, ...; or one for each. None
                draws them at random.

        Returns:
            The seed of each environment.

        Raises:
            ValueError: if there is not one seed for each environment.
        """
        if seed is None or isinstance(seed, int | np.integer):
            return super().seed(seed)  # type: ignore[arg-type]
        if len(seed) != self.num_envs:
            raise ValueError(f"{len(seed)} seeds for {self.num_envs} environments")
        self._seeds = list(seed)
        return self._seeds

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

        Raises:
            ResetNeeded: if no episode has begun, or a step was interrupted.
        """
        if self.batch.unfinished:
            raise ResetNeeded(UNFINISHED)
        observations = np.empty((self.num_envs, self.batch.observation_size), np.float32)
        rewards = np.empty(self.num_envs)
        dones, truncated = np.empty((2, self.num_envs), bool)
        flat = observations.reshape(-1)
        _, endings = self.batch.step(self._actions, flat, rewards, dones, truncated)
        self.total_steps += 1
        infos = self._infos(np.ones(self.num_envs, bool))
        for info in infos:
            info["TimeLimit.truncated"] = False
        if endings:
            terminated = dones
            dones = terminated | truncated
            lanes = np.flatnonzero(dones)
            for i in lanes.tolist():
                last = self.batch.in_groups(observations[i].copy())
                infos[i] |= self._ended(i, last, bool(terminated[i]))
            self.envs.renew()
            self.metadata["render_fps"] = self.scene.frames_per_second
            self.batch.go_on(lanes, flat)
        self.batch.unfinished = False
        return self.batch.in_groups(observations), rewards.astype(np.float32), dones, infos

    def _infos(self, stepped: NDArray[np.bool_]) -> list[dict[str, Any]]:
        """Return the info of each environment; `stepped` as for `Batch.reported`."""
        steps, (strides, outcomes), ended, measures = self.batch.reported(stepped)
        others = self.batch.info_values(stepped)
        drawn = others.pop("randomized", None)
        columns = dict(zip(task.EVERY_STEP, (*steps, strides), strict=True)) | others
        blank: dict[str, Any] = dict.fromkeys((*task.EVERY_STEP, *task.EVERY_STRIDE, *others), 0.0)
        blank["outcome"] = ""
        infos = []
        for row in zip(*(column.tolist() for column in columns.values()), strict=True):
            infos.append(blank.copy())  # most have no other entries
            infos[-1].update(zip(columns, row, strict=True))
        if drawn is not None:
            for info, row in zip(infos, zip(*drawn.values(), strict=True), strict=True):
                info["randomized"] = dict(zip(drawn, map(float, row), strict=True))
        for i in np.flatnonzero(outcomes).tolist():
            infos[i]["outcome"] = interface.OUTCOMES[outcomes[i]]
        for i, row in zip(ended.tolist(), measures.tolist(), strict=True):
            infos[i] |= zip(task.EVERY_STRIDE, row, strict=True)
        return infos

    def _ended(self, lane: int, observation: Any, terminated: bool) -> dict[str, Any]:
        """Keep return, length and time of an episode that has ended.

        Returns the entries that its last info has besides those of every step.
        """
        own, row = self.lanes[lane], self.batch.ledger[lane]
        total, steps = float(row["total"]), int(row["steps"])
        spent = time.perf_counter() - self._born
        own.episode_returns.append(total)
        own.episode_lengths.append(steps)
        own.episode_times.append(spent)
        return {
            "TimeLimit.truncated": bool(row["truncated"]) and not terminated,
            "terminal_observation": observation,
            "episode": {"r": round(total, 6), "l": steps, "t": round(spent, 6)},
        }

    def get_images(self) -> Sequence[NDArray[np.uint8] | None]:
        """Return a picture of each walker; None without a render mode."""
        frames = self.envs.render()
        if frames is None:
            warnings.warn("pictures need render_mode='rgb_array'", stacklevel=2)
            return [None] * self.num_envs
        return list(frames)

    def get_attr(self, attr_name: str, indices: int | Iterable[int] | None = None) -> list[Any]:
        """Return an attribute of some environments; `Lane` has those of single environments."""
        return [getattr(self.lanes[i], attr_name) for i in self._get_indices(indices)]

    def set_attr(
        self, attr_name: str, value: Any, indices: int | Iterable[int] | None = None
    ) -> None:
        """Set an attribute of the user's own; attributes of the simulation are read-only.

        Raises:
            AttributeError: if the attribute belongs to the simulation.
        """
        lanes = [self.lanes[i] for i in self._get_indices(indices)]
        if attr_name in _ARGUMENTS:
            raise AttributeError(
                f"{attr_name} cannot be set: it is an argument of the scene, which "
                f'env_method("set_scene", {attr_name}=...) changes for all environments'
            )
        taken = any(hasattr(each, attr_name) for each in (Lane, PassiveWalkerEnv, Monitor))
        if (
            taken
            or attr_name.startswith("_")
            or hasattr(self.envs, attr_name)
            or any(attr_name in vars(lane) for lane in lanes)
        ):
            raise AttributeError(f"{attr_name} cannot be set: it belongs to the environment")
        for lane in lanes:
            lane.notes[attr_name] = value

    def env_method(
        self,
        method_name: str,
        *method_args: Any,
        indices: int | Iterable[int] | None = None,
        **method_kwargs: Any,
    ) -> list[Any]:
        """Call a method of some environments; `Lane` has those of single environments.

        Raises:
            AttributeError: if there is no such method.
            ValueError: if `set_scene` or `set_energy_cost` is called for some of the environments.
        """
        lanes = [self.lanes[i] for i in self._get_indices(indices)]
        if method_name not in _ACT_ON_ALL:
            return [getattr(each, method_name)(*method_args, **method_kwargs) for each in lanes]
        if len({*lanes}) < self.num_envs:
            raise ValueError(
                f"{method_name} acts on all {self.num_envs} environments, since a batch has one "
                "scene: leave out indices, or make a PassiveWalkerVecEnv for each scene"
            )
        getattr(self, method_name)(*method_args, **method_kwargs)
        return [None] * len(lanes)

    def env_is_wrapped(
        self, wrapper_class: type, indices: int | Iterable[int] | None = None
    ) -> list[bool]:
        """Return whether each environment does what a wrapper adds.

        They have a monitor and a check for resets, and a time limit if `max_episode_steps` is one.
        """
        wrapped = any(issubclass(each, wrapper_class) for each in self._wrappers)
        return [wrapped for _ in self._get_indices(indices)]

    def set_slopes(
        self, slopes: ArrayLike, mask: NDArray[np.bool_] | None = None
    ) -> NDArray[np.float32]:
        """Set the slopes of strides that begin; see `PassiveWalkerVectorEnv.set_slopes`."""
        return self.envs.set_slopes(slopes, mask)
