"""Loci of bifurcations in two parameters: folds, period doublings or Neimark-Sacker points.

A gait at a bifurcation solves the gait equations and one more, that a matrix is singular. The
stride map's derivative less the identity is at a fold, plus the identity at a doubling. At a
Neimark-Sacker point its second compound matrix less the identity is, as the product of two
multipliers is 1. The least singular value is the equation's residual; singular vectors on both
sides take the place of the borders of a bordered system. All first derivatives are exact. Second
derivatives, along these vectors alone, are differences of them: they guide Newton's method and do
not affect where a locus lies.

References:
    Yu. A. Kuznetsov, "Elements of Applied Bifurcation Theory" (2004), chapters 9 and 10.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from itertools import combinations
from typing import Any, ClassVar, Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

from gym_passive_walker._tools.arguments import instance, number
from gym_passive_walker._tools.progress import progress
from gym_passive_walker._tools.shown import Table
from gym_passive_walker.gaits.branches.continuation import (
    BOUND,
    VANISHED,
    Axis,
    Curve,
    Point,
    locate,
    past_bound,
    points_along,
    reason_of,
    vanishes,
)
from gym_passive_walker.gaits.branches.family import (
    FINEST,
    TOLERANCE,
    GaitFamily,
    axis_of,
    states_between,
)
from gym_passive_walker.gaits.gait import (
    GaitNotFound,
    multiplier_columns,
    multipliers_of,
    state_columns,
)
from gym_passive_walker.models.walkers import Walker, name_of

Bifurcation = Literal["fold", "period doubling", "Neimark-Sacker"]

CLOSED = "the locus is closed"
PAIR_MEETS = "the complex pair of multipliers becomes real"

_ROUGH = 1e-6  # violation of points until all are known
_SHIFT = 1e-4  # of logarithmic coordinates, for differences of derivatives
_FIRST_STEP, _CUSP, _SAME = 0.02, 1e-5, 1e-9


class SpecialPoint(NamedTuple):
    """A point of a locus at which a second condition holds.

    Attributes:
        kind: "cusp", where two folds meet; "fold-flip", with multipliers 1 and -1; or a strong
            resonance. "1:1" and "1:2" have two multipliers at 1 or at -1, "1:3" and "1:4" a pair
            at a third or a quarter of a turn.
        values: The two parameters.
    """

    kind: str
    values: tuple[float, float]


class LocusEnd(NamedTuple):
    """End of a locus.

    Attributes:
        values: The two parameters.
        reason: Why it ends there.
    """

    values: tuple[float, float]
    reason: str


@dataclass(frozen=True, repr=False)
class BifurcationLocus(Table):
    """A curve of bifurcations in two parameters, in order along it; arrays have an entry a point.

    Attributes:
        walker: The walker of the family.
        bifurcation: "fold", "period doubling" or "Neimark-Sacker".
        period: Strides of each gait.
        parameters: Names of the two parameters: that of the family, and the other.
        values: Their values, in the walker's own units, (n, 2).
        slope: Slope in rad, (n,).
        state: States on the Poincaré section, (n, 6), angles in rad, then angular velocities.
        multipliers: Floquet multipliers (n, m), largest modulus first.
        special: Points at which a second condition holds.
        ends: First and last end, with the reason of each.
    """

    walker: Walker
    bifurcation: Bifurcation
    period: int
    parameters: tuple[str, str]
    values: NDArray[np.float64]
    slope: NDArray[np.float64]
    state: NDArray[np.float64]
    multipliers: NDArray[np.complex128]
    special: tuple[SpecialPoint, ...]
    ends: tuple[LocusEnd, LocusEnd]

    @property
    def bounds_stable_gaits(self) -> NDArray[np.bool_]:
        """Whether all other multipliers are within the unit circle, (n,).

        Gaits are then stable on one side of the locus.
        """
        rest = [_rest(each, self.bifurcation) for each in self.multipliers]
        return np.array([bool(np.all(np.abs(each) < 1.0)) for each in rest])

    def __len__(self) -> int:
        return len(self.values)

    def facts(self) -> dict[str, str]:
        """Ranges of the parameters, special points and ends."""

        def at(values: tuple[float, float]) -> str:
            pairs = zip(self.parameters, values, strict=True)
            return ", ".join(f"{name} {value:.6g}" for name, value in pairs)

        return {
            "walker": name_of(self.walker),
            "gaits": f"{len(self)} of period {self.period}, each at a {self.bifurcation}"
            + " point" * (self.bifurcation == "Neimark-Sacker"),
            **{
                name: f"{column.min():.6g} to {column.max():.6g}" + " rad" * (name == "slope")
                for name, column in zip(self.parameters, self.values.T, strict=True)
            },
            **{f"{kind} at": at(values) for kind, values in self.special},
            "ends": " and ".join(f"at {at(end.values)} ({end.reason})" for end in self.ends),
        }

    def columns(self) -> dict[str, NDArray]:
        """A row for each point, in order along the curve."""
        return {
            **dict(zip(self.parameters, self.values.T, strict=True)),
            **({} if "slope" in self.parameters else {"slope": self.slope}),
            **state_columns(self.walker, self.state),
            **multiplier_columns(self.multipliers),
            "bounds_stable_gaits": self.bounds_stable_gaits,
        }


class _Singular(NamedTuple):
    """The least singular value of a bifurcation's matrix, with its sign, and its derivative.

    Attributes:
        value: The singular value; negative if the left vector has turned over.
        weights: Its derivative by the entries of the matrix that varies, (m, m).
        left: Left singular vector, (k,).
        right: Right singular vector, (k,).
        directions: Orthonormal directions out of which `weights` is zero, (1 or 2, m).
    """

    value: float
    weights: NDArray[np.float64]
    left: NDArray[np.float64]
    right: NDArray[np.float64]
    directions: NDArray[np.float64]


def _singular(
    matrix: NDArray, bifurcation: Bifurcation, before: _Singular | None = None
) -> _Singular:
    """Return the least singular value of a bifurcation's matrix, and its derivative.

    Args:
        matrix: Derivative by the coordinates: of the gait equations for a fold, of the stride map
            for others, (m, m).
        bifurcation: The bifurcation.
        before: Value of a point near, of which vectors keep their signs.
    """
    m, pair = len(matrix), bifurcation == "Neimark-Sacker"
    if not np.isfinite(matrix).all():
        none = np.zeros(math.comb(m, 2) if pair else m)
        return _Singular(math.nan, np.full((m, m), math.nan), none, none, np.eye(m)[: 1 + pair])
    i, j = np.array([*combinations(range(m), 2)]).T
    if bifurcation == "fold":
        zero = matrix
    elif bifurcation == "period doubling":
        zero = matrix + np.eye(m)
    else:  # the second compound matrix: minors of two rows and two columns
        rows, columns = matrix[i], matrix[j]
        zero = rows[:, i] * columns[:, j] - rows[:, j] * columns[:, i] - np.eye(len(i))
    lefts, sizes, rights = np.linalg.svd(zero)
    size, left, right = sizes[-1], lefts[:, -1], rights[-1]
    if before is not None and right @ before.right < 0.0:
        left, right = -left, -right
    if before is not None and left @ before.left < 0.0:
        left, size = -left, -size
    if not pair:
        return _Singular(size, np.outer(left, right), left, right, right[None])
    p, q = np.zeros((m, m)), np.zeros((m, m))
    p[i, j], p[j, i], q[i, j], q[j, i] = left, -left, right, -right
    weights = p @ matrix @ q.T
    return _Singular(size, weights, left, right, np.linalg.svd(weights)[2][:2])


@dataclass(frozen=True, kw_only=True)
class _LocusCurve(Curve):
    """The gaits of a period at one kind of bifurcation: points are (u, first, second).

    Attributes:
        second: The second parameter.
        bifurcation: The bifurcation.
        careful: Whether vectors are computed at each point before differences are taken along them.
        last: If not, the singular value at the last point, of which the vectors serve the next one.
    """

    second: Axis
    bifurcation: Bifurcation
    last_step: ClassVar[float] = 1e-5  # loci that nearly cross turn within a hundred of these
    careful: bool = False
    last: list[_Singular] = field(default_factory=list)

    @property
    def axes(self) -> tuple[Axis, Axis]:
        """Both parameters."""
        return self.axis, self.second

    def _matrices(self, ys: NDArray) -> tuple[NDArray, NDArray, NDArray, NDArray]:
        """Return what a bifurcation's equations consist of, at coordinates (n, m + 2).

        Returns:
            Residuals of the gait equations (n, m), and their derivatives by all coordinates
            (n, m, m + 2); derivatives of the stride map, (n, m, m + 2); and those of the two in
            which the bifurcation's matrix is.
        """
        stride_map, gaits, rates = self._gaits(ys)
        ends = stride_map.at(gaits.passage.ends).in_search(gaits.change.ends)
        ends[:, :, -2:] *= rates
        own = gaits.derivatives if self.bifurcation == "fold" else ends
        return gaits.values, gaits.derivatives, ends, own

    def correct(self, *arguments: Any, **options: Any) -> Point | None:
        """Return the point nearest to a guess, as `Curve.correct` does."""
        found = super().correct(*arguments, **options)
        if found is None and not self.careful:
            return replace(self, careful=True).correct(*arguments, **options)
        return found

    def _residuals(self, ys: NDArray) -> tuple[NDArray, NDArray, NDArray]:
        """Return residuals (n, m + 1) of gaits at the bifurcation, and derivatives."""
        n, m = len(ys), ys.shape[1] - 2
        before = self.last
        if self.careful or n > 1 or not before:
            before = [_singular(x, self.bifurcation) for x in self._matrices(ys)[3][:, :, :m]]
        directions = np.array([each.directions for each in before])
        shifts = np.zeros((n, 1 + 2 * directions.shape[1], m + 2))
        shifts[:, 1::2, :m], shifts[:, 2::2, :m] = _SHIFT * directions, -_SHIFT * directions
        beside = ys[:, None] + shifts
        values, derivatives, ends, own = (
            x.reshape(*beside.shape[:2], *x.shape[1:])
            for x in self._matrices(beside.reshape(-1, m + 2))
        )
        here = [
            _singular(x, self.bifurcation, last)
            for x, last in zip(own[:, 0, :, :m], before, strict=True)
        ]
        if np.isfinite(here[0].value):
            self.last[:] = here[:1]
        bent = (own[:, 1::2] - own[:, 2::2]) / (2.0 * _SHIFT)
        weights, sizes = (np.array([x[i] for x in here]) for i in (1, 0))
        gradient = np.einsum("nij,nkj,nkil->nl", weights, directions, bent)
        return (
            np.append(values[:, 0], sizes[:, None], axis=1),
            np.append(derivatives[:, 0], gradient[:, None], axis=1),
            ends[:, 0, :, :m],
        )


def _rest(multipliers: NDArray, bifurcation: str) -> NDArray[np.complex128]:
    """Return the multipliers that are not those of the bifurcation."""
    if bifurcation == "Neimark-Sacker":
        pairs = np.array([*combinations(range(len(multipliers)), 2)])
        own = pairs[np.argmin(np.abs(multipliers[pairs].prod(axis=1) - 1.0))]
    else:
        own = np.argmin(np.abs(multipliers - (1.0 if bifurcation == "fold" else -1.0)))
    return np.delete(multipliers, own)


def _tests(bifurcation: Bifurcation, here: Point) -> dict[str, Callable[[Point], float]]:
    """Return functions of points near one that change sign at special points, by their kinds."""

    def beside(at: float) -> Callable[[Point], float]:
        return lambda x: float(np.prod(_rest(multipliers_of(x.map), bifurcation) - at).real)

    def turn(cosine: float) -> Callable[[Point], float]:
        """Return the difference of half a pair's sum, the cosine of its angle, from a value."""

        def test(point: Point) -> float:
            multipliers = multipliers_of(point.map)
            rest = _rest(multipliers, bifurcation)
            return float(0.5 * (multipliers.sum() - rest.sum()).real - cosine)

        return test

    if bifurcation == "period doubling":
        return {"1:2": beside(-1.0), "fold-flip": beside(1.0)}
    if bifurcation == "fold":
        # Both parameters turn back at a cusp.
        return {
            "cusp": lambda x: float(x.tangent[-2:] @ here.tangent[-2:]),
            "1:1": beside(1.0),
            "fold-flip": beside(-1.0),
        }
    return {"1:1": turn(1.0), "1:2": turn(-1.0), "1:3": turn(-0.5), "1:4": turn(0.0)}


class _Part(NamedTuple):
    """One direction of a locus."""

    points: list[Point]
    special: list[SpecialPoint]
    end: LocusEnd


def _follow(curve: _LocusCurve, start: Point, resolution: float) -> _Part:
    """Follow a locus from a point along its tangent to an end, or until it closes."""
    points, special = [start], []

    def crossings(there: Point) -> Point | None:
        """Note special points on the way to a point; return that at which a pair ends."""
        for kind, test in _tests(curve.bifurcation, points[-1]).items():
            if test(points[-1]) * test(there) < 0.0:
                located = locate(curve, points[-1], there, test)
                # At a cusp both parameters stand still; elsewhere they only turn sharply.
                if located and (kind != "cusp" or np.abs(located.tangent[-2:]).max() < _CUSP):
                    special.append(SpecialPoint(kind, curve.values_at(located)))
                    if curve.bifurcation == "Neimark-Sacker" and kind in ("1:1", "1:2"):
                        return located
        return None

    steps = points_along(curve, start, first=_FIRST_STEP, longest=resolution, accuracy=_ROUGH)
    with progress("points of a locus") as followed:
        for there in steps:
            followed()
            here = points[-1]
            if vanishes(curve, there):
                return _Part(points, special, LocusEnd(curve.values_at(here), VANISHED))
            if past := past_bound(curve, here, there):
                _, last = past
                if last is not None and np.abs(last.y - here.y).max() > _SAME:  # or it began there
                    points.append(crossings(last) or last)
                return _Part(points, special, LocusEnd(curve.values_at(points[-1]), BOUND))
            points.append(met := crossings(there) or there)
            if met is not there:
                return _Part(points, special, LocusEnd(curve.values_at(met), PAIR_MEETS))
            back = start.y - there.y
            if len(points) > 3 and np.linalg.norm(back) < np.linalg.norm(there.y - here.y):
                if back @ there.tangent < 0.0 < start.tangent @ there.tangent:
                    return _Part(points, special, LocusEnd(curve.values_at(start), CLOSED))
    reason = reason_of(curve, points[-1:]).reason
    return _Part(points, special, LocusEnd(curve.values_at(points[-1]), reason))


def bifurcation_locus(
    family: GaitFamily,
    at: float,
    parameter: str,
    low: float,
    high: float,
    *,
    resolution: float = 0.05,
) -> BifurcationLocus:
    """Follow a bifurcation of a family of gaits as a second parameter changes.

    On one side of the locus of a fold, a period doubling or a Neimark-Sacker point, gaits are
    stable, if their other multipliers are within the unit circle.

    Example:
        >>> import gym_passive_walker as gpw
        >>> family = gpw.gait_family("lab", 0.018, 0.06)
        >>> locus = gpw.bifurcation_locus(family, family.folds[1], "shank_length", 0.33, 0.47)
        >>> [point.kind for point in locus.special]
        ['cusp']

    Args:
        family: The family, of `gait_family` or `parameter_family`. The locus stays within its
            range.
        at: Value of the family's parameter at the bifurcation: one of its `folds`,
            `period_doublings` or `neimark_sackers`.
        parameter: The second parameter, in which the family's walker has its own value: "slope",
            or another that `parameter_family` takes.
        low: Lowest value of the second parameter.
        high: Highest value.
        resolution: Longest step along the curve, as for `gait_family`; the range of a parameter,
            other than a slope downhill, counts as one.

    Raises:
        GaitNotFound: if the gait at the bifurcation is not found again.
        ValueError: if the family has no bifurcation there, there is no such parameter, or the range
            is empty or leaves out the walker's own value.
    """
    instance(family, GaitFamily, "family", "gpw.gait_family and gpw.parameter_family return")
    resolution = number(resolution, "resolution", least=FINEST, most=1.0)
    at, bifurcation = _bifurcation_at(family, number(at, "at"))
    stride_map, own = family.stride_map.with_tolerance(TOLERANCE), float(family.slope[0])
    if family.axis.make is not None or not stride_map.exact:
        raise ValueError(
            "a locus needs exact derivatives, and those of this family are differences: vary a "
            "parameter of a walker, which has no controller or one with exact derivatives"
        )
    if parameter == family.parameter:
        raise ValueError(f"parameter must be another than {parameter!r}, which the family varies")
    _, second = axis_of(stride_map, parameter, low, high, own)
    own = own if parameter == "slope" else stride_map.parameters[parameter]
    if not second.low < second.high or not second.low <= own <= second.high:
        raise ValueError(f"{parameter} of this family is {own:g}: give low <= {own:g} <= high")
    curve = _LocusCurve(
        stride_map, family.axis, family.period, second=second, bifurcation=bifurcation
    )
    start = _start(curve, family, at, own)
    if start is None:
        raise GaitNotFound(
            f"the gait at the {bifurcation} at {family.parameter} {at:g} was not found again: "
            "follow the family with a smaller resolution"
        )
    up = _follow(curve, start, resolution)
    down = _Part([start], [], up.end)
    if up.end.reason != CLOSED:
        down = _follow(curve, start._replace(tangent=-start.tangent), resolution)
    points = curve.polished(down.points[:0:-1] + up.points)
    there, places, slopes, _ = curve.gaits_at(points)
    bounds = [(axis.low, axis.high) for axis in (family.axis, second)]  # passed by rounding alone
    return BifurcationLocus(
        walker=family.walker,
        bifurcation=bifurcation,
        period=family.period,
        parameters=(family.parameter, parameter),
        values=np.clip([curve.values_at(point) for point in points], *np.transpose(bounds)),
        slope=slopes,
        state=there.states_at(places),
        multipliers=np.array([multipliers_of(point.map) for point in points]),
        special=tuple(down.special[::-1] + up.special),
        ends=(down.end, up.end),
    )


def _bifurcation_at(family: GaitFamily, at: float) -> tuple[float, Bifurcation]:
    """Return the value of a family's bifurcation nearest to a value, and its kind.

    Raises:
        ValueError: if it is not that value, but for rounding.
    """
    lists = family.folds, family.period_doublings, family.neimark_sackers
    kinds = zip(get_args(Bifurcation), lists, strict=True)
    known = [(value, kind) for kind, values in kinds for value in values]
    near = [each for each in known if np.isclose(each[0], at, rtol=1e-6, atol=0.0)]
    if near:
        return min(near, key=lambda each: abs(each[0] - at))
    listed = ", ".join(f"a {kind} at {value:.8g}" for value, kind in known) or "none"
    raise ValueError(
        f"at must be {family.parameter} at a bifurcation of the family, not {at:g}: it has {listed}"
    )


def _start(curve: _LocusCurve, family: GaitFamily, at: float, own: float) -> Point | None:
    """Return the point of a locus at a bifurcation of a family; None if it is not found."""
    nearest = int(np.argmin(np.abs(family.value - at)))
    _, passed = states_between(family, at)
    for state in (*passed, family.state[nearest]):
        y = np.array([0.0, curve.axis.coordinate(at), curve.second.coordinate(own)])
        stride_map, _ = curve._settings(y[None])
        found = curve.correct(np.concatenate([stride_map.points(state[None]).search[0], y[1:]]))
        if found is not None and np.isclose(curve.values_at(found)[0], at, rtol=1e-6, atol=0.0):
            return found
    return None
