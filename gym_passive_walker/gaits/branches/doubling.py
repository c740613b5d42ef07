"""The period-doubling route to chaos, located on the gaits themselves.

Where a multiplier of a gait of period n passes -1, a gait of period 2n branches off along that
multiplier's eigenvector. Following the branch by continuation leads to where it doubles in turn,
and so on: each slope is a root found to rounding, stable or not.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from gym_passive_walker._tools.arguments import whole
from gym_passive_walker._tools.progress import progress
from gym_passive_walker._tools.shown import Table
from gym_passive_walker.gaits.branches.continuation import (
    Axis,
    Curve,
    Point,
    doubling_test,
    locate,
    points_along,
)
from gym_passive_walker.gaits.branches.family import gait_family
from gym_passive_walker.gaits.gait import Gait, GaitKind, GaitNotFound, gait_at
from gym_passive_walker.gaits.stride_map import MapLike, map_of
from gym_passive_walker.models.walkers import Walker, describe, name_of

FEIGENBAUM = 4.669201609102990
"""Limit of the ratios of successive distances between doublings (Feigenbaum, 1978)."""

_FIRST_STEP, _LONGEST_STEP, _SHORTEST_STEP = 2e-3, 0.03, 1e-9  # in logarithmic coordinates
_SHRINK = 2.5  # each branch is so much smaller than the one before
_MOST_STEPS = 400


@dataclass(frozen=True, repr=False)
class Cascade(Table):
    """Successive period doublings.

    Attributes:
        walker: The walker.
        periods: Period of the gait that doubles, in strides: 1, 2, 4, ...
        slopes: Slopes in rad of the doublings.
        gaits: Gaits at the doublings, with a multiplier at -1.
    """

    walker: Walker
    periods: tuple[int, ...]
    slopes: tuple[float, ...]
    gaits: tuple[Gait, ...]

    @property
    def ratios(self) -> tuple[float, ...]:
        """Distances between successive doublings, each over the next; they tend to FEIGENBAUM."""
        gaps = np.diff(self.slopes)
        return tuple(float(x) for x in gaps[:-1] / gaps[1:])

    @property
    def limit(self) -> float:
        """Slope in rad at which doublings accumulate, extrapolated from the last two."""
        if len(self.slopes) < 2:
            return float("nan")
        return self.slopes[-1] + (self.slopes[-1] - self.slopes[-2]) / (FEIGENBAUM - 1.0)

    def facts(self) -> dict[str, str]:
        """Slopes of the doublings, and their limit."""
        doublings = zip(self.periods, self.slopes, strict=True)
        return {
            "walker": name_of(self.walker),
            "period doubles": ", ".join(f"{n} at {slope:.8g}" for n, slope in doublings) + " rad",
            "limit": f"{self.limit:.8g} rad",
        }

    def columns(self) -> dict[str, NDArray]:
        """A row for each doubling."""
        return {
            "period": np.array(self.periods),
            "slope": np.array(self.slopes),
            "stance_angle": np.array([gait.stance_angle for gait in self.gaits]),
        }


def doubling_cascade(
    walker: MapLike,
    slope_min: float,
    slope_max: float,
    *,
    kind: GaitKind = "long",
    doublings: int = 5,
) -> Cascade:
    """Locate a gait's successive period doublings.

    Args:
        walker: The walker, in a form that `as_walker` takes, or a map of `stride_map`.
        slope_min: Slope in rad at which the branch of the period-one gait begins.
        slope_max: Steepest slope searched, in rad.
        kind: Period-one gait to follow, "long" or "short".
        doublings: Number of doublings; the last gait has period 2 ** (doublings - 1).

    Returns:
        The cascade, with fewer doublings if a branch ends before the next one.

    Raises:
        GaitNotFound: if there is no gait in the range, or its period does not double there.
    """
    stride_map = map_of(walker, tolerance=1e-12)
    doublings = whole(doublings, "doublings")
    family = gait_family(stride_map, slope_min, slope_max, kind)
    if not family.period_doublings:
        raise GaitNotFound(
            f"the {kind}-step gait of {describe(stride_map.walker)} does not double its period "
            f"from {slope_min} to {slope_max} rad"
        )
    slope = family.period_doublings[0]
    nearest = int(np.argmin(np.abs(family.slope - slope)))
    curve = Curve(stride_map, Axis("slope", slope_min, slope_max))
    u = stride_map.points(family.state[nearest]).search[0]
    here = curve.correct(np.append(u, curve.axis.coordinate(slope)))
    gaits: list[Gait] = []
    with progress("period doublings", doublings) as located:
        while here is not None:
            point = stride_map.searched(here.y[None, :-1])
            gaits.append(gait_at(point, curve.value_at(here), curve.period))
            located()
            if len(gaits) == doublings:
                break
            curve = replace(curve, period=2 * curve.period)
            here = _next_doubling(curve, here, curve.axis.coordinate(slope_max))
    periods, slopes = (tuple(getattr(gait, name) for gait in gaits) for name in ("period", "slope"))
    return Cascade(stride_map.walker, periods, slopes, tuple(gaits))


def _next_doubling(curve: Curve, birth: Point, high: float) -> Point | None:
    """Return the next doubling on the curve that branches off at a doubling; None if lost."""
    values, vectors = np.linalg.eig(birth.map)
    direction = np.append(np.real(vectors[:, np.argmin(np.abs(values + 1.0))]), 0.0)
    direction /= np.linalg.norm(direction)
    shrink = _SHRINK ** -np.log2(curve.period / 2)
    step, longest = _FIRST_STEP * shrink, _LONGEST_STEP * shrink
    here = curve.correct(birth.y + step * direction, direction)
    if here is None:
        return None
    if here.tangent @ (here.y - birth.y) < 0.0:
        here = here._replace(tangent=-here.tangent)
    along = points_along(curve, here, first=step, longest=longest, shortest=_SHORTEST_STEP)
    with progress(f"gaits of period {curve.period}") as followed:
        for there in islice(along, _MOST_STEPS):
            if doubling_test(here) * doubling_test(there) < 0.0:
                found = locate(curve, here, there, doubling_test)
                return None if found is None or found.y[-1] > high else found
            if there.y[-1] > high:
                return None
            here = there
            followed()
    return None
