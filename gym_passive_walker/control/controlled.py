"""The stride map of a walker whose motors follow a controller: a policy, or any function.

The controller observes the walker at the start of each control step, as in the environment, and
its torques are held until the next. The map is exact in double precision. Where the controller has
a derivative (the network of a trained policy has one) so has the map; else it is differentiated by
differences. Everything is dimensionless, and strides lead from point to point of the section.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from os import PathLike
from types import MappingProxyType
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker.arguments import check_tolerance, one_slope, shown
from gym_passive_walker.control.controllers import ControllerLike, SceneLike, acting
from gym_passive_walker.envs import task
from gym_passive_walker.envs.scene import CALM, CHANNELS, Scene, make_scene
from gym_passive_walker.envs.starts import Starts
from gym_passive_walker.gaits.drive import PASSIVE, Drive, for_each, one_drive
from gym_passive_walker.gaits.flow import MOTORS, ROWS, Walkers, go_on, new_records
from gym_passive_walker.gaits.passage import Change, Passage, imbalance, product
from gym_passive_walker.gaits.section import Section
from gym_passive_walker.gaits.stride_map import StrideMap
from gym_passive_walker.gaits.terrain import Terrain
from gym_passive_walker.physics.hybrid import Outcome, State
from gym_passive_walker.progress import progress
from gym_passive_walker.walkers import WalkerLike, as_walker

_STATE = len(State._fields)
_TOLD = (*ROWS, *MOTORS)
_TIME, _LENGTH, _KNEE, _PUSHED = map(_TOLD.index, ("time", "step_length", "knee_time", "push_work"))
_LOST = [_TOLD.index(name) for name in ("knee_loss", "heel_loss", "friction_loss")]
_MOVED = [_TOLD.index(name) for name in ("moved", "ankle_moved")]
_INPUTS = ("hip_torque", "ankle_torque", "push_off")  # of the flow, for each of CHANNELS
_RUNNING, _STRUCK = int(Outcome.RUNNING), int(Outcome.HEELSTRIKE)
_SLOPE = 7  # its place in an observation
_SHIFTS = 1e-6, 5e-4  # of a coordinate, for differences in double and in single precision
_BOUNDS = np.array(task.BOUNDS)


@dataclass(frozen=True, eq=False, kw_only=True)
class ControlledMap(Section):
    """The stride map of a walker under a controller; made by `stride_map`.

    Attributes:
        walker: The walker.
        slope: Slope in rad, where none is given to `apply` or `linearize`.
        controller: What acts: an object with `predict(observation, state, episode_start,
            deterministic)`, and perhaps `linearize(observation)`. What it remembers starts again
            with each stride.
        scene: Which motors it has, how strong they are, and how long it holds them.
        tolerance: Error of the integration, relative to the largest angle or rate.
    """

    slope: float
    controller: Any
    scene: Scene
    tolerance: float = 1e-12

    @property
    def name(self) -> str:
        """What the controller is called."""
        return str(getattr(self.controller, "name", type(self.controller).__name__))

    @property
    def passive(self) -> bool:
        """It is not: motors follow the controller."""
        return False

    @property
    def exact(self) -> bool:
        """Whether derivatives are exact: the controller has a derivative."""
        return callable(getattr(self.controller, "linearize", None))

    def with_tolerance(self, tolerance: float) -> Self:
        """The same map, followed with another tolerance."""
        return replace(self, tolerance=tolerance)

    @cached_property
    def _walkers(self) -> Walkers:
        using = tuple(_INPUTS[CHANNELS.index(name)] for name in self.scene.actions if name != "hip")
        return Walkers(
            walker=self.walker, using=using, tolerance=self.tolerance,
            parameters={} if self.values is None else {str(self.parameter): self.values},
            stub=bool(self.scene.stub) and self.walker.knees,
        )  # fmt: skip

    def beginning(self, slopes: ArrayLike) -> NDArray[np.float64]:
        """Where walks begin at some slopes: as in the environment, near a gait of the walker.

        Args:
            slopes: Slopes in rad, (n,).

        Returns:
            Points, (n, m).
        """
        begun = Starts(self.scene, self.walker)
        values = np.ravel(slopes).tolist()
        states = {slope: begun.state(slope) for slope in set(values)}
        return self.point(np.array([states[slope] for slope in values]))

    def apply(
        self, points: NDArray, slopes: ArrayLike | None = None, *, strides: int = 1
    ) -> Passage:
        """Take walkers through some strides.

        Args:
            points: Points of the section, (n, m).
            slopes: Slope in rad, one for all or (n,); the map's own when None.
            strides: Strides to take.
        """
        slopes = for_each(self.slope if slopes is None else slopes, len(points))
        told, outcomes = self._strides(points, slopes, strides)
        return Passage(**self._named(told[:, :, 0]), outcomes=outcomes)

    def linearize(
        self,
        points: NDArray,
        slopes: ArrayLike | None = None,
        *,
        strides: int = 1,
        by: Sequence[str] = ("state",),
        along: NDArray | None = None,
    ) -> tuple[Passage, Change]:
        """Take walkers through some strides, with derivatives.

        Args:
            points: Points of the section, (n, m).
            slopes: Slope in rad, one for all or (n,); the map's own when None.
            strides: Strides to take.
            by: Columns of the derivatives, in order: "state" (one for each coordinate), "slope",
                or a parameter of the walker, all else being held dimensionless.
            along: Directions for "state" instead of the coordinates, (n, m, k).

        Returns:
            Where the strides lead, and the derivatives of all of it: exact, or by differences where
            the controller has no derivative, to about eight digits of a function and three of
            `predict`, which observes in single precision.

        Raises:
            ValueError: if a controller without derivative is asked for one by a parameter.
        """
        slopes = for_each(self.slope if slopes is None else slopes, len(points))
        m = self.dimension
        ways: Any = along
        if ways is None:
            ways = np.broadcast_to(np.eye(m), (len(points), m, m))
        if not self.exact:
            told, outcomes = self._by_differences(points, slopes, strides, by, ways)
        else:
            changes, moving, columns = [np.zeros((len(points), m, 0))], {}, 0
            for name in by:
                part = ways if name == "state" else np.zeros((len(points), m, 1))
                if name != "state":
                    moving[name] = columns
                columns += part.shape[2]
                changes.append(part)
            seeds = np.concatenate(changes, axis=2)
            told, outcomes = self._strides(points, slopes, strides, seeds, moving)
        passage = Passage(**self._named(told[:, :, 0]), outcomes=outcomes)
        return passage, Change(**self._named(told[:, :, 1:]))

    def _named(self, told: NDArray) -> dict[str, NDArray]:
        """The fields of `Change` from (n, m + 6, ...)."""
        m = self.dimension
        names = ("durations", "lengths", "lost", "supplied", "knee_times", "imbalance")
        return {"ends": told[:, :m]} | {name: told[:, m + i] for i, name in enumerate(names)}

    def _strides(
        self,
        points: NDArray,
        slopes: NDArray,
        strides: int,
        seeds: NDArray | None = None,
        moving: Mapping[str, int] = MappingProxyType({}),
    ) -> tuple[NDArray, NDArray[np.int8]]:
        """What `Change` tells, values before tangents, (n, m + 6, 1 + k); and the outcomes.

        Args:
            points: Where they start, (n, m).
            slopes: Slope in rad, (n,).
            strides: How many.
            seeds: How points change along k tangents, (n, m, k); none when None.
            moving: What else changes along a tangent, by its number.
        """
        m, n = self.dimension, len(points)
        change = np.zeros((n, m, 0)) if seeds is None else seeds
        total = np.zeros((n, m + 6, 1 + change.shape[2]))
        outcomes = np.full(n, _STRUCK, np.int8)
        with progress("strides under a controller", strides) as taken:
            for _ in range(strides):
                told, ended = self._stride(points, slopes, change, moving)
                outcomes = np.where(outcomes == _STRUCK, ended, outcomes)
                total[:, m : m + 4] += told[:, m : m + 4]
                total[:, :m], total[:, m + 4] = told[:, :m], told[:, m + 4]
                points, change = told[:, :m, 0], told[:, :m, 1:]
                taken()
                if not (outcomes == _STRUCK).any():
                    break
        with np.errstate(all="ignore"):
            lost, supplied, none = total[:, m + 2], total[:, m + 3], np.zeros((n, 1))
            total[:, m + 5] = imbalance(lost, supplied, none, total[:, m + 1])
        return total, outcomes.astype(np.int8)

    def _by_differences(
        self, points: NDArray, slopes: NDArray, strides: int, by: Sequence[str], ways: NDArray
    ) -> tuple[NDArray, NDArray[np.int8]]:
        """As `_strides`, by central differences."""
        if other := set(by) - {"state", "slope"}:
            raise ValueError(
                f"{self.name} has no derivative, so its map is differentiated by state and slope "
                f"alone, not by {', '.join(sorted(other))}"
            )
        shift = _SHIFTS[not isinstance(self.controller, _Function)]
        shifts: list[tuple[ArrayLike, float]] = []
        for name in by:
            if name == "slope":
                shifts.append((0.0, shift))
            else:
                shifts += [(shift * ways[:, :, j], 0.0) for j in range(ways.shape[2])]
        starts, grounds = [points], [slopes]
        for of_point, of_slope in shifts:
            starts += [points + of_point, points - of_point]
            grounds += [slopes + of_slope, slopes - of_slope]
        crowd = self._strides(np.concatenate(starts), np.concatenate(grounds), strides)
        told, outcomes = (x.reshape(len(starts), len(points), *x.shape[1:]) for x in crowd)
        changes = (told[1::2] - told[2::2]) / (2.0 * shift)
        return np.concatenate([told[0], np.moveaxis(changes[..., 0], 0, -1)], axis=-1), outcomes[0]

    def _observed(self, records: NDArray, slopes: NDArray) -> NDArray[np.float64]:
        """What the controller observes of walkers, as in the environment, (n, size)."""
        scene, record = self.scene, records[:, 0]
        seen = np.zeros((len(records), task.SIZE + (scene.command is not None) + 2 * scene.preview))
        links = np.array([phase.links for phase in self._walkers.system().phases])
        seen[:, :_STATE] = np.clip(record["state"], -_BOUNDS[:_STATE], _BOUNDS[:_STATE])
        seen[:, _STATE] = links[record["phase"]] == 2
        seen[:, _STATE + 1] = np.clip(slopes, -_BOUNDS[_STATE + 1], _BOUNDS[_STATE + 1])
        if scene.command is not None:
            seen[:, task.SIZE] = np.mean(scene.command)
        return seen

    def _stride(
        self, points: NDArray, slopes: NDArray, change: NDArray, moving: Mapping[str, int]
    ) -> tuple[NDArray, NDArray]:
        """One stride, control step by control step, as `_strides` but for the imbalance.

        The chain rule leads from one control step to the next: through the observation and the
        controller to the torques, and through the flow.
        """
        walkers, (n, m, width) = self._walkers, change.shape
        motors = [CHANNELS.index(name) for name in self.scene.actions]
        of_motors = [_INPUTS[channel] for channel in motors]
        by = ("state", *of_motors, *moving, "start") if width else ()
        by_slope = np.array([float(moving.get("slope") == j) for j in range(width)])
        works = np.array(walkers.system().works)
        change = self.state(change.swapaxes(1, 2)).swapaxes(1, 2)  # (n, 6, k)
        start = change[:, :1].copy()
        on = np.flatnonzero(self._sound(points))
        records = new_records(self.state(np.where(np.isfinite(points), points, 0.0)), slopes)
        told, books = np.full((n, m + 6, 1 + width), np.nan), np.zeros((n, 2, 1 + width))
        told[on, m + 4] = 0.0  # unless the knee locks
        outcomes = np.full(n, int(Outcome.DIVERGED))
        memory, step = None, 0
        while len(on):
            step += 1
            held, memory = self._act(records, slopes, memory, step == 1, change, by_slope)
            last = step * self._held_for >= self.scene.longest_stride
            records["moved"], records["turned"] = 0.0, 0.0
            records["end"] = self.scene.longest_stride if last else step * self._held_for
            for channel, torque in zip(motors, held[:, :, 0].T, strict=True):
                if channel < len(works):
                    records["control"][:, 0, channel] = torque
                else:
                    records["push_off"][:, 0] = torque
            walked = go_on(walkers, records[on], by, lanes=on, on_section=step == 1)
            rows = walked.told(_TOLD)
            parts = np.cumsum([1, _STATE, len(motors), len(moving)])
            values, by_state, by_held, by_rest, by_start = np.split(rows, parts, axis=2)
            if width:
                tangents = by_state @ change[on] + by_held @ held[on, :, 1:] + by_start @ start[on]
                for j, tangent in enumerate(moving.values()):
                    tangents[:, :, tangent] += by_rest[:, :, j]
                rows = np.concatenate([values, tangents], axis=2)
            else:
                rows = values
            books[on, 0] += rows[:, _LOST].sum(axis=1)  # friction and knee: since the start
            books[on, 0, 0] -= sum(records[name][on, 0] for name in ("friction_loss", "knee_loss"))
            for j, channel in enumerate(motors):
                if channel < len(works):
                    books[on, 1] += works[channel] * product(held[on, j], rows[:, _MOVED[channel]])
            records[on], change[on] = walked.here, rows[:, :_STATE, 1:]
            told[on[walked.locked], m + 4] = rows[walked.locked, _KNEE]
            outcomes[on], struck = walked.outcomes, walked.struck
            there, ended = on[struck], rows[struck]
            told[there, : m + 2] = ended[:, [*self.coordinates, _TIME, _LENGTH]]
            sine = np.concatenate(
                [np.sin(slopes)[:, None], np.cos(slopes)[:, None] * by_slope], axis=1
            )
            books[there, 1] += product(sine[there], ended[:, _LENGTH]) + ended[:, _PUSHED]
            on = on[walked.outcomes == _RUNNING]
            if last:
                outcomes[on] = int(Outcome.STALLED)
                break
        told[:, m + 2 : m + 4] = books
        told[outcomes != _STRUCK] = np.nan
        if not self.walker.knees:
            told[:, m + 4] = np.nan
        return told, outcomes

    @property
    def _held_for(self) -> float:
        """How long the controller's actions are held."""
        return self.scene.tick if self.scene.control == "tick" else math.inf

    def _act(
        self,
        records: NDArray,
        slopes: NDArray,
        memory: Any,
        first: bool,
        change: NDArray,
        by_slope: NDArray,
    ) -> tuple[NDArray[np.float64], Any]:
        """What motors are given, with tangents, (n, motors, 1 + k); and what is remembered."""
        n, largest = len(records), np.array([self.scene.largest(x) for x in self.scene.actions])
        seen = self._observed(records, slopes)
        if self.exact:
            actions, by_seen = self.controller.linearize(seen)
        else:
            begun = np.full(n, first)
            if not isinstance(self.controller, _Function):
                seen = seen.astype(np.float32)  # as the environment gives it
            actions, memory = self.controller.predict(seen, memory, begun, deterministic=True)
        actions, shape = np.asarray(actions, dtype=float), (n, len(largest))
        if actions.size != n * len(largest) or not np.all(np.isfinite(actions)):
            raise ValueError(
                f"{self.name} must return actions of shape {shape}, one for each of "
                f"{', '.join(self.scene.actions)}, all finite, not {shown(actions)}"
            )
        actions = actions.reshape(shape)
        least = np.array([0.0 if name == "push_off" else -1.0 for name in self.scene.actions])
        held = np.zeros((n, len(largest), 1 + len(by_slope)))
        held[:, :, 0] = largest * np.clip(actions, least, 1.0)
        if len(by_slope):
            inside = np.abs(records["state"][:, 0]) < _BOUNDS[:_STATE]
            tangents = (by_seen[:, :, :_STATE] * inside[:, None]) @ change
            tangents += by_seen[:, :, _SLOPE, None] * by_slope
            free = (actions > least) & (actions < 1.0)
            held[:, :, 1:] = (largest * free)[:, :, None] * tangents
        return held, memory

    def _sound(self, points: NDArray) -> NDArray[np.bool_]:
        """Whether strides may begin at points: no knee bent backwards, no leg on the ground."""
        with np.errstate(invalid="ignore"):
            sound = (points[:, 0] > 0.0) & (points[:, 0] < 0.5 * math.pi)
            return sound & (points[:, 3] <= points[:, 2]) if self.walker.knees else sound


def stride_map(
    walker: WalkerLike | None = None,
    slope: float | None = None,
    *,
    controller: ControllerLike | Drive | Callable[[NDArray], ArrayLike] | None = None,
    scene: SceneLike | None = None,
    tolerance: float = 1e-12,
) -> StrideMap | ControlledMap:
    """The stride map (the Poincare map) of a walker, passive or under a controller.

    Example:
        >>> import gym_passive_walker as gpw
        >>> strides = gpw.stride_map(controller=gpw.load_policy("level-ppo"))
        >>> strides.exact  # its network has a derivative, and so has the map
        True

    Args:
        walker: The walker, in a form that `as_walker` takes; the scene's when None.
        slope: Slope in rad; the scene's, or the middle of its range, when None.
        controller: What acts: None for a passive walker; a `Drive`, the same in each stride; a
            trained policy, a baseline, or the name of either; any object with
            `predict(observation, state, episode_start, deterministic)`; or a function from
            observations (n, 8) to actions (n, actions). What it remembers starts again with each
            stride.
        scene: Which motors a controller has, how strong they are and how long its actions are
            held, in a form that `make_scene` takes; the policy's own or "level" when None. Its
            disturbances are left out.
        tolerance: Error of the integration, relative to the largest angle or rate.

    Returns:
        The map. Its `apply` and `linearize` take points of the section, which `points_at` makes of
        states.

    Raises:
        ValueError: if the controller cannot act, or an argument is out of its range.
    """
    tolerance = check_tolerance(tolerance)
    if controller is None or isinstance(controller, Drive):
        if scene is not None and walker is None:
            walker = make_scene(scene).walker
        if scene is not None and slope is None:
            slope = float(np.mean(make_scene(scene).slope))
        if walker is None or slope is None:
            raise ValueError("stride_map needs a walker and a slope, or a scene, or a policy")
        own, drive = as_walker(walker), controller or PASSIVE
        return StrideMap.of(
            own, slope=one_slope(slope), tolerance=tolerance, drive=one_drive(own, drive)
        )
    named: Any = controller
    if callable(named) and not hasattr(named, "predict"):
        named = _Function(named)
    if scene is None and not isinstance(named, str | PathLike):
        scene = getattr(named, "scene", "level")
    changes = {} if walker is None else {"walker": as_walker(walker)}
    acts, there = acting(named, scene, **changes)  # type: ignore[arg-type]
    there = calm(there, slope)
    return ControlledMap(
        walker=there.walker, slope=float(np.mean(there.slope)), controller=acts, scene=there,
        tolerance=tolerance,
    )  # fmt: skip


def calm(scene: Scene, slope: float | None = None) -> Scene:
    """A scene on smooth ground without disturbances, of one slope and one command.

    Args:
        scene: The scene. Motors are charged for absolute work, and an agent that sees the ground
            ahead sees that it is smooth.
        slope: Slope in rad; the scene's, or the middle of its range, when None.
    """
    slope = float(np.mean(scene.slope)) if slope is None else one_slope(slope)
    command = None if scene.command is None else float(np.mean(scene.command))
    smooth = {"terrain": Terrain(), "preview": scene.preview} if scene.preview else {}
    alike = {"energy": "absolute", "perturbation": 0.0, "randomise": {}}
    return make_scene(scene, **alike, **CALM | smooth | {"slope": slope, "command": command})


class _Function:
    """A controller that is a function of observations."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self.function, self.name = function, getattr(function, "__name__", "function")

    def predict(
        self, observation: NDArray, state: Any = None, *_: Any, **__: Any
    ) -> tuple[NDArray[np.float64], Any]:
        """Its actions."""
        return np.asarray(self.function(observation), dtype=float), state
