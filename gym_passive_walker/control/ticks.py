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

from gym_passive_walker.control.motion import ROWS, Motion
from gym_passive_walker.engine.run import advance, new_records
from gym_passive_walker.gaits.passage import NoStride
from gym_passive_walker.gaits.section import Section
from gym_passive_walker.physics.hybrid import Outcome
from gym_passive_walker.physics.systems import bodies, system_of
from gym_passive_walker.walkers import Walker

LONGEST = 20.0
"""Time after which a stride is given up."""

_DURATION, _LENGTH, _KNEE, *_HIP = map(
    ROWS.index, ("time", "step_length", "knee_time", "moved", "turned")
)
_SAMPLES = 200  # of a stride, for a picture
_VERGE = 1e-8  # of a stride, before its end: the heelstrike has not yet come


class TickedStride(NamedTuple):
    """Strides of n walkers under N torques, with their derivatives; NaN where a walker fell.

    Of a single stride (see `ticked_stride`) nothing has the axis of walkers.

    Attributes:
        end: Where each ends on the section, (n, m).
        duration: Time taken, (n,).
        length: Step length, (n,).
        swing: How far the hip opened while each torque was held, (n, N): the net work of a unit.
        turn: How far it turned, either way, (n, N): the absolute work of a unit.
        kneestrike: When the knee locks, (n,); 0 without knees.
        by: Derivatives of all these, in this order, by the m coordinates of the start, the N
            torques, and what else was asked for, (n, m + 3 + 2 N, m + N + others).
        outcomes: How each ended, an `Outcome`, (n,).
    """

    end: NDArray[np.float64]
    duration: NDArray[np.float64]
    length: NDArray[np.float64]
    swing: NDArray[np.float64]
    turn: NDArray[np.float64]
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
        """Derivative of the end by the torques, (n, m, N)."""
        m, count = self.end.shape[-1], self.swing.shape[-1]
        return self.by[..., :m, m : m + count]


def ticked_stride(
    walker: Walker,
    slope: float,
    point: NDArray,
    torques: NDArray,
    *,
    tick: float,
    stub: bool = False,
    tolerance: float = 1e-12,
) -> TickedStride:
    """Follow one walker through a stride, each torque held for a tick; see `ticked_strides`.

    Args:
        walker: The walker.
        slope: Slope in rad.
        point: Start on the section, (m,).
        torques: Torques, (N,).
        tick: How long a torque is held.
        stub: Whether a stubbed toe ends the stride.
        tolerance: Of the integration.

    Raises:
        NoStride: if the stride does not end with a heelstrike.
    """
    motion = Motion(walker=walker, tolerance=tolerance, stub=stub)
    points, held = (np.asarray(x, dtype=float)[None] for x in (point, torques))
    walked = TickedStride(*(x[0] for x in ticked_strides(motion, slope, points, held, tick=tick)))
    outcome = Outcome(int(walked.outcomes))
    if outcome != Outcome.HEELSTRIKE:
        raise NoStride(f"this stride does not end with a heelstrike but with {outcome.name}")
    return walked


def ticked_strides(
    motion: Motion,
    slopes: ArrayLike,
    points: NDArray,
    torques: NDArray,
    *,
    tick: float,
    by: Sequence[str] = (),
) -> TickedStride:
    """Follow walkers through a stride each, every torque held for a tick.

    A tick is followed with its derivatives by the state in which it begins and by its own torque;
    the chain rule makes those of the stride of them, so that a tick costs the same however many
    there are.

    Args:
        motion: How the walkers move.
        slopes: Slope in rad, one for all or (n,).
        points: Starts on the section, (n, m).
        torques: Torques, (n, N); the last one is held until heelstrike, and those that come after
            it have no effect.
        tick: How long a torque is held.
        by: Columns of derivatives behind those by coordinates and torques: "slope", or parameters
            of the walker.
    """
    section = motion.section
    (n, m), count = points.shape, torques.shape[1]
    columns, others = m + count + len(by), m + count
    told = np.full((n, m + 3 + 2 * count, 1 + columns), np.nan)
    ends = [*section.coordinates, _DURATION, _LENGTH]
    hip = told[:, m + 2 : -1].reshape(n, 2, count, 1 + columns)  # a view: swing and turn
    hip[:], told[:, -1] = 0.0, 0.0
    outcomes, walking = np.full(n, Outcome.STALLED, np.int64), np.arange(n)
    records, change = new_records(section.state(points), slopes), np.eye(m, columns)
    tick_by = ("point", "torque", *by)
    for k in range(count):
        hold(records, torques[walking, k], LONGEST if k == count - 1 else (k + 1) * tick)
        ended = motion.follow(records, tick_by, lanes=walking, from_section=k == 0)
        rows, size = np.empty((len(walking), len(ROWS), 1 + columns)), change.shape[-2]
        rows[:, :, 0], by_all = ended.told[:, :, 0], rows[:, :, 1:]
        by_state, by_torque, by_others = np.split(ended.told[:, :, 1:], [size, size + 1], axis=2)
        np.matmul(by_state, change, out=by_all)
        by_all[:, :, m + k] += by_torque[:, :, 0]
        by_all[:, :, others:] += by_others[:, :, : len(by)]
        if k:
            by_all[:, :, 0] += by_others[:, :, -1]
        hip[walking, :, k] = rows[:, _HIP]
        if ended.locked.any():
            told[walking[ended.locked], -1] = rows[ended.locked, _KNEE]
        if ended.outcomes.any():
            struck = ended.outcomes == Outcome.HEELSTRIKE
            told[walking[struck], : m + 2] = rows[struck][:, ends]
            on = ended.outcomes == Outcome.RUNNING
            outcomes[walking[~on]] = ended.outcomes[~on]
            walking, records, change = walking[on], ended.records[on], by_all[on, :6]
            if len(walking) == 0:
                break
        else:
            records, change = ended.records, by_all[:, :6]
        tick_by = ("state", "torque", *by, "start")
    told[outcomes != Outcome.HEELSTRIKE] = np.nan
    values = told[:, :, 0]
    return TickedStride(
        end=values[:, :m],
        duration=values[:, m],
        length=values[:, m + 1],
        swing=values[:, m + 2 : m + 2 + count],
        turn=values[:, m + 2 + count : -1],
        kneestrike=values[:, -1],
        by=told[:, :, 1:],
        outcomes=outcomes,
    )


def hold(records: NDArray, torques: ArrayLike, until: float) -> None:
    """Have walkers (n, 1) hold torques, one for all or (n,), until a time; work is counted anew."""
    records["control"][:, 0, 0], records["end"][:, 0] = torques, until
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
        torques: Torques, (N,).
        tick: How long a torque is held.
        duration: When the stride ends.

    Returns:
        Times (k,), from the start to just before heelstrike; states with dimensionless rates
        (k, 6); and the torque under which the walker came to each, (k,).
    """
    section, system = Section(walker=walker), system_of(walker)
    edges = tick * np.arange(1, len(torques))
    times = np.union1d(np.linspace(0.0, duration * (1.0 - _VERGE), _SAMPLES), edges)
    records = new_records(section.state(point[None]), slope)
    states, held = [records["state"][0, 0].copy()], [torques[0]]
    for before, time in pairwise(times):
        held.append(torques[np.searchsorted(edges, before, side="right")])
        hold(records, held[-1], time)
        advance(system, bodies(walker), records, tolerance=1e-10, from_section=before == 0.0)
        states.append(records["state"][0, 0].copy())
    return times, np.array(states), np.array(held)
