"""The equations of a gait, and Newton's method on them from many points at once."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from gym_passive_walker.gaits.section import Return, Section, split, strides, with_derivatives
from gym_passive_walker.physics.record import LONGEST_STRIDE

Setting = Callable[[NDArray], tuple[NDArray, NDArray]]
"""Turns values of a parameter into constants, one row each, and slopes."""

LONGEST_SEARCHED = 20.0
"""Time in sqrt(l/g) after which a stride is given up in a search."""

_MOST_ITERATIONS = 20


def equations(
    section: Section,
    points: NDArray,
    *,
    period: int,
    torque: float,
    tolerance: float,
    longest: float = LONGEST_STRIDE,
    setting: Setting | None = None,
) -> tuple[NDArray, NDArray, NDArray]:
    """What vanishes on a gait, with its exact derivative.

    The equation for the stance leg's rate is replaced by the balance of energy, which says the
    same on a gait but keeps its digits at small slopes, where the map is nearly the identity along
    one direction.

    Args:
        section: The section.
        points: Points and slope (or what `setting` reads), shape (n, dimension + 1).
        period: Strides of the gait.
        torque: Dimensionless hip torque.
        tolerance: Of the integration.
        longest: Time after which a stride is given up.
        setting: Turns the last column into constants and slopes; None if it is the slope.

    Returns:
        Values (n, dimension), derivatives (n, dimension, dimension + 1) and the multipliers'
        matrix (n, dimension, dimension); NaN where a walker did not complete its strides.
    """
    count, columns = points.shape
    m = columns - 1
    values = np.full((count, m), np.nan)
    derivatives = np.full((count, m, columns), np.nan)
    map_derivatives = np.full((count, m, m), np.nan)

    def follow(p: NDArray) -> tuple[NDArray, Return]:
        u, slope, own = p[:, :-1], p[:, -1], section
        if setting is not None:
            constants, slope = setting(slope)
            own = own._replace(constants=constants)
        return u, strides(
            own, u, slope, count=period, torque=torque, tolerance=tolerance, longest=longest
        )

    # Without derivatives first: strides that fail cost as much as many that do not.
    _, plain = follow(points.astype(float))
    alive = plain.alive
    if np.any(alive):
        u, result = follow(with_derivatives(points[alive]))
        gap = result.end - u
        _, map_derivative = split(result.end, columns)
        gap[:, 1] = result.imbalance
        values[alive], derivatives[alive] = split(gap, columns)
        map_derivatives[alive] = map_derivative[..., :-1]
        # Whether a stride exists at all may differ by a rounding; then there is none.
        broken = alive.copy()
        broken[alive] = ~result.alive.reshape(-1, columns).all(axis=1)
        values[broken] = np.nan
    return values, derivatives, map_derivatives


def _size(value: NDArray) -> NDArray:
    with np.errstate(all="ignore"):
        size = np.abs(value).max(axis=1)
    return np.where(np.isfinite(size), size, np.inf)


def _solved(derivatives: NDArray, values: NDArray) -> NDArray:
    """Solutions of the linear systems of all points; NaN where there is none."""
    solutions = np.full(values.shape, np.nan)
    for i, (derivative, value) in enumerate(zip(derivatives, values, strict=True)):
        try:
            solutions[i] = np.linalg.solve(derivative[:, :-1], value)
        except np.linalg.LinAlgError:
            continue
    return solutions


def newton(
    section: Section,
    u: NDArray,
    slope: float,
    *,
    period: int,
    torque: float,
    tolerance: float,
    accuracy: float,
) -> tuple[NDArray, NDArray]:
    """Damped Newton iterations from many points at once, as lanes.

    Returns:
        Final points (n, dimension) and the size of the equations' violation there (n,).
    """
    u = u.copy()
    options = {
        "period": period, "torque": torque, "tolerance": tolerance, "longest": LONGEST_SEARCHED
    }  # fmt: skip

    def at(points: NDArray) -> tuple[NDArray, NDArray]:
        full = np.column_stack([points, np.full(len(points), slope)])
        value, derivative, _ = equations(section, full, **options)
        return value, derivative

    value, derivative = at(u)
    size = _size(value)
    damping = np.ones(len(u))
    for _ in range(_MOST_ITERATIONS):
        active = np.flatnonzero(np.isfinite(size) & (size > accuracy) & (damping > 1e-2))
        if len(active) == 0:
            break
        step = _solved(derivative[active], -value[active])
        length = np.abs(step).max(axis=1)
        limit = np.minimum(1.0, 0.7 / np.maximum(length, 1e-300))
        trial = u[active] + step * (damping[active] * limit)[:, None]
        sane = np.all(np.isfinite(trial), axis=1) & (trial[:, 0] < math.log(1.4))
        trial[~sane] = u[active][~sane]
        new_value, new_derivative = at(trial)
        new_size = np.where(sane, _size(new_value), np.inf)
        # The step that would follow tells better than the equations, whose scales differ, whether a
        # gait is nearer (Deuflhard's natural test).
        following = _size(_solved(derivative[active], -new_value))
        better = (new_size < size[active]) | (np.isfinite(new_size) & (following < length))
        won, lost = active[better], active[~better]
        u[won], value[won] = trial[better], new_value[better]
        derivative[won], size[won] = new_derivative[better], new_size[better]
        damping[won] = np.minimum(1.0, 4.0 * damping[won])
        damping[lost] *= np.where(size[lost] < 1e-9, 0.0, 0.25)  # at rounding there is no better
    return u, size
