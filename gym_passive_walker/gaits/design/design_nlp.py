"""Design as a nonlinear program: candidates judged by their gaits, for SciPy's SLSQP."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from gym_passive_walker._tools.progress import progress
from gym_passive_walker.gaits.branches.sensitivity import (
    SLOPE,
    Sensitivity,
    map_change,
    place_near,
    sensitivity,
    size_of,
)
from gym_passive_walker.gaits.design.objectives import (
    QUANTITIES,
    SPECTRAL_RADIUS,
    Graded,
    coefficients,
    inside,
    spectral_radius,
)
from gym_passive_walker.gaits.gait import Gait, GaitNotFound
from gym_passive_walker.gaits.map_result import NoStride
from gym_passive_walker.gaits.section import Points
from gym_passive_walker.models.walkers import WalkerError

_PIECES = (1, 4, 16)  # in which a gait is followed to another walker, as long as need be
_LEAP = 0.3  # from where a gait is expected to where Newton's method finds one
_LEAST_RADIUS, _LARGEST_RADIUS = 1e-3, 1e3
_MARGIN = 1.05  # of the radius that the search for the least begins with, over the largest modulus
_CIRCLE = 5  # conditions that multipliers lie inside a circle


class Judged(NamedTuple):
    """Quantities of a candidate's gait; gradients are by its k shares.

    Attributes:
        gait: The gait.
        quantities: Quantities asked for, by name, with gradients (k,).
        cubic: Coefficients of the polynomial with the multipliers as roots, (3,), and their
            derivatives (3, k), as `coefficients` returns them; None if not asked for.
    """

    gait: Sensitivity
    quantities: dict[str, Graded]
    cubic: tuple[NDArray[np.float64], NDArray[np.float64]] | None


class Candidates:
    """Walkers that differ in some parameters, and in the slope if that is among them.

    Shares x determine a candidate: the position of each parameter between its bounds, from 0 to 1.
    Its gait is followed from the gait of the candidate before.

    Args:
        start: First gait.
        parameters: Names of the k parameters.
        box: Lower and upper bounds, (k, 2).
        names: Quantities to compute.
        multipliers: Whether to compute the multipliers as well.

    Attributes:
        first: Shares of the first walker, (k,).
        tried: Number of candidates so far.
    """

    def __init__(
        self,
        start: Gait,
        parameters: Sequence[str],
        box: NDArray,
        names: Sequence[str],
        *,
        multipliers: bool,
    ) -> None:
        self._start, self._parameters, self._names = start, tuple(parameters), tuple(names)
        self._low, self._width, self._multipliers = box[:, 0], box[:, 1] - box[:, 0], multipliers
        self._sizes = [size_of(name, start.walker, start.slope) for name in parameters]
        self._here = sensitivity(start.point, self._parameters)
        self._last: tuple[bytes, Judged | None] = b"", None
        self.tried = 0
        self.first = (self._values(start.point) - self._low) / self._width

    def at(self, x: NDArray) -> Judged | None:
        """Return a candidate's quantities; None where its gait is lost, or it is no walker."""
        if x.tobytes() != self._last[0]:
            self.tried += 1
            try:
                judged = self._judged(self._low + self._width * x)
            except (WalkerError, NoStride, np.linalg.LinAlgError):
                judged = None
            self._last = x.tobytes(), judged
        return self._last[1]

    def inside(self, x: NDArray, radius: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Conditions that all multipliers lie inside a circle, positive if so; -1 without a gait.

        Returns:
            Values (5,), and derivatives (5, k + 1) by the shares and the radius.
        """
        judged = self.at(x)
        if judged is None:
            return -np.ones(_CIRCLE), np.zeros((_CIRCLE, len(x) + 1))
        assert judged.cubic is not None
        values, by = inside(judged.cubic[0], radius)
        return values, np.column_stack([by[:, :3] @ judged.cubic[1], by[:, 3]])

    def _values(self, place: Points) -> NDArray[np.float64]:
        """Return the parameters at a place, (k,)."""
        own = {**place.section.walker.parameters, SLOPE: place.section.slope}
        return np.array([own[name] for name in self._parameters])

    def _followed(self, values: NDArray) -> Sensitivity | None:
        """Follow the gait from the last one found to other parameters; None if it is lost."""
        origin = self._values(self._here.place)
        for pieces in _PIECES:
            here = self._here
            for share in np.arange(1, pieces + 1) / pieces:
                goal = origin + share * (values - origin)
                moved = goal - self._values(here.place)
                place = self._beside(goal, here.place.search[0] + here.coordinates @ moved)
                if place is None:
                    break
                here = sensitivity(place, self._parameters)
            else:
                self._here = here
                return here
        return None

    def _beside(self, values: NDArray, guess: NDArray) -> Points | None:
        """Return the gait at some parameters that is near to a guess; None if there is none."""
        changed = dict(zip(self._parameters, values.tolist(), strict=True))
        slope = changed.pop(SLOPE, self._start.slope)
        walker = self._start.walker.with_body(changed)
        place = place_near(self._start.stride_map.with_walker(walker), slope, guess)
        return place if place and np.abs(place.search[0] - guess).max() < _LEAP else None

    def _judged(self, values: NDArray) -> Judged | None:
        gait = self._followed(values)
        if gait is None:
            return None
        quantities = {}
        for name in self._names:
            value, gradient = QUANTITIES[name](gait)
            quantities[name] = value, gradient * self._width
        known, cubic = [*quantities.values()], None
        if self._multipliers:
            polynomial, derivatives = coefficients(gait.map, map_change(gait, self._sizes))
            cubic = polynomial, derivatives * self._width
            known.append(cubic)
        if not all(np.isfinite(array).all() for pair in known for array in pair):
            return None  # strides beside it fail
        return Judged(gait, quantities, cubic)


Valued = Callable[[NDArray], tuple[Any, NDArray]]
"""Takes z to values and their derivatives by z."""


def slsqp(
    cost: Valued,
    start: NDArray,
    bounds: list[tuple[float, float]],
    *,
    equal: Valued,
    beyond: Valued,
    iterations: int,
    accuracy: float = 1e-10,
    callback: Callable[..., None] | None = None,
) -> Any:
    """Minimize by SciPy's SLSQP (D. Kraft, 1988).

    Args:
        cost: Objective.
        start: Initial z, (n,).
        bounds: Bounds of each entry of z.
        equal: Equality constraints; none if it has no values at the start.
        beyond: Constraints that must not be negative; none if it has no values at the start.
        iterations: Largest number of iterations.
        accuracy: Change of the cost at which the search ends.
        callback: Function called after each iteration.
    """
    constraints = [
        {"type": kind, "fun": lambda z, f=f: f(z)[0], "jac": lambda z, f=f: f(z)[1]}
        for kind, f in (("eq", equal), ("ineq", beyond))
        if len(f(start)[0])
    ]
    return scipy.optimize.minimize(
        cost, start, jac=True, method="SLSQP", bounds=bounds, constraints=constraints,
        options={"maxiter": iterations, "ftol": accuracy}, callback=callback,
    )  # fmt: skip


class DesignProblem:
    """Objective and constraints as SciPy takes them, of z: a candidate's shares x and a radius.

    The least spectral radius is that of the smallest circle with all multipliers inside, so that
    nothing here has corners. Where the radius is not sought, it is no part of z.

    Args:
        candidates: The walkers.
        objective: Quantity to minimize.
        sign: 1, or -1 to maximize it.
        ranges: Lowest and highest value of each constrained quantity; None for no bound.

    Attributes:
        first: The first candidate.

    Raises:
        GaitNotFound: if the first candidate's gait is lost to Newton's method.
    """

    def __init__(
        self, candidates: Candidates, objective: str, sign: float, ranges: Mapping[str, tuple]
    ) -> None:
        self.candidates, self.objective, self.sign = candidates, objective, sign
        self.count, self.sought = len(candidates.first), objective == SPECTRAL_RADIUS
        self.radius = ranges.get(SPECTRAL_RADIUS, (None, None))[1]
        first = candidates.at(candidates.first)
        if first is None:
            raise GaitNotFound("the gait to begin with could not be followed")
        self.first = first
        self.unit = 1.0 if self.sought else abs(first.quantities[objective][0]) or 1.0
        # Name and bound of a quantity, and what its distance from the bound is multiplied by: one
        # over what counts as a large difference, negative if it must not be more.
        self.equal: list[tuple[str, float, float]] = []
        self.beyond: list[tuple[str, float, float]] = []
        for name, (low, high) in ranges.items():
            if name == SPECTRAL_RADIUS:
                continue
            size = max(abs(x or 0.0) for x in (low, high, first.quantities[name][0])) or 1.0
            if low == high:
                self.equal.append((name, low, 1.0 / size))
            else:
                sides = (name, low, 1.0 / size), (name, high, -1.0 / size)
                self.beyond += [side for side in sides if side[1] is not None]

    def cost(self, z: NDArray) -> tuple[float, NDArray]:
        """Return the objective and its gradient; infinite where there is no gait."""
        judged = self.candidates.at(z[: self.count])
        if judged is None:
            return np.inf, np.zeros(len(z))
        if self.sought:
            return float(z[-1]), np.eye(len(z))[-1]
        value, gradient = judged.quantities[self.objective]
        return self.sign * value / self.unit, self.sign * gradient / self.unit

    def constraints(self, z: NDArray, equal: bool) -> tuple[NDArray, NDArray]:
        """Return the constraints that must be zero, or not negative, and their derivatives."""
        sides, radius = (self.equal, None) if equal else (self.beyond, self.radius)
        radius = z[-1] if self.sought and not equal else radius
        count = len(sides)
        values = -np.ones(count + _CIRCLE * (radius is not None))
        derivatives = np.zeros((len(values), len(z)))
        judged = self.candidates.at(z[: self.count])
        if judged is None:  # no step of a line search ends here
            return values, derivatives
        for i, (name, bound, scale) in enumerate(sides):
            value, gradient = judged.quantities[name]
            values[i], derivatives[i, : self.count] = scale * (value - bound), scale * gradient
        if radius is not None:
            values[count:], by = self.candidates.inside(z[: self.count], radius)
            derivatives[count:] = by[:, : len(z)]  # by the radius as well if it is part of z
        return values, derivatives

    def solve(self, iterations: int) -> Any:
        """Return SciPy's solution."""
        start, bounds = self.candidates.first, [(0.0, 1.0)] * self.count
        if self.sought:
            start = np.append(start, _MARGIN * spectral_radius(self.first.gait.map))
            bounds.append((_LEAST_RADIUS, _LARGEST_RADIUS))
        with progress(f"{self.objective}: iterations") as one_more:
            return slsqp(
                self.cost, start, bounds, equal=lambda z: self.constraints(z, True),
                beyond=lambda z: self.constraints(z, False), iterations=iterations,
                callback=lambda _: one_more(),
            )  # fmt: skip

    def missed(self, z: NDArray) -> float:
        """Return the largest violation of the constraints, over their sizes."""
        equal, beyond = (self.constraints(z, kind)[0] for kind in (True, False))
        return float(max(np.abs(equal).max(initial=0.0), (-beyond).max(initial=0.0)))
