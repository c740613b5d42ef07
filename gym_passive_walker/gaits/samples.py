"""Strides looked at inside: states at any instants, as exact as the stride map itself.

Every sample is integrated from the start of its stride to its own time, all of them side by side in
one batch; nothing is interpolated.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker.engine.run import advance, new_records
from gym_passive_walker.gaits.drive import Drive, to_dimensionless
from gym_passive_walker.gaits.forces import forces
from gym_passive_walker.physics.hybrid import System
from gym_passive_walker.physics.systems import UNEVEN, bodies, system_of
from gym_passive_walker.units import units_of
from gym_passive_walker.walkers import Walker, WalkerLike, as_walker

_VERGE = 1e-8  # of the time until a strike: its square is nothing


class Samples(NamedTuple):
    """Strides looked at inside, dimensionless.

    Attributes:
        states: Angles of stance leg, thigh and shank, then their rates, (n, k, 6).
        phases: `Stage` of the swing leg, (n, k).
    """

    states: NDArray[np.float64]
    phases: NDArray[np.int64]


def look_inside(
    system: System,
    own: NDArray,
    starts: NDArray,
    slopes: NDArray,
    controls: NDArray,
    times: NDArray,
    *,
    tolerance: float,
    stub: bool = False,
    rises: NDArray | None = None,
) -> Samples:
    """Look at strides at any instants; all of it dimensionless.

    Args:
        system: Which equations the walkers obey.
        own: What the engine knows of them, (1 or n, 1, constants): one for all, or each.
        starts: States with which the strides start, (n, 6).
        slopes: Slope in rad of each, (n,).
        controls: What is held in each, a `hybrid.Control`, (n, 2).
        times: Since the start, (n, k), in any order; later ones than a stride's end give the state
            that it ends with, and one that is not finite gives nothing.
        tolerance: Of the integration.
        stub: Whether a kneed walker's locked swing leg below the ground ends the stride.
        rises: Height of the next foothold in each, (n,); none when None.
    """
    count, looks = times.shape
    starts, slopes, held = (np.repeat(x, looks, axis=0) for x in (starts, slopes, controls))
    ends = times.ravel()
    steps = 0.0 if rises is None else np.repeat(rises, looks)
    records = new_records(starts, slopes, held, end=ends, rise=steps)
    records[~np.isfinite(ends)] = np.zeros((), records.dtype)  # nothing to follow
    own = own if len(own) == 1 else np.repeat(own, looks, axis=0)
    record = advance(system, own, records, tolerance=tolerance, scuff=stub)[:, 0]
    stages = np.array([phase.stage for phase in system.phases])
    phases = stages[record["phase"]].reshape(count, looks)
    return Samples(record["state"].reshape(count, looks, 6), phases)


def states_inside(
    walker: Walker,
    slope: ArrayLike,
    starts: NDArray,
    drives: NDArray,
    times: NDArray,
    tolerance: float,
    rises: NDArray | None = None,
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """States (n, k, 6) and phases (n, k) of n strides at times (n, k), in the walker's own units.

    Args:
        walker: Who walks.
        slope: Slope in rad, one for all or (n,).
        starts: States with which the strides start, (n, 6).
        drives: A `Drive` in each, (n, 3).
        times: Since the start, (n, k).
        tolerance: Of the integration.
        rises: Height of the next foothold in each, (n,); none when None.
    """  # fmt: skip
    units = units_of(walker)
    first = units.to_dimensionless(starts)
    if not walker.knees:
        first[:, 2], first[:, 5] = first[:, 1], first[:, 4]
    drive = Drive(*drives.T)
    hip, ankle, _ = to_dimensionless(units, drive)
    states, phases = look_inside(
        system_of(walker, using=drive.using if rises is None else UNEVEN), bodies(walker), first,
        np.broadcast_to(slope, len(first)), np.stack([hip, ankle], axis=1), times / units.time,
        tolerance=tolerance, rises=None if rises is None else rises / units.length,
    )  # fmt: skip
    return units.to_own(states), phases


def states_at(
    walker: WalkerLike,
    slope: float,
    state: ArrayLike,
    times: ArrayLike,
    *,
    hip_torque: float = 0.0,
    ankle_torque: float = 0.0,
    tolerance: float = 1e-10,
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """States inside one stride at any instants.

    Args:
        walker: The walker, in a form that `as_walker` takes.
        slope: Slope in rad.
        state: Where the stride starts, shape (6,).
        times: Since the start, shape (n,), in any order; later ones than the stride's end give
            the state that the stride ends with.
        hip_torque: Torque, as for `stride`.
        ankle_torque: Likewise.
        tolerance: As for `stride`.

    Returns:
        States (n, 6) and phases (n,).
    """
    start, instants = np.array([state], dtype=float), np.asarray(times, dtype=float)[None]
    drive = np.array([Drive(hip_torque, ankle_torque)], dtype=float)
    states, phases = states_inside(as_walker(walker), slope, start, drive, instants, tolerance)
    return states[0], phases[0]


def just_before(
    walker: WalkerLike,
    slope: float,
    state: ArrayLike,
    strike: float,
    *,
    hip_torque: float = 0.0,
    ankle_torque: float = 0.0,
    tolerance: float = 1e-13,
) -> NDArray[np.float64]:
    """The state on the verge of a strike, before the collision, exact to rounding.

    A state is taken so short before the strike that its accelerations lead there.

    Args:
        walker: The walker, in a form that `as_walker` takes.
        slope: Slope in rad.
        state: Where the stride starts, shape (6,).
        strike: Time of the kneestrike or the heelstrike since the start.
        hip_torque: Torque, as for `stride`.
        ankle_torque: Likewise.
        tolerance: As for `stride`.

    Returns:
        State (6,).
    """
    walker = as_walker(walker)
    time = np.array([strike * (1.0 - _VERGE)])
    held = {"hip_torque": hip_torque, "ankle_torque": ankle_torque}
    states, phases = states_at(walker, slope, state, time, tolerance=tolerance, **held)
    left = strike - time[0]
    change = forces(walker, slope, states, phases, **held).accelerations[0] * left
    angles, rates = states[0, :3], states[0, 3:]
    return np.concatenate([angles + (rates + 0.5 * change) * left, rates + change])
