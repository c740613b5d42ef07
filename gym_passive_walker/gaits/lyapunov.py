"""Lyapunov exponents: how fast neighbouring walks part.

References:
    G. Benettin, L. Galgani, A. Giorgilli, J.-M. Strelcyn, Meccanica 15 (1980) 9-20.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker.arguments import check_tolerance, several_slopes, whole
from gym_passive_walker.gaits.bifurcation import beginnings
from gym_passive_walker.gaits.gait import GaitKind
from gym_passive_walker.gaits.section import by_logarithms, in_logarithms
from gym_passive_walker.gaits.stride_map import MapLike, map_of
from gym_passive_walker.progress import progress


def lyapunov_exponents(
    walker: MapLike,
    slopes: ArrayLike,
    *,
    count: int = 1,
    strides: int = 2000,
    settle: int = 500,
    start: ArrayLike | None = None,
    kind: GaitKind = "long",
    tolerance: float = 1e-10,
) -> NDArray[np.float64]:
    """Lyapunov exponents of the settled walk, per stride, from exact derivatives of each stride.

    A positive one means chaos: neighbouring walks part by its exponential at each stride. On a
    stable gait of period n they are ln|multipliers| / n.

    Args:
        walker: The walker, or a map of `stride_map`, as for `bifurcation_diagram`.
        slopes: Slopes in rad.
        count: How many exponents, from the largest on; at most the section's dimension.
        strides: Strides averaged over.
        settle: Strides taken before.
        start: A section state to begin with, or one for each slope; beside the gait if None.
        kind: Which gait to begin beside.
        tolerance: Of the integration.

    Returns:
        Shape (n, count), largest first; NaN where the walker falls.
    """
    stride_map = map_of(walker, tolerance=check_tolerance(tolerance))
    values = several_slopes(slopes, downhill=stride_map.passive)
    strides, settle = whole(strides, "strides"), whole(settle, "settle", 0)
    m = stride_map.dimension
    count = whole(count, "count", 1, m)
    points = beginnings(stride_map, values, kind, start)
    points = stride_map.apply(points, values, strides=settle).ends
    exponents = np.full((len(values), count), np.nan)
    walking = np.flatnonzero(np.isfinite(points[:, 0]))
    points = points[walking]
    frames = np.broadcast_to(np.eye(m)[:, :count], (len(points), m, count))
    sums = np.zeros((len(points), count))
    with progress("strides averaged over", strides) as averaged:
        for _ in range(strides):
            averaged()
            if len(walking) == 0:
                break
            # In logarithmic coordinates, as rates are of another size than angles.
            along = by_logarithms(points) @ frames
            passage, change = stride_map.linearize(points, values[walking], along=along)
            on = passage.alive
            walking, points, sums = walking[on], passage.ends[on], sums[on]
            frames, triangle = np.linalg.qr(in_logarithms(points, change.ends[on]))
            with np.errstate(divide="ignore"):  # a direction that a strike forgets: minus infinity
                sums = sums + np.log(np.abs(np.diagonal(triangle, axis1=1, axis2=2)))
    exponents[walking] = sums / strides
    return exponents
