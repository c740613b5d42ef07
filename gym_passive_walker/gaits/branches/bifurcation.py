"""Settled walks, chaos and crises, beyond the stability of a gait.

A settled walk is found by walking; lanes take many values of a parameter at once. The doublings
themselves are not read off a diagram but located on the unstable gaits (see `doubling`).

References:
    G. Benettin, L. Galgani, A. Giorgilli, J.-M. Strelcyn, Meccanica 15 (1980) 9-20, for exponents.
    M. J. Feigenbaum, "Quantitative universality for a class of nonlinear transformations",
    J. Stat. Phys. 19 (1978) 25-52.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker._tools.arguments import (
    KEPT,
    boolean,
    check_state,
    check_tolerance,
    gait_kind,
    number,
    one_slope,
    real_array,
    several_slopes,
    shown,
    whole,
)
from gym_passive_walker._tools.progress import progress
from gym_passive_walker._tools.shown import Table
from gym_passive_walker.gaits.branches.continuation import Axis
from gym_passive_walker.gaits.branches.family import (
    GaitFamily,
    axis_of,
    gait_family,
    parameter_family,
    states_between,
)
from gym_passive_walker.gaits.branches.varied_map import MapOfValue
from gym_passive_walker.gaits.gait import GaitKind
from gym_passive_walker.gaits.measures import InUnits
from gym_passive_walker.gaits.section import Section
from gym_passive_walker.gaits.stride_map import MapLike, StrideMap, map_of
from gym_passive_walker.models.units import Units
from gym_passive_walker.models.walkers import Walker, name_of

_FINEST = 1e-15  # accuracy of a crisis
_NUDGE = 1e-4  # off the gait, which a walker would otherwise stay on though it be unstable


@dataclass(frozen=True, repr=False)
class BifurcationDiagram(InUnits, Table):
    """Settled walks over slopes or another quantity.

    Attributes:
        walker: The walker (at its own value, if a parameter of the walker is varied).
        parameter: The quantity that is varied, as in `GaitFamily`.
        value: Its values, in the walker's own units, (n,).
        slope: Slopes in rad, (n,).
        stance_angle: Stance angles in rad of successive settled strides, (n, n_recorded); NaN where
            the walker fell.
        period: Strides after which the settled walk repeats, (n,); 0 where it does not, for the
            longest period looked for, or where the walker fell.
        state: Last states on the Poincaré section, (n, 6), in the walker's own units.
    """

    walker: Walker
    parameter: str
    value: NDArray[np.float64]
    slope: NDArray[np.float64]
    stance_angle: NDArray[np.float64]
    period: NDArray[np.int64]
    state: NDArray[np.float64]
    _units: Units

    @property
    def units(self) -> Units:
        """Dimensionless units of each walk's walker, in its own, (n,) each."""
        return self._units

    @property
    def walks(self) -> NDArray[np.bool_]:
        """Whether the walker still walks, (n,)."""
        return np.isfinite(self.stance_angle[:, -1])

    def facts(self) -> dict[str, str]:
        """Range of values, and the periods found."""
        value, slopes = self.value, self.parameter == "slope"
        periods = ", ".join(map(str, np.unique(self.period[self.period > 0])))
        return {
            "walker": name_of(self.walker),
            "slopes" if slopes else self.parameter: f"{len(value)} from {value.min():.6g} to "
            f"{value.max():.6g}" + " rad" * slopes,
            "walks at": str(self.walks.sum()),
            "strides kept": str(self.stance_angle.shape[1]),
            "periods": periods or "none",
        }

    def columns(self) -> dict[str, NDArray]:
        """A row for each recorded stride, value by value."""
        count, n_recorded = self.stance_angle.shape
        return {
            self.parameter: np.repeat(self.value, n_recorded),
            "slope": np.repeat(self.slope, n_recorded),
            "period": np.repeat(self.period, n_recorded),
            "stride": np.tile(np.arange(n_recorded), count),
            "stance_angle": self.stance_angle.ravel(),
        }


def period_of(points: NDArray, longest: int, tolerance: float = 1e-6) -> NDArray[np.int64]:
    """Return the smallest period with which sequences of points repeat; 0 where none does.

    Args:
        points: Sequences, shape (..., count, m), longer than `longest`.
        longest: Longest period looked for.
        tolerance: Largest difference of repeated values, relative to their size.
    """
    count = points.shape[-2]
    if not 1 <= longest < count:
        raise ValueError(f"a period from 1 to below {count}, not {longest}")
    with np.errstate(invalid="ignore"):
        size = tolerance * np.abs(points).max(axis=(-2, -1))
        period = np.zeros(points.shape[:-2], dtype=np.int64)
        for p in range(longest, 0, -1):
            gap = np.abs(points[..., p:, :] - points[..., :-p, :]).max(axis=(-2, -1))
            period[gap <= size] = p
    return period


def repeating(section: Section) -> slice:
    """Return the coordinates by which walks repeat or not: the stance angle alone of legs.

    A user's system may strike at an angle that never changes.
    """
    return slice(None) if section.chart.balance is None else slice(1)


def nearest_on(family: GaitFamily, values: NDArray) -> NDArray[np.float64]:
    """Return states on a family at given values, by interpolation; NaN where it has none.

    Where a family passes a value more than once, the gait nearest to being stable is taken.

    Args:
        family: A family.
        values: Values of what it varies, (n,).

    Returns:
        Section states, (n, 6) for a `Walker`, in the walker's own units.
    """
    size = np.abs(family.multipliers[:, 0])
    size = np.maximum(size[:-1], size[1:])
    states = np.full((len(values), family.state.shape[1]), np.nan)
    for i, value in enumerate(values):
        passed, between = states_between(family, value)
        if len(passed):
            states[i] = between[np.argmin(size[passed])]
    return states


class _Walks(NamedTuple):
    """Walks at several values of a parameter, and where they begin.

    Attributes:
        own: The stride map, apart from what varies.
        axis: What varies, and its range.
        values: Its values, (n,).
    """

    own: StrideMap
    axis: Axis
    values: NDArray[np.float64]

    @classmethod
    def of(
        cls, walker: MapLike | MapOfValue, parameter: str, values: ArrayLike, slope: float | None,
        tolerance: float,
    ) -> _Walks:  # fmt: skip
        """Return the walks of an analysis, from its arguments."""
        tolerance = check_tolerance(tolerance)
        if parameter == "slope" and not callable(walker):
            if slope is not None:
                raise ValueError("slope is that of walks over another parameter: omit it")
            own = map_of(walker, tolerance=tolerance)
            downhill = own.passive and own.terrain is None
            values = several_slopes(values, "values", downhill=downhill)
        else:
            allowed = f"values of {shown(parameter)}, a list of finite numbers"
            values = np.atleast_1d(real_array(values, "values", allowed))
            if values.ndim != 1 or len(values) == 0 or not np.all(np.isfinite(values)):
                raise ValueError(f"values must be {allowed}, not {shown(values)}")
        low, high = float(values.min()), float(values.max())
        if parameter != "slope" and not callable(walker):  # the family begins at the walker's own
            here = map_of(walker, tolerance=tolerance).parameters.get(str(parameter), low)
            low, high = min(low, here), max(high, here)
        if low == high:
            high = low + (1e-9 * abs(low) or 1e-9)
        own, axis = axis_of(walker, parameter, low, high, slope, tolerance=tolerance)
        return cls(own, axis, values)

    def at(self, which: Any = slice(None)) -> tuple[StrideMap, NDArray]:
        """Return the stride map of some of the walks, and their slopes in rad."""
        return self.axis.settings(self.own, self.values[which])

    def beginnings(self, kind: GaitKind, start: ArrayLike | None) -> NDArray[np.float64]:
        """Return the points (n, m) from which the walks begin; NaN where there is no gait.

        They are beside a gait of this kind, or at states (6,) or (n, 6) in the walker's own units.
        """
        kind, (there, slopes), n = gait_kind(kind), self.at(), len(self.values)
        if start is not None:
            size = self.own.size
            states = check_state(start, "start", self.own.walker)
            if states.shape not in ((size,), (1, size), (n, size)):
                raise ValueError(
                    f"start must be one state, or one for each of {n} "
                    f"{'slopes' if self.axis.parameter == 'slope' else 'values'}, not of shape "
                    f"{states.shape}"
                )
            return there.points_at(np.broadcast_to(states, (n, size)))
        low, high = self.axis.low, self.axis.high
        if self.axis.parameter == "slope":
            if self.own.controlled:
                return self.own.beginning(slopes)  # type: ignore[attr-defined]
            low, high = float(slopes.min()), float(slopes.max())
            low, high = (
                x + sign * (1e-9 * abs(x) or 1e-9) for x, sign in ((low, -1.0), (high, 1.0))
            )
            family = gait_family(self.own, low, high, kind)
        else:
            varied = self.axis.make or self.own
            family = parameter_family(
                varied, self.axis.parameter, low, high, slope=self.axis.slope, kind=kind
            )
        points = there.points_at(nearest_on(family, self.values))
        points[:, 0] *= 1.0 + _NUDGE
        return points


def _settle(
    stride_map: StrideMap, points: NDArray, slopes: NDArray, n_transient: int, n_recorded: int
) -> NDArray[np.float64]:
    """Return the points of the recorded strides, (n, n_recorded, m)."""
    if n_transient:
        points = stride_map.apply(points, slopes, strides=n_transient).ends
    walked = np.empty((len(slopes), n_recorded, points.shape[1]))
    with progress("strides kept", n_recorded) as taken:
        for i in range(n_recorded):
            walked[:, i] = points = stride_map.apply(points, slopes).ends
            taken()
    walked[np.isnan(walked[:, -1, 0])] = np.nan
    return walked


def bifurcation_diagram(
    walker: MapLike | MapOfValue,
    values: ArrayLike,
    *,
    parameter: str = "slope",
    slope: float | None = None,
    n_transient: int = 1000,
    n_recorded: int = 128,
    start: ArrayLike | None = None,
    kind: GaitKind = "long",
    sweep: bool = False,
    longest_period: int = 32,
    tolerance: float = 1e-10,
) -> BifurcationDiagram:
    """Simulate walks until they settle, for each of several slopes or other values (Fig. 4.10).

    Example:
        >>> import gym_passive_walker as gpw
        >>> diagram = gpw.bifurcation_diagram(
        ...     "lab", [0.0, 0.5, 1.0], parameter="hip_mass", slope=0.036, n_transient=200
        ... )
        >>> diagram.period.tolist()
        [1, 1, 1]

    Args:
        walker: The walker, in a form that `as_walker` takes; or a map of `stride_map` with
            its controller; or a function from a value to a map, as for `parameter_family`.
        values: Slopes in rad, or values of the parameter, in the order in which a sweep takes them.
        parameter: What varies: "slope", or another parameter that `parameter_family` takes.
        slope: Slope in rad where another parameter varies; the map's own when None.
        n_transient: Transient strides, which are not recorded. Here and in the result, legs or
            ground that repeat after L strides count L strides as one.
        n_recorded: Recorded strides.
        start: Initial state on the Poincaré section, (6,), or one for each value, (n, 6). If None,
            each walk begins just beside the period-one gait of its value, stable or not.
        kind: Gait to begin beside, "long" or "short".
        sweep: Whether each value begins with the settled walk of the value before, if that still
            walks. Values are then simulated one after the other, which is slower.
        longest_period: Longest period detected.
        tolerance: Tolerance of the integration.

    Returns:
        The `BifurcationDiagram`; rows of walkers that fell are NaN.

    Raises:
        GaitNotFound: if there is no gait in the range of values to begin with.
        ValueError: if there is no such parameter, or a walker cannot have one of the values.
    """
    walks = _Walks.of(walker, parameter, values, slope, tolerance)
    n_transient = whole(n_transient, "n_transient", 0)
    n_recorded = whole(n_recorded, "n_recorded", 1, KEPT)
    sweep = boolean(sweep, "sweep")
    longest_period = whole(longest_period, "longest_period")
    if not longest_period < n_recorded:
        raise ValueError(
            f"n_recorded must be above the longest period {longest_period}, not {n_recorded}"
        )
    points, n = walks.beginnings(kind, start), len(walks.values)
    together = 1 if sweep else n
    walked, states = np.empty((n, n_recorded, points.shape[1])), np.empty((n, walks.own.size))
    slopes, units = np.empty(n), np.empty((len(Units._fields), n))
    with progress("slopes" if parameter == "slope" else "values", n) as done:
        for i in range(0, n, together):
            if i > 0 and np.all(np.isfinite(points[i - 1])):
                points[i] = points[i - 1]
            at = slice(i, i + together)
            there, slopes[at] = walks.at(at)
            walked[at] = _settle(there, points[at], slopes[at], n_transient, n_recorded)
            own = np.broadcast_arrays(*there.units)
            points[at], units[:, at] = walked[at, -1], np.reshape(own, (len(units), -1))
            states[at] = there.states_at(points[at])
            done(together)
    return BifurcationDiagram(
        walker=walks.own.walker,
        parameter=parameter,
        value=walks.values,
        slope=slopes,
        stance_angle=np.ascontiguousarray(walked[:, :, 0]),
        period=period_of(walked[:, :, repeating(walks.own)], longest_period),
        state=states,
        _units=Units(*units),  # type: ignore[arg-type]
    )


def crisis(
    walker: MapLike | MapOfValue,
    low: float,
    high: float,
    *,
    parameter: str = "slope",
    slope: float | None = None,
    start: ArrayLike | None = None,
    strides: int = 3000,
    walkers: int = 64,
    kind: GaitKind = "long",
    accuracy: float = 1e-7,
    tolerance: float = 1e-10,
) -> float:
    """Find the slope, or the value of another parameter, at which settled walking ends.

    Walkers spread over the settled walk at `low` are moved towards `high` until one of them falls.
    Just beyond the crisis walks last long before they end, so the value found is slightly too far.
    More strides and more walkers reduce this error. A range without a settled walk is missed if it
    is narrower than the search's steps.

    Args:
        walker: The walker, a map of `stride_map`, or a function from a value to one, as for
            `bifurcation_diagram`.
        low: Slope in rad, or value, at which the walk settles.
        high: Slope in rad, or value, beyond the crisis.
        parameter: What varies: "slope", or another parameter that `parameter_family` takes.
        slope: Slope in rad where another parameter varies; the map's own when None.
        start: Initial state at `low` on the Poincaré section, (6,); beside the gait if None.
        strides: Strides that all walkers must make, counted as in `bifurcation_diagram`.
        walkers: Number of walkers at each value.
        kind: Gait to begin beside, "long" or "short".
        accuracy: Accuracy, at least 1e-15.
        tolerance: Tolerance of the integration.

    Returns:
        The slope in rad or the value, from `low` to `high`.

    Raises:
        ValueError: if the walker falls at `low`, or walks on at `high`; or if there is no such
            parameter, or a walker cannot have one of these values.
    """
    steep = parameter == "slope"
    checked = one_slope if steep else number
    low, high = checked(low, "low"), checked(high, "high")
    own = None if callable(walker) else map_of(walker, tolerance=tolerance)
    downhill = own is not None and own.passive and own.terrain is None
    if low == high or (steep and (not low < high or (downhill and low <= 0.0))):
        allowed = (
            ("0 < low < high" if downhill else "low < high") if steep else "low and another high"
        )
        raise ValueError(f"{'slopes' if steep else 'values'} must be {allowed}, not {low}, {high}")
    bounds = min(low, high), max(low, high)
    axis_of(walker, parameter, *bounds, slope, tolerance=tolerance)  # refuses what cannot be
    walks = _Walks.of(walker, parameter, [low], slope, tolerance)
    strides, walkers = whole(strides, "strides"), whole(walkers, "walkers", 1, KEPT)
    accuracy = number(accuracy, "accuracy", least=_FINEST, most=1.0 if steep else abs(high - low))
    points = walks.beginnings(kind, start)
    there, at = walks.axis.setting(walks.own, low)
    points = there.apply(points, at, strides=strides).ends
    said = "at " + parameter + " {}"
    if not np.all(np.isfinite(points)):
        raise ValueError(f"the walker falls {said.format(low)}")
    batch = np.repeat(points, walkers, axis=0)
    for i in range(1, walkers):  # spread along the settled walk
        batch[i] = there.apply(batch[i - 1 : i], at).ends[0]

    def all_walk(points: NDArray, value: float) -> NDArray | None:
        there, at = walks.axis.setting(walks.own, value)
        for done in range(0, strides, 50):
            points = there.apply(points, at, strides=min(50, strides - done)).ends
            if not np.all(np.isfinite(points)):
                return None
        return points

    on = f"walking has not ended {said.format(high)}"
    if all_walk(batch, high) is not None:
        raise ValueError(on)
    step, fell = (high - low) / 64.0, False
    with progress("slopes tried" if steep else "values tried") as tried:
        while abs(step) > accuracy or not fell:
            value = low + step if (low + step - high) * step < 0.0 else high
            if (moved := all_walk(batch, value)) is None:
                step, fell = 0.5 * step, True
            elif value == high:  # by small steps, though not by one from `low`
                raise ValueError(on)
            else:
                low, batch = value, moved
            tried()
    return low


def lyapunov_exponents(
    walker: MapLike | MapOfValue,
    values: ArrayLike,
    *,
    parameter: str = "slope",
    slope: float | None = None,
    count: int = 1,
    strides: int = 2000,
    n_transient: int = 500,
    start: ArrayLike | None = None,
    kind: GaitKind = "long",
    tolerance: float = 1e-10,
) -> NDArray[np.float64]:
    """Compute Lyapunov exponents of settled walks, per stride, from exact derivatives.

    A positive exponent means chaos: neighbouring walks diverge by its exponential at each stride.
    On a stable gait that repeats after n strides the exponents are ln|multipliers| / n.

    Args:
        walker: The walker, a map of `stride_map`, or a function from a value to one, as for
            `bifurcation_diagram`.
        values: Slopes in rad, or values of the parameter.
        parameter: What varies: "slope", or another parameter that `parameter_family` takes.
        slope: Slope in rad where another parameter varies; the map's own when None.
        count: Number of exponents, from the largest on; at most the section's dimension.
        strides: Strides of the average; of legs or ground that repeat after L strides, L times as
            many.
        n_transient: Transient strides before them, counted so too.
        start: Initial state on the Poincaré section, (6,), or one for each value, (n, 6); beside
            the gait if None.
        kind: Gait to begin beside, "long" or "short".
        tolerance: Tolerance of the integration.

    Returns:
        Exponents (n, count), largest first; NaN where the walker falls.
    """
    walks = _Walks.of(walker, parameter, values, slope, tolerance)
    strides, n_transient = whole(strides, "strides"), whole(n_transient, "n_transient", 0)
    m = walks.own.dimension
    count = whole(count, "count", 1, m)
    points = walks.beginnings(kind, start)
    if n_transient:
        there, slopes = walks.at()
        points = there.apply(points, slopes, strides=n_transient).ends
    exponents = np.full((len(walks.values), count), np.nan)
    walking = np.flatnonzero(np.isfinite(points[:, 0]))
    points, (there, slopes) = points[walking], walks.at(walking)
    frames = np.broadcast_to(np.eye(m)[:, :count], (len(points), m, count))
    sums = np.zeros((len(points), count))
    with progress("strides averaged over", strides) as averaged:
        for _ in range(strides):
            averaged()
            if len(walking) == 0:
                break
            # In logarithmic coordinates, as rates are of another size than angles.
            along = there.at(points).by_search @ frames
            passage, change = there.linearize(points, slopes, along=along)
            on = passage.alive
            points, sums = passage.ends[on], sums[on]
            if not on.all():
                walking = walking[on]
                there, slopes = walks.at(walking)
            frames, triangle = np.linalg.qr(there.at(points).in_search(change.ends[on]))
            with np.errstate(divide="ignore"):  # a direction that a strike forgets: minus infinity
                sums = sums + np.log(np.abs(np.diagonal(triangle, axis1=1, axis2=2)))
    exponents[walking] = sums / (strides * len(walks.own.ground))
    return exponents
