"""Following a curve of gaits: pseudo-arclength continuation (H. B. Keller, 1977).

Where the parameter turns back lies a fold; where a multiplier passes -1 the period doubles; both
are located to rounding by root finding along the curve. The curve ends where the stride itself
ceases to be one.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from gym_passive_walker.gaits.curve import Curve, Point, doubling_test, locate
from gym_passive_walker.gaits.ends import BOUND, VANISHED, End, margins, reason_of
from gym_passive_walker.progress import progress

_FIRST_STEP, _SHORTEST_STEP = 0.02, 1e-7
_VANISHING = 10.0  # rate over angle of a walker that rocks rather than steps
_ASTRAY = 0.3  # of a step: from where a gait is expected to where it may be
_ROUGHLY = 1e-5  # violation of gaits until all of a curve are known
_MOST_POINTS = 4000
_LAST = 40  # points that tell of an end
_CROWDED = 1e-3
_GLIDING = 0.01


def _glides(curve: Curve, point: Point) -> bool:
    """Whether the foot lands so nearly along the ground that the rest is better extrapolated."""
    gait = curve.gaits_at([point])
    left = margins(gait.stride_map, gait.points, gait.slopes, curve.period)
    return bool(left.landing[0] < _GLIDING)


def points_along(
    curve: Curve,
    start: Point,
    *,
    first: float,
    longest: float,
    shortest: float = _SHORTEST_STEP,
    accuracy: float = 1e-10,
) -> Iterator[Point]:
    """Points of the curve one after the other, from a start along its tangent, until it is lost.

    Args:
        curve: The curve.
        start: Where to start; not among the points.
        first: Length of the first step.
        longest: Longest step.
        shortest: Step below which the curve counts as lost.
        accuracy: Violation of each gait, before a last step of Newton's method squares it.
    """
    here, step, curvature = start, min(first, longest), np.zeros(len(start.y))
    # Where torques change within a stride, the map may jump as a strike comes at such a moment.
    pieces = math.isfinite(curve.stride_map.hold)
    for _ in range(_MOST_POINTS):
        ahead = here.y + step * here.tangent
        bend = 0.5 * step**2 * curvature
        there = curve.correct(ahead, here.tangent, accuracy, bend)
        # A turn too sharp for this step, or a leap to another branch: try a shorter one.
        astray = there is None or there.tangent @ here.tangent < 0.8
        if there is not None and pieces:
            astray |= bool(np.linalg.norm(there.y - ahead - bend) > _ASTRAY * step)
        if there is None or astray:
            step *= 0.4
            if step < shortest or (step < 0.02 * longest and _glides(curve, here)):
                return
        else:
            yield there
            curvature = (there.tangent - here.tangent) / np.linalg.norm(there.y - here.y)
            here, step = there, min(1.5 * step, longest)


class Branch(NamedTuple):
    """One direction of a curve: its points and what was located between them."""

    points: list[Point]
    folds: list[float]
    doublings: list[float]
    end: End


def follow(curve: Curve, start: Point, low: float, high: float, resolution: float) -> Branch:
    """Follow the curve from a point along its tangent to an end."""
    points, folds, doublings = [start], [], []
    at_bound: list[Point] = []
    end: End | None

    def crossings(there: Point, test: Callable[[Point], float]) -> list[float]:
        crossed = test(points[-1]) * test(there) < 0.0
        located = locate(curve, points[-1], there, test) if crossed else None
        return [curve.value_at(located)] if located else []

    steps = points_along(curve, start, first=_FIRST_STEP, longest=resolution, accuracy=_ROUGHLY)
    with progress("gaits along a curve") as followed:
        for there in steps:
            followed()
            here, p = points[-1], there.y[-1]
            if abs(there.y[1]) > _VANISHING:
                end = End(curve.value_at(here), VANISHED)
                break
            if not low <= p <= high:
                bound = low if p < low else high
                fraction = (bound - here.y[-1]) / (p - here.y[-1])
                guess = here.y + fraction * (there.y - here.y)
                guess[-1] = bound
                last = curve.correct(guess)
                end = End(float(curve.axis.value(bound)), BOUND)
                if last is not None:
                    doublings += crossings(last, doubling_test)
                    at_bound.append(last)
                break
            folds += crossings(there, lambda point: float(point.tangent[-1]))
            doublings += crossings(there, doubling_test)
            points.append(there)
        else:
            end = None
    if curve.stride_map.exact and len(points) > 1:
        points = [start, *curve.polished(points[1:])]
    points += at_bound
    if end is None:
        end = reason_of(*curve.gaits_at(points[-_LAST:]), curve.period)
    return Branch(_thinned(points), folds, doublings, end)


def _thinned(points: list[Point]) -> list[Point]:
    """The points without those that crowd before an end: short steps are for finding it."""
    kept = points[:1]
    for point in points[1:-1]:
        if np.abs(point.y - kept[-1].y).max() > _CROWDED:
            kept.append(point)
    return kept + points[-1:] if len(points) > 1 else kept
