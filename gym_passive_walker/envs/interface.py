"""Interface of the environments: spaces, options, and names of entries in `info`."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NoReturn

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from gym_passive_walker._tools.arguments import shown, unknown, whole
from gym_passive_walker.envs import task
from gym_passive_walker.envs.custom import Custom
from gym_passive_walker.envs.infos import lane_values
from gym_passive_walker.envs.one_thread import Token, one_thread
from gym_passive_walker.gaits.scenes import rules
from gym_passive_walker.gaits.scenes.checks import CHECKS
from gym_passive_walker.gaits.scenes.rewards import DRAWN, OWN
from gym_passive_walker.gaits.scenes.scene import FASTEST, Scene, make_scene
from gym_passive_walker.models.equations.hybrid import Outcome

REASONS = {
    "contact": "lost_contact",
    "friction": "slipped",
    "knee lock": "stance_knee_gave_way",
    "scuffing": "scuffed",
}
"""Outcome of an episode that a constraint ends, by the constraint's name."""

OUTCOMES = (
    "",
    *(outcome.name.lower() for outcome in Outcome if outcome),
    *(REASONS[check] for check in CHECKS),
    "stopped",  # by the user's termination; see `transitions.STOPPED`
    "time_limit",
)
"""Names of outcomes, indexed by their numbers; empty where no stride or episode ends."""


NO_STRIDE: dict[str, Any] = {
    **dict.fromkeys((*task.EVERY_STEP, *task.EVERY_STRIDE), np.float64(0.0)),
    "strides": np.int64(0),
    "outcome": "",
}
"""The `info` of a single environment at a reset: a plain dictionary with NumPy numbers.

Libraries such as JAX take a subclass of dictionaries for a single value.
"""


def observation_space(scene: Scene, custom: Custom | None = None) -> Any:
    """Return the observation space of one walker; a `Dict` of an observation with groups.

    Args:
        scene: The scene; its options can add entries to the default observation.
        custom: The user's own functions; None without them.
    """
    if custom and custom.groups is not None:
        bounds: dict[str, list[tuple[Any, Any]]] = {}
        for group, part, place in custom.parts:
            high = np.full(place.stop - place.start, 1.0 if part == DRAWN else np.inf)
            ends = _own_bounds(scene) if part == OWN else (-high, high)
            bounds.setdefault(group, []).append(ends)
        joined = {name: map(np.concatenate, zip(*row, strict=True)) for name, row in bounds.items()}
        return spaces.Dict({name: _box(*ends) for name, ends in joined.items()})
    if custom and custom.observation_size is not None:
        return spaces.Box(-np.inf, np.inf, (custom.observation_size,), np.float32)
    return _box(*_own_bounds(scene))


def _own_bounds(scene: Scene) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the smallest and largest numbers of the environment's own observation."""
    commanded = scene.command is not None
    ahead = np.tile([rules.HIGHEST, rules.STEEPEST], scene.terrain_lookahead)
    body = np.full(len(scene.observe_body), rules.LARGEST_PROPORTION)
    lowest, largest = rules.bounds_of(scene.walker)
    low = np.concatenate([lowest, [0.0] * commanded, -ahead, -body])
    return low, np.concatenate([largest, [FASTEST] * commanded, ahead, body])


def _box(low: NDArray[np.float64], high: NDArray[np.float64]) -> Any:
    return spaces.Box(low.astype(np.float32), high.astype(np.float32), dtype=np.float32)


def action_space(scene: Scene) -> Any:
    """Return the action space of one walker: shares of the largest value of each actuator."""
    low = np.array([scene.least(name) for name in scene.actions], np.float32)
    return spaces.Box(low, np.ones_like(low), dtype=np.float32)


def step_limit(max_episode_steps: int | None) -> float:
    """Return the number of steps of an episode; infinite for -1 and None.

    Raises:
        ValueError: if it is no positive integer, -1 or None.
    """
    if max_episode_steps in (None, -1):
        return math.inf
    try:
        return float(whole(max_episode_steps, "max_episode_steps"))
    except ValueError as error:
        raise ValueError(f"{error}; without limit it is None or -1") from None


def elapsed_steps(steps: Any, count: int, limit: float) -> NDArray[np.int64]:
    """Return numbers of steps of `count` episodes after a check.

    Raises:
        ValueError: if they are not (count,) whole numbers from 0 on and below the limit.
    """
    found = np.asarray(steps)
    if found.shape != (count,) or found.dtype.kind not in "iu":
        raise ValueError(f"steps must be whole numbers of shape ({count},), not {shown(steps)}")
    if not np.all((found >= 0) & (found < limit)):
        below = "" if limit == math.inf else f" and below the time limit, {limit:g}"
        raise ValueError(f"steps must be from 0 on{below}, not {shown(steps)}")
    return found.astype(np.int64)


def reset_options(options: Mapping[str, Any] | None, known: Sequence[str]) -> dict[str, Any]:
    """Return a copy of the options of a reset.

    Raises:
        ValueError: if they are no mapping, or have an unknown name.
    """
    if options is None:
        return {}
    if not isinstance(options, Mapping):
        raise ValueError(f"options must map names to values, not {options!r}")
    if said := unknown(options, known, "reset"):
        raise ValueError(said)
    return dict(options)


def numbers(actions: Any, names: Sequence[str]) -> NDArray[np.float64]:
    """Return actions as an array of float64.

    Raises:
        ValueError: if they are no numbers.
    """
    try:
        return np.asarray(actions, dtype=np.float64)
    except (TypeError, ValueError):
        refuse(actions, names)


def refuse(action: Any, actions: Sequence[str], lane: int | None = None) -> NoReturn:
    """Raise an error that describes an invalid action.

    Raises:
        ValueError: always.
    """
    where = "" if lane is None else f" of environment {lane}"
    wanted = "one finite number" if len(actions) == 1 else f"finite numbers of {', '.join(actions)}"
    wanted = wanted if actions else "without numbers"
    given = action[0] if isinstance(action, np.ndarray) and action.shape == (1,) else action
    raise ValueError(
        f"the action{where} must be {wanted} (beyond -1 and 1 it is clipped), not {given}"
    )


class EnergyCost:
    """Energy cost of environments with a `batch`, and changes of their scene, which keep it."""

    batch: Any
    scene: Scene
    metadata: dict[str, Any]
    token: Token
    _next: Any = None  # the batch in a scene that begins later

    @property
    def energy_cost(self) -> str:
        """Work that the energy term counts: "absolute", "positive" or "net"."""
        return rules.ENERGIES[int(self.batch.rules["charged"][0])]

    @one_thread
    def set_energy_cost(self, energy: str | None) -> None:
        """Set the work that the energy term counts, from the next step on.

        It stays through resets and changes of other arguments of the scene: until the next call,
        or until `set_scene` is given a scene or `energy`.

        Args:
            energy: "absolute", "positive" or "net"; None restores the scene's own.

        Raises:
            ValueError: if there is no such kind.
            RuntimeError: if another thread is using this environment.
        """
        if energy is not None and energy not in rules.ENERGIES:
            allowed = ", ".join(map(repr, rules.ENERGIES))
            raise ValueError(f"motors are charged for {allowed} or None, not {energy!r}")
        for batch in (self.batch, self._next):
            if batch is not None:
                kind = batch.scene.energy if energy is None else energy
                batch.rules["charged"] = rules.ENERGIES.index(kind)

    def _changed(self, scene: Any, changes: Mapping[str, Any]) -> Any:
        """Return the batch in the scene that `set_scene` is given, before its episodes."""
        now = self.batch if self._next is None else self._next
        fresh = now.changed(make_scene(now.scene if scene is None else scene, **changes))
        if scene is None and "energy" not in changes:
            fresh.rules["charged"] = now.rules["charged"]
        return fresh

    def _become(self, fresh: Any) -> None:
        """Continue with the batch of `_changed`, in its scene."""
        self.batch.become(fresh)
        self.scene, self._next = fresh.scene, None
        self.metadata = {**self.metadata, "render_fps": self.scene.frames_per_second}


OF_EACH = {
    "walker": "walkers", "slope": "slopes", "state": "states", "np_random": "np_random",
    "np_random_seed": "np_random_seed", "set_slope": "set_slopes", "render": "render",
}  # fmt: skip
"""Names of a single environment that differ in a batch, and the batch's names for all of them."""

OF_ALL = {
    "scene": "scene", "energy_cost": "energy_cost", "render_mode": "render_mode",
    "observation_space": "single_observation_space", "action_space": "single_action_space",
    "set_scene": "set_scene", "set_energy_cost": "set_energy_cost",
}  # fmt: skip
"""Names of a single environment that are alike in a batch, and the batch's names of them."""


class SingleNames:
    """A vector environment's access to its single environments, as in Gymnasium's own."""

    num_envs: int

    def call(self, name: str, *args: Any, **kwargs: Any) -> tuple[Any, ...]:
        """Return an attribute of each environment, or what a method of each returns.

        The results are those of Gymnasium's `SyncVectorEnv`. A method acts on all environments.

        Args:
            name: An attribute ("walker", "slope", "state", "np_random", "np_random_seed", "scene",
                "energy_cost", "render_mode", "observation_space", "action_space") or a method
                ("render", "set_slope", "set_scene", "set_energy_cost") of `PassiveWalkerEnv`.
            *args: Arguments of the method.
            **kwargs: Keyword arguments of the method.

        Returns:
            The values, one for each environment.

        Raises:
            AttributeError: if it is another name. A batch has no single environments, of which one
                could be stepped, reset or saved.
            TypeError: if there are arguments, and the name is an attribute.
        """
        known = OF_EACH | OF_ALL
        if name not in known:
            raise AttributeError(
                f"call and get_attr have no {name!r}, because a batch is stepped, reset and saved "
                f"as a whole: choose {', '.join(known)}, or use attributes of the batch itself"
            )
        found: Any = getattr(self, known[name])
        if callable(found):
            found = found(*args, **kwargs)
        elif args or kwargs:
            raise TypeError(f"{name} is an attribute, which takes no arguments")
        if name in OF_ALL or found is None:
            return (found,) * self.num_envs
        return tuple(lane_values(found, i) for i in range(self.num_envs))

    def get_attr(self, name: str) -> tuple[Any, ...]:
        """Return an attribute of each environment; see `call`."""
        return self.call(name)

    def set_attr(self, name: str, values: Any) -> NoReturn:
        """Raise an error: attributes of the simulation are read-only.

        Raises:
            AttributeError: always.
        """
        raise AttributeError(
            f"{name} of a batch is read-only: use set_scene, set_slopes or set_energy_cost"
        )


class Adapter:
    """Methods that an adapter passes to its vector environment."""

    envs: Any

    @property
    def scene(self) -> Scene:
        """The scene."""
        return self.envs.scene

    def set_scene(self, scene: Any = None, **changes: Any) -> None:
        """Change the scene; see `PassiveWalkerVectorEnv.set_scene`."""
        self.envs.set_scene(scene, **changes)

    def set_energy_cost(self, energy: str | None) -> None:
        """Set the work that the energy term counts; see `PassiveWalkerVectorEnv`."""
        self.envs.set_energy_cost(energy)

    def get_state(self) -> dict[str, Any]:
        """Return a copy of everything that determines later steps and resets."""
        return self.envs.get_state()

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Restore a state from `get_state`."""
        self.envs.set_state(state)

    def close(self) -> None:
        """Close the renderers."""
        self.envs.close()
