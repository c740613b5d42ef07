"""A design as a nonlinear programme: objective and constraints, for SciPy's SLSQP."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from gym_passive_walker.gaits.candidates import Candidates, Judged
from gym_passive_walker.gaits.circle import spectral_radius
from gym_passive_walker.gaits.gait import GaitNotFound
from gym_passive_walker.gaits.quantities import SPECTRAL_RADIUS
from gym_passive_walker.progress import progress

_LEAST_RADIUS, _LARGEST_RADIUS = 1e-3, 1e3
_MARGIN = 1.05  # of the radius that the search for the least begins with, over the largest modulus
_CIRCLE = 5  # conditions that multipliers lie inside one


class Side(NamedTuple):
    """A quantity that must lie on one side of a bound, or on it.

    Attributes:
        name: The quantity.
        bound: The bound.
        sign: 1 if it must not be less, -1 if it must not be more.
        size: What counts as a large difference.
    """

    name: str
    bound: float
    sign: float
    size: float

    def at(self, judged: Judged) -> tuple[float, NDArray]:
        """How far it is on the right side, and the derivatives."""
        value, gradient = judged.quantities[self.name]
        scale = self.sign / self.size
        return scale * (value - self.bound), scale * gradient


class Programme:
    """Objective and constraints as SciPy takes them, of z: a candidate's shares x and a radius.

    The least spectral radius is that of the smallest circle with all multipliers inside, so that
    nothing here has corners. Where the radius is not sought, it is no part of z.

    Args:
        candidates: What to choose from.
        objective: What is to be least.
        sign: 1, or -1 if it is to be greatest.
        ranges: Lowest and highest value of what is constrained; None for none.

    Raises:
        GaitNotFound: if the first candidate's gait is lost to Newton's method.
    """

    def __init__(
        self, candidates: Candidates, objective: str, sign: float, ranges: Mapping[str, tuple]
    ) -> None:
        self.candidates, self.objective, self.sign = candidates, objective, sign
        self.sought = objective == SPECTRAL_RADIUS
        self.radius = ranges.get(SPECTRAL_RADIUS, (None, None))[1]
        self.circle = self.sought or self.radius is not None
        first = candidates.at(candidates.first)
        if first is None:
            raise GaitNotFound("the gait to begin with could not be followed")
        self.unit = 1.0 if self.sought else abs(first.quantities[objective][0]) or 1.0
        self.equal: list[Side] = []
        self.beyond: list[Side] = []
        for name, (low, high) in ranges.items():
            if name == SPECTRAL_RADIUS:
                continue
            size = max(abs(x or 0.0) for x in (low, high, first.quantities[name][0])) or 1.0
            if low == high:
                self.equal.append(Side(name, low, 1.0, size))
            else:
                sides = Side(name, low, 1.0, size), Side(name, high, -1.0, size)
                self.beyond += [side for side in sides if side.bound is not None]
        self.start = candidates.first
        if self.sought:
            self.start = np.append(self.start, _MARGIN * spectral_radius(first.gait.map))

    def cost(self, z: NDArray) -> tuple[float, NDArray]:
        """The objective and its gradient; infinite where there is no gait."""
        judged = self._judged(z)
        if judged is None:
            return np.inf, np.zeros(len(z))
        if self.sought:
            return float(z[-1]), np.eye(len(z))[-1]
        value, gradient = judged.quantities[self.objective]
        return self.sign * value / self.unit, self.sign * gradient / self.unit

    def equalities(self, z: NDArray) -> tuple[NDArray, NDArray]:
        """What has to vanish, and its derivatives."""
        return self._stacked(z, self.equal)

    def inequalities(self, z: NDArray) -> tuple[NDArray, NDArray]:
        """What must not be negative, and its derivatives."""
        return self._stacked(z, self.beyond, circle=self.circle)

    def _judged(self, z: NDArray) -> Judged | None:
        return self.candidates.at(z[: len(self.candidates.first)])

    def _stacked(
        self, z: NDArray, sides: list[Side], circle: bool = False
    ) -> tuple[NDArray, NDArray]:
        count, k = len(sides), len(self.candidates.first)
        values = -np.ones(count + _CIRCLE * circle)
        derivatives = np.zeros((len(values), len(z)))
        judged = self._judged(z)
        if judged is None:  # no step of a line search ends here
            return values, derivatives
        for i, side in enumerate(sides):
            values[i], derivatives[i, :k] = side.at(judged)
        if circle:
            values[count:], by = judged.inside(z[-1] if self.sought else self.radius)
            derivatives[count:] = by[:, : len(z)]  # by the radius as well if it is part of z
        return values, derivatives

    def solve(self, iterations: int) -> Any:
        """What SciPy finds."""
        bounds = [(0.0, 1.0)] * len(self.candidates.first)
        bounds += [(_LEAST_RADIUS, _LARGEST_RADIUS)] * self.sought
        constraints = [
            {"type": kind, "fun": lambda z, f=f: f(z)[0], "jac": lambda z, f=f: f(z)[1]}
            for kind, f in (("eq", self.equalities), ("ineq", self.inequalities))
            if len(f(self.start)[0])
        ]
        with progress(f"{self.objective}: iterations") as one_more:
            return minimize(
                self.cost, self.start, jac=True, method="SLSQP", bounds=bounds,
                constraints=constraints, options={"maxiter": iterations, "ftol": 1e-10},
                callback=lambda _: one_more(),
            )  # fmt: skip

    def missed(self, z: NDArray) -> float:
        """By how much the constraints are missed at most, over their sizes."""
        equal, beyond = self.equalities(z)[0], self.inequalities(z)[0]
        return float(max(np.abs(equal).max(initial=0.0), (-beyond).max(initial=0.0)))
