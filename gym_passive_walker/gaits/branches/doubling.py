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
    Curve,
    Point,
    doubling_test,
    locate,
    points_along,
)
from gym_passive_walker.gaits.branches.family import parameter_family, states_between
from gym_passive_walker.gaits.branches.varied_map import MapOfValue
from gym_passive_walker.gaits.gait import Gait, GaitKind, GaitNotFound, gait_at
from gym_passive_walker.gaits.stride_map import MapLike
from gym_passive_walker.models.walkers import Walker, describe, name_of

FEIGENBAUM = 4.669201609102990
"""Limit of the ratios of successive distances between doublings (Feigenbaum, 1978)."""

_FIRST_STEP, _LONGEST_STEP, _SHORTEST_STEP = 2e-3, 0.03, 1e-9  # in logarithmic coordinates
_SHRINK = 2.5  # each branch is so much smaller than the one before
_MOST_STEPS = 400
_TOLERANCE = 1e-12


@dataclass(frozen=True, repr=False)
class Cascade(Table):
    """Successive period doublings.

    Attributes:
        walker: The walker (at its own value, if a parameter of the walker is varied).
        parameter: The quantity that is varied, as in `GaitFamily`.
        periods: Period of the gait that doubles, in strides: 1, 2, 4, ...
        values: Values of the varied quantity at the doublings, in the walker's own units.
        gaits: Gaits at the doublings, with a multiplier at -1.
    """

    walker: Walker
    parameter: str
    periods: tuple[int, ...]
    values: tuple[float, ...]
    gaits: tuple[Gait, ...]

    @property
    def slopes(self) -> tuple[float, ...]:
        """Slopes in rad of the doublings."""
        return tuple(gait.slope for gait in self.gaits)

    @property
    def ratios(self) -> tuple[float, ...]:
        """Distances between successive doublings, each over the next; they tend to FEIGENBAUM."""
        gaps = np.diff(self.values)
        return tuple(float(x) for x in gaps[:-1] / gaps[1:])

    @property
    def limit(self) -> float:
        """Value at which doublings accumulate, extrapolated from the last two."""
        if len(self.values) < 2:
            return float("nan")
        return self.values[-1] + (self.values[-1] - self.values[-2]) / (FEIGENBAUM - 1.0)

    def facts(self) -> dict[str, str]:
        """Values at the doublings, and their limit."""
        doublings = zip(self.periods, self.values, strict=True)
        unit = " rad" * (self.parameter == "slope")
        varied = {} if unit else {"parameter": self.parameter}
        return {
            "walker": name_of(self.walker),
            **varied,
            "period doubles": ", ".join(f"{n} at {value:.8g}" for n, value in doublings) + unit,
            "limit": f"{self.limit:.8g}{unit}",
        }

    def columns(self) -> dict[str, NDArray]:
        """A row for each doubling."""
        return {
            "period": np.array(self.periods),
            self.parameter: np.array(self.values),
            "slope": np.array(self.slopes),
            "stance_angle": np.array([gait.stance_angle for gait in self.gaits]),
        }


def doubling_cascade(
    walker: MapLike | MapOfValue,
    low: float,
    high: float,
    *,
    parameter: str = "slope",
    slope: float | None = None,
    kind: GaitKind = "long",
    doublings: int = 5,
) -> Cascade:
    """Locate a gait's successive period doublings as its slope or another parameter grows.

    Args:
        walker: The walker, in a form that `as_walker` takes, or a map of `stride_map`; or a
            function from a value to a map, as for `parameter_family`.
        low: Slope in rad, or value, at which the branch of the period-one gait begins.
        high: Greatest slope in rad, or value, searched.
        parameter: What varies: "slope", or another parameter that `parameter_family` takes.
        slope: Slope in rad where another parameter varies; the map's own when None.
        kind: Period-one gait to follow, "long" or "short".
        doublings: Number of doublings; the last gait has period 2 ** (doublings - 1).

    Returns:
        The cascade, with fewer doublings if a branch ends before the next one.

    Raises:
        GaitNotFound: if there is no gait in the range, or its period does not double there.
        ValueError: if there is no such parameter, or a walker cannot have one of the values.
    """
    doublings = whole(doublings, "doublings")
    family = parameter_family(walker, parameter, low, high, slope=slope, kind=kind)
    steep = parameter == "slope"
    if not family.period_doublings:
        raise GaitNotFound(
            f"the {kind}-step gait of {describe(family.walker)} does not double its period "
            f"from {low} to {high}" + (" rad" if steep else f" of {parameter}")
        )
    value = family.period_doublings[0]
    # Beyond a fold the family passes the value again, by gaits that do not double there.
    passed, states = states_between(family, value)
    nearest = np.argmin(np.abs(family.multipliers[passed] + 1.0).min(axis=1))
    own, axis = family.stride_map.with_tolerance(_TOLERANCE), family.axis
    curve = Curve(own, axis)
    u = axis.setting(own, value)[0].points(states[nearest][None]).search[0]
    here = curve.correct(np.append(u, axis.coordinate(value)))
    gaits: list[Gait] = []
    values: list[float] = []
    with progress("period doublings", doublings) as located:
        while here is not None:
            values.append(curve.value_at(here))
            _, at, place = curve.one(here)
            gaits.append(gait_at(place, at, curve.period))
            located()
            if len(gaits) == doublings:
                break
            curve = replace(curve, period=2 * curve.period)
            here = _next_doubling(curve, here, axis.coordinate(axis.high))
    periods = tuple(gait.period for gait in gaits)
    return Cascade(family.walker, parameter, periods, tuple(values), tuple(gaits))


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
