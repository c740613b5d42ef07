"""Newton's method with exact derivatives, from many guesses at once."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gym_passive_walker.engine.jit import Kernel

_ROUNDING = 1e-9
"""Violations below this may be as small as rounding lets them be."""

_FLOOR = 1e-12
"""Those below this are, if a step does not halve them."""


class Solution(NamedTuple):
    """Points that Newton's method has reached from n guesses.

    Attributes:
        points: (n, k).
        values: Values of the equations there, (n, k).
        sizes: Largest violation at each, (n,); infinite where it was given up or has no value.
        derivatives: Derivatives of the equations there, (n, k, k).
        carried: Third result of the equations, one entry for each point; empty if there is none.
    """

    points: NDArray[np.float64]
    values: NDArray[np.float64]
    sizes: NDArray[np.float64]
    derivatives: NDArray[np.float64]
    carried: NDArray[np.float64]


def newton(
    equations: Callable[[NDArray], tuple[NDArray, ...]],
    guesses: NDArray,
    *,
    accuracy: float,
    iterations: int = 20,
    longest: float = 0.7,
    damped: bool = True,
    patience: int | None = None,
) -> Solution:
    """Solve equations near guesses, all of them side by side.

    A step that brings its point no nearer is tried again at a quarter of its length. Undamped, a
    point is given up where a full step is longer than allowed or makes the violation four times as
    large: for guesses so near that anything else is a leap to another solution.

    Args:
        equations: Takes points (n, k) to values (n, k) and derivatives (n, k, k), NaN where there
            are none; and, if it likes, to an array of anything that belongs to each point.
        guesses: (n, k).
        accuracy: Violation at which a point is a solution.
        iterations: Steps tried at most.
        longest: Longest step, by its largest coordinate.
        damped: Whether steps are shortened.
        patience: Steps after the first solution for others to be found; as many as there may be
            when None.

    References:
        P. Deuflhard, "Newton Methods for Nonlinear Problems" (2004), for the natural test.
    """
    points = guesses.copy()
    values, derivatives, carried = _evaluated(equations, points)
    sizes = _size(values)
    damping, left = np.ones(len(points)), iterations
    while left:
        left -= 1
        if patience is not None and np.any(sizes <= accuracy):
            left, patience = min(left, patience), None
        active = np.flatnonzero(np.isfinite(sizes) & (sizes > accuracy) & (damping > 1e-2))
        if len(active) == 0:
            break
        step = solved(derivatives[active], -values[active])
        length = np.abs(step).max(axis=1)
        share = np.minimum(1.0, longest / np.maximum(length, 1e-300))
        trial = points[active] + step * (damping[active] * share)[:, None]
        if not damped:
            trial[share < 1.0] = np.nan
        new_values, new_derivatives, new_carried = _evaluated(equations, trial)
        new_sizes, old_sizes = _size(new_values), sizes[active]
        if damped:
            # The step that would follow shows better than the equations, as their scales differ,
            # whether a solution is nearer: the natural test.
            better = new_sizes < old_sizes
            if not better.all():
                following = _size(solved(derivatives[active], -new_values))
                better |= np.isfinite(new_sizes) & (following < length)
        else:
            better = new_sizes <= 4.0 * old_sizes
        won, lost = active[better], active[~better]
        points[won], values[won], sizes[won] = trial[better], new_values[better], new_sizes[better]
        derivatives[won] = new_derivatives[better]
        if len(carried):
            carried[won] = new_carried[better]
        if damped:
            still = (new_sizes < _FLOOR) & (new_sizes > 0.5 * old_sizes)
            damping[won] = np.where(still[better], 0.0, np.minimum(1.0, 4.0 * damping[won]))
            damping[lost] *= np.where(sizes[lost] < _ROUNDING, 0.0, 0.25)
        else:
            still = (new_sizes < _ROUNDING) & (new_sizes > 0.1 * old_sizes)
            damping[active[still]] = 0.0
            sizes[lost] = np.inf
    return Solution(points, values, sizes, derivatives, carried)


def _evaluated(
    equations: Callable[[NDArray], tuple[NDArray, ...]], points: NDArray
) -> tuple[NDArray, NDArray, NDArray]:
    with np.errstate(all="ignore"):
        values, derivatives, *carried = equations(points)
    return values, derivatives, carried[0] if carried else np.empty(0)


def _size(values: NDArray) -> NDArray:
    sizes = np.abs(values).max(axis=1)
    return np.where(np.isfinite(sizes), sizes, np.inf)


def solved(derivatives: NDArray, values: NDArray) -> NDArray:
    """Solutions (n, k) of the linear systems of all points; NaN where there is none."""
    solutions = np.array(values, float, order="C")
    eliminate(np.array(derivatives, float, order="C"), solutions)
    return solutions


@Kernel
def eliminate(matrices, values):
    """Solve linear systems by Gaussian elimination, in place; LAPACK's bits depend on the CPU.

    Args:
        matrices: (n, k, k); overwritten.
        values: Right sides, (n, k); they become the solutions.
    """
    count, size = values.shape
    for i in range(count):
        for column in range(size):
            pivot = column
            for row in range(column + 1, size):
                if abs(matrices[i, row, column]) > abs(matrices[i, pivot, column]):
                    pivot = row
            for k in range(column, size):
                kept = matrices[i, pivot, k]
                matrices[i, pivot, k] = matrices[i, column, k]
                matrices[i, column, k] = kept
            kept = values[i, pivot]
            values[i, pivot] = values[i, column]
            values[i, column] = kept
            for row in range(column + 1, size):
                part = matrices[i, row, column] / matrices[i, column, column]
                for k in range(column + 1, size):
                    matrices[i, row, k] -= part * matrices[i, column, k]
                values[i, row] -= part * values[i, column]
        solvable = True
        for column in range(size - 1, -1, -1):
            solvable = solvable and matrices[i, column, column] != 0.0
            for k in range(column + 1, size):
                values[i, column] -= matrices[i, column, k] * values[i, k]
            values[i, column] /= matrices[i, column, column]
        for k in range(size):
            if not solvable:
                values[i, k] = np.nan
