"""States at any instants of a stride."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker.gaits.actuation import Actuation
from gym_passive_walker.gaits.stride_map import StrideMap


def states_at(
    walker: Any,
    slope: float,
    state: ArrayLike,
    times: ArrayLike,
    *,
    tolerance: float = 1e-10,
    **torques: float,
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """States (n, 6) and stages (n,) at times (n,) since a stride's start, in any order."""
    strides = StrideMap.of(walker, controller=Actuation(**torques), tolerance=tolerance)
    instants = np.asarray(times, dtype=float)[None] / strides.units.time
    seen = strides.look(strides.dimensionless(state), np.array([slope]), instants)
    return strides.units.to_own(seen.states[0]), seen.stages[0]
