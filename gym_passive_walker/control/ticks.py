"""A stride under a torque that changes from tick to tick, with its exact derivatives.

Everything here is dimensionless. A point of the section is [stance angle, stance rate, thigh rate,
shank rate] for a kneed walker and [angle, stance rate, swing rate] for a straight-legged one.
"""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker.engine.run import Seeds, advance, new_records
from gym_passive_walker.gaits.passage import NoStride
from gym_passive_walker.gaits.section import Section
from gym_passive_walker.physics.hybrid import Outcome
from gym_passive_walker.physics.systems import bodies, system_of
from gym_passive_walker.walkers import Walker

LONGEST = 20.0
"""Time after which a stride is given up."""

_SAMPLES = 200  # of a stride, for a picture
_VERGE = 1e-8  # of a stride, before its end: the heelstrike has not yet come


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

    Derivatives are carried along, through the flow, the strikes and the moments at which they
    happen.

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
    section, system = Section(walker=walker), system_of(walker)
    m, count = len(point), len(torques)
    states = np.zeros((1, m + count, 6))
    states[0, :m] = section.state(np.eye(m))
    start = section.state(np.asarray(point, dtype=float))[None]
    records = new_records(start, slope, seeds=Seeds(states=states), planes=m + count)
    swing, turn = np.zeros((2, count, m + count + 1))
    outcome = Outcome.RUNNING
    for k, torque in enumerate(torques):
        held = np.zeros((1, m + count + 1, 1))
        held[0, 0], held[0, 1 + m + k] = torque, 1.0
        hold(records, held, LONGEST if k == count - 1 else (k + 1) * tick)
        advance(
            system, bodies(walker), records, tolerance=tolerance, scuff=stub, from_section=k == 0
        )
        swing[k], turn[k] = records["moved"][0, :, 0], records["turned"][0, :, 0]
        outcome = Outcome(int(records["outcome"][0, 0]))
        if outcome != Outcome.RUNNING:
            break
    if outcome != Outcome.HEELSTRIKE:
        raise NoStride(f"this stride does not end with a heelstrike but with {outcome.name}")
    record = records[0]
    ends = section.point(record["state"]).T
    told = np.vstack(
        [ends, record["time"], record["step_length"], swing, turn, record["knee_time"]]
    )
    values = told[:, 0]
    return TickedStride(
        end=values[:m],
        duration=float(values[m]),
        length=float(values[m + 1]),
        swing=values[m + 2 : m + 2 + count],
        turn=values[m + 2 + count : -1],
        kneestrike=float(values[-1]),
        by=told[:, 1:],
    )


def hold(records: NDArray, controls: ArrayLike, until: float) -> None:
    """Have walkers hold controls (n, planes, controls) until a time, their work counted anew."""
    records["control"], records["moved"], records["turned"] = controls, 0.0, 0.0
    records["end"][:, 0] = until


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
