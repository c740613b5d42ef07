"""Coefficients of embedded Runge-Kutta pairs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class Pair(NamedTuple):
    """A Runge-Kutta method with an error estimate.

    Attributes:
        order: Order of the method.
        error_order: Order of the error estimate.
        weights: Weights of the stages' derivatives in each stage; the last row gives the step's
            end. Shape (stages + 1, stages).
        nodes: Fraction of the step at each stage and at the end, (stages + 1,).
        error: Weights of the stages' derivatives in the error estimate, (stages,).
    """

    order: int
    error_order: int
    weights: NDArray[np.longdouble]
    nodes: NDArray[np.longdouble]
    error: NDArray[np.longdouble]

    __hash__ = object.__hash__  # by identity, as arrays have no hash

    @property
    def stages(self) -> int:
        """Evaluations of the equations in a step; one more at its end is the next step's first."""
        return self.weights.shape[1]

    def neighbours(self) -> list[int]:
        """Return the nearest earlier stage of each stage but the first, and of the step's end."""
        nodes = self.nodes.astype(float)
        return [
            min(range(stage), key=lambda j: (round(abs(nodes[j] - nodes[stage]), 9), -j))
            for stage in range(1, self.stages + 1)
        ]

    def places(self) -> list[int]:
        """Assign a storage place to each stage and the step's end.

        A place stays occupied while later stages have its stage as their nearest, and is then used
        again. All stages that are never the nearest one share the last place.
        """
        followers: dict[int, int] = {}
        for stage, other in enumerate(self.neighbours(), 1):
            followers[other] = stage
        until: list[int] = []
        found: dict[int, int] = {}
        for stage, last in sorted(followers.items()):
            free = [place for place, end in enumerate(until) if end <= stage]
            found[stage] = free[0] if free else len(until)
            until[found[stage] : found[stage] + 1] = [last]
        return [found.get(stage, len(until)) for stage in range(self.stages + 1)]

    def onward(self, count: int) -> dict[int, list[float]]:
        """Return the polynomial through the accelerations of the last stages of a step.

        Args:
            count: Number of stages that the polynomial passes through, including the step's end.

        Returns:
            Weights of each stage's acceleration in the coefficients of the polynomial, by stage.
            Powers ascend; the variable is the time from the step's end over the step's length.
        """
        places: dict[float, int] = {}
        for stage in reversed(range(self.stages + 1)):
            places.setdefault(round(float(self.nodes[stage]), 9), stage)
        chosen = list(places.values())[:count]
        where = {stage: self.nodes[stage] - self.nodes[-1] for stage in chosen}
        weights = {}
        for stage, at in where.items():
            product = np.ones(1, np.longdouble)
            for x in (x for other, x in where.items() if other != stage):
                product = np.append(0.0, product) - np.append(x * product, 0.0)
                product = product / (at - x)
            weights[stage] = [float(x) for x in product]
        return weights

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
        """Create a pair from its Butcher tableau.

        Args:
            matrix: Rows of A below its diagonal; zeros at the end of a row may be omitted.
            weights: Weights of the method, (stages,).
            error: Weights of the method less those of the embedded method, (stages,).
            order: Order of the method.
            error_order: Order of the error estimate.
        """
        stages = len(weights)
        rows = np.zeros((stages + 1, stages), np.longdouble)
        for row, given in zip(rows, [*matrix, weights], strict=True):
            row[: len(given)] = given
        nodes = rows.sum(axis=1)
        return cls(order, error_order, rows, nodes, np.array(error, np.longdouble))
