"""Runge-Kutta pairs, as data."""

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
        weights: What of each stage's slopes goes into the later ones, and last into the step's end:
            shape (stages + 1, stages).
        nodes: Where in the step each of them lies, shape (stages + 1,).
        error: What of them goes into the estimate of the error, (stages,).
    """

    order: int
    error_order: int
    weights: NDArray[np.longdouble]
    nodes: NDArray[np.longdouble]
    error: NDArray[np.longdouble]

    @property
    def stages(self) -> int:
        """Evaluations of the equations in a step; one more at its end serves the next."""
        return self.weights.shape[1]

    def neighbours(self) -> list[int]:
        """For each stage but the first, and for the step's end, the one before nearest in time."""
        nodes = self.nodes.astype(float)
        return [
            min(range(stage), key=lambda j: (round(abs(nodes[j] - nodes[stage]), 9), -j))
            for stage in range(1, self.stages + 1)
        ]

    def places(self) -> list[int]:
        """For each stage and the step's end, which of a few places is its own while others follow.

        A place is taken again once nobody is left to follow who had it. The last one is for those
        whom nobody follows.
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
        """Accelerations near a step's end, as the polynomial through its last stages.

        Args:
            count: How many stages it passes through, the step's end among them.

        Returns:
            For each of these stages the weights of its acceleration in the polynomial's
            coefficients, by powers of the time from the step's end over the step's length.
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
        """A pair from its tableau.

        Args:
            matrix: Rows of A below its diagonal; zeros at a row's end may be left out.
            weights: Of the method.
            error: Its weights less those of the method that it is compared with.
            order: Of the method.
            error_order: Of the estimate of the error.
        """
        stages = len(weights)
        rows = np.zeros((stages + 1, stages), np.longdouble)
        for row, given in zip(rows, [*matrix, weights], strict=True):
            row[: len(given)] = given
        nodes = rows.sum(axis=1)
        return cls(order, error_order, rows, nodes, np.array(error, np.longdouble))
