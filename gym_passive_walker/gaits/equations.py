"""The equations of a gait, in the section's logarithmic coordinates."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker.gaits.log_chart import (
    by_logarithms,
    from_logarithms,
    in_logarithms,
    logarithms,
)
from gym_passive_walker.gaits.passage import Change, Passage
from gym_passive_walker.gaits.stride_map import StrideMap


class Violation(NamedTuple):
    """How far n points are from being gaits, exactly derived; NaN where strides fail.

    Attributes:
        values: What vanishes on a gait, (n, m).
        derivatives: By the coordinates, and by what else was asked for, (n, m, columns).
        map: Derivative of the strides' end by their start, (n, m, m): the multipliers' matrix.
        passage: Where the strides lead.
        change: Its derivatives, by the same columns.
    """

    values: NDArray[np.float64]
    derivatives: NDArray[np.float64]
    map: NDArray[np.float64]
    passage: Passage
    change: Change


def gait_equations(
    stride_map: StrideMap,
    u: NDArray,
    slopes: ArrayLike,
    *,
    period: int = 1,
    by: Sequence[str] = (),
) -> Violation:
    """What vanishes on a gait, with its exact derivative.

    The equation for the stance leg's rate is replaced by the balance of energy, which says the
    same on a gait but keeps its digits at small slopes, where the map is nearly the identity along
    one direction.

    Args:
        stride_map: Whose gait.
        u: Points in logarithmic coordinates, (n, m).
        slopes: Slope in rad, one for all or (n,).
        period: Strides of the gait.
        by: What to differentiate by besides the coordinates, as for `StrideMap.linearize`.
    """
    points, m = from_logarithms(u), u.shape[1]
    passage, change = stride_map.linearize(
        points, slopes, strides=period, by=("state", *by), along=by_logarithms(points)
    )
    values = logarithms(passage.ends) - u
    values[:, 1] = passage.imbalance
    derivatives = in_logarithms(passage.ends, change.ends)
    map_derivatives = derivatives[:, :, :m].copy()
    derivatives[:, :, :m] -= np.eye(m)
    derivatives[:, 1] = change.imbalance
    return Violation(values, derivatives, map_derivatives, passage, change)
