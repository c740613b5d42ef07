"""A stride under a torque that changes from tick to tick, with its exact derivatives.

Everything here is dimensionless. A point of the section is [stance angle, stance rate, thigh rate,
shank rate] for a kneed walker and [angle, stance rate, swing rate] for a straight-legged one.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from gym_passive_walker.gaits.stability import NoStride
from gym_passive_walker.gaits.stride_map import INFINITESIMAL, StrideMap
from gym_passive_walker.physics import constants as K
from gym_passive_walker.physics import record as R
from gym_passive_walker.physics.engine import advance
from gym_passive_walker.physics.hybrid import Outcome
from gym_passive_walker.physics.frame import frame_of
from gym_passive_walker.physics.record import new_records
from gym_passive_walker.walkers import Walker

LONGEST = 20.0
"""Time after which a stride is given up."""


_SAMPLES = 200  # of a stride, for a picture
_VERGE = 1e-8  # of a stride, before its end: the heelstrike has not yet come
_BACK = 1e-9  # rad by which a hip must turn back within a tick to be noticed


class TickedStride(NamedTuple):
    """One stride under N torques, and its derivatives by the m coordinates and the N torques.

    Attributes:
        end: Where it ends on the section, (m,).
        duration: Time taken.
        length: Step length.
        swing: How far the hip opened while each torque was held, (N,): the net work of a unit.
        turn: How far it turned, either way, (N,): the absolute work of a unit.
        kneestrike: When the knee locks; 0 without knees.
        by: Derivatives of all these, in this order, shape (m + 3 + 2 N, m + N).
    """

    end: NDArray[np.float64]
    duration: float
    length: float
    swing: NDArray[np.float64]
    turn: NDArray[np.float64]
    kneestrike: float
    by: NDArray[np.float64]

    @property
    def by_point(self) -> NDArray[np.float64]:
        """Derivative of the end by the start, (m, m)."""
        m = len(self.end)
        return self.by[:m, :m]

    @property
    def by_torque(self) -> NDArray[np.float64]:
        """Derivative of the end by the torques, (m, N)."""
        m = len(self.end)
        return self.by[:m, m:]


def coordinates(walker: Walker) -> list[int]:
    """Which entries of a state are coordinates of the section."""
    return [0, 3, 4, 5] if walker.knees else [0, 3, 4]


def section_state(walker: Walker, point: NDArray) -> NDArray:
    """The state (..., 6) at a point (..., m) of the section."""
    angle, rates = point[..., :1], point[..., 1:]
    if not walker.knees:
        rates = np.concatenate([rates, rates[..., -1:]], axis=-1)
    return np.concatenate([angle, -angle, -angle, rates], axis=-1)


def section_point(walker: Walker, state: NDArray) -> NDArray:
    """The dimensionless point (..., m) of a section state (..., 6) in the walker's own units."""
    kept = coordinates(walker)
    return state[..., kept] * np.array([1.0] + [walker.time_unit] * (len(kept) - 1))


def torque_unit(walker: Walker) -> float:
    """The torque m g l in the walker's own units; of the simplest walker, per unit of foot mass."""
    return frame_of(walker).torque


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
    """Follow a walker through a stride, each torque held for a tick.

    Each coordinate and each torque has a lane of its own in which it carries an infinitesimal
    imaginary part, through the flow, the strikes and the moments at which they happen.

    Args:
        walker: The walker.
        slope: Slope in rad.
        point: Start on the section, (m,).
        torques: Torques, (N,); the last one is held until heelstrike, and those that come after it
            have no effect.
        tick: How long a torque is held.
        stub: Whether a stubbed toe ends the stride.
        tolerance: Of the integration.

    Raises:
        NoStride: if the stride does not end with a heelstrike.
    """
    section = StrideMap.of(walker)
    m, count = len(point), len(torques)
    varied = np.concatenate([point, torques]) + 1j * INFINITESIMAL * np.eye(m + count)
    starts = section_state(walker, varied[:, :m])
    records = new_records(starts, np.full(m + count, slope))

    def on(records: NDArray, until: float) -> NDArray:
        """Carry records on to a time, and return how far the hip has opened since."""
        records[:, [R.HIP_NET, R.HIP_TURN]] = 0.0
        records[:, R.END] = until
        own = section.constants.astype(records.dtype)
        fresh = bool(np.all(records[:, R.TIME] == 0.0))
        with np.errstate(all="ignore"):
            advance(section.kind, own, records, tolerance=tolerance, stub=stub, from_section=fresh)
        return records[:, R.HIP_NET].copy()

    swing, turn = np.zeros((2, count, m + count), complex)
    for k in range(count):
        records[:, R.TORQUE] = varied[:, m + k]
        before, until = records.copy(), LONGEST if k == count - 1 else (k + 1) * tick
        swing[k] = on(records, until)
        turn[k] = np.sign(np.real(swing[k])) * swing[k]
        outcome = Outcome(int(records[0, R.OUTCOME].real))
        if records[0, R.HIP_TURN].real > abs(swing[k, 0]) + _BACK:
            # Where the hip turns back its rate is zero, so the moment's own shift is nothing.
            there = _reversal(on, np.real(before[:1]), float(records[0, R.TIME].real))
            pieces = [on(before, there), on(before, until)]
            turn[k] = sum(np.sign(np.real(piece)) * piece for piece in pieces)
        if outcome != Outcome.RUNNING:
            break
    if outcome != Outcome.HEELSTRIKE:
        raise NoStride(f"this stride does not end with a heelstrike but with {outcome.name}")
    end = records[:, 0]
    leg, radius = section.constants[0, [K.LEG, K.FOOT_RADIUS]]
    length = 2.0 * leg * np.sin(end) + radius * (starts[:, 0] + end)
    ends, knee = records[:, coordinates(walker)], records[:, R.KNEE_TIME]
    told = np.column_stack([ends, records[:, R.TIME], length, swing.T, turn.T, knee])
    values = told[0].real
    return TickedStride(
        end=values[:m],
        duration=float(values[m]),
        length=float(values[m + 1]),
        swing=values[m + 2 : m + 2 + count],
        turn=values[m + 2 + count : -1],
        kneestrike=float(values[-1]),
        by=np.imag(told).T / INFINITESIMAL,
    )


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
    section = StrideMap.of(walker)
    edges = tick * np.arange(1, len(torques))
    times = np.union1d(np.linspace(0.0, duration * (1.0 - _VERGE), _SAMPLES), edges)
    record = new_records(section_state(walker, point[None]), np.array([slope]))
    states, held = [record[0, :6].copy()], [torques[0]]
    for before, time in pairwise(times):
        held.append(torques[np.searchsorted(edges, before, side="right")])
        record[:, R.TORQUE], record[:, R.END] = held[-1], time
        advance(
            section.kind, section.constants, record, tolerance=1e-10, from_section=before == 0.0
        )
        states.append(record[0, :6].copy())
    return times, np.array(states), np.array(held)


def _reversal(on: Callable[[NDArray, float], NDArray], record: NDArray, end: float) -> float:
    """When the hip turns back, between a record's time and an end that may be a heelstrike."""

    def rate(time: float) -> float:
        there = record.copy()
        on(there, time)
        return float(there[0, R.RATES + 1] - there[0, R.RATES])

    start = float(record[0, R.TIME])
    margin = 1e-9 * (end - start)
    if rate(start + margin) * rate(end - margin) >= 0.0:  # it turns back twice, by next to nothing
        return start
    root: Any = brentq(rate, start + margin, end - margin, xtol=1e-14)
    return float(root)
