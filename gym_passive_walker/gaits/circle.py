"""Whether all multipliers lie inside a circle, as inequalities that are smooth everywhere.

The modulus of the largest multiplier has corners where two are as large, and no slope where two
meet. The coefficients of the characteristic polynomial are smooth, and so are the conditions that
its roots lie inside the circle: those of I. Schur and A. Cohn, as E. I. Jury has them for a cubic.
Of a walker's multipliers at most three differ from zero.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def spectral_radius(matrix: NDArray) -> float:
    """The largest modulus of an eigenvalue."""
    return float(np.abs(np.linalg.eigvals(matrix)).max())


def coefficients(matrix: NDArray, change: NDArray) -> tuple[NDArray, NDArray]:
    """a, b, c of x^3 + a x^2 + b x + c, whose roots are a matrix's eigenvalues besides zeros.

    Args:
        matrix: Of rank 3 at most, (m, m).
        change: Its derivatives, (m, m, k).

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
    """What is positive when all roots lie inside a circle about zero, and only then.

    The first vanishes with a root at +radius, the second with one at -radius, the third with two
    whose product is radius squared; the last two with a product of all three of radius cubed.

    Args:
        cubic: a, b, c of x^3 + a x^2 + b x + c.
        radius: Of the circle.

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
