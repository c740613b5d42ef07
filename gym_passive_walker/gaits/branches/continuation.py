"""Following a branch of gaits: pseudo-arclength continuation (H. B. Keller, 1977).

The gaits of a walker as its ground or one of its parameters changes are a curve in the section's
logarithmic coordinates and one coordinate of the varied quantity; derivatives are exact. Where the
parameter turns back lies a fold; where a multiplier passes -1 the period doubles; where a complex
pair crosses the unit circle a torus is born (Neimark and Sacker). All are located to rounding by
root finding along the curve.

A curve may be closed. Else it can only end where the stride map itself has an edge: where
kneestrike comes as late as heelstrike, or where the foot no longer comes down at heelstrike but
glides along the ground. What is lost goes to zero smoothly along the curve, so the end is found by
going there in steps and extrapolating the rest.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, ClassVar, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from gym_passive_walker._tools.progress import progress
from gym_passive_walker.gaits.actuation import Actuation
from gym_passive_walker.gaits.branches.varied_map import MapOfValue, VariedMap, map_at
from gym_passive_walker.gaits.find.newton import newton, solved
from gym_passive_walker.gaits.flow import RATE_BEFORE
from gym_passive_walker.gaits.gait import Violation, gait_equations
from gym_passive_walker.gaits.section import Points
from gym_passive_walker.gaits.stride_map import Samples, StrideMap

KNEE_MEETS_HEEL = "kneestrike and heelstrike coincide"
STANCE_STOPS = "the stance leg barely passes the vertical"
TANGENTIAL = "heelstrike becomes tangential"
BOUND = "end of the range asked for"
VANISHED = "the step length goes to zero"
CLOSED_CURVE = "the curve is closed"
STEP_ENDS = "a strike comes as a control step ends"
LOST = "the family could not be followed further"

_LOOKS, _ROUGHLY = 96, 1e-9  # at the stance leg during a stride, and their tolerance
_NEAR = 0.3  # a margin below this is about to be lost
_TINY = 1e-3  # stance angle of steps that are about to vanish
_AT_ONCE = 1e-3  # of a control step: a strike so near to its end comes with it
_ENDLESS = 12.0  # time in sqrt(l/g) of a stride that hardly gets over the vertical

_CORRECTIONS = 7  # of a guess, before it is given up
_UNPOLISHED = 1e-5  # violation of gaits until all of a curve are known
_CLOSED = 1e-10  # violation of a gait that is to be known to rounding
_FIRST_STEP, _SHORTEST_STEP = 0.02, 1e-7
_VANISHING = 10.0  # rate over angle of a walker that rocks rather than steps
_ASTRAY = 0.3  # of a step: from where a gait is expected to where it may be
_SAME = 1e-8  # gaits closer than this are one
_MOST_POINTS = 4000
_LAST = 40  # points that indicate an end
_CROWDED = 1e-3
_GLIDING = 0.01


class Axis(NamedTuple):
    """The varied quantity of a curve: downhill slopes by their logarithm, others by their share.

    Attributes:
        parameter: "slope", a part of `Actuation`, or a parameter of the walker.
        low: Start of the range.
        high: End of the range.
        slope: Slope in rad, where something else is varied; each map's own when None.
        unit: Unit in which the stride map takes the parameter.
        make: Function from a value to its stride map; None if the maps vary by themselves.
    """

    parameter: str = "slope"
    low: float = 1.0
    high: float = 2.0
    slope: float | None = None
    unit: float = 1.0
    make: MapOfValue | None = None

    @property
    def downhill(self) -> bool:
        """Whether slopes downhill are varied, which may be very small ones."""
        return self.parameter == "slope" and self.low > 0.0

    def coordinate(self, value: float) -> float:
        """Return the coordinate of a value."""
        if self.downhill:
            return float(np.log(value))
        return (value - self.low) / (self.high - self.low)

    def value(self, coordinate: Any) -> Any:
        """Return the values at coordinates."""
        if self.downhill:
            return np.exp(coordinate)
        return coordinate * (self.high - self.low) + self.low

    def rate(self, coordinate: float) -> float:
        """Return the derivative of the value by its coordinate."""
        return float(np.exp(coordinate)) if self.downhill else self.high - self.low

    def settings(self, stride_map: StrideMap, values: NDArray) -> tuple[StrideMap, NDArray]:
        """Return the stride map and the slopes in rad of n values, (n,)."""
        if self.parameter == "slope":
            return stride_map, values
        if self.make is None:
            varied = stride_map.with_parameter(self.parameter, values / self.unit)
            return varied, np.full(len(values), self.slope)
        made = VariedMap(
            walker=stride_map.walker, terrain=stride_map.terrain, parameter=self.parameter,
            values=values, tolerance=stride_map.tolerance, make=self.make,
            bounds=(self.low, self.high),
        )  # fmt: skip
        return made, np.array([each.chosen(self.slope) for each in made.maps])

    def setting(self, stride_map: StrideMap, value: float) -> tuple[StrideMap, float]:
        """Return the stride map and the slope in rad of one value."""
        if self.parameter == "slope":
            return stride_map, value
        if self.make is not None:
            there = map_at(self.make, self.parameter, value, stride_map.tolerance)
        elif self.parameter in Actuation._fields:
            varied = {self.parameter: value / self.unit}
            there = replace(stride_map, actuation=stride_map.actuation._replace(**varied))
        else:
            walker = stride_map.walker.with_parameters(**{self.parameter: value})
            there = stride_map.with_walker(walker)
        return there, there.chosen(self.slope)


class Point(NamedTuple):
    """A gait on the curve.

    Attributes:
        y: Coordinates: u of the section, and the varied quantity's.
        tangent: Tangent of the curve, of length 1.
        map: The stride map's derivative by u over the period.
    """

    y: NDArray[np.float64]
    tangent: NDArray[np.float64]
    map: NDArray[np.float64]


@dataclass(frozen=True)
class Curve:
    """The gaits of a period as a curve.

    Attributes:
        stride_map: The stride map of the gaits.
        axis: The varied quantity.
        period: Strides of each gait.
    """

    stride_map: StrideMap
    axis: Axis
    period: int = 1

    last_step: ClassVar[float] = math.inf
    """Longest step that may be the last one of a rough correction."""

    @property
    def axes(self) -> tuple[Axis, ...]:
        """All k varied quantities; the last k coordinates of a point are theirs."""
        return (self.axis,)

    def values_at(self, point: Point) -> Any:
        """Return the varied quantities at a point, (k,)."""
        each = zip(self.axes, point.y[-len(self.axes) :], strict=True)
        return tuple(float(axis.value(y)) for axis, y in each)

    def value_at(self, point: Point) -> float:
        """Return the first varied quantity at a point."""
        return self.values_at(point)[0]

    def gaits_at(self, points: list[Point]) -> tuple[StrideMap, NDArray, NDArray, NDArray]:
        """Return points of the curve as points of the section, with walkers and slopes.

        Returns:
            Their stride map; points of the section (n, m), slopes in rad (n,), and the first varied
            quantity (n,).
        """
        ys = np.array([point.y for point in points])
        stride_map, slopes = self._settings(ys)
        u, values = ys[:, : -len(self.axes)], self.axis.value(ys[:, -len(self.axes)])
        return stride_map, stride_map.searched(u).values, slopes, values

    def one(self, point: Point) -> tuple[StrideMap, float, Points]:
        """Return the stride map of a gait's own walker, its slope in rad, and its point."""
        own, slope = self._set(Axis.setting, self.values_at(point))
        return own, slope, own.searched(point.y[None, : -len(self.axes)])

    def _settings(self, ys: NDArray) -> tuple[StrideMap, NDArray]:
        """Return the stride map and the slopes in rad at coordinates (n, m + k)."""
        each = zip(self.axes, ys[:, -len(self.axes) :].T, strict=True)
        return self._set(Axis.settings, [axis.value(column) for axis, column in each])

    def _set(self, setting: Callable[..., Any], values: Sequence[Any]) -> tuple[StrideMap, Any]:
        """Return stride map and slope, with each axis set to its value."""
        own, slope = self.stride_map, None
        for axis, value in zip(self.axes, values, strict=True):
            own, given = setting(axis, own, value)
            slope = given if slope is None or axis.parameter == "slope" else slope
        return own, slope

    def correct(
        self,
        guess: NDArray,
        tangent: NDArray | None = None,
        accuracy: float = 1e-10,
        bend: NDArray | float = 0.0,
    ) -> Point | None:
        """Return the gait nearest to a guess across a tangent; None if there is none near.

        Args:
            guess: Coordinates, (m + 1,).
            tangent: Direction in which the gait is not moved; the varied quantity's if None.
            accuracy: Largest violation.
            bend: Expected distance of the gait from the guess, (m + 1,).
        """
        across = np.eye(len(guess))[-1] if tangent is None else tangent
        closes = self.stride_map.closes
        found = newton(
            lambda ys: self._equations(ys, guess[None], across[None]),
            (guess + bend)[None], iterations=_CORRECTIONS,
            accuracy=accuracy if self.stride_map.exact else closes,
            longest=1.0, damped=False,
        )  # fmt: skip
        if found.sizes[0] > max(closes, accuracy) or not np.isfinite(found.derivatives[0]).all():
            return None
        # One step more squares what is left of the error, and costs no stride.
        left = np.linalg.solve(found.derivatives[0], found.values[0])
        if accuracy > _CLOSED and np.abs(left).max() > self.last_step:
            return self.correct(guess, tangent, bend=bend)
        y = found.points[0] - left
        new = np.linalg.svd(found.derivatives[0, :-1])[2][-1]
        return Point(y, new if new @ across >= 0.0 else -new, found.carried[0])

    def _equations(
        self, ys: NDArray, guesses: NDArray, across: NDArray
    ) -> tuple[NDArray, NDArray, NDArray]:
        """Return residuals (n, m + k) of gaits across directions from guesses, and derivatives."""
        values, derivatives, maps = self._residuals(ys)
        moved = ((ys - guesses) * across).sum(axis=1)
        ways = np.broadcast_to(across[:, None], (len(ys), 1, ys.shape[1]))
        values = np.append(values, moved[:, None], axis=1)
        return values, np.append(derivatives, ways, axis=1), maps

    def _residuals(self, ys: NDArray) -> tuple[NDArray, NDArray, NDArray]:
        """Return what vanishes on the curve (n, m + k - 1), derivatives, and the stride map's."""
        _, gaits, _ = self._gaits(ys)
        return gaits.values, gaits.derivatives, gaits.map

    def _gaits(self, ys: NDArray) -> tuple[StrideMap, Violation, NDArray]:
        """Return stride map, gait equations, and rates of the map's parameters, (n, 1, k)."""
        axes, k = self.axes, len(self.axes)
        stride_map, slopes = self._settings(ys)
        by = tuple(axis.parameter for axis in axes)
        gaits = gait_equations(stride_map, ys[:, :-k], slopes, period=self.period, by=by)
        each = zip(axes, ys[:, -k:].T, strict=True)
        rates = np.array([[axis.rate(y) / axis.unit for y in column] for axis, column in each])
        gaits.derivatives[:, :, -k:] *= rates.T[:, None]
        return stride_map, gaits, rates.T[:, None]

    def polished(self, points: list[Point]) -> list[Point]:
        """Improve rough gaits to rounding, by two steps of Newton's method for all of them.

        Args:
            points: Gaits of small violation; each is moved across its tangent.
        """
        ys, across = (np.array([getattr(x, name) for x in points]) for name in ("y", "tangent"))
        guess = ys.copy()

        def step() -> tuple[NDArray, NDArray]:
            """Take a step; return which gaits were closed before it, and their maps."""
            with np.errstate(all="ignore"):
                values, derivatives, maps = self._equations(ys, guess, across)
                sizes = np.abs(values).max(axis=1)
            here = np.isfinite(sizes) & np.isfinite(derivatives).all(axis=(1, 2))
            ys[here] -= solved(derivatives[here], values[here])
            return here & (sizes < _CLOSED), maps

        step()
        closed, maps = step()
        return [
            Point(y, point.tangent, own) if good
            else self.correct(point.y, point.tangent) or point
            for y, point, own, good in zip(ys, points, maps, closed, strict=True)
        ]  # fmt: skip


def past_bound(curve: Curve, here: Point, there: Point) -> tuple[float, Point | None] | None:
    """Return the bound between two points, as a coordinate, and the curve's point there, if any."""
    for i, axis in zip(range(-len(curve.axes), 0), curve.axes, strict=True):
        low, high = (axis.coordinate(bound) for bound in (axis.low, axis.high))
        y = there.y[i]
        if not low <= y <= high:
            bound = low if y < low else high
            guess = here.y + (bound - here.y[i]) / (y - here.y[i]) * (there.y - here.y)
            guess[i] = bound
            return bound, curve.correct(guess, np.eye(len(guess))[i])
    return None


def doubling_test(point: Point) -> float:
    """Return a number that changes sign where a multiplier passes -1."""
    return float(np.linalg.det(np.eye(len(point.map)) + point.map))


def neimark_sacker_test(point: Point) -> float:
    """Return a number that changes sign where the product of two multipliers passes 1.

    A complex pair has this product on the unit circle. Two real multipliers may have it as well,
    which is no bifurcation.
    """
    multipliers = np.linalg.eigvals(point.map)
    i, j = np.triu_indices(len(multipliers), 1)
    return float(np.prod(multipliers[i] * multipliers[j] - 1.0).real)


def on_the_unit_circle(point: Point) -> bool:
    """Return whether a complex pair of multipliers has modulus 1, to the accuracy of `locate`."""
    multipliers = np.linalg.eigvals(point.map)
    return bool(np.any((np.abs(np.abs(multipliers) - 1.0) < 1e-6) & (multipliers.imag > 1e-6)))


def locate(curve: Curve, a: Point, b: Point, test: Callable[[Point], float]) -> Point | None:
    """Locate the zero of a test function between two points, by Brent's method on the chord."""
    chord = b.y - a.y
    length = float(np.linalg.norm(chord))
    chord = chord / length

    def at(s: float) -> Point:
        # Where multipliers are large, rounding hides the last digits of a gait.
        tried = (curve.correct(a.y + s * chord, chord, accuracy) for accuracy in (1e-13, 1e-10))
        point = next((found for found in tried if found), None)
        if point is None:
            raise ArithmeticError
        return point

    try:
        try:
            s: Any = scipy.optimize.brentq(
                lambda s: test(at(s)), 0.0, length, xtol=1e-13, rtol=np.float64(1e-14)
            )
        except ValueError:  # rounding has turned the sign of an end, which is the zero then
            s = min(0.0, length, key=lambda s: abs(test(at(s))))
        return at(s)
    except ArithmeticError:
        return None


def points_along(
    curve: Curve,
    start: Point,
    *,
    first: float,
    longest: float,
    shortest: float = _SHORTEST_STEP,
    accuracy: float = 1e-10,
) -> Iterator[Point]:
    """Yield points of the curve from a start along its tangent, until the curve is lost.

    Args:
        curve: The curve.
        start: First point, which is not yielded.
        first: Length of the first step.
        longest: Longest step.
        shortest: Step below which the curve counts as lost.
        accuracy: Violation of each gait, before a last step of Newton's method squares it.
    """

    def glides(point: Point) -> bool:
        """Return whether the foot lands so nearly along the ground that the end is near."""
        return bool(margins(curve, [point]).landing[0] < _GLIDING)

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
            if step < shortest or (step < 0.02 * longest and glides(here)):
                return
        else:
            yield there
            curvature = (there.tangent - here.tangent) / np.linalg.norm(there.y - here.y)
            here, step = there, min(1.5 * step, longest)


def vanishes(curve: Curve, point: Point) -> bool:
    """Return whether legs rock rather than step; a user's system has coordinates of its own."""
    return curve.stride_map.chart.balance is not None and abs(point.y[1]) > _VANISHING


class Branch(NamedTuple):
    """One direction of a curve: its points and what was located between them."""

    points: list[Point]
    folds: list[float]
    doublings: list[float]
    torus: list[float]
    end: End


def follow_branch(curve: Curve, start: Point, resolution: float) -> Branch:
    """Follow the curve from a point along its tangent to an end of the curve or of its axis."""
    points, folds, doublings, torus = [start], [], [], []
    at_bound: Point | None = None
    end: End | None = None

    def crossings(
        there: Point,
        test: Callable[[Point], float],
        holds: Callable[[Point], bool] = lambda point: True,
    ) -> list[float]:
        crossed = test(points[-1]) * test(there) < 0.0
        located = locate(curve, points[-1], there, test) if crossed else None
        return [curve.value_at(located)] if located and holds(located) else []

    def multipliers_cross(there: Point) -> None:
        doublings.extend(crossings(there, doubling_test))
        torus.extend(crossings(there, neimark_sacker_test, on_the_unit_circle))

    steps = points_along(curve, start, first=_FIRST_STEP, longest=resolution, accuracy=_UNPOLISHED)
    with progress("gaits along a curve") as followed:
        for there in steps:
            followed()
            here = points[-1]
            if vanishes(curve, there):
                end = End(curve.value_at(here), VANISHED)
                break
            if past := past_bound(curve, here, there):
                bound, at_bound = past
                end = End(float(curve.axis.value(bound)), BOUND)
                if at_bound is not None:
                    multipliers_cross(at_bound)
                break
            closes = len(points) > 1 and _between(curve, here, start, there)
            there = start if closes else there
            folds += crossings(there, lambda point: float(point.tangent[-1]))
            multipliers_cross(there)
            points.append(there)
            if closes:
                end = End(curve.value_at(start), CLOSED_CURVE)
                break
    if curve.stride_map.exact and len(points) > 1:
        points = [start, *curve.polished(points[1:])]
        if end is not None and end.reason == CLOSED_CURVE:
            points[-1] = start
    if at_bound is not None:
        points.append(at_bound)
    if end is None:
        end = reason_of(curve, points[-_LAST:])
    return Branch(_thinned(points), folds, doublings, torus, end)


def _between(curve: Curve, a: Point, point: Point, b: Point) -> bool:
    """Return whether a point lies on the piece of a curve from one point to the next."""
    chord, way = b.y - a.y, point.y - a.y
    length = float(np.linalg.norm(chord))
    chord = chord / length
    share = float(way @ chord) / length
    apart = float(np.linalg.norm(way - share * length * chord))
    if not 0.0 < share <= 1.0 or apart > _ASTRAY * length or point.tangent @ chord <= 0.0:
        return False
    found = curve.correct(a.y + share * length * chord, chord)
    return found is not None and bool(np.abs(found.y - point.y).max() < _SAME)


def _thinned(points: list[Point]) -> list[Point]:
    """Return the points without the dense ones just before an end."""
    kept = points[:1]
    for point in points[1:-1]:
        if np.abs(point.y - kept[-1].y).max() > _CROWDED:
            kept.append(point)
    return kept + points[-1:] if len(points) > 1 else kept


class End(NamedTuple):
    """End of a family.

    Attributes:
        value: Slope in rad, or the parameter's value.
        reason: Why it ends there.
    """

    value: float
    reason: str


class Margins(NamedTuple):
    """Distances of strides from failure, (n,) each; the least of a gait's several strides.

    Attributes:
        knee: Time from kneestrike to heelstrike over the stride's; infinite without knees.
        landing: Rate at which the legs close just before heelstrike, over the larger of theirs; of
            a user's system, how steeply the foot comes down.
        pace: Least rate of the stance leg in mid-stride over its first; negative where it turns
            back for a while.
        time: Duration of the longest stride; of a user's system, the mean over its footholds.
        size: Stance angle; infinite for a user's system.
    """

    knee: NDArray[np.float64]
    landing: NDArray[np.float64]
    pace: NDArray[np.float64]
    time: NDArray[np.float64]
    size: NDArray[np.float64]


def margins(curve: Curve, points: list[Point]) -> Margins:
    """Return the distances of gaits from the failure of their strides."""
    stride_map, here, slopes, _ = curve.gaits_at(points)
    knee, landing, pace, size = (np.full(len(points), np.inf) for _ in range(4))
    time = np.zeros(len(points))
    if "contact margins" not in stride_map.walker.supports:
        for _ in range(curve.period):
            if not stride_map.controlled:
                landing = np.fmin(landing, stride_map.steepness(here, slopes))
            passage = stride_map.apply(here, slopes)
            here = passage.ends
            time = np.maximum(time, passage.durations / len(stride_map.ground))
        return Margins(knee, landing, pace, time, size)
    size = here[:, 0]
    if len(stride_map.ground) > 1:
        found = np.array([_on_footholds(curve, point) for point in points])
        return Margins._make([*found.T, size])
    roughly = stride_map.with_tolerance(_ROUGHLY)
    for _ in range(curve.period):
        passage = stride_map.apply(here, slopes)
        found = _of_stride(
            passage.durations, passage.knee_times, here[:, 1],
            partial(stride_map.sample, here, slopes), partial(roughly.sample, here, slopes),
        )  # fmt: skip
        knee, landing, pace = map(np.fmin, (knee, landing, pace), found)
        here, time = passage.ends, np.maximum(time, passage.durations)
    return Margins(knee, landing, pace, time, size)


def _of_stride(
    durations: NDArray,
    knee_times: NDArray,
    first: NDArray,
    sample: Callable[[NDArray], Samples],
    roughly: Callable[[NDArray], Samples],
) -> tuple[NDArray, NDArray, NDArray]:
    """Return the knee, landing and pace of n strides, as in `Margins`; without knees NaN for knee.

    `first` are the first rates of the stance legs. `sample` and `roughly`, which has a coarse
    tolerance, sample the strides at times (n, k).
    """
    rates = sample((durations * (1.0 - RATE_BEFORE))[:, None]).states[:, 0, 3:5]
    landing = -rates.sum(axis=1) / np.abs(rates).max(axis=1)
    times = durations[:, None] * np.linspace(0.0, 1.0 - RATE_BEFORE, _LOOKS)
    pace = np.min(roughly(times).states[:, :, 3] / first[:, None], axis=1)
    return 1.0 - knee_times / durations, landing, pace


def _on_footholds(curve: Curve, point: Point) -> list[float]:
    """Return the margins of a gait on several footholds."""
    own, slope, begun = curve.one(point)
    state, least, longest = begun.states[0], [math.inf] * 3, 0.0
    now, rough = own, own.with_tolerance(_ROUGHLY)
    for place, walked in enumerate(own.walk(state, slope, curve.period)):
        tilt, rise, turn = own.ground[place % len(own.ground)]
        start = own.dimensionless(state)
        times = np.array([[walked.duration], [walked.kneestrike_time]]) / own.units.time
        given = {"rises": rise, "turns": turn, "ahead": own.ahead(place)}
        sample, roughly = (
            partial(each.look, start, slope + tilt, **given) for each in (now, rough)
        )
        found = _of_stride(times[0], times[1], start[:, 3], sample, roughly)
        least = [*map(np.fmin, least, found)]
        state, longest = walked.state, max(longest, times[0, 0])
        now, rough = now.swapped, rough.swapped
    return [*(float(np.max(each)) for each in least), longest]


def reason_of(curve: Curve, last: list[Point]) -> End:
    """Return the end of a curve and its reason, from its last gaits, the last one last."""
    *_, values = curve.gaits_at(last)
    if math.isfinite(curve.stride_map.hold):
        # There a controller observes the walker before the strike or after it.
        own, slope, begun = curve.one(last[-1])
        strides = own.walk(begun.states[0], slope, curve.period)
        strikes = np.array([(each.kneestrike_time, each.duration) for each in strides])
        steps = strikes / (own.units.time * own.hold)
        if np.nanmin(np.abs(steps - np.round(steps))) < _AT_ONCE:
            return End(float(values[-1]), STEP_ENDS)
    left = margins(curve, last)
    near = {
        reason: (_vanishing(margin, values), margin[-1])
        for reason, margin, least in (
            (KNEE_MEETS_HEEL, left.knee, _NEAR),
            (TANGENTIAL, left.landing, _NEAR),
            (VANISHED, left.size, _TINY),
        )
        if margin[-1] <= least
    }
    if not near:
        stopped = left.time[-1] > _ENDLESS
        return End(float(values[-1]), STANCE_STOPS if stopped else LOST)
    # What is lost first is nearest, whichever margin is the smaller.
    running_out = {reason: end for reason, (end, _) in near.items() if end is not None}
    if not running_out:
        return End(float(values[-1]), min(near, key=lambda reason: near[reason][1]))
    reason = min(running_out, key=lambda reason: abs(running_out[reason] - values[-1]))
    return End(running_out[reason], reason)


def _vanishing(margin: NDArray, values: NDArray) -> float | None:
    """Return the value at which a decreasing margin would be zero; None if it does not decrease.

    By a polynomial in the margin through gaits that differ by it; noise would spoil near ones.
    """
    chosen = [len(margin) - 1]
    for i in range(len(margin) - 2, -1, -1):
        if margin[i] > 1.4 * margin[chosen[-1]] + 1e-6 and margin[i] < 2.0 * _NEAR:
            chosen.append(i)
    chosen = chosen[:5]
    if len(chosen) == 1:
        return None
    powers = np.vander(margin[chosen], increasing=True)
    base = values[-1]
    return float(base + np.linalg.solve(powers, values[chosen] - base)[0])
