"""Settled walks, chaos and crises, beyond the stability of a gait.

A settled walk is found by walking; lanes take many slopes at once. The doublings themselves are
not read off a diagram but located on the unstable gaits (see `doubling`).

References:
    G. Benettin, L. Galgani, A. Giorgilli, J.-M. Strelcyn, Meccanica 15 (1980) 9-20, for exponents.
    M. J. Feigenbaum, "Quantitative universality for a class of nonlinear transformations",
    J. Stat. Phys. 19 (1978) 25-52.
"""

from __future__ import annotations

from dataclasses import dataclass

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
    several_slopes,
    whole,
)
from gym_passive_walker._tools.progress import progress
from gym_passive_walker._tools.shown import Table
from gym_passive_walker.gaits.branches.family import GaitFamily, gait_family
from gym_passive_walker.gaits.gait import GaitKind
from gym_passive_walker.gaits.measures import InUnits
from gym_passive_walker.gaits.stride_map import MapLike, StrideMap, map_of
from gym_passive_walker.models.walkers import Walker, name_of

_FINEST_SLOPE = 1e-15  # rad
_NUDGE = 1e-4  # off the gait, which a walker would otherwise stay on though it be unstable


@dataclass(frozen=True, repr=False)
class BifurcationDiagram(InUnits, Table):
    """Settled walks over slopes.

    Attributes:
        walker: The walker.
        slope: Slopes in rad, (n,).
        stance_angle: Stance angles in rad of successive settled strides, (n, n_recorded); NaN where
            the walker fell.
        period: Strides after which the settled walk repeats, (n,); 0 where it does not, for the
            longest period looked for, or where the walker fell.
        state: Last states on the Poincaré section, (n, 6), in the walker's own units.
    """

    walker: Walker
    slope: NDArray[np.float64]
    stance_angle: NDArray[np.float64]
    period: NDArray[np.int64]
    state: NDArray[np.float64]

    @property
    def walks(self) -> NDArray[np.bool_]:
        """Whether the walker still walks, (n,)."""
        return np.isfinite(self.stance_angle[:, -1])

    def facts(self) -> dict[str, str]:
        """Range of slopes, and the periods found."""
        slopes = self.slope
        periods = ", ".join(map(str, np.unique(self.period[self.period > 0])))
        return {
            "walker": name_of(self.walker),
            "slopes": f"{len(slopes)} from {slopes.min():.6g} to {slopes.max():.6g} rad",
            "walks at": str(self.walks.sum()),
            "strides kept": str(self.stance_angle.shape[1]),
            "periods": periods or "none",
        }

    def columns(self) -> dict[str, NDArray]:
        """A row for each recorded stride, slope by slope."""
        count, n_recorded = self.stance_angle.shape
        return {
            "slope": np.repeat(self.slope, n_recorded),
            "period": np.repeat(self.period, n_recorded),
            "stride": np.tile(np.arange(n_recorded), count),
            "stance_angle": self.stance_angle.ravel(),
        }


def period_of(values: ArrayLike, longest: int, tolerance: float = 1e-6) -> NDArray[np.int64]:
    """Return the smallest period with which sequences repeat; 0 where none does.

    Args:
        values: Sequences, shape (..., count), longer than `longest`.
        longest: Longest period looked for.
        tolerance: Largest difference of repeated values, relative to their size.
    """
    values = np.asarray(values, dtype=float)
    if not 1 <= longest < values.shape[-1]:
        raise ValueError(f"a period from 1 to below {values.shape[-1]}, not {longest}")
    with np.errstate(invalid="ignore"):
        size = tolerance * np.abs(values).max(axis=-1)
        period = np.zeros(values.shape[:-1], dtype=np.int64)
        for p in range(longest, 0, -1):
            gap = np.abs(values[..., p:] - values[..., :-p]).max(axis=-1)
            period[gap <= size] = p
    return period


def nearest_on(family: GaitFamily, slopes: NDArray) -> NDArray[np.float64]:
    """Return states on a family at given slopes, by interpolation; NaN where it has none.

    Where a family passes a slope more than once, the gait nearest to being stable is taken.

    Args:
        family: A family over slopes.
        slopes: rad, (n,).

    Returns:
        Section states, (n, 6) for a `Walker`, in the walker's own units.
    """
    here, there = family.slope[:-1], family.slope[1:]
    size = np.abs(family.multipliers[:, 0])
    size = np.maximum(size[:-1], size[1:])
    states = np.full((len(slopes), family.state.shape[1]), np.nan)
    for i, slope in enumerate(slopes):
        low, high = np.minimum(here, there), np.maximum(here, there)
        passed = np.flatnonzero((low <= slope) & (slope <= high) & (low < high))
        if len(passed):
            j = passed[np.argmin(size[passed])]
            share = (slope - here[j]) / (there[j] - here[j])
            states[i] = family.state[j] + share * (family.state[j + 1] - family.state[j])
    return states


def beginnings(
    stride_map: StrideMap, slopes: NDArray, kind: GaitKind, start: ArrayLike | None
) -> NDArray[np.float64]:
    """Return the points from which walks begin.

    Args:
        stride_map: The stride map.
        slopes: Slopes in rad, (n,).
        kind: Gait to begin beside.
        start: Initial states instead, (6,) or (n, 6), in the walker's own units.

    Returns:
        Points (n, m); NaN where there is no gait.
    """
    kind = gait_kind(kind)
    if start is not None:
        size = stride_map.size
        states = check_state(start, "start", stride_map.walker)
        if states.shape not in ((size,), (1, size), (len(slopes), size)):
            raise ValueError(
                f"start must be one state, or one for each of {len(slopes)} slopes, not of shape "
                f"{states.shape}"
            )
        return stride_map.points_at(np.broadcast_to(states, (len(slopes), size)))
    if stride_map.controlled:
        return stride_map.beginning(slopes)  # type: ignore[attr-defined]
    low, high = float(slopes.min()), float(slopes.max())
    low, high = (x + sign * (1e-9 * abs(x) or 1e-9) for x, sign in ((low, -1.0), (high, 1.0)))
    family = gait_family(stride_map, low, high, kind)
    points = stride_map.points_at(nearest_on(family, slopes))
    points[:, 0] *= 1.0 + _NUDGE
    return points


def _settle(
    stride_map: StrideMap, points: NDArray, slopes: NDArray, n_transient: int, n_recorded: int
) -> tuple[NDArray, NDArray]:
    """Return the stance angles of the recorded strides, (n, n_recorded), and the last points."""
    if n_transient:
        points = stride_map.apply(points, slopes, strides=n_transient).ends
    angles = np.empty((len(slopes), n_recorded))
    with progress("strides kept", n_recorded) as taken:
        for i in range(n_recorded):
            points = stride_map.apply(points, slopes).ends
            angles[:, i] = points[:, 0]
            taken()
    angles[np.isnan(angles[:, -1])] = np.nan
    return angles, points


def bifurcation_diagram(
    walker: MapLike,
    slopes: ArrayLike,
    *,
    n_transient: int = 1000,
    n_recorded: int = 128,
    start: ArrayLike | None = None,
    kind: GaitKind = "long",
    sweep: bool = False,
    longest_period: int = 32,
    tolerance: float = 1e-10,
) -> BifurcationDiagram:
    """Simulate walks until they settle, for each of several slopes (Fig. 4.10).

    Args:
        walker: The walker, in a form that `as_walker` takes; or a map of `stride_map` with
            its controller.
        slopes: Slopes in rad, in the order in which a sweep takes them.
        n_transient: Transient strides, which are not recorded.
        n_recorded: Recorded strides.
        start: Initial state on the Poincaré section, (6,), or one for each slope, (n, 6). If None,
            each walk begins just beside the period-one gait of its slope, stable or not.
        kind: Gait to begin beside, "long" or "short".
        sweep: Whether each slope begins with the settled walk of the slope before, if that still
            walks. Slopes are then simulated one after the other, which is slower.
        longest_period: Longest period detected.
        tolerance: Tolerance of the integration.

    Returns:
        The `BifurcationDiagram`; rows of walkers that fell are NaN.

    Raises:
        GaitNotFound: if there is no gait in the range of slopes to begin with.
    """
    stride_map = map_of(walker, tolerance=check_tolerance(tolerance))
    values = several_slopes(slopes, downhill=stride_map.passive)
    n_transient = whole(n_transient, "n_transient", 0)
    n_recorded = whole(n_recorded, "n_recorded", 1, KEPT)
    sweep = boolean(sweep, "sweep")
    longest_period = whole(longest_period, "longest_period")
    if not longest_period < n_recorded:
        raise ValueError(
            f"n_recorded must be above the longest period {longest_period}, not {n_recorded}"
        )
    points = beginnings(stride_map, values, kind, start)
    together = 1 if sweep else len(values)
    angles = np.empty((len(values), n_recorded))
    with progress("slopes", len(values)) as done:
        for i in range(0, len(values), together):
            if i > 0 and np.all(np.isfinite(points[i - 1])):
                points[i] = points[i - 1]
            at = slice(i, i + together)
            angles[at], points[at] = _settle(
                stride_map, points[at], values[at], n_transient, n_recorded
            )
            done(together)
    period = period_of(angles, longest_period)
    return BifurcationDiagram(
        stride_map.walker, values, angles, period, stride_map.states_at(points)
    )


def crisis_slope(
    walker: MapLike,
    low: float,
    high: float,
    *,
    start: ArrayLike | None = None,
    strides: int = 3000,
    walkers: int = 64,
    kind: GaitKind = "long",
    accuracy: float = 1e-7,
    tolerance: float = 1e-10,
) -> float:
    """Find the slope at which settled walking ends.

    Walkers spread over the settled walk at `low` are moved to steeper slopes until one of them
    falls. Just beyond the crisis walks last long before they end, so the slope found is slightly
    too high. More strides and more walkers reduce this error. A range without a settled walk is
    missed if it is narrower than the search's steps.

    Args:
        walker: The walker, or a map of `stride_map`, as for `bifurcation_diagram`.
        low: Slope in rad at which the walk settles.
        high: Slope in rad beyond the crisis.
        start: Initial state at `low` on the Poincaré section, (6,); beside the gait if None.
        strides: Strides that all walkers must make.
        walkers: Number of walkers at each slope.
        kind: Gait to begin beside, "long" or "short".
        accuracy: Accuracy in rad, at least 1e-15.
        tolerance: Tolerance of the integration.

    Returns:
        The slope in rad, from `low` to `high`.

    Raises:
        ValueError: if the walker falls at `low`, or walks on at `high`.
    """
    stride_map = map_of(walker, tolerance=check_tolerance(tolerance))
    low, high = one_slope(low, "low"), one_slope(high, "high")
    strides, walkers = whole(strides, "strides"), whole(walkers, "walkers", 1, KEPT)
    accuracy = number(accuracy, "accuracy", least=_FINEST_SLOPE, most=1.0)
    if not low < high or (stride_map.passive and low <= 0.0):
        allowed = "0 < low < high" if stride_map.passive else "low < high"
        raise ValueError(f"slopes must be {allowed}, not {low}, {high}")
    points = beginnings(stride_map, np.array([low]), kind, start)
    points = stride_map.apply(points, low, strides=strides).ends
    if not np.all(np.isfinite(points)):
        raise ValueError(f"the walker falls at slope {low}")
    batch = np.repeat(points, walkers, axis=0)
    said = f"walking has not ended at slope {high}"
    for i in range(1, walkers):  # spread along the settled walk
        batch[i] = stride_map.apply(batch[i - 1 : i], low).ends[0]
    if _all_walk(stride_map, batch, high, strides) is not None:
        raise ValueError(said)
    step, fell = (high - low) / 64.0, False
    with progress("slopes tried") as tried:
        while step > accuracy or not fell:
            there = min(low + step, high)
            if (ends := _all_walk(stride_map, batch, there, strides)) is None:
                step, fell = 0.5 * step, True
            elif there == high:  # by small steps, though not by one from `low`
                raise ValueError(said)
            else:
                low, batch = there, ends
            tried()
    return low


def _all_walk(stride_map: StrideMap, points: NDArray, slope: float, strides: int) -> NDArray | None:
    """Return walkers' points after some strides; None as soon as one falls."""
    for _ in range(0, strides, 50):
        points = stride_map.apply(points, slope, strides=50).ends
        if not np.all(np.isfinite(points)):
            return None
    return points


def lyapunov_exponents(
    walker: MapLike,
    slopes: ArrayLike,
    *,
    count: int = 1,
    strides: int = 2000,
    n_transient: int = 500,
    start: ArrayLike | None = None,
    kind: GaitKind = "long",
    tolerance: float = 1e-10,
) -> NDArray[np.float64]:
    """Compute Lyapunov exponents of settled walks, per stride, from exact derivatives.

    A positive exponent means chaos: neighbouring walks diverge by its exponential at each stride.
    On a stable gait of period n the exponents are ln|multipliers| / n.

    Args:
        walker: The walker, or a map of `stride_map`, as for `bifurcation_diagram`.
        slopes: Slopes in rad.
        count: Number of exponents, from the largest on; at most the section's dimension.
        strides: Strides of the average.
        n_transient: Transient strides before them.
        start: Initial state on the Poincaré section, (6,), or one for each slope, (n, 6); beside
            the gait if None.
        kind: Gait to begin beside, "long" or "short".
        tolerance: Tolerance of the integration.

    Returns:
        Exponents (n, count), largest first; NaN where the walker falls.
    """
    stride_map = map_of(walker, tolerance=check_tolerance(tolerance))
    values = several_slopes(slopes, downhill=stride_map.passive)
    strides, n_transient = whole(strides, "strides"), whole(n_transient, "n_transient", 0)
    m = stride_map.dimension
    count = whole(count, "count", 1, m)
    points = beginnings(stride_map, values, kind, start)
    if n_transient:
        points = stride_map.apply(points, values, strides=n_transient).ends
    exponents = np.full((len(values), count), np.nan)
    walking = np.flatnonzero(np.isfinite(points[:, 0]))
    points = points[walking]
    frames = np.broadcast_to(np.eye(m)[:, :count], (len(points), m, count))
    sums = np.zeros((len(points), count))
    with progress("strides averaged over", strides) as averaged:
        for _ in range(strides):
            averaged()
            if len(walking) == 0:
                break
            # In logarithmic coordinates, as rates are of another size than angles.
            along = stride_map.at(points).by_search @ frames
            passage, change = stride_map.linearize(points, values[walking], along=along)
            on = passage.alive
            walking, points, sums = walking[on], passage.ends[on], sums[on]
            frames, triangle = np.linalg.qr(stride_map.at(points).in_search(change.ends[on]))
            with np.errstate(divide="ignore"):  # a direction that a strike forgets: minus infinity
                sums = sums + np.log(np.abs(np.diagonal(triangle, axis1=1, axis2=2)))
    exponents[walking] = sums / strides
    return exponents
