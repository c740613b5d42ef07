"""A curve of gaits: the gaits of a walker as its ground or one of its parameters changes.

The curve lives in the section's logarithmic coordinates and one coordinate of the varied quantity.
Derivatives are exact.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from gym_passive_walker.gaits.gait import gait_equations
from gym_passive_walker.gaits.newton import newton, solved
from gym_passive_walker.gaits.section import from_logarithms
from gym_passive_walker.gaits.stride_map import StrideMap

_CORRECTIONS = 7  # of a guess, before it is given up
_CLOSED = 1e-10  # violation of a gait that is to be known to rounding


class Axis(NamedTuple):
    """What is varied along a curve: slopes downhill by their logarithm, all else by its share.

    Attributes:
        parameter: "slope", a part of `Actuation`, or a parameter of the walker.
        low: Where the range starts; of no account for slopes downhill.
        high: Where it ends.
        slope: Slope in rad, where something else is varied.
        unit: In which the stride map takes the parameter.
    """

    parameter: str = "slope"
    low: float = 1.0
    high: float = 2.0
    slope: float = 0.0
    unit: float = 1.0

    @property
    def downhill(self) -> bool:
        """Whether slopes downhill are varied, which may be very small ones."""
        return self.parameter == "slope" and self.low > 0.0

    def coordinate(self, value: float) -> float:
        """The coordinate of a value."""
        if self.downhill:
            return float(np.log(value))
        return (value - self.low) / (self.high - self.low)

    def value(self, coordinate: Any) -> Any:
        """The value at a coordinate, or those at several."""
        if self.downhill:
            return np.exp(coordinate)
        return coordinate * (self.high - self.low) + self.low

    def rate(self, coordinate: float) -> float:
        """Change of the value with its coordinate."""
        return float(np.exp(coordinate)) if self.downhill else self.high - self.low


class Point(NamedTuple):
    """A gait on the curve.

    Attributes:
        y: Coordinates: u of the section, and the varied quantity's.
        tangent: Of the curve, of length 1.
        map: The stride map's derivative by u over the period.
    """

    y: NDArray[np.float64]
    tangent: NDArray[np.float64]
    map: NDArray[np.float64]


class GaitsAt(NamedTuple):
    """Some gaits of a curve.

    Attributes:
        stride_map: Whose strides.
        points: Points of the section, (n, m).
        slopes: rad, (n,).
        values: Of the varied quantity, (n,).
    """

    stride_map: StrideMap
    points: NDArray[np.float64]
    slopes: NDArray[np.float64]
    values: NDArray[np.float64]


@dataclass(frozen=True)
class Curve:
    """The gaits of a period as a curve.

    Attributes:
        stride_map: Whose gaits.
        axis: What is varied.
        period: Strides of each gait.
    """

    stride_map: StrideMap
    axis: Axis
    period: int = 1

    def value_at(self, point: Point) -> float:
        """The varied quantity at a point."""
        return float(self.axis.value(point.y[-1]))

    def gaits_at(self, points: list[Point]) -> GaitsAt:
        """Points as gaits of the walkers that walk there."""
        ys = np.array([point.y for point in points])
        stride_map, slopes, values = self._setting(ys)
        return GaitsAt(stride_map, from_logarithms(ys[:, :-1]), slopes, values)

    def _setting(self, ys: NDArray) -> tuple[StrideMap, NDArray, NDArray]:
        """Whose strides, on which slopes, and the varied quantity at coordinates (n, m + 1)."""
        values = self.axis.value(ys[:, -1])
        if self.axis.parameter == "slope":
            return self.stride_map, values, values
        varied = self.stride_map.with_parameter(self.axis.parameter, values / self.axis.unit)
        return varied, np.full(len(values), self.axis.slope), values

    def correct(
        self,
        guess: NDArray,
        tangent: NDArray | None = None,
        accuracy: float = 1e-10,
        bend: NDArray | float = 0.0,
    ) -> Point | None:
        """The gait nearest to a guess across a tangent; None if there is none near.

        Args:
            guess: Coordinates.
            tangent: Direction in which the gait is not moved; the varied quantity's if None.
            accuracy: Largest violation.
            bend: How far from the guess the gait may be expected.
        """
        across = np.eye(len(guess))[-1] if tangent is None else tangent
        closes = self.stride_map.closes

        def equations(ys: NDArray) -> tuple[NDArray, NDArray, NDArray]:
            return self._equations(ys, guess[None], across[None])

        found = newton(
            equations, (guess + bend)[None], iterations=_CORRECTIONS,
            accuracy=accuracy if self.stride_map.exact else closes,
            longest=1.0, damped=False,
        )  # fmt: skip
        if found.sizes[0] > max(closes, accuracy) or not np.isfinite(found.derivatives[0]).all():
            return None
        # One step more squares what is left of the error, and costs no stride.
        y = found.points[0] - np.linalg.solve(found.derivatives[0], found.values[0])
        new = np.linalg.svd(found.derivatives[0, :-1])[2][-1]
        return Point(y, new if new @ across >= 0.0 else -new, found.carried[0])

    def _equations(
        self, ys: NDArray, guesses: NDArray, across: NDArray
    ) -> tuple[NDArray, NDArray, NDArray]:
        """What vanishes on gaits (n, m + 1) that lie across directions from guesses, derived."""
        stride_map, slopes, _ = self._setting(ys)
        gaits = gait_equations(
            stride_map, ys[:, :-1], slopes, period=self.period, by=(self.axis.parameter,)
        )
        rates = np.array([self.axis.rate(y) for y in ys[:, -1]]) / self.axis.unit
        gaits.derivatives[:, :, -1] *= rates[:, None]
        moved = ((ys - guesses) * across).sum(axis=1)
        ways = np.broadcast_to(across[:, None], (len(ys), 1, ys.shape[1]))
        return (
            np.append(gaits.values, moved[:, None], axis=1),
            np.append(gaits.derivatives, ways, axis=1),
            gaits.map,
        )

    def polished(self, points: list[Point]) -> list[Point]:
        """Gaits that are known roughly, to rounding: two steps of Newton's method for all at once.

        Args:
            points: Gaits whose violation is small; each is moved across its tangent.
        """
        ys, across = (np.array([getattr(x, name) for x in points]) for name in ("y", "tangent"))
        guess = ys.copy()
        maps, sizes = np.empty((len(points), 0, 0)), np.full(len(points), np.inf)
        here = np.zeros(len(points), bool)
        for _ in range(2):
            with np.errstate(all="ignore"):
                values, derivatives, maps = self._equations(ys, guess, across)
                sizes = np.abs(values).max(axis=1)
            here = np.isfinite(sizes) & np.isfinite(derivatives).all(axis=(1, 2))
            ys[here] -= solved(derivatives[here], values[here])
        closed = here & (sizes < _CLOSED)
        return [
            Point(y, point.tangent, own) if good
            else self.correct(point.y, point.tangent) or point
            for y, point, own, good in zip(ys, points, maps, closed, strict=True)
        ]  # fmt: skip


def doubling_test(point: Point) -> float:
    """Changes sign where a multiplier passes -1."""
    return float(np.linalg.det(np.eye(len(point.map)) + point.map))


def locate(curve: Curve, a: Point, b: Point, test: Callable[[Point], float]) -> Point | None:
    """The point between two where a test function vanishes, by Brent's method along the chord."""
    chord = b.y - a.y
    length = float(np.linalg.norm(chord))
    chord = chord / length

    def at(s: float) -> Point:
        point = curve.correct(a.y + s * chord, chord, accuracy=1e-13)
        if point is None:
            raise ArithmeticError
        return point

    try:
        s: Any = brentq(lambda s: test(at(s)), 0.0, length, xtol=1e-13, rtol=np.float64(1e-14))
        return at(s)
    except (ArithmeticError, ValueError):
        return None
