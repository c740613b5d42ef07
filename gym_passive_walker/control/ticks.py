"""Strides under a torque that changes from tick to tick, with their exact derivatives.

Everything here is dimensionless. A point of the section is [stance angle, stance rate, thigh rate,
shank rate] for a kneed walker and [angle, stance rate, swing rate] for a straight-legged one.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker.engine.layout import RECORD
from gym_passive_walker.gaits.flow import MOTORS, ROWS, Flow, Walkers, go_on, new_records
from gym_passive_walker.gaits.passage import NoStride
from gym_passive_walker.physics.hybrid import Outcome, State
from gym_passive_walker.walkers import Walker

LONGEST = 20.0
"""Time after which a stride is given up."""

_TOLD = (*ROWS, *MOTORS)
_DURATION, _LENGTH, _KNEE, _PUSHED = map(
    _TOLD.index, ("time", "step_length", "knee_time", "push_work")
)
_OF_HIP = list(map(_TOLD.index, ("moved", "turned")))
_OF_BOTH = list(map(_TOLD.index, ("moved", "ankle_moved", "turned", "ankle_turned")))
_MOTORS = ("hip_torque", "ankle_torque")
_TOGETHER = 128  # walkers whose ticks are followed side by side
_STATE = len(State._fields)
_RUNNING, _STRUCK = int(Outcome.RUNNING), int(Outcome.HEELSTRIKE)
_SAMPLES = 200  # of a stride, for a picture
_VERGE = 1e-8  # of a stride, before its end: the heelstrike has not yet come


class TickedStride(NamedTuple):
    """Strides of n walkers under N torques, with their derivatives; NaN where a walker fell.

    Of a single stride (see `ticked_stride`) nothing has the axis of walkers. Where torques are of
    hip and ankle, (n, 2, N), so are `swing` and `turn`; T is how many there are for a walker.

    Attributes:
        end: Where each ends on the section, (n, m).
        duration: Time taken, (n,).
        length: Step length, (n,).
        swing: How far the hip opened while each torque was held, (n, N): the net work of a unit.
        turn: How far it turned, either way, (n, N): the absolute work of a unit.
        push_work: Work of the push-off, (n,).
        kneestrike: When the knee locks, (n,); 0 without knees.
        by: Derivatives of all these, in this order, by the m coordinates of the start, the T
            torques, the push-off if there is one, and what else was asked for,
            (n, m + 4 + 2 T, m + T + others).
        outcomes: How each ended, an `Outcome`, (n,).
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
    stub: bool = False,
    tolerance: float = 1e-12,
) -> TickedStride:
    """Follow one walker through a stride, each torque held for a tick; see `ticked_strides`.

    Args:
        walker: The walker.
        slope: Slope in rad.
        point: Start on the section, (m,).
        torques: Torques of the hip (N,), or of hip and ankle (2, N).
        tick: How long a torque is held.
        push_off: Impulse just before heelstrike, if there is one.
        stub: Whether a stubbed toe ends the stride.
        tolerance: Of the integration.

    Raises:
        NoStride: if the stride does not end with a heelstrike.
    """
    motors = ("ankle_torque",) * (np.ndim(torques) == 2) + ("push_off",) * (push_off is not None)
    walkers = Walkers(walker=walker, tolerance=tolerance, stub=stub, using=motors)
    points, held = (np.asarray(x, dtype=float)[None] for x in (point, torques))
    pushed = None if push_off is None else np.array([push_off])
    walked = ticked_strides(walkers, slope, points, held, tick=tick, push_offs=pushed)
    walked = TickedStride(*(x[0] for x in walked))
    outcome = Outcome(int(walked.outcomes))
    if outcome != Outcome.HEELSTRIKE:
        raise NoStride(f"this stride does not end with a heelstrike but with {outcome.name}")
    return walked


def before_kneestrike(
    walkers: Walkers,
    slope: float,
    point: NDArray,
    torques: NDArray,
    *,
    tick: float,
    walked: TickedStride,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The state of one walker on the verge of kneestrike, with its derivatives.

    Args:
        walkers: The walker, as in `ticked_strides`.
        slope: Slope in rad.
        point: Start on the section, (m,).
        torques: Torques of the hip (N,), or of hip and ankle (2, N).
        tick: How long a torque is held.
        walked: The stride, from `ticked_stride`, in which the knee locks.

    Returns:
        The dimensionless state (6,), and its derivatives by the columns of `walked.by`,
        (6, m + T + others).
    """
    held = np.reshape(torques, (1, -1, np.shape(torques)[-1]))
    _, motors, count = held.shape
    m, end = len(point), (1.0 - _VERGE) * float(walked.kneestrike)
    records = new_records(walkers.section.state(point[None]), slope)
    change = np.zeros((_STATE, walked.by.shape[-1]))
    change[:, :m] = walkers.section.state(np.eye(m)).T
    for k in range(count):
        until = end if k == count - 1 else min((k + 1) * tick, end)
        hold(records, held[:, :, k], until)
        followed = go_on(walkers, records, ("state", *_MOTORS[:motors], "end"), on_section=k == 0)
        value, by_state, by_motors, by_end = np.split(
            followed.told(State._fields)[0], np.cumsum([1, _STATE, motors]), axis=1
        )
        change = by_state @ change
        change[:, m + k : m + motors * count : count] += by_motors
        records = followed.here
        if until == end:
            break
    return value[:, 0], change + (1.0 - _VERGE) * by_end @ walked.by[-1:]


def ticked_strides(
    walkers: Walkers,
    slopes: ArrayLike,
    points: NDArray,
    torques: NDArray,
    *,
    tick: float,
    push_offs: NDArray | None = None,
    by: Sequence[str] = (),
) -> TickedStride:
    """Follow walkers through a stride each, every torque held for a tick.

    A tick is followed with its derivatives by the state in which it begins and by its own torque;
    the chain rule makes those of the stride of them, so that a tick costs the same however many
    there are.

    Args:
        walkers: Who walks; they are `using` ankle torque and push-off if there are any.
        slopes: Slope in rad, one for all or (n,).
        points: Starts on the section, (n, m).
        torques: Torques of the hip, (n, N), or of hip and ankle, (n, 2, N); the last one is held
            until heelstrike, and those that come after it have no effect.
        tick: How long a torque is held.
        push_offs: Impulses just before heelstrike, (n,), if there are any.
        by: Columns of derivatives behind those by coordinates and motors: "slope", or parameters
            of the walker.
    """
    n, m = points.shape
    held = torques if torques.ndim == 3 else torques[:, None]
    size = held.shape[1] * held.shape[2]
    pushes = 0.0 if push_offs is None else push_offs
    records = new_records(walkers.section.state(points), slopes, push_off=pushes)
    columns = by if push_offs is None else ("push_off", *by)
    parts = [
        _ticked(walkers, records, held, np.arange(i, min(i + _TOGETHER, n)), tick, columns)
        for i in range(0, n, _TOGETHER)
    ]
    told, outcomes = map(np.concatenate, zip(*parts, strict=True))
    told[outcomes != _STRUCK] = np.nan
    values, shape = told[:, :, 0], torques.shape
    return TickedStride(
        end=values[:, :m],
        duration=values[:, m],
        length=values[:, m + 1],
        swing=values[:, m + 2 : m + 2 + size].reshape(shape),
        turn=values[:, m + 2 + size : -2].reshape(shape),
        push_work=values[:, -2],
        kneestrike=values[:, -1],
        by=told[:, :, 1:],
        outcomes=outcomes,
    )


def _ticked(
    walkers: Walkers,
    records: NDArray,
    held: NDArray,
    chosen: NDArray,
    tick: float,
    others: Sequence[str],
    *,
    in_turn: bool = False,
) -> tuple[NDArray, NDArray]:
    """What `TickedStride` tells of some walkers, values before derivatives; and the outcomes.

    Where every tick begins is known once all have been walked without derivatives; then all of
    them are followed side by side, or on request with their derivatives one after the other.
    """
    section, (_, motors, count) = walkers.section, held.shape
    n, m, size = len(chosen), section.dimension, motors * count
    columns = ("state", *_MOTORS[:motors], *others, "start")
    ticks = _through_ticks(walkers, records, held, chosen, tick, columns if in_turn else ())
    lanes = np.searchsorted(chosen, np.concatenate([lanes for lanes, _, _ in ticks]))
    if in_turn:
        moved = np.concatenate([ended.told(_TOLD) for _, _, ended in ticks])
        astray = lanes[:0]
    else:
        moved, alike = _side_by_side(walkers, ticks, columns)
        astray = np.unique(lanes[~alike])
    tick_of = np.repeat(np.arange(len(ticks)), [len(lanes) for lanes, _, _ in ticks])
    edges = np.searchsorted(tick_of, np.arange(len(ticks) + 1))
    by_state, by_motors, by_others, by_start = np.split(
        moved[:, :, 1:], np.cumsum([_STATE, motors, len(others)]), axis=2
    )

    # How a walker changes with all that came before a tick; the chain rule goes through them.
    before = np.empty((len(lanes), _STATE, m + size + len(others)))
    change = np.zeros((n, *before.shape[1:]))
    change[:, :, :m] = section.state(np.eye(m)).T
    for k, (low, high) in enumerate(pairwise(edges)):
        here, state = lanes[low:high], np.s_[low:high, :_STATE]
        before[low:high] = change[here]
        after = by_state[state] @ before[low:high]
        after[:, :, m + k : m + size : count] += by_motors[state]
        after[:, :, m + size :] += by_others[state]
        change[here] = after
    width = 1 + before.shape[2]
    rows = np.empty((len(lanes), len(_TOLD), width))
    rows[:, :, 0], by_all = moved[:, :, 0], rows[:, :, 1:]
    np.matmul(by_state, before, out=by_all)
    every = np.arange(len(lanes))
    for j in range(motors):
        by_all[every, :, m + j * count + tick_of] += by_motors[:, :, j]
    by_all[:, :, m + size :] += by_others
    by_all[:, :, 0] += by_start[:, :, 0]

    told = np.full((n, m + 4 + 2 * size, width), np.nan)
    angles = told[:, m + 2 : -2].reshape(n, 2, motors, count, -1)  # a view: swing and turn
    angles[:], told[:, -2:] = 0.0, 0.0
    works = _OF_BOTH if motors == 2 else _OF_HIP
    angles[lanes, :, :, tick_of] = rows[:, works].reshape(len(lanes), 2, motors, -1)
    ended, locked = (
        np.concatenate([getattr(ended, name) for _, _, ended in ticks])
        for name in ("outcomes", "locked")
    )
    struck, over = ended == _STRUCK, ended != _RUNNING
    told[lanes[struck], : m + 2] = rows[struck][:, [*section.coordinates, _DURATION, _LENGTH]]
    told[lanes[struck], -2] = rows[struck, _PUSHED]
    told[lanes[locked], -1] = rows[locked, _KNEE]
    outcomes = np.full(n, Outcome.STALLED, np.int64)
    outcomes[lanes[over]] = ended[over]
    if len(astray):
        again = _ticked(walkers, records, held, chosen[astray], tick, others, in_turn=True)
        told[astray], outcomes[astray] = again
    return told, outcomes


def _through_ticks(
    walkers: Walkers,
    records: NDArray,
    held: NDArray,
    lanes: NDArray,
    tick: float,
    by: Sequence[str] = (),
) -> list[tuple[NDArray, NDArray, Flow]]:
    """Carry walkers through tick after tick: which they were, from where, what became of them."""
    ticks, last = [], held.shape[2] - 1
    records = records[lanes]
    for k in range(last + 1):
        hold(records, held[lanes, :, k], LONGEST if k == last else (k + 1) * tick)
        ended = go_on(walkers, records, by, lanes=lanes, on_section=k == 0)
        ticks.append((lanes, records, ended))
        on = ended.outcomes == _RUNNING
        lanes, records = lanes[on], ended.here[on]
        if len(lanes) == 0:
            break
    return ticks


def _side_by_side(
    walkers: Walkers, ticks: list[tuple[NDArray, NDArray, Flow]], by: Sequence[str]
) -> tuple[NDArray, NDArray[np.bool_]]:
    """What is told of ticks with their derivatives, all followed at once; and of which it holds.

    Values with derivatives and without may differ by a rounding, which may move a strike from one
    tick to the next.
    """
    told, alike = [], []
    for first, some in ((True, ticks[:1]), (False, ticks[1:])):
        if not some:
            continue
        # As plain numbers: NumPy is slow to see that records are alike.
        before = np.concatenate([records.view(float) for _, records, _ in some]).view(RECORD)
        lanes = np.concatenate([lanes for lanes, _, _ in some])
        part = go_on(walkers, before, by, lanes=lanes, on_section=first)
        ended, locked = (
            np.concatenate([getattr(ended, name) for _, _, ended in some])
            for name in ("outcomes", "locked")
        )
        told.append(part.told(_TOLD))
        alike.append((part.outcomes == ended) & (part.locked == locked))
    return np.concatenate(told), np.concatenate(alike)


def hold(records: NDArray, torques: ArrayLike, until: float) -> None:
    """Have walkers (n, 1) hold torques until a time; work is counted anew.

    Args:
        records: The walkers.
        torques: Of the hip, one for all; or of their first motors, (n, motors).
        until: The time.
    """
    motors = np.shape(torques)[1] if np.ndim(torques) else 1
    records["control"][:, 0, :motors], records["end"][:, 0] = torques, until
    records["moved"], records["turned"] = 0.0, 0.0


def course(
    walker: Walker,
    slope: float,
    point: NDArray,
    torques: NDArray,
    *,
    tick: float,
    duration: float,
) -> tuple[NDArray, NDArray, NDArray]:
    """What a walker passes through in a stride under given torques, for pictures.

    Args:
        walker: The walker.
        slope: Slope in rad.
        point: Where the stride starts on the section, (m,).
        torques: Torques of hip and ankle, (2, N).
        tick: How long a torque is held.
        duration: When the stride ends.

    Returns:
        Times (k,), from the start to just before heelstrike; states with dimensionless rates
        (k, 6); and the torques under which the walker came to each, (2, k).
    """
    using = ("ankle_torque",) * bool(np.any(torques[1]))
    walkers = Walkers(walker=walker, using=using, tolerance=1e-10)
    edges = tick * np.arange(1, torques.shape[1])
    times = np.union1d(np.linspace(0.0, duration * (1.0 - _VERGE), _SAMPLES), edges)
    records = new_records(walkers.section.state(point[None]), slope)
    states, held = [records["state"][0, 0].copy()], [torques[:, 0]]
    for before, time in pairwise(times):
        held.append(torques[:, np.searchsorted(edges, before, side="right")])
        hold(records, held[-1][None], time)
        records = go_on(walkers, records, on_section=before == 0.0).here
        states.append(records["state"][0, 0])
    return times, np.array(states), np.transpose(held)
