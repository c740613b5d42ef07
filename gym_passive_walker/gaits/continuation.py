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

from gym_passive_walker.gaits.newton import LONGEST_SEARCHED, Setting, equations
from gym_passive_walker.gaits.section import INFINITESIMAL, Section, strides
from gym_passive_walker.physics import constants as K
from gym_passive_walker.physics import integrator as I

KNEE_MEETS_HEEL = "kneestrike and heelstrike coincide"
STANCE_STOPS = "the stance leg barely passes the vertical"
TANGENTIAL = "heelstrike becomes tangential"
BOUND = "end of the range asked for"
VANISHED = "the step length goes to zero"
LOST = "the family could not be followed further"

_FIRST_STEP, _SHORTEST_STEP = 0.02, 1e-7
_VANISHING = 10.0  # rate over angle of a walker that rocks rather than steps
_MOST_POINTS = 4000


class End(NamedTuple):
    """Where a family ends.

    Attributes:
        value: Slope in rad, or the parameter's value.
        reason: Why it ends there.
    """

    value: float
    reason: str


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


def _why(curve: Curve, y: NDArray) -> str:
    """Which way a stride at the end of its family is about to fail."""
    value = curve.decode(y[-1:])
    section, slope = curve.section, value
    if curve.setting is not None:
        constants, slope = curve.setting(value)
        section = section._replace(constants=constants)
    result = strides(section, y[None, :-1], slope, count=curve.period, tolerance=1e-12)
    record = result.records[0]
    time = record[I.TIME]
    signs = {STANCE_STOPS: 4.0 / max(time, 1e-9) if time > 5.0 else 1.0}
    if section.kind == K.Kind.KNEED:
        signs[KNEE_MEETS_HEEL] = (time - record[I.KNEE_TIME]) / time
    # The rate at which the legs close at heelstrike, from the motion just before it.
    records = strides(
        section, y[None, :-1], slope, count=curve.period, tolerance=1e-12, longest=time - 1e-4
    ).records[0]
    closing = -(records[I.RATES] + records[I.RATES + 1])
    signs[TANGENTIAL] = closing / max(abs(records[I.RATES]), abs(records[I.RATES + 1]))
    reason, least = min(signs.items(), key=lambda item: item[1])
    return reason if least < 0.3 else LOST


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
    reason = LOST
    while len(points) < _MOST_POINTS:
        there = curve.correct(here.y + step * here.tangent, here.tangent)
        # A turn too sharp for this step, or a leap to another branch: try a shorter one.
        if there is None or there.tangent @ here.tangent < 0.8:
            step *= 0.4
            if step < _SHORTEST_STEP:
                reason = _why(curve, here.y)
                break
            continue
        p = there.y[-1]
        if abs(there.y[1]) > _VANISHING:
            reason = VANISHED
            break
        if not low <= p <= high:
            bound = low if p < low else high
            across = np.zeros_like(here.y)
            across[-1] = 1.0
            fraction = (bound - here.y[-1]) / (p - here.y[-1])
            guess = here.y + fraction * (there.y - here.y)
            guess[-1] = bound
            last = curve.correct(guess, across)
            reason = BOUND
            if last is not None:
                if doubling_test(here) * doubling_test(last) < 0.0:
                    located = locate(curve, here, last, doubling_test)
                    doublings += [located[0]] if located else []
                points.append(last)
                here = last
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
    return Branch(points, folds, doublings, End(float(curve.decode(here.y[-1:])[0]), reason))
