"""Following a curve of gaits: pseudo-arclength continuation (H. B. Keller, 1977).

The curve lives in the section's logarithmic coordinates and one parameter. Derivatives are exact.
Where the parameter turns back lies a fold; where a multiplier passes -1 the period doubles; both
are located to rounding by root finding along the curve. The curve ends where the stride itself
ceases to be one.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from gym_passive_walker.gaits.ends import BOUND, LOST, VANISHED, End, margins, reason_of
from gym_passive_walker.gaits.newton import LONGEST_SEARCHED, Setting, equations
from gym_passive_walker.gaits.section import INFINITESIMAL, Section

_FIRST_STEP, _SHORTEST_STEP = 0.02, 1e-7
_VANISHING = 10.0  # rate over angle of a walker that rocks rather than steps
_MOST_POINTS = 4000
_LAST = 40  # points that tell of an end
_CROWDED = 1e-3
_GLIDING = 0.01


class Point(NamedTuple):
    """A gait on the curve: coordinates (u, p), unit tangent, and the stride map's derivative."""

    y: NDArray
    tangent: NDArray
    map: NDArray


class Curve:
    """The set of gaits as a curve in the space of section and parameter."""

    def __init__(
        self,
        section: Section,
        decode: Callable[[NDArray], NDArray],
        setting: Setting | None,
        period: int,
    ) -> None:
        self.section, self.decode, self.setting, self.period = section, decode, setting, period

    def equations(self, y: NDArray) -> tuple[NDArray, NDArray, NDArray]:
        """Violation, its derivative by y, and the stride map's derivative."""
        p = np.array([y[-1]])
        point = np.append(y[:-1], self.decode(p))[None]
        # The chart's own derivative: exact for the exponential and the identity.
        scale = np.imag(self.decode(p + 1j * INFINITESIMAL)) / INFINITESIMAL
        value, derivative, map_derivative = equations(
            self.section, point, period=self.period, torque=0.0, tolerance=1e-12,
            longest=LONGEST_SEARCHED,
            setting=self.setting,
        )  # fmt: skip
        derivative = derivative[0].copy()
        derivative[:, -1] *= scale[0]
        return value[0], derivative, map_derivative[0]

    def correct(self, guess: NDArray, tangent: NDArray, accuracy: float = 1e-10) -> Point | None:
        """The gait nearest to a guess across the tangent, by Newton's method; None if lost."""
        y, size, before = guess.copy(), np.inf, np.inf
        for _ in range(8):
            with np.errstate(all="ignore"):
                value, derivative, map_derivative = self.equations(y)
            if not np.all(np.isfinite(value)):
                return None
            size = np.abs(value).max()
            if size < accuracy or (size < 1e-9 and size > 0.1 * before):
                break
            if size > 4.0 * before:
                return None
            before = size
            matrix = np.vstack([derivative, tangent])
            try:
                step = np.linalg.solve(matrix, np.append(-value, -(tangent @ (y - guess))))
            except np.linalg.LinAlgError:
                return None
            if np.abs(step).max() > 1.0:
                return None
            y = y + step
        if size > 1e-9:
            return None
        new = np.linalg.svd(derivative)[2][-1]
        return Point(y, new if new @ tangent >= 0.0 else -new, map_derivative)


def doubling_test(point: Point) -> float:
    """Changes sign where a multiplier passes -1."""
    return float(np.linalg.det(np.eye(len(point.map)) + point.map))


def locate(
    curve: Curve, a: Point, b: Point, test: Callable[[Point], float]
) -> tuple[float, Point] | None:
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
        point = at(s)
    except (ArithmeticError, ValueError):
        return None
    return float(curve.decode(point.y[-1:])[0]), point


def setting_at(curve: Curve, ys: NDArray) -> tuple[Section, NDArray, NDArray]:
    """The section with its constants, the slopes and the parameter's values at points (n, d)."""
    values = curve.decode(ys[:, -1])
    if curve.setting is None:
        return curve.section, values, values
    constants, slopes = curve.setting(values)
    return curve.section._replace(constants=constants), slopes, values


def _end(curve: Curve, points: list[Point]) -> End:
    """Why the curve ends after its last points, and where."""
    ys = np.array([point.y for point in points[-_LAST:]])
    section, slopes, values = setting_at(curve, ys)
    return reason_of(section, ys[:, :-1], slopes, values, curve.period)


def _glides(curve: Curve, point: Point) -> bool:
    """Whether the foot lands so nearly along the ground that the rest is better extrapolated."""
    section, slopes, _ = setting_at(curve, point.y[None])
    return bool(margins(section, point.y[None, :-1], slopes, curve.period).landing[0] < _GLIDING)


class Branch(NamedTuple):
    """One direction of a curve: its points and what was located between them."""

    points: list[Point]
    folds: list[float]
    doublings: list[float]
    end: End


def follow(curve: Curve, start: Point, low: float, high: float, resolution: float) -> Branch:
    """Follow the curve from a point along its tangent to an end."""
    points, folds, doublings = [start], [], []
    step, here = min(_FIRST_STEP, resolution), start
    end = None
    while len(points) < _MOST_POINTS:
        there = curve.correct(here.y + step * here.tangent, here.tangent)
        # A turn too sharp for this step, or a leap to another branch: try a shorter one.
        if there is None or there.tangent @ here.tangent < 0.8:
            step *= 0.4
            if step < _SHORTEST_STEP or (step < 0.02 * resolution and _glides(curve, here)):
                end = _end(curve, points)
                break
            continue
        p = there.y[-1]
        if abs(there.y[1]) > _VANISHING:
            end = End(float(curve.decode(here.y[-1:])[0]), VANISHED)
            break
        if not low <= p <= high:
            bound = low if p < low else high
            across = np.zeros_like(here.y)
            across[-1] = 1.0
            fraction = (bound - here.y[-1]) / (p - here.y[-1])
            guess = here.y + fraction * (there.y - here.y)
            guess[-1] = bound
            last = curve.correct(guess, across)
            end = End(float(curve.decode(np.array([bound]))[0]), BOUND)
            if last is not None:
                if doubling_test(here) * doubling_test(last) < 0.0:
                    located = locate(curve, here, last, doubling_test)
                    doublings += [located[0]] if located else []
                points.append(last)
            break
        if here.tangent[-1] * there.tangent[-1] < 0.0:
            located = locate(curve, here, there, lambda point: float(point.tangent[-1]))
            folds += [located[0]] if located else []
        if doubling_test(here) * doubling_test(there) < 0.0:
            located = locate(curve, here, there, doubling_test)
            doublings += [located[0]] if located else []
        here = there
        points.append(here)
        step = min(1.5 * step, resolution)
    if end is None:
        end = End(float(curve.decode(here.y[-1:])[0]), LOST)
    return Branch(_thinned(points), folds, doublings, end)


def _thinned(points: list[Point]) -> list[Point]:
    """The points without those that crowd before an end: short steps are for finding it."""
    kept = points[:1]
    for point in points[1:-1]:
        if np.abs(point.y - kept[-1].y).max() > _CROWDED:
            kept.append(point)
    return kept + points[-1:] if len(points) > 1 else kept
