"""Objectives and constraints of a design, with derivatives.

Quantities are those of a gait and of its walker, with their gradients. The modulus of the largest
multiplier is not smooth: it has corners where two are as large, and no derivative where two meet.
The coefficients of the characteristic polynomial are smooth. So are the conditions that its roots
lie inside a circle, which are those of I. Schur and A. Cohn, in E. I. Jury's form for a cubic. At
most three of a walker's multipliers differ from zero.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from gym_passive_walker.gaits.branches.sensitivity import SLOPE, Sensitivity, change_along, size_of
from gym_passive_walker.gaits.look.reality import reality_check
from gym_passive_walker.gaits.stride_map import StrideMap
from gym_passive_walker.models.equations.numbers import complex_step, step_derivative
from gym_passive_walker.models.units import growth

SPECTRAL_RADIUS = "spectral_radius"

Graded = tuple[float, NDArray[np.float64]]
"""A value and its gradient (k,) by the parameters of a sensitivity."""


def _in_units(gait: Sensitivity, quantity: Graded, *, length: int = 0, time: int = 0) -> Graded:
    """Convert a dimensionless quantity by powers of the walker's units of length and time."""
    walker, (value, gradient) = gait.place.section.walker, quantity
    units = walker.units
    own = units.length**length * units.time**time
    grown = np.zeros(len(gait.by))
    for i, name in enumerate(gait.by):
        if name != SLOPE and "units" in walker.supports:
            share = growth(walker, name)
            grown[i] = length * share.length + time * share.time
    return own * value, own * (gradient + value * grown)


def _of_stride(gait: Sensitivity, names: str) -> Graded:
    """Return the sum of some measures of a stride, the mean of all strides, dimensionless."""
    each = [(getattr(gait.passage, x)[0], getattr(gait.change, x)[0]) for x in names.split()]
    value, by = float(sum(value for value, _ in each)), np.sum([by for _, by in each], axis=0)
    strides = len(gait.place.section.ground)
    return value / strides, by / strides


def _quotient(gait: Sensitivity, above: str, below: str) -> Graded:
    """Return the quotient of two of the stride's measures."""
    (top, d_top), (bottom, d_bottom) = _of_stride(gait, above), _of_stride(gait, below)
    return top / bottom, (d_top - top / bottom * d_bottom) / bottom


def _stance_angle(gait: Sensitivity) -> Graded:
    return float(gait.place.values[0, 0]), gait.place.by_search[0, 0] @ gait.coordinates


def _knee_margin(gait: Sensitivity) -> Graded:
    share, gradient = _quotient(gait, "knee_times", "durations")
    return 1.0 - share, -gradient


def _total_mass(gait: Sensitivity) -> Graded:
    walker = gait.place.section.walker
    by = np.zeros(len(gait.by))
    for i, name in enumerate(gait.by):
        if name in walker.parameters:
            by[i] = step_derivative(
                walker.mass_with(**{name: complex_step(walker.parameters[name])})
            )
    return walker.total_mass, by


def _cost(gait: Sensitivity) -> Graded:
    """Return the energy spent over weight and distance: on a gait, that lost and braked."""
    cost, by = _quotient(gait, "lost braked", "lengths")
    walker = gait.place.section.walker
    if "units" in walker.supports:  # the weight is the unit of force
        return cost, by
    weight, by_weight = _total_mass(gait)
    return cost / weight, (by - cost * by_weight / weight) / weight


def _clearance(gait: Sensitivity) -> Graded:
    point, stride_map = gait.place, gait.place.section
    walker, slope, units = stride_map.walker, stride_map.slope, stride_map.units
    lowest = reality_check(stride_map, slope, point.states[0]).clearance
    time = lowest.time / units.time
    knee = float(gait.passage.knee_times[0])
    # At its lowest the height does not change with time, so the gradient is that of the height at
    # this time; but the knee's stop may be what turns it up, and that moves.
    corner = abs(time - knee) < 1e-9

    def look(walkers: StrideMap, beside: NDArray, slopes: NDArray) -> NDArray:
        points = walkers.searched(beside).values
        times = walkers.apply(points, slopes).knee_times if corner else np.full(len(points), time)
        states = walkers.sample(points, slopes, times[:, None]).states[:, 0]
        body = walkers.system.Body(*walkers.walkers.constants[:, 0].T)
        return walkers.system.foot_clearance(body, walkers.system.State(*states.T))

    sizes = [size_of(name, walker, slope) for name in gait.by]
    height = lowest.value / units.length, change_along(gait, sizes, look)
    return _in_units(gait, height, length=1)


OF_ONE_STRIDE = ("clearance", "knee_margin")
"""Quantities of gaits that repeat after one stride."""

QUANTITIES: dict[str, Callable[[Sensitivity], Graded]] = {
    "slope": lambda gait: (
        gait.place.section.slope,
        np.array([x == SLOPE for x in gait.by], float),
    ),
    "cost_of_transport": _cost,
    "speed": lambda gait: _in_units(
        gait, _quotient(gait, "lengths", "durations"), length=1, time=-1
    ),
    "froude_speed": lambda gait: _quotient(gait, "lengths", "durations"),
    "step_length": lambda gait: _in_units(gait, _of_stride(gait, "lengths"), length=1),
    "step_period": lambda gait: _in_units(gait, _of_stride(gait, "durations"), time=1),
    "stance_angle": _stance_angle,
    "clearance": _clearance,
    "knee_margin": _knee_margin,
    "leg_length": lambda gait: _in_units(gait, (1.0, np.zeros(len(gait.by))), length=1),
    "total_mass": _total_mass,
}
"""Quantities by name, in the walker's own units: those of `Gait` and `Walker`, and

- clearance: least height of the passing swing foot over the ground, as `RealityCheck.clearance`;
- knee_margin: time from kneestrike to heelstrike over the stride's, of a walker with knees.
"""


def spectral_radius(matrix: NDArray) -> float:
    """Return the largest modulus of an eigenvalue."""
    return float(np.abs(np.linalg.eigvals(matrix)).max())


def coefficients(matrix: NDArray, change: NDArray) -> tuple[NDArray, NDArray]:
    """Return a, b, c of x^3 + a x^2 + b x + c, with a matrix's nonzero eigenvalues as roots.

    Args:
        matrix: Matrix of rank 3 at most, (m, m).
        change: Derivatives of the matrix, (m, m, k).

    Returns:
        The coefficients (3,) and their derivatives (3, k), from the traces of powers (Newton).
    """
    square = matrix @ matrix
    one, two, three = np.trace(matrix), np.trace(square), np.trace(square @ matrix)
    d_one = np.trace(change)
    d_two = 2.0 * np.einsum("ij,jik->k", matrix, change)
    d_three = 3.0 * np.einsum("ij,jik->k", square, change)
    values = [-one, (one**2 - two) / 2.0, -(one**3 - 3.0 * one * two + 2.0 * three) / 6.0]
    derivatives = [
        -d_one,
        one * d_one - d_two / 2.0,
        -(3.0 * one**2 * d_one - 3.0 * (d_one * two + one * d_two) + 2.0 * d_three) / 6.0,
    ]
    return np.array(values), np.array(derivatives)


def inside(cubic: NDArray, radius: float) -> tuple[NDArray, NDArray]:
    """Return conditions that are all positive if and only if all roots lie inside a circle.

    The first vanishes with a root at +radius, the second with one at -radius, the third with two
    of a product of radius squared; the last two with a product of all three of radius cubed.

    Args:
        cubic: a, b, c of x^3 + a x^2 + b x + c.
        radius: Radius of the circle, which is centred at zero.

    Returns:
        Values (5,), and derivatives (5, 4) by a, b, c and the radius.
    """
    powers = radius ** -np.arange(1.0, 4.0)
    a, b, c = cubic * powers
    values = [1.0 + a + b + c, 1.0 - a + b - c, 1.0 - b + a * c - c**2, 1.0 - c, 1.0 + c]
    by_scaled = np.array(
        [[1.0, 1.0, 1.0], [-1.0, 1.0, -1.0], [c, -1.0, a - 2.0 * c], [0.0, 0.0, -1.0], [0, 0, 1.0]]
    )
    by_radius = by_scaled @ (np.array([-1.0, -2.0, -3.0]) * np.array([a, b, c])) / radius
    return np.array(values), np.column_stack([by_scaled * powers, by_radius])
