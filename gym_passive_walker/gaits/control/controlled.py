"""The stride map of a walker under a controller: a policy, a feedback, any function.

A controller chooses at the start of each control step, as in the environment, and its torques are
held until the next. The map is exact in double precision. Where the controller has a derivative
(feedbacks and the networks of trained policies have one) so has the map; else it is differentiated
by differences. Everything is dimensionless, and strides lead from point to point of the section.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker._tools.arguments import shown
from gym_passive_walker._tools.progress import progress
from gym_passive_walker.engine.layout import layout_of
from gym_passive_walker.gaits.actuation import for_each
from gym_passive_walker.gaits.control.baselines import StrideFeedback
from gym_passive_walker.gaits.control.policy import method_of, policy_name
from gym_passive_walker.gaits.control.ticks import Choice, Steps, follow, hold_time
from gym_passive_walker.gaits.flow import (
    Walkers,
    go_on,
    ground_changes,
    new_records,
    numbers_of,
    report_of,
    states_in,
)
from gym_passive_walker.gaits.map_result import imbalance, product
from gym_passive_walker.gaits.scenes import rules
from gym_passive_walker.gaits.scenes.rules import bounds_of
from gym_passive_walker.gaits.scenes.scene import Scene, make_scene, recorded_weight
from gym_passive_walker.gaits.scenes.starts import Starts
from gym_passive_walker.gaits.stride import Stride, account, reported_as
from gym_passive_walker.gaits.stride_map import Samples, Seeds, StrideMap
from gym_passive_walker.models.equations.hybrid import Outcome
from gym_passive_walker.models.units import observed_numbers, unit_of
from gym_passive_walker.models.walkers.walker import Walker

_RUNNING, _STRUCK, _STALLED = map(int, (Outcome.RUNNING, Outcome.HEELSTRIKE, Outcome.STALLED))
_SHIFTS = 1e-6, 5e-4  # of a coordinate, for differences in double and in single precision
_SETTLING, _BESIDE = 100, 15  # strides and walkers before a search begins
_FAR = 0.1  # how far from the start these are, as a share of it


class _Asked(NamedTuple):
    """What a controller is asked for in a control step.

    Attributes:
        records: Records of the walkers, (n, 1).
        slopes: Slope in rad, (n,).
        step: Number of control steps that the stride has had.
        seeds: Tangents of the stride's start; none without derivatives.
        lanes: Indices of the walkers, where they differ in a parameter, (n,).
        ahead: Changes to the footholds ahead; smooth when None.
    """

    records: NDArray
    slopes: NDArray
    step: int
    seeds: Seeds
    lanes: NDArray
    ahead: NDArray | None = None


class _Planning:
    """A controller that plans each stride where it begins; its memory is the plan."""

    recalls, single = True, False

    def __init__(self, agent: Any) -> None:
        self.plan, self.plan_by = agent.plan, method_of(agent, "plan_by")
        self.exact = self.plan_by is not None

    def choose(self, strides: ControlledMap, asked: _Asked, memory: Any) -> tuple[Choice, Any]:
        """Return actions and the plan."""
        if asked.step == 0:
            points, seeds = strides.point(strides.states_of(asked.records)), asked.seeds
            plan, by = np.asarray(self.plan(points, asked.slopes)), None
            if seeds.points.shape[2]:
                by_point, by_slope = self.plan_by(points, asked.slopes)  # type: ignore[misc]
                by = by_point @ seeds.points[:, None] + by_slope[..., None] * seeds.slope
            memory = plan, by
        plan, by = memory
        now = min(asked.step, plan.shape[1] - 1)
        return Choice(plan[:, now], along=None if by is None else by[:, now]), memory


class _Observing:
    """A controller that acts in each control step; what it remembers starts with each stride."""

    def __init__(self, agent: Any) -> None:
        self.predict, self.linearize = agent.predict, method_of(agent, "linearize")
        self.exact = self.linearize is not None
        # A torch module has a method of this name.
        self.single = not self.exact and getattr(agent, "double", False) is not True
        # A memory is of all walkers, also of those with strides that have ended.
        self.recalls = not self.exact
        self.mean = method_of(agent, "mean_actions")  # of `linearize`, in a tenth of its time

    def choose(self, strides: ControlledMap, asked: _Asked, memory: Any) -> tuple[Choice, Any]:
        """Return actions and the controller's memory."""
        seen, seeds = strides.observed(asked), asked.seeds
        if self.linearize is None:
            if self.single:
                seen = seen.astype(np.float32)  # as the environment gives it
            begun = np.full(len(seen), asked.step == 0)
            actions, memory = self.predict(seen, memory, begun, deterministic=True)
            return Choice(actions), memory
        if not seeds.points.shape[2] and self.mean:
            return Choice(self.mean(seen)), None
        actions, by_seen = self.linearize(seen)
        inside = (
            np.abs(strides.states_of(asked.records)) < bounds_of(strides.walker)[1][: strides.size]
        )
        by_state = by_seen[:, :, : strides.size] * inside[:, None]
        along = by_seen[:, :, len(strides.walker.observed) - 1, None] * seeds.slope
        return Choice(actions, by_state, along), None


@dataclass(frozen=True, eq=False, kw_only=True)
class ControlledMap(StrideMap):
    """The stride map of a walker under a controller; made by `stride_map`.

    Attributes:
        agent: The controller. It has `plan(points, slopes)`, actions (n, steps, actions) of a
            stride from where that begins, and perhaps `plan_by`, their derivatives; or
            `predict(observation, state, episode_start, deterministic)`, and perhaps
            `linearize(observation)`, actions with their derivatives. What it remembers starts again
            with each stride.
        scene: Scene that gives the actuators, their limits and the control step.
        spread: Distance of differences, over the usual one.
        turned: Whether legs that differ are exchanged, as in every second stride.
    """

    agent: Any
    scene: Scene
    tolerance: float = 1e-12
    spread: float = 1.0
    turned: bool = False

    controlled = True

    @property
    def controller(self) -> Any:
        """The controller."""
        return self.agent

    @property
    def controller_name(self) -> str:
        """Name of the controller."""
        return policy_name(self.agent)

    @cached_property
    def _acts(self) -> _Planning | _Observing:
        """The controller, as it is asked in each control step."""
        return (_Planning if method_of(self.agent, "plan") else _Observing)(self.agent)

    @property
    def passive(self) -> bool:
        """False: the actuators follow the controller."""
        return False

    @property
    def exact(self) -> bool:
        """Whether derivatives are exact: the controller has a derivative."""
        return self._acts.exact

    @cached_property
    def swapped(self) -> Self:
        """This map of walkers with the legs exchanged; itself if they are alike."""
        return self if self.walker.legs_alike else replace(super().swapped, turned=not self.turned)

    def with_walker(self, walker: Walker) -> Self:
        """Return the map of another walker, with the same largest controls."""
        if walker is self.walker:
            return self
        lighter = recorded_weight(self.scene.walker) / recorded_weight(walker)
        most = self.scene.max_hip_torque * lighter
        there = make_scene(self.scene, walker=walker, max_hip_torque=most)
        return replace(self, walker=walker, scene=there)

    @cached_property
    def _seen_body(self) -> list[Any]:
        """What the controller observes of the walkers' parameters, a number or (n,) each."""
        first = self.swapped if self.turned else self
        return observed_numbers(first.walker, self.scene.observe_body, first.varied)

    def coarser(self) -> Self:
        """Return this map with differences over twice the distance, to estimate their error."""
        return replace(self, spread=2.0 * self.spread)

    @property
    def remembers(self) -> bool:
        """Whether the controller returns a memory, which it would take along to the next stride."""
        if method_of(self.agent, "plan"):
            return False
        slopes = np.array([self.chosen(None)])
        records = self._begun(self.state(self.beginning(slopes)), slopes)
        asked = _Asked(records, slopes, 0, self.seeds(1, (), None), np.zeros(1, np.intp))
        return self._choice(asked, None)[1] is not None

    @property
    def closes(self) -> float:
        """The largest violation of the equations of a gait at which its strides close."""
        return 1e-4 if self._acts.single else 1e-9

    @property
    def hold(self) -> float:
        """For how long torques are held."""
        return hold_time(self.scene)

    @property
    def terrain_lookahead(self) -> int:
        """Number of footholds ahead that the controller observes."""
        return self.scene.terrain_lookahead

    @cached_property
    def _motors(self) -> list[int]:
        """Index of each action among the scene's channels."""
        return [self.scene.channels.index(name) for name in self.scene.actions]

    @cached_property
    def _bounds(self) -> NDArray[np.float64]:
        """What the action 1 is, and the smallest action, of each action, (2, actions)."""
        bounds = self.scene.largest, self.scene.least
        return np.array([[of(name) for name in self.scene.actions] for of in bounds])

    @cached_property
    def _inputs(self) -> list[str]:
        """Name of each action's input, as in derivatives."""
        return [self.walker.inputs[motor] for motor in self._motors]

    @cached_property
    def walkers(self) -> Walkers:
        """The walkers, and how exactly they are followed."""
        return Walkers(
            walker=self.walker, using=tuple(self._inputs), tolerance=self.tolerance,
            parameters=self.varied,
            end_on_toe_stub=bool(self.scene.end_on_toe_stub and self.walker.toe_stubs),
        )  # fmt: skip

    def beginning(self, slopes: ArrayLike) -> NDArray[np.float64]:
        """Return points where walks begin, as in the environment: near a gait of the walker.

        Args:
            slopes: Slopes in rad, (n,).

        Returns:
            Points, (n, m).
        """
        begun = Starts(self.scene, self.walker)
        values = np.ravel(slopes).tolist()
        states = {slope: begun.state(slope) for slope in set(values)}
        return self.point(np.array([states[slope] for slope in values]))

    def likely(self, slope: float) -> NDArray[np.float64]:
        """Return points near which a gait may be: ends of walks from the start and beside it.

        Walks begin at the gait that the controller holds too, if it holds one.

        Args:
            slope: Slope in rad.

        Returns:
            Points (n, m); the starts are among them, as a gait may be unstable.
        """
        begun = self.beginning(slope)
        off = np.random.default_rng(0).uniform(-_FAR, _FAR, (_BESIDE, self.dimension))
        points = np.concatenate([begun, begun * (1.0 + off)])
        if isinstance(self.agent, StrideFeedback):
            held = self.agent.point
            if held.shape == points[0].shape and held.any():  # zero for constant controls
                points = np.concatenate([[held], points])
        settled = self.apply(points, slope, strides=_SETTLING).ends
        return np.concatenate([settled[np.isfinite(settled[:, 0])], points])

    def _follow(
        self,
        points: NDArray,
        slopes: NDArray,
        lanes: NDArray,
        strides: int,
        by: Sequence[str] = (),
        along: NDArray | None = None,
    ) -> tuple[NDArray, NDArray[np.int8]]:
        """Results as in `Change`, values before derivatives, (1 + k, m + 7, n); and outcomes."""
        m, n = self.dimension, len(points)
        change, moving = self.seeds(n, by, along)
        total = np.zeros((n, m + 7, 1 + change.shape[2]))
        outcomes = np.full(n, _STRUCK)
        places = np.tile(np.arange(len(self.ground)), strides).tolist()
        with (
            np.errstate(all="ignore"),
            progress("strides under a controller", len(places)) as taken,
        ):
            for place in places:
                now = self.swapped if place % 2 else self
                named = {now.walker.counterpart(name): at for name, at in moving.items()}
                seeds = Seeds(change, moving if now is self else named)
                results, ended = now._stride(points, slopes, lanes, seeds, place)
                outcomes = np.where(outcomes == _STRUCK, ended, outcomes)
                total[:, m : m + 5] += results[:, m : m + 5]
                total[:, :m], total[:, m + 5 :] = results[:, :m], results[:, m + 5 :]
                points, change = results[:, :m, 0], results[:, :m, 1:]
                taken()
                if not (outcomes == _STRUCK).any():
                    break
            rows = total[:, m + 2], total[:, m + 3], total[:, m + 6], total[:, m + 1]
            total[:, m + 6] = imbalance(*rows)
        return total.transpose(2, 1, 0), outcomes.astype(np.int8)

    def _stride(
        self, points: NDArray, slopes: NDArray, lanes: NDArray, seeds: Seeds, place: int
    ) -> tuple[NDArray, NDArray]:
        """One stride, as `_follow` but for the imbalance, (n, m + 7, 1 + k); and the outcomes.

        Where the imbalance goes is the push-off.
        """
        (n, m, width), moving = seeds.points.shape, seeds.moving
        sees_change = self.scene.observe_body and moving.keys() - {"slope"}
        if width and (sees_change or not self.exact):
            return self._differences(points, slopes, lanes, seeds, place)
        tilt, height_change, slope_change = self.ground[place]
        slopes, sound = slopes + tilt, self.chart.walking(points)
        states = self.state(np.where(np.isfinite(points), points, 0.5), place, lanes)
        change = self.state_by(points, seeds, place, lanes)
        steps = self._steps(
            states, slopes, lanes, np.flatnonzero(sound), seeds, change, rises=height_change,
            turns=slope_change, ahead=self.ahead(place),
        )  # fmt: skip
        at, of, rows = report_of(self.system).at, steps.walkers, steps.rows
        struck, over = steps.outcomes == _STRUCK, steps.outcomes != _RUNNING
        there, ended = of[struck], rows[struck]
        results = np.full((n, m + 7, 1 + width), np.nan)
        outcomes = np.full(n, int(Outcome.DIVERGED))
        results[sound, m + 2 :], outcomes[sound] = 0.0, _STALLED
        outcomes[of[over]] = steps.outcomes[over]
        results[there, : m + 2] = ended[:, [*self.chart.coordinates, at["time"], at["step_length"]]]
        results[of[steps.locked], m + 5] = rows[steps.locked, at["knee_time"]]
        lost, supplied, braked = results[:, m + 2], results[:, m + 3], results[:, m + 4]
        losses = [at[f"{name}_loss"] for name in ("knee", "heel", "friction")]
        lost_since = rows[:, losses].sum(axis=1)  # friction and knee: since the stride began
        lost_since[:, 0] -= steps.before["friction_loss"][:, 0] + steps.before["knee_loss"][:, 0]
        np.add.at(lost, of, lost_since)
        works = self.walkers.system().works
        for j, channel in enumerate(self._motors):
            if channel < len(works):
                held = steps.held[:, j]
                work = product(held, rows[:, at["moved", channel]])
                turned = product(np.sign(held[:, :1]) * held, rows[:, at["turned", channel]])
                np.add.at(supplied, of, works[channel] * work)
                np.add.at(braked, of, works[channel] * (turned - work))
            else:
                results[there, m + 6] = steps.held[struck, j]
        ground = np.zeros((n, 1 + width, 2))
        ground[:, 0, 0], ground[:, 0, 1] = np.sin(slopes), np.cos(slopes)
        if "slope" in moving:
            ground[:, 1 + moving["slope"]] = ground_changes(ground[:, 0], np.ones(1))[:, 0]
        sine, cosine = np.moveaxis(ground, 2, 0)
        fallen = product(sine[there], ended[:, at["step_length"]])
        fallen = self.weighted(fallen, lanes[there], moving)
        supplied[there] += fallen + ended[:, at["push_work"]]
        if self.terrain is not None:
            heights = np.zeros((len(there), 1 + width))
            columns = [0, *(1 + tangent for tangent in moving.values())]
            bodies = self.walkers.bodies(tuple(moving), lanes[there])
            heights[:, columns] = self._heights(bodies, (len(there), len(columns)), place)
            raised = product(cosine[there], heights)
            supplied[there] -= self.weighted(raised, lanes[there], moving)
        results[outcomes != _STRUCK] = np.nan
        if not self.walker.knees:
            results[:, m + 5] = np.nan
        return results, outcomes

    def _differences(
        self, points: NDArray, slopes: NDArray, lanes: NDArray, seeds: Seeds, place: int
    ) -> tuple[NDArray, NDArray]:
        """Return what `_stride` does, by central differences along the tangents."""
        change, (n, m) = seeds.points, points.shape
        apart = [name for name in seeds.moving if name != "slope"][1:]
        if apart:  # the walkers of a map differ in one parameter
            rest = {name: at for name, at in seeds.moving.items() if name not in apart}
            found, ended = self._differences(points, slopes, lanes, Seeds(change, rest), place)
            for name in apart:
                at = seeds.moving[name]
                own = Seeds(change[:, :, at : at + 1], {name: 0})
                beside, _ = self._differences(points, slopes, lanes, own, place)
                found[:, :, 1 + at] = beside[:, :, 1]
            return found, ended
        units = np.ones(change.shape[2])
        for name in seeds.moving.keys() & self.parameters.keys():
            units[seeds.moving[name]] = self._unit(name)
        size = np.abs(change).max(axis=1) * units
        size[:, list(seeds.moving.values())] += 1.0
        shift = self.spread * _SHIFTS[self._acts.single]
        steps = shift / np.where(size > 0.0, size, 1.0) * units  # (n, k)
        count, still = steps.shape[1], Seeds(np.zeros((n * steps.shape[1], m, 0)), {})
        results = []
        for shifts in (steps, -steps):
            starts = points[:, None] + (change * shifts[:, None]).swapaxes(1, 2)
            grounds = np.repeat(slopes[:, None], count, axis=1)
            every, changed = np.repeat(lanes, count), {}
            for name, tangent in seeds.moving.items():
                if name == "slope":
                    grounds[:, tangent] += shifts[:, tangent]
                else:
                    own = self.varied[name][lanes] if name in self.varied else self.parameters[name]
                    values = np.repeat(np.broadcast_to(own, n)[:, None], count, axis=1)
                    values[:, tangent] += shifts[:, tangent]
                    changed[name] = values.ravel()
            batch = self
            if changed:
                others = {name: values[every] for name, values in self.varied.items()}
                batch, every = replace(self, varied=others | changed), np.arange(n * count)
            taken, _ = batch._stride(starts.reshape(-1, m), grounds.ravel(), every, still, place)
            results.append(taken[:, :, 0].reshape(n, count, m + 7).swapaxes(1, 2))
        by = (results[0] - results[1]) / (2.0 * steps[:, None])
        values, ended = self._stride(points, slopes, lanes, Seeds(change[:, :, :0], {}), place)
        return np.concatenate([values, by], axis=2), ended

    def _unit(self, name: str) -> float:
        """Return the size of changes of a parameter: its unit; of a user's system, its value."""
        if "units" in self.walker.supports:
            return unit_of(self.walker, name)
        return abs(self.parameters[name]) or 1.0

    def _steps(
        self,
        states: NDArray,
        slopes: NDArray,
        lanes: NDArray,
        chosen: NDArray | None = None,
        seeds: Seeds | None = None,
        change: NDArray | None = None,
        *,
        rises: ArrayLike = 0.0,
        turns: ArrayLike = 0.0,
        ahead: NDArray | None = None,
    ) -> Steps:
        """A stride, control step by control step.

        Args:
            states: Initial states, (n, 6).
            slopes: Slope in rad, (n,).
            lanes: Indices of the walkers, where they differ in a parameter.
            chosen: Indices of the walkers to follow; all when None.
            seeds: Tangents; none when None.
            change: Changes of the states along these, (n, 6, k).
            rises: Height changes to the next footholds, in leg lengths.
            turns: Slope changes to the next footholds, in rad.
            ahead: Changes to the footholds ahead, as for `look`; smooth when None.
        """
        memory: Any
        seeds, recalls = seeds or self.seeds(len(states), (), None), self._acts.recalls

        def choose(chosen: NDArray, records: NDArray, number: int, on: NDArray) -> Choice:
            nonlocal memory
            if not recalls:
                chosen, records = chosen[on], records.take(on, axis=0)
            seen = ahead[chosen] if np.ndim(ahead) == 2 else ahead  # type: ignore[index]
            own = Seeds(seeds.points[chosen], seeds.moving)
            choice, memory = self._choice(
                _Asked(records, slopes[chosen], number, own, lanes[chosen], seen),
                memory if number else None,
            )
            return choice._make(x if x is None else x[on] for x in choice) if recalls else choice

        return follow(
            self.walkers, self._begun(states, slopes, rises, turns), choose,
            motors=self._inputs, tick=self.hold,
            max_stride_time=self.scene.max_stride_time, lanes=lanes, chosen=chosen,
            change=change if seeds.points.shape[2] else None, moving=seeds.moving,
        )  # fmt: skip

    def _begun(
        self, states: NDArray, slopes: NDArray, rises: ArrayLike = 0.0, turns: ArrayLike = 0.0
    ) -> NDArray:
        """Records in which strides begin, (n, 1)."""
        return new_records(
            states, slopes, height_change=rises, slope_change=turns,
            layout=layout_of(self.walkers.system()),
        )  # fmt: skip

    def _choice(self, asked: _Asked, memory: Any) -> tuple[Choice, Any]:
        """Return the controls of a control step, and the controller's memory."""
        (actions, by_state, along), memory = self._acts.choose(self, asked, memory)
        largest, least = self._bounds
        actions, shape = np.asarray(actions, dtype=float), (len(asked.records), len(largest))
        if actions.size != math.prod(shape) or not np.all(np.isfinite(actions)):
            raise ValueError(
                f"{self.controller_name} must return actions of shape {shape}, one for each of "
                f"{', '.join(self.scene.actions)}, all finite, not {shown(actions)}"
            )
        actions = actions.reshape(shape)
        free = (largest * ((actions > least) & (actions < 1.0)))[:, :, None]
        held = largest * rules.clip(actions, least, 1.0)
        by_state, along = (x if x is None else free * x for x in (by_state, along))
        return Choice(held, by_state, along), memory

    def observed(self, asked: _Asked) -> NDArray[np.float64]:
        """Return the controller's observations, as in the environment, (n, size)."""
        scene, records, ahead = self.scene, asked.records, asked.ahead
        body = [x[asked.lanes] if np.ndim(x) else x for x in self._seen_body]
        locked = np.array([phase.knee_locked for phase in self.walkers.system().phases])
        locked = locked[records["phase"][:, 0]]
        # Without terrain the ground ahead is smooth.
        rows = np.atleast_2d(np.zeros(2 * scene.terrain_lookahead) if ahead is None else ahead)
        changes = rows.reshape(len(rows), scene.terrain_lookahead, 2).transpose(1, 2, 0)
        command = None if scene.command is None else np.mean(scene.command)
        seen = rules.observed(
            scene, self.states_of(records).T, locked, asked.slopes, command, changes, body
        )  # fmt: skip
        return np.stack(np.broadcast_arrays(*seen), axis=1, dtype=float)

    def states_of(self, records: NDArray) -> NDArray[np.float64]:
        """States of walkers, (n, 6)."""
        return states_in(records[:, 0], self.size // 2)

    def _taken(
        self, state: ArrayLike, slope: ArrayLike, rise: ArrayLike, turn: ArrayLike, ahead: NDArray
    ) -> Stride:
        """Take the stride of `stride`, with known changes to the next foothold."""
        starts = self.dimensionless(state)
        slopes = for_each(slope, len(starts))
        units, system, n = self.units, self.walkers.system(), len(starts)
        rises = np.divide(rise, units.length)
        steps = self._steps(starts, slopes, np.arange(n), rises=rises, turns=turn, ahead=ahead)
        works, ended = np.zeros((2, 2, n)), self._begun(starts, slopes)
        before, after, places = steps.before[:, 0], steps.after[:, 0], reported_as(self.walker)
        for motor, (place, unit) in enumerate(zip(places, system.works, strict=True)):
            power = before["control"][:, motor] * (unit * units.energy)
            np.add.at(works[place, 0], steps.walkers, power * after["moved"][:, motor])
            np.add.at(works[place, 1], steps.walkers, np.abs(power) * after["turned"][:, motor])
        numbers_of(ended)[steps.walkers] = numbers_of(steps.after)  # the last of a walker's stays
        record, pushed = ended[:, 0], ended["push_work"][:, 0] * units.energy
        constants, shape = self.walkers.constants, np.shape(state)[:-1]
        return account(self.walker, system, constants, record, works, pushed, shape)

    def look(
        self,
        states: NDArray,
        slopes: ArrayLike,
        times: NDArray,
        rises: ArrayLike | None = None,
        turns: ArrayLike | None = None,
        ahead: NDArray | None = None,
    ) -> Samples:
        """Sample strides from states (n, 6) just after heelstrike; see `_steps` for the ground."""
        (n, k), each = times.shape, np.arange(len(states))
        rises, turns = (0.0 if x is None else x for x in (rises, turns))
        slopes = for_each(slopes, n)
        steps = self._steps(states, slopes, each, rises=rises, turns=turns, ahead=ahead)
        found = Samples(
            np.full((n, k, self.size), np.nan), np.zeros((n, k), np.int64),
            np.zeros((n, k, len(self.walker.inputs))),
        )  # fmt: skip
        rows, columns = np.nonzero(np.isfinite(times))
        wanted = times[rows, columns]
        # The control step of each time, of a walker's own one after the other; the last at the end.
        order, counts = np.lexsort((steps.numbers, steps.walkers)), np.bincount(steps.walkers)
        number = np.searchsorted(self.hold * np.arange(1, counts.max(initial=0) + 1), wanted)
        begin = (np.cumsum(counts) - counts)[rows]
        step = order[begin + np.minimum(number, counts[rows] - 1)]
        for first in (True, False):
            some = (steps.numbers[step] == 0) == first
            if not some.any():
                continue
            here, records = (rows[some], columns[some]), steps.before[step[some]]
            records["end"][:, 0] = wanted[some]
            seen = go_on(self.walkers, records, lanes=here[0], on_section=first)
            found.states[here], found.stages[here] = seen.states, seen.stages
            controls = records["control"][:, 0]
            if "push_off" in self.walker.inputs:
                controls = np.column_stack([controls, records["push_off"]])
            found.controls[here] = controls[:, : found.controls.shape[2]]
        return found
