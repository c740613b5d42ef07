"""Strides in control steps: what motors do is chosen as each begins, and held until it ends.

A stride is walked first without tangents. Where each control step begins is then known, so all of
them are followed side by side, each with the tangents of its own state and motors; the chain rule
makes those of the stride of them. That takes as long however many torques there are. Everything
here is dimensionless.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker.engine.layout import layout_of
from gym_passive_walker.gaits.actuation import Actuation
from gym_passive_walker.gaits.flow import (
    STATE_BEFORE,
    Reported,
    Walkers,
    go_on,
    new_records,
    numbers_of,
    report_of,
    rows_of,
)
from gym_passive_walker.gaits.map_result import NoStride
from gym_passive_walker.gaits.scenes.scene import Scene
from gym_passive_walker.gaits.stride_map import LONGEST
from gym_passive_walker.models.equations.hybrid import Outcome, State
from gym_passive_walker.models.walkers import Walker

_TOGETHER = 2048, 128  # walkers that are followed at once, without tangents and with them
_STATE = len(State._fields)
_RUNNING, _STRUCK = int(Outcome.RUNNING), int(Outcome.HEELSTRIKE)


def hold_time(scene: Scene) -> float:
    """Return for how long an action is held, over sqrt(l/g); infinite if for a whole stride."""
    return scene.tick if scene.control == "tick" else math.inf


def control_steps(scene: Scene, duration: float) -> int:
    """Return the number of control steps in a stride of some duration, over sqrt(l/g)."""
    return max(1, math.ceil(duration / hold_time(scene)))


class Choice(NamedTuple):
    """Controls of n walkers in a control step, and their derivatives.

    Attributes:
        held: Torques and push-offs, (n, motors).
        by_state: Derivatives of `held` by the states at the step's beginning, (n, motors, 6); None
            where it is chosen without them.
        along: Further changes of `held` along tangents, (n, motors, k); None if there are none.
    """

    held: NDArray[np.float64]
    by_state: NDArray[np.float64] | None = None
    along: NDArray[np.float64] | None = None


class Steps(NamedTuple):
    """The control steps of strides, those with which they begin before those that come after.

    Attributes:
        walkers: The walkers of these steps, (s,).
        numbers: The how-manieth of its stride each is, from 0, (s,).
        before: Records at the beginning of each, with controls and end time, (s, 1).
        after: Records at the end of each, (s, 1).
        change: Changes of their initial states along tangents, (s, 6, k).
        held: Controls, values before tangents, (s, motors, 1 + k).
        rows: Values and tangents of the rows of `report_of`, (s, rows, 1 + k).
    """

    walkers: NDArray[np.intp]
    numbers: NDArray[np.intp]
    before: NDArray
    after: NDArray
    change: NDArray[np.float64]
    held: NDArray[np.float64]
    rows: NDArray[np.float64]

    @property
    def outcomes(self) -> NDArray[np.int64]:
        """`Outcome` of each; RUNNING where its time was up."""
        return self.after["outcome"][:, 0]

    @property
    def locked(self) -> NDArray[np.bool_]:
        """In which a knee locked."""
        return _locked(self.before, self.after)


def follow(
    batch: Walkers,
    records: NDArray,
    choose: Callable[[NDArray, NDArray, int, NDArray], Choice],
    *,
    motors: Sequence[str],
    tick: float,
    max_stride_time: float = LONGEST,
    lanes: NDArray | None = None,
    change: NDArray | None = None,
    moving: Mapping[str, int] | None = None,
    chosen: NDArray | None = None,
    in_turn: bool = False,
) -> Steps:
    """Take walkers through a stride each, control step by control step.

    Args:
        batch: The walkers.
        records: Records at the beginning of strides, (n, 1).
        choose: Function of which walkers (c,), their records (c, 1), the control step's number, and
            the indices (d,) among them of those with strides that go on; it returns their controls.
        motors: Names of the actuators, some of `Model.inputs`.
        tick: Length of a control step, over sqrt(l/g).
        max_stride_time: Time after which a stride is given up, over sqrt(l/g).
        lanes: Index of each walker among `batch`, where these differ in a parameter.
        change: Changes of the states along k tangents, (n, 6, k); None without tangents.
        moving: Parameters that change along one tangent each, with its number: "slope", or the
            walkers' own.
        chosen: Indices of the walkers to follow; all when None.
        in_turn: Whether control steps are followed one after the other with their tangents.
    """
    again = partial(
        follow, batch, records, choose, motors=motors, tick=tick, max_stride_time=max_stride_time,
        lanes=lanes, change=change, moving=moving,
    )  # fmt: skip
    chosen = np.arange(len(records)) if chosen is None else chosen
    lanes = np.arange(len(records)) if lanes is None else lanes
    width, moving = 0 if change is None else change.shape[2], moving or {}
    if len(chosen) > (most := _TOGETHER[width > 0]):
        parts = [chosen[i : i + most] for i in range(0, len(chosen), most)]
        return _beside([again(chosen=part, in_turn=in_turn) for part in parts])
    by, report = ("state", *motors, *moving, "start") if width else (), report_of(batch.system())
    found, inputs = records.take(chosen, axis=0), batch.walker.inputs
    places = [inputs.index(motor) for motor in motors]
    if not len(chosen):
        shapes = ((report.size, width), (len(motors), 1 + width), (len(report.entries), 1 + width))
        empty = (np.empty((0, *shape)) for shape in shapes)
        return Steps._make([chosen, chosen, records[:0], records[:0], *empty])
    on, taken, choices = np.arange(len(chosen)), [], []
    while len(on):
        number = len(taken)
        choice, before = choose(chosen, found, number, on), found.take(on, axis=0)
        hold(before, places, choice.held)
        last = (number + 1) * tick >= max_stride_time
        before["end"] = max_stride_time if last else (number + 1) * tick
        before["moved"], before["turned"] = 0.0, 0.0
        tangents, own = by if in_turn else (), lanes[chosen[on]]
        walked = go_on(batch, before, tangents, lanes=own, on_section=number == 0)
        taken.append((on, before, walked.records))
        choices.append(choice)
        numbers_of(found)[on] = numbers_of(walked.here)
        on = on[walked.outcomes == _RUNNING]
        if last:
            break
    walkers, before, after = (_joined(parts) for parts in zip(*taken, strict=True))
    edges = np.cumsum([0, *(len(on) for on, _, _ in taken)])
    numbers = np.repeat(np.arange(len(taken)), np.diff(edges))
    held = np.concatenate([choice.held for choice in choices])[:, :, None]
    plain, astray = after[:, :1], walkers[:0]
    if change is None:
        rows, states = rows_of(after, report.entries), np.zeros((len(walkers), report.size, 0))
        return Steps(chosen[walkers], numbers, before, plain, states, held, rows)
    if not in_turn:
        after, alike = _side_by_side(batch, before, plain, by, lanes[chosen[walkers]], edges[1])
        astray, plain = np.unique(walkers[~alike]), after[:, :1]
    columns = [*moving.values()]
    states, along, rows = _chained(after, walkers, edges, choices, change[chosen], columns, report)
    steps = Steps(
        chosen[walkers], numbers, before, plain, states,
        np.concatenate([held, along], axis=2), rows,
    )  # fmt: skip
    if not len(astray):
        return steps
    kept = ~np.isin(walkers, astray)
    return _beside(
        [steps._make(of[kept] for of in steps), again(chosen=chosen[astray], in_turn=True)]
    )


def _chained(
    after: NDArray,
    walkers: NDArray,
    edges: NDArray,
    choices: Sequence[Choice],
    change: NDArray,
    columns: list[int],
    report: Reported,
) -> tuple[NDArray, NDArray, NDArray]:
    """Tangents of control steps' states and motors, and their results, by the chain rule.

    Args:
        after: Their ends, with tangents by the steps' own state and motors, (s, 1 + k).
        walkers: The walkers of these records, (s,).
        edges: Index at which the steps of each number begin, and the end of all.
        choices: Controls in the steps of each number.
        change: Changes of initial states, (n, 6, k); changed in place to those of final states.
        columns: Tangents along which a parameter changes.
        report: The rows that are reported.
    """
    size, width, motors = report.size, change.shape[2], choices[0].held.shape[1]
    values, by_state, by_held, by_rest, by_start = np.split(
        rows_of(after, report.entries), np.cumsum([1, size, motors, len(columns)]), axis=2
    )
    starts = change[walkers, : by_start.shape[2]]
    states, along = (np.zeros((len(walkers), each, width)) for each in (size, motors))
    for choice, (low, high) in zip(choices, pairwise(edges), strict=True):
        here, now = walkers[low:high], slice(low, high)
        states[now] = change[here]
        if choice.by_state is not None:
            along[now] += choice.by_state @ states[now]
        if choice.along is not None:
            along[now] += choice.along
        ends = by_state[now, :size] @ states[now] + by_held[now, :size] @ along[now]
        ends[:, :, columns] += by_rest[now, :size]
        change[here] = ends
    rows = by_state @ states + by_held @ along + by_start @ starts
    rows[:, :, columns] += by_rest
    return states, along, np.concatenate([values, rows], axis=2)


def _side_by_side(
    batch: Walkers,
    before: NDArray,
    plain: NDArray,
    by: Sequence[str],
    lanes: NDArray,
    first: int,
) -> tuple[NDArray, NDArray[np.bool_]]:
    """Control steps with their tangents, all followed at once, (s, 1 + k); and of which they hold.

    Values with tangents and without may differ by a rounding, which may move a strike from one
    control step to the next.
    """
    after = _joined([
        go_on(batch, before[some], by, lanes=lanes[some], on_section=begins).records
        for begins, some in ((True, slice(first)), (False, slice(first, None)))
        if len(before[some])
    ])  # fmt: skip
    alike = after["outcome"][:, 0] == plain["outcome"][:, 0]
    return after, alike & (_locked(before, after) == _locked(before, plain))


def _locked(before: NDArray, after: NDArray) -> NDArray[np.bool_]:
    """In which control steps a knee locked, by the records before and after, (s,)."""
    return after["knee_time"][:, 0] != before["knee_time"][:, 0]


def _joined(parts: Sequence[NDArray]) -> NDArray[Any]:
    """Arrays one after the other; records as plain numbers: NumPy compares their types fast."""
    if (kind := parts[0].dtype).names is None:
        return np.concatenate(parts)
    return np.concatenate([part.view(float) for part in parts]).view(kind)


def _beside(parts: Sequence[Steps]) -> Steps:
    """Steps of walkers and of others, in the order of `Steps`."""
    every = Steps._make(_joined(part) for part in zip(*parts, strict=True))
    order = np.argsort(every.numbers, kind="stable")
    return every._make(part.take(order, axis=0) for part in every)


def hold(records: NDArray, motors: Sequence[int], given: NDArray) -> None:
    """Set some inputs of walkers (n, 1), by their numbers, to values (n, motors)."""
    for motor, held in zip(motors, given.T, strict=True):
        if motor < records["control"].shape[2]:
            records["control"][:, 0, motor] = held
        else:
            records["push_off"][:, 0] = held


class PiecewiseConstantStride(NamedTuple):
    """Strides of n walkers under N torques, with their derivatives; NaN where a walker fell.

    Of a single stride (see `ticked_stride`) nothing but `steps` has the axis of walkers. Where
    torques are of several motors, (n, motors, N), so are `swing` and `turn`; T is how many there
    are for a walker.

    Attributes:
        end: Final point on the section, (n, m).
        duration: Time taken, (n,).
        length: Step length, (n,).
        swing: Net opening of the hip while each torque was held, (n, N): the net work of a unit.
        turn: Total rotation of the hip, either way, (n, N): the absolute work of a unit.
        push_work: Work of the push-off, (n,).
        kneestrike: Time of kneestrike, (n,); 0 without knees.
        by: Derivatives of all these, in this order, (n, m + 4 + 2 T, m + T + others). They are by
            the m coordinates of the initial state, the T torques, the push-off if there is one,
            and the other variables that were named.
        outcomes: `Outcome` of each, (n,).
        steps: The control steps.
    """

    end: NDArray[np.float64]
    duration: NDArray[np.float64]
    length: NDArray[np.float64]
    swing: NDArray[np.float64]
    turn: NDArray[np.float64]
    push_work: NDArray[np.float64]
    kneestrike: NDArray[np.float64]
    by: NDArray[np.float64]
    outcomes: NDArray[np.int64]
    steps: Steps

    @property
    def by_point(self) -> NDArray[np.float64]:
        """Derivative of the end by the start, (n, m, m)."""
        m = self.end.shape[-1]
        return self.by[..., :m, :m]

    @property
    def by_torque(self) -> NDArray[np.float64]:
        """Derivative of the end by the torques, (n, m, T)."""
        m = self.end.shape[-1]
        count = (self.by.shape[-2] - m - 4) // 2
        return self.by[..., :m, m : m + count]


def ticked_stride(
    walker: Walker,
    slope: float,
    point: NDArray,
    torques: NDArray,
    *,
    tick: float,
    push_off: float | None = None,
    end_on_toe_stub: bool = False,
    tolerance: float = 1e-12,
) -> PiecewiseConstantStride:
    """Follow one walker through a stride, each torque held for a control step.

    Args:
        walker: The walker.
        slope: Slope in rad.
        point: Start on the section, (m,).
        torques: Torques of the first motor (N,), or of several (motors, N); see `ticked_strides`.
        tick: Time for which a torque is held.
        push_off: Impulse just before heelstrike, if there is one.
        end_on_toe_stub: Whether a stubbed toe ends the stride.
        tolerance: Tolerance of the integration.

    Raises:
        NoStride: if the stride does not end with a heelstrike.
    """
    points, held = (np.asarray(x, dtype=float)[None] for x in (point, torques))
    motors = _inputs(walker, 1 if held.ndim == 2 else held.shape[1], push_off is not None)
    walkers = Walkers(
        walker=walker, tolerance=tolerance, end_on_toe_stub=end_on_toe_stub, using=motors
    )
    pushed = None if push_off is None else np.array([push_off])
    *parts, steps = ticked_strides(walkers, slope, points, held, tick=tick, push_offs=pushed)
    walked = PiecewiseConstantStride._make([*(part[0] for part in parts), steps])
    outcome = Outcome(int(walked.outcomes))
    if outcome != Outcome.HEELSTRIKE:
        raise NoStride(f"this stride does not end with a heelstrike but with {outcome.name}")
    return walked


def ticked_strides(
    walkers: Walkers,
    slopes: ArrayLike,
    points: NDArray,
    torques: NDArray,
    *,
    tick: float,
    push_offs: NDArray | None = None,
    by: Sequence[str] = (),
) -> PiecewiseConstantStride:
    """Follow walkers through a stride each, every torque held for a control step.

    Args:
        walkers: The walkers; they are `using` ankle torque and push-off if there are any.
        slopes: Slope in rad, one for all or (n,).
        points: Starts on the section, (n, m).
        torques: Torques of the first of the walker's `inputs`, (n, N), or of the first several of
            them, (n, motors, N); the last one is held until heelstrike, and those that come after
            it have no effect.
        tick: Time for which a torque is held.
        push_offs: Impulses just before heelstrike, (n,), if there are any.
        by: Columns of derivatives behind those by coordinates and motors: "slope", or parameters
            of the walker.
    """
    section, (n, m) = walkers.section, points.shape
    given = torques if torques.ndim == 3 else torques[:, None]
    motors, count = given.shape[1:]
    size, pushes = motors * count, push_offs is not None
    width = m + size + pushes + len(by)
    using = _inputs(walkers.walker, motors, pushes)

    def choose(chosen: NDArray, records: NDArray, number: int, on: NDArray) -> Choice:
        now, chosen = min(number, count - 1), chosen[on]
        held, along = given[chosen, :, now], np.zeros((len(chosen), len(using), width))
        along[:, range(motors), m + now + count * np.arange(motors)] = 1.0
        if push_offs is not None:
            held = np.column_stack([held, push_offs[chosen]])
            along[:, -1, m + size] = 1.0
        return Choice(held, along=along)

    change = np.zeros((n, section.size, width))
    change[:, :, :m] = section.state(np.eye(m)).T
    system = walkers.system()
    records = new_records(section.state(points), slopes, layout=layout_of(system))
    steps = follow(
        walkers, records, choose, motors=using, tick=tick, change=change,
        moving=dict(zip(by, range(width - len(by), width), strict=True)),
    )  # fmt: skip
    found, outcomes = np.zeros((n, m + 4 + 2 * size, 1 + width)), np.full(n, int(Outcome.STALLED))
    angles = found[:, m + 2 : -2].reshape(n, 2, motors, count, -1)  # a view: swing and turn
    report = report_of(system)
    places = [[report.at[name, j] for j in range(motors)] for name in ("moved", "turned")]
    turned = steps.rows[:, places]
    held_in = np.minimum(steps.numbers, count - 1)
    np.add.at(angles, (steps.walkers, slice(None), slice(None), held_in), turned)  # type: ignore[arg-type]
    struck, over = steps.outcomes == _STRUCK, steps.outcomes != _RUNNING
    ended = [*section.chart.coordinates, report.at["time"], report.at["step_length"]]
    found[steps.walkers[struck], : m + 2] = steps.rows[struck][:, ended]
    found[steps.walkers[struck], -2] = steps.rows[struck, report.at["push_work"]]
    found[steps.walkers[steps.locked], -1] = steps.rows[steps.locked, report.at["knee_time"]]
    outcomes[steps.walkers[over]] = steps.outcomes[over]
    found[outcomes != _STRUCK] = np.nan
    values, shape = found[:, :, 0], torques.shape
    return PiecewiseConstantStride(
        end=values[:, :m],
        duration=values[:, m],
        length=values[:, m + 1],
        swing=values[:, m + 2 : m + 2 + size].reshape(shape),
        turn=values[:, m + 2 + size : -2].reshape(shape),
        push_work=values[:, -2],
        kneestrike=values[:, -1],
        by=found[:, :, 1:],
        outcomes=outcomes,
        steps=steps,
    )


def _inputs(walker: Walker, motors: int, pushes: bool) -> tuple[str, ...]:
    """Return the names of the first motors, and of the push-off if there is one."""
    return (*walker.inputs[:motors], *("push_off",) * pushes)


def before_kneestrike(
    walkers: Walkers, walked: PiecewiseConstantStride
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The state of one walker on the verge of kneestrike, with its derivatives.

    Args:
        walkers: The walker, as in `ticked_strides`.
        walked: The stride of several motors, from `ticked_stride`, in which the knee locks.

    Returns:
        The dimensionless state (6,), and its derivatives by the columns of `walked.by`.
    """
    steps, motors = walked.steps, len(walked.swing)
    (now,) = np.flatnonzero(steps.locked)
    records = steps.before[[now]]
    records["end"] = (1.0 - STATE_BEFORE) * walked.kneestrike
    by = ("state", *Actuation._fields[:motors], "end")
    verge = go_on(walkers, records, by, on_section=steps.numbers[now] == 0)
    value, by_state, by_held, by_end = np.split(
        verge.rows[0, :_STATE], np.cumsum([1, _STATE, motors]), axis=1
    )
    change = by_state @ steps.change[now] + by_held @ steps.held[now, :motors, 1:]
    return value[:, 0], change + (1.0 - STATE_BEFORE) * by_end @ walked.by[-1:]
