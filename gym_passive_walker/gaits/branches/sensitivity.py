"""Derivatives of a gait by parameters of its walker and by the slope.

The gait's equations F(u, p) = 0 hold along a curve of gaits, so u' = -F_u^-1 F_p (the implicit
function theorem); both derivatives are exact. The change of multipliers would need second
derivatives. It is differenced from exact values at four places along the curve's tangent, with a
relative error below 1e-8 (see `tests/gaits/test_sensitivity.py`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gym_passive_walker.gaits.find.newton import newton
from gym_passive_walker.gaits.gait import gait_equations
from gym_passive_walker.gaits.map_result import Change, Passage
from gym_passive_walker.gaits.section import Points
from gym_passive_walker.gaits.stride_map import StrideMap
from gym_passive_walker.models.units import unit_of
from gym_passive_walker.models.walkers import Walker

SLOPE = "slope"

_ACCURACY = 1e-14  # violation that is aimed at
_STEP = 2.5e-4  # between places: largest change of a coordinate, or of the parameter
_PLACES = np.array([-2.0, -1.0, 1.0, 2.0])
_WEIGHTS = np.array([1.0, -8.0, 8.0, -1.0]) / 12.0


class Sensitivity(NamedTuple):
    """A gait of one stride, and its derivatives by k parameters.

    Attributes:
        place: The gait's point; the section is its stride map, which has its slope.
        by: Names of the parameters: "slope", or parameters of the walker.
        coordinates: Derivatives of the gait's coordinates u in the chart, (m, k).
        map: The stride map's derivative by u, (m, m). Its eigenvalues are the multipliers.
        passage: Measures of the stride, dimensionless.
        change: Derivatives of `passage` along the gaits, with k columns.
    """

    place: Points
    by: tuple[str, ...]
    coordinates: NDArray
    map: NDArray[np.float64]
    passage: Passage
    change: Change


def place_near(stride_map: StrideMap, slope: float, guess: NDArray) -> Points | None:
    """Return the point of the gait of one stride nearest to a guess; None if none is found.

    Args:
        stride_map: The stride map of the gait.
        slope: Slope in rad.
        guess: Coordinates in the chart, (m,).
    """
    found = newton(
        lambda u: gait_equations(stride_map, u, slope)[:2],
        guess[None], accuracy=_ACCURACY, damped=False,
    )  # fmt: skip
    if not found.sizes[0] < stride_map.closes:
        return None
    return replace(stride_map, slope=slope).searched(found.points)


def sensitivity(place: Points, by: Sequence[str]) -> Sensitivity:
    """Return the exact derivatives of a gait.

    Args:
        place: The gait's point, of a stride map with its slope.
        by: "slope", or parameters of the walker or of its actuation. All other dimensionless
            quantities are held constant, as for `StrideMap.linearize`.

    Raises:
        numpy.linalg.LinAlgError: at a fold, where the derivatives do not exist.
    """
    m = place.section.dimension
    gait = gait_equations(place.section, place.search, place.section.slope, by=by)
    coordinates = -np.linalg.solve(gait.derivatives[0, :, :m], gait.derivatives[0, :, m:])
    along = {
        name: value[..., :m] @ coordinates + value[..., m:]
        for name, value in vars(gait.change).items()
    }
    return Sensitivity(place, tuple(by), coordinates, gait.map[0], gait.passage, Change(**along))


def size_of(name: str, walker: Walker, slope: float) -> float:
    """Return what counts as a large change of a parameter or of the slope, in their own units."""
    if "units" not in walker.supports:
        return abs(walker.parameters.get(name, slope)) or 1.0
    return (abs(slope) or 1.0) if name == SLOPE else unit_of(walker, name)


Look = Callable[[StrideMap, NDArray, NDArray], NDArray]
"""Function of n walkers, coordinates (n, m) and slopes (n,) that returns values (n, ...)."""


def change_along(gait: Sensitivity, sizes: Sequence[float], look: Look) -> NDArray[np.float64]:
    """Return derivatives along the gaits, by central differences of fourth order.

    Args:
        gait: A gait with its derivatives.
        sizes: Size of a large change of each of the k parameters.
        look: Function to differentiate; it is evaluated close to gaits.

    Returns:
        Derivatives (..., k), by the parameters in the last axis.
    """
    stride_map, u = gait.place.section, gait.place.search[0]
    slope = stride_map.slope
    columns = []
    for name, direction, size in zip(gait.by, gait.coordinates.T, sizes, strict=True):
        step = _STEP / max(1.0 / size, np.abs(direction).max())
        beside = u + step * _PLACES[:, None] * direction
        slopes = np.full(len(_PLACES), slope)
        walkers = stride_map
        if name == SLOPE:
            slopes = slope + step * _PLACES
        else:
            values = stride_map.parameters[name] / stride_map.unit(name) + step * _PLACES
            walkers = stride_map.with_parameter(name, values)
        columns.append(np.tensordot(_WEIGHTS, look(walkers, beside, slopes), axes=1) / step)
    return np.stack(columns, axis=-1)


def map_change(gait: Sensitivity, sizes: Sequence[float]) -> NDArray[np.float64]:
    """Return the derivatives of the stride map's derivative along the gaits, (m, m, k)."""
    return change_along(
        gait, sizes, lambda walkers, u, slopes: gait_equations(walkers, u, slopes).map
    )
