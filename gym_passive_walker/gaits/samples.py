"""States inside strides, in walkers' own units: at any instants, and on the verge of strikes."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker.gaits.actuation import Actuation
from gym_passive_walker.gaits.given import walk_of
from gym_passive_walker.gaits.stride_map import MapLike, StrideMap
from gym_passive_walker.units import units_of


def states_at(
    walker: MapLike,
    slope: float,
    state: ArrayLike,
    times: ArrayLike,
    *,
    hip_torque: float | None = None,
    ankle_torque: float | None = None,
    tolerance: float = 1e-10,
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """States inside one stride at any instants.

    Args:
        walker: The walker, in a form that `as_walker` takes, or a stride map.
        slope: Slope in rad.
        state: Where the stride starts, shape (6,).
        times: Since the start, shape (n,), in any order; later ones than the stride's end give
            the state that the stride ends with.
        hip_torque: Torque, as for `stride`.
        ankle_torque: Likewise.
        tolerance: As for `stride`.

    Returns:
        States (n, 6) and stages (n,).
    """
    strides, start = _begun(walker, slope, state, hip_torque, ankle_torque, tolerance)
    units = units_of(strides.walker)
    instants = np.asarray(times, dtype=float)[None] / units.time
    seen = strides.look(start, np.array([slope], dtype=float), instants)
    return units.to_own(seen.states[0]), seen.stages[0]


def just_before(
    walker: MapLike,
    slope: float,
    state: ArrayLike,
    strike: float,
    *,
    hip_torque: float | None = None,
    ankle_torque: float | None = None,
    tolerance: float = 1e-13,
) -> NDArray[np.float64]:
    """The state (6,) on the verge of a strike, before the collision, exact to rounding.

    Args:
        walker: As for `states_at`.
        slope: Slope in rad.
        state: Where the stride starts, shape (6,).
        strike: Time of the kneestrike or the heelstrike since the start.
        hip_torque: Torque, as for `stride`.
        ankle_torque: Likewise.
        tolerance: As for `stride`.
    """
    strides, start = _begun(walker, slope, state, hip_torque, ankle_torque, tolerance)
    units = units_of(strides.walker)
    return units.to_own(strides.verge(start, slope, strike / units.time)[None])[0]


def _begun(
    walker: MapLike, slope: float, state: ArrayLike, hip: float | None, ankle: float | None,
    tolerance: float,
) -> tuple[StrideMap, NDArray[np.float64]]:  # fmt: skip
    """The map, and where its stride begins, dimensionless, (1, 6)."""
    walk = walk_of(walker, slope, state, hip, ankle)
    strides = walk.controlled or StrideMap.of(
        walk.walker, controller=Actuation(*map(float, walk.actuation))
    )
    return strides.with_tolerance(tolerance), strides.dimensionless(state)
