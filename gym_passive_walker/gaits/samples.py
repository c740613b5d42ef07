"""States inside strides, in walkers' own units: at any instants, and on the verge of impacts."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker.gaits.drive import Drive, to_dimensionless
from gym_passive_walker.gaits.flow import Walkers, flow
from gym_passive_walker.units import units_of
from gym_passive_walker.walkers import Walker, WalkerLike, as_walker

_VERGE = 1e-8  # of the time until a strike: its square is nothing


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
    """
    units = units_of(walker)
    first = units.to_dimensionless(starts)
    if not walker.knees:
        first[:, 2], first[:, 5] = first[:, 1], first[:, 4]
    drive = Drive(*drives.T)
    hip, ankle, _ = to_dimensionless(units, drive)
    seen = flow(
        Walkers(walker=walker, using=drive.using, tolerance=tolerance), first, slope,
        controls=np.stack([hip, ankle], axis=1), save_at=times / units.time,
        rises=None if rises is None else rises / units.length,
    )  # fmt: skip
    return units.to_own(seen.states), seen.stages


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
    units, drive = units_of(walker), Drive(hip_torque, ankle_torque)
    hip, ankle, _ = to_dimensionless(units, drive)
    verge = before_impact(
        Walkers(walker=walker, using=drive.using, tolerance=tolerance),
        units.to_dimensionless(np.array([state], dtype=float)), slope,
        np.array([strike / units.time]),
        controls=np.array([[hip, ankle]]),
    )  # fmt: skip
    return units.to_own(verge[0])


def before_impact(
    walkers: Walkers,
    states: NDArray,
    slopes: ArrayLike,
    strikes: NDArray,
    *,
    controls: ArrayLike = 0.0,
) -> NDArray[np.float64]:
    """States on the verge of impacts, before the collision, exact to rounding; dimensionless.

    A state is taken so short before the impact that its accelerations lead there.

    Args:
        walkers: Who walks.
        states: Where strides start, (n, 6).
        slopes: Slope in rad, one for all or (n,).
        strikes: Times of kneestrikes or heelstrikes since the start, (n,).
        controls: What is held, as for `flow`.

    Returns:
        States (n, 6).
    """
    times = strikes * (1.0 - _VERGE)
    verge = flow(walkers, states, slopes, controls=controls, until=times)
    left = (strikes - times)[:, None]
    angles, rates = verge.states[:, :3], verge.states[:, 3:]
    change = verge.accelerations * left
    return np.concatenate([angles + (rates + 0.5 * change) * left, rates + change], axis=1)
