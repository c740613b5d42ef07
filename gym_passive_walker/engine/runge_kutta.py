"""Runge-Kutta pairs for second-order equations, as data.

The equations of motion give accelerations, angle'' = f(angle, rate). A Runge-Kutta method with
matrix A then needs no stages for the angles: with K the stage accelerations,

    rate_i = rate + h sum_j A_ij K_j,    angle_i = angle + h c_i rate + h^2 sum_j (A A)_ij K_j,

which is the same method, with half the numbers to keep and one reading of each for both sums.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class Pair(NamedTuple):
    """A method that estimates its own error.

    Attributes:
        order: Of the method.
        error_order: Of its estimate of the error.
        rates: Weights of stage accelerations in the rates of each stage, and last of the step's
            end: shape (stages + 1, stages).
        angles: Likewise in the angles.
        nodes: Where in the step each of them lies, shape (stages + 1,).
        rate_error: Weights in the error of the rates, (stages,).
        angle_error: Likewise of the angles.
    """

    order: int
    error_order: int
    rates: NDArray[np.longdouble]
    angles: NDArray[np.longdouble]
    nodes: NDArray[np.longdouble]
    rate_error: NDArray[np.longdouble]
    angle_error: NDArray[np.longdouble]

    @property
    def stages(self) -> int:
        """Evaluations of the accelerations in a step; one more at its end serves the next."""
        return self.rates.shape[1]

    @classmethod
    def from_tableau(
        cls,
        matrix: Sequence[Sequence[float]],
        weights: Sequence[float],
        error: Sequence[float],
        *,
        order: int,
        error_order: int,
    ) -> Pair:
        """A pair from its tableau for first-order equations.

        Args:
            matrix: Rows of A below its diagonal; zeros at a row's end may be left out.
            weights: Of the method.
            error: Its weights less those of the method that it is compared with.
            order: Of the method.
            error_order: Of the estimate of the error.
        """
        stages = len(weights)
        rates = np.zeros((stages + 1, stages), np.longdouble)
        for row, given in zip(rates, [*matrix, weights], strict=True):
            row[: len(given)] = given
        rate_error = np.array(error, np.longdouble)
        square = rates[:stages]
        return cls(
            order, error_order, rates, rates @ square, rates.sum(axis=1), rate_error,
            rate_error @ square,
        )  # fmt: skip
