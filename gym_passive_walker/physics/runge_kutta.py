"""A Runge-Kutta pair for second-order equations, as code with no loop and no zero in it.

The equations of motion give accelerations, angle'' = f(angle, rate). A Runge-Kutta method with
matrix A then needs no stages for the angles: with K the stage accelerations,

    rate_i = rate + h sum_j A_ij K_j,    angle_i = angle + h c_i rate + h^2 sum_j (A A)_ij K_j,

which is the same method, with half the numbers to keep and one reading of each for both sums.

A loop over the stages would hide from the compiler what it needs to keep in registers, so each
stage is a function of its own, written from the table of coefficients.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from gym_passive_walker.physics import verner
from gym_passive_walker.physics.lanes import get, inlined

STAGES = verner.STAGES
ORDER = 9


def _written(lines: list[str]) -> Any:
    """Compile a function from its lines."""
    names: dict[str, Any] = {"get": get}
    exec("\n".join(lines), names)
    return inlined(names[lines[0].split()[1].split("(")[0]])


def _sum(weights: np.ndarray) -> str:
    """The weighted sum of stage accelerations, without those that have no part in it."""
    terms = [f"{float(w)!r} * k{j}" for j, w in enumerate(weights) if w != 0.0]
    return " + ".join(terms)


def _read(*weights: np.ndarray, part: str = "") -> list[str]:
    """Lines that read the stage accelerations in which one of the sums has a part."""
    used = np.flatnonzero(np.any(weights, axis=0))
    return [f"    k{j} = get(tile, k + {3 * j}, lane){part}" for j in used.tolist()]


def _table() -> np.ndarray:
    """Rows of the matrix and, last, the weights: shape (STAGES + 1, STAGES)."""
    table = np.zeros((STAGES + 1, STAGES), np.longdouble)
    for i, row in enumerate([*verner.MATRIX, verner.WEIGHTS]):
        table[i, : len(row)] = row
    return table


_TABLE = _table()
_SQUARE = _TABLE @ _TABLE[:STAGES]


def _stage(i: int) -> Any:
    """Write stage i; after the last comes the step's end."""
    return _written(
        [
            f"def stage_{i}(tile, lane, k, h, angle, rate):",
            *_read(_TABLE[i], _SQUARE[i]),
            f"    shift = {_sum(_SQUARE[i]) or '0.0 * h'}",
            f"    new_rate = {_sum(_TABLE[i])}",
            f"    node = {float(_TABLE[i].sum())!r}",
            "    return angle + h * (node * rate + h * shift), rate + h * new_rate",
        ]
    )


STAGE: tuple[Any, ...] = (None, *(_stage(i) for i in range(1, STAGES + 1)))
"""Stage i, from 1 on; the last is the step's end. Called as ``stage(tile, lane, k, h, angle,
rate)`` with k the row of the coordinate's first acceleration; returns its angle and rate."""


def _error() -> Any:
    """Write the estimate of the error."""
    rate = np.array(verner.ERROR, np.longdouble)
    angle = rate @ _TABLE[:STAGES]
    return _written(
        [
            "def error(tile, lane, k, h, weight):",
            *_read(rate, angle, part=".real"),
            f"    of_rate = weight * ({_sum(rate)})",
            f"    of_angle = weight * h * ({_sum(angle)})",
            "    return of_rate * of_rate + of_angle * of_angle",
        ]
    )


error: Any = _error()
"""Squared error of one coordinate, estimated to order 8: ``error(tile, lane, k, h, weight)`` with
h real and weight a factor on it before squaring, h over the error allowed."""
