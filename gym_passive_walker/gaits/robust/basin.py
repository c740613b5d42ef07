"""Basins of attraction of gaits, and the largest velocity perturbation that a gait withstands.

The Poincaré section has more coordinates than a picture, so a basin is shown on a slice through a
gait. On the slice stance angle and stance angular velocity are free. The swing leg's angular
velocities are those after a heelstrike in which the legs have the gait's own ratio of angular
velocities. A walk can reach such states. For the simplest walker they are all states.

References:
    A. L. Schwab, M. Wisse, "Basin of attraction of the simplest walking model", ASME DETC (2001).
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker._tools.arguments import (
    check_tolerance,
    instance,
    number,
    real_array,
    shown,
    whole,
)
from gym_passive_walker._tools.progress import progress
from gym_passive_walker._tools.shown import Table
from gym_passive_walker.gaits.branches.bifurcation import period_of, repeating
from gym_passive_walker.gaits.find.fixed_point import find_gait, find_gaits
from gym_passive_walker.gaits.find.search import at_heelstrike, seek
from gym_passive_walker.gaits.gait import Gait, GaitNotFound
from gym_passive_walker.gaits.measures import InUnits
from gym_passive_walker.gaits.stride_map import MapLike, StrideMap, map_of
from gym_passive_walker.models.equations.hybrid import Outcome
from gym_passive_walker.models.model import check_supports
from gym_passive_walker.models.walkers import Walker, describe, name_of

FELL, UNSETTLED = -1, -2
"""Values in place of a gait's index: the walker fell, or still walks but on none of the gaits."""

_CHUNK = 1 << 16  # cells in one batch
_PUSHES = 512  # perturbations in one batch
_FINEST_PUSH = 1e-15  # relative to the gait's stance angular velocity
_FINEST = 10_000  # angles, and angular velocities
_ROUGHLY = 1e-8  # tolerance of a first survey
_LONGEST_PERIOD = 12
_SETTLING = 500  # transient strides before the period is measured
_WALKED = 1e-9  # tolerance of such walks
_SPAN = 2.2  # upper end of a default slice over the gait's angle and angular velocity


@dataclass(frozen=True, repr=False)
class Basin(InUnits, Table):
    """Basins of attraction on a slice of the Poincaré section.

    Attributes:
        walker: The walker.
        slope: Slope in rad.
        stance_angle: Stance angles of the slice in rad, (n,).
        stance_rate: Stance angular velocities of the slice, (m,), in the walker's own units.
        gaits: Stable gaits to which walks converge.
        settled: Index into `gaits`, shape (m, n): FELL (-1) where the walker fell, UNSETTLED (-2)
            where it still walked at the end but on none of the gaits.
        outcome: `Outcome` of the last stride, (m, n); HEELSTRIKE unless the walker fell.
        strides: Strides completed until the walker fell or had converged, (m, n).
    """

    walker: Walker
    slope: float
    stance_angle: NDArray[np.float64]
    stance_rate: NDArray[np.float64]
    gaits: tuple[Gait, ...]
    settled: NDArray[np.int8]
    outcome: NDArray[np.int8]
    strides: NDArray[np.int32]

    @property
    def walks(self) -> NDArray[np.bool_]:
        """Whether the walker did not fall, shape (m, n)."""
        return self.settled != FELL

    def facts(self) -> dict[str, str]:
        """The slice, and the share of each basin."""
        angles, rates = self.stance_angle, self.dimensionless.stance_rate
        shares = {f"settles on gait {i}": self.settled == i for i in range(len(self.gaits))}
        shares |= {"walks on unsettled": self.settled == UNSETTLED, "falls": ~self.walks}
        return {
            "walker": name_of(self.walker),
            "slope": f"{self.slope:.6g} rad",
            "stance angles": f"{len(angles)} from {angles.min():.4g} to {angles.max():.4g} rad",
            "stance rates": f"{len(rates)} from {rates.min():.4g} to {rates.max():.4g} √(g/l)",
            **{name: f"{where.mean():.2%}" for name, where in shares.items()},
        }

    def columns(self) -> dict[str, NDArray]:
        """One row for each initial state of the slice."""
        angle, rate = np.meshgrid(self.stance_angle, self.stance_rate)
        names = ("settled", "outcome", "strides")
        return {"stance_angle": angle.ravel(), "stance_rate": rate.ravel()} | {
            name: getattr(self, name).ravel() for name in names
        }


@dataclass(frozen=True)
class VelocityPerturbations(InUnits):
    """Largest velocity perturbations, just after heelstrike, that a gait withstands.

    A perturbation changes the stance leg's angular velocity. The gait withstands every smaller one
    that was tried. A limit is infinite if no perturbation tried makes the walker fall.

    Attributes:
        forward: Largest change that speeds the walker up, positive, in the walker's own units.
        backward: Largest change that slows the walker down, positive, in the walker's own units.
        walker: The walker.
    """

    forward: float
    backward: float
    walker: Walker


class Attractors:
    """Points of the stable gaits at a slope, to find the gait to which a walk converges.

    Args:
        stride_map: The stride map.
        gaits: Gaits of any period.
        atol: Distance in logarithmic coordinates that counts as close.
    """

    def __init__(self, stride_map: StrideMap, gaits: list[Gait], atol: float) -> None:
        self.atol, self._stride_map = atol, stride_map
        every = len(stride_map.ground)  # strides of one application on ground that repeats
        states = [gait.cycle.state[every - 1 :: every] for gait in gaits]
        self.points = [point for own in states for point in stride_map.points(own).search]
        self.owner = [i for i, own in enumerate(states) for _ in own]

    def of(self, points: NDArray) -> NDArray[np.int8]:
        """Return the index (n,) of the gait near each point (n, m); UNSETTLED if there is none."""
        index = np.full(len(points), UNSETTLED, np.int8)
        with np.errstate(invalid="ignore"):  # on a step the stance angle may be negative
            u = self._stride_map.at(points).search
        for point, owner in zip(self.points, self.owner, strict=True):
            index[np.abs(u - point).max(axis=1) < self.atol] = owner
        return index


def walk_until_settled(
    stride_map: StrideMap, points: NDArray, slope: float, gaits: Attractors, most: int
) -> tuple[NDArray[np.int8], NDArray[np.int8], NDArray[np.int32], NDArray[np.float64]]:
    """Iterate the stride map until each walker has fallen or has come close to a stable gait.

    Args:
        stride_map: The stride map.
        points: Initial points, (n, m).
        slope: Slope in rad.
        gaits: Points of the stable gaits.
        most: Strides after which a walk counts as unsettled.

    Returns:
        Index of the gait close by, or FELL or UNSETTLED, (n,); `Outcome` of the last stride, (n,);
        strides completed, (n,); and the last points, (n, m).
    """
    count, here = len(points), points.copy()
    settled = np.full(count, UNSETTLED, np.int8)
    outcome = np.full(count, Outcome.HEELSTRIKE, np.int8)
    strides, walking = np.zeros(count, np.int32), np.arange(count)
    with progress("strides until all have settled", most) as taken:
        for _ in range(most):
            passage = stride_map.apply(here[walking], slope)
            on = passage.alive
            outcome[walking] = passage.outcomes
            settled[walking[~on]] = FELL
            walking = walking[on]
            here[walking] = passage.ends[on]
            strides[walking] += 1
            settled[walking] = gaits.of(here[walking])
            walking = walking[settled[walking] == UNSETTLED]
            if len(walking) == 0:
                break
            taken()
    return settled, outcome, strides, here


def _close(stride_map: StrideMap) -> float:
    """Return the distance at which a walk is on a gait, or two gaits are one."""
    return 1e-5 if stride_map.exact else 1e-3


def other_attractors(
    stride_map: StrideMap, slope: float, points: NDArray, known: list[Gait]
) -> list[Gait]:
    """Return further stable gaits of any period to which walks from a slice converge.

    Args:
        stride_map: The stride map.
        slope: Slope in rad.
        points: Points of the slice, (n, m), of which a sample is used.
        known: Stable gaits already known.

    Returns:
        Gaits, those of short period first. Walks that are still unsettled or chaotic give none.
    """
    sample = points[:: max(1, len(points) // 4096)]
    roughly = stride_map.with_tolerance(_ROUGHLY)
    attractors = Attractors(roughly, known, 1e-2)
    settled, _, _, points = walk_until_settled(roughly, sample, slope, attractors, 60)
    if not np.any(settled == UNSETTLED):
        return []
    roughly = stride_map.with_tolerance(_WALKED)
    points = roughly.apply(points[settled == UNSETTLED], slope, strides=_SETTLING).ends
    points = points[np.isfinite(points[:, 0])]
    walked, here = [], points
    for _ in range(2 * _LONGEST_PERIOD):
        here = roughly.apply(here, slope).ends
        walked.append(here[:, repeating(stride_map)])
    periods = period_of(np.stack(walked, axis=1), _LONGEST_PERIOD, 1e-4)
    found: list[Gait] = []
    for period in sorted(set(periods[periods > 0].tolist())):
        left = points[periods == period]
        while len(left):
            guess = stride_map.states_at(left[:1])
            gaits = find_gaits(stride_map, slope, period=period, guess=guess)[:1]
            if not gaits:
                break
            there = Attractors(stride_map, known + found, _close(stride_map))
            new = (x for x in gaits if x.stable and there.of(x.point.values)[0] == UNSETTLED)
            found += new
            left = left[Attractors(stride_map, gaits, 1e-2).of(left) == UNSETTLED]
    return found


def _slice(
    stride_map: StrideMap, gait: Gait | None, angles: NDArray, rates: NDArray,
    ratios: tuple[float, float] | None,
) -> NDArray:  # fmt: skip
    """Return points of the section (n, m) at pairs of stance angle and angular velocity."""
    if ratios is not None:
        swing = [rates * ratio for ratio in ratios[: stride_map.dimension - 2]]
        return np.column_stack([angles, rates, *swing])
    assert gait is not None
    own = gait.point.values[0]
    if stride_map.terrain is not None and "ratios" in stride_map.walker.supports:
        return np.column_stack([angles, rates, rates[:, None] / own[1] * own[2:]])
    # Legs that differ begin on the section after a stride on the other leg.
    last = 0 if stride_map.walker.legs_alike else -1
    began = gait.state if last == 0 else gait.cycle.state[-2]
    duration = float(gait.cycle.duration[last]) / stride_map.units.time
    strides = gait.stride_map if last == 0 else gait.stride_map.swapped
    before = strides.before_strike(strides.points_at(began)[0], gait.slope, duration)
    if "ratios" not in stride_map.walker.supports:
        system: Any = stride_map.walker
        m = system.coordinates
        near = system.with_both_feet_down(gait.state[:m] * (angles / gait.state[0])[:, None])
        old = system.exchanged(near)
        if not np.allclose(system.swapped.exchanged(old), near, equal_nan=True):
            raise ValueError(
                "the slice of a basin needs legs that a second heelstrike exchanges back: "
                f"relabel of system {system.name!r} does not"
            )
        speeds = system.swapped.struck(np.hstack([old, np.tile(before[m:], (len(old), 1))]))[:, m:]
        return np.hstack([near, speeds * (rates / speeds[:, 0])[:, None]])
    stance, swing = (np.full(len(angles), rate) for rate in before[3:5])
    push_off = stride_map.actuation.push_off
    points, *_ = at_heelstrike(stride_map, angles, stance, swing, push_off)
    # The impact is linear in the angular velocities, so the result is scaled to each stance value.
    swing = points[:, 2:] * (rates / points[:, 1])[:, None]
    return np.column_stack([angles, rates, swing])


def basin_of_attraction(
    walker: MapLike,
    slope: float | None = None,
    *,
    stance_angles: ArrayLike | None = None,
    stance_rates: ArrayLike | None = None,
    resolution: int = 200,
    ratios: tuple[float, float] | None = None,
    strides: int = 300,
    atol: float = 1e-4,
    tolerance: float = 1e-8,
) -> Basin:
    """Compute the basins of attraction of a walker's gaits on a slice of the Poincaré section.

    Args:
        walker: The walker, in a form that `as_walker` takes, or a `System`; or a map of
            `stride_map`, which may have a controller. The stance angle of a system is its first
            coordinate; its other coordinates on the slice are those near the gait's at which the
            swing foot touches the ground.
        slope: Slope in rad; the map's own when None.
        stance_angles: Stance angles in rad, (n,); from near 0 to 2.2 times the long gait's if None.
        stance_rates: Stance angular velocities in the walker's own units, (m,); from 2.2 times the
            long gait's to near 0 if None.
        resolution: Number of angles and of angular velocities that are not given.
        ratios: Thigh and shank angular velocity over the stance angular velocity. If None, they
            follow from a heelstrike with the long gait's ratio of angular velocities; on a terrain
            they are those of that gait.
        strides: Strides after which a walk counts as unsettled. Here and in the result, legs or
            ground that repeat after L strides count L strides as one.
        atol: Distance from a gait, in the section's logarithmic coordinates, at which a walk has
            converged.
        tolerance: Tolerance of the integration.

    Returns:
        The `Basin`.

    Raises:
        GaitNotFound: if the walker has no gait at this slope and a default above requires one.
        ValueError: if an argument is out of range.
    """
    stride_map = map_of(walker, tolerance=check_tolerance(tolerance))
    walker, slope = stride_map.walker, stride_map.chosen(slope)
    atol = number(atol, "atol", above=0.0)
    resolution = whole(resolution, "resolution", 1, _FINEST)
    strides = whole(strides, "strides")
    if ratios is not None:
        check_supports(stride_map.walker, "ratios")
        allowed = "two numbers, thigh and shank rate over the stance rate"
        if real_array(ratios, "ratios", allowed).shape != (2,):
            raise ValueError(f"ratios must be {allowed}, not {shown(ratios)}")
    if stride_map.controlled:  # one gait is searched for
        sought = seek(stride_map, slope).gait
        known = [sought] if sought else []
    else:
        known = find_gaits(stride_map, slope)
    gait = known[0] if known else None
    if gait is None and (stance_angles is None or stance_rates is None or ratios is None):
        raise GaitNotFound(
            f"no gait of {describe(walker)} at slope {slope} rad to lay a slice through: give "
            "stance_angles, stance_rates and ratios"
        )
    share = np.linspace(_SPAN / resolution, _SPAN, resolution)
    angles = _axis(stance_angles, share * (gait.stance_angle if gait else 0.0), "stance_angles")
    if stride_map.size < 4:
        raise ValueError("the slice of a basin needs a system of two coordinates or more")
    rates = share[::-1] * (gait.state[stride_map.size // 2] if gait else 0.0)
    rates = _axis(stance_rates, rates, "stance_rates")
    _warn_of_units(stride_map, gait, rates)
    if np.any(angles <= 0.0) and stride_map.chart.balance is not None:
        raise ValueError("stance_angles must be positive: they are those just after heelstrike")
    grid = np.meshgrid(angles, rates * stride_map.units.time)
    points = _slice(stride_map, gait, grid[0].ravel(), grid[1].ravel(), ratios)
    stable = [x for x in known if x.stable]
    stable += other_attractors(stride_map, slope, points, stable)
    attractors = Attractors(stride_map, stable, atol)
    parts = []
    with progress("cells of the basin", len(points)) as walked:
        for i in range(0, len(points), _CHUNK):
            some = points[i : i + _CHUNK]
            parts.append(walk_until_settled(stride_map, some, slope, attractors, strides)[:3])
            walked(len(some))
    settled, outcome, taken = (
        np.concatenate(pieces).reshape(grid[0].shape) for pieces in zip(*parts, strict=True)
    )
    return Basin(walker, slope, angles, rates, tuple(stable), settled, outcome, taken)


def _warn_of_units(stride_map: StrideMap, gait: Gait | None, rates: NDArray) -> None:
    """Warn if the gait's rate is among the rates in units of √(g/l) only."""
    if gait is None:
        return
    rate, time = gait.state[stride_map.size // 2], stride_map.units.time
    own, plain = (rates.min() <= each <= rates.max() for each in (rate, rate * time))
    if plain and not own:
        warnings.warn(
            f"stance_rates are in the walker's own units, and the gait's is {rate:.4g}: rates of "
            f"the literature, in units of √(g/l), are to be multiplied by {1.0 / time:.4g}",
            stacklevel=3,
        )


def _axis(given: ArrayLike | None, otherwise: NDArray, name: str) -> NDArray[np.float64]:
    allowed = "one or more numbers in one row"
    values = np.atleast_1d(otherwise if given is None else real_array(given, name, allowed))
    if values.ndim != 1 or len(values) == 0:
        raise ValueError(f"{name} must be {allowed}, not of shape {values.shape}")
    return values


def narrowed(
    survived: Callable[[NDArray], NDArray], low: NDArray, high: NDArray, shares: NDArray
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int64]]:
    """Narrow down the largest disturbances that walkers survive, each with all smaller ones tried.

    Args:
        survived: Function of sizes (k, tries) that returns whether walkers survive each of them.
        low: Sizes that are survived, (k,).
        high: Sizes that are not, or the largest to be tried, (k,).
        shares: Sizes to try, as increasing shares of the way from low to high, (tries,).

    Returns:
        The new bounds, (k,) each, and the number of tries below the first failure, (k,).
    """
    sizes = low[:, None] + (high - low)[:, None] * shares
    kept = np.logical_and.accumulate(survived(sizes), axis=1)
    count, rows, last = np.count_nonzero(kept, axis=1), np.arange(len(low)), len(shares) - 1
    below = np.where(count > 0, sizes[rows, np.maximum(count - 1, 0)], low)
    above = np.where(count <= last, sizes[rows, np.minimum(count, last)], high)
    return below, above, count


def largest_push(
    walker: MapLike,
    slope: float | None = None,
    *,
    gait: Gait | None = None,
    strides: int = 300,
    accuracy: float = 1e-9,
    tolerance: float = 1e-10,
) -> VelocityPerturbations:
    """Find the largest velocity perturbation, just after heelstrike, that a gait withstands.

    A perturbation changes the stance leg's angular velocity. 512 perturbations are tried at a time,
    all smaller than the smallest failure so far. When only the largest one fails, the limit is
    narrowed down.

    Args:
        walker: The walker, in a form that `as_walker` takes; or a map of `stride_map`, which may
            have a controller.
        slope: Slope in rad; the map's own when None.
        gait: The gait that is perturbed; if None, `walker` if it is a `Gait`, else the long-step
            gait.
        strides: A gait withstands a perturbation if the walker makes so many strides after it, or
            returns to the gait before that. Legs or ground that repeat after L strides count L
            strides as one.
        accuracy: Accuracy relative to the gait's stance angular velocity, at least 1e-15, which is
            about the precision of the numbers.
        tolerance: Tolerance of the integration.

    Returns:
        The largest changes, in the walker's own units; 0 if the gait withstands none.

    Raises:
        GaitNotFound: if there is no gait to perturb.
        ValueError: if an argument is out of range, or the gait is none of the walker at the slope.
    """
    stride_map = map_of(walker, tolerance=check_tolerance(tolerance))
    slope, strides = stride_map.chosen(slope), whole(strides, "strides")
    accuracy = number(accuracy, "accuracy", least=_FINEST_PUSH, most=1.0)
    if gait is None:
        gait = walker if isinstance(walker, Gait) else find_gait(stride_map, slope)
    instance(gait, Gait, "gait", "gpw.find_gait returns")
    attractors = Attractors(stride_map, [gait] if gait.stable else [], _close(stride_map))
    start = stride_map.points_at(gait.state)
    repeated = stride_map.apply(start, slope, strides=gait.period).ends
    if not np.abs(repeated - start).max() < _close(stride_map):
        raise ValueError(
            f"gait must be one of this walker at slope {slope:g} rad, under the same controller "
            "and on the same ground: its strides do not repeat there"
        )
    rate = stride_map.chart.coordinates.index(stride_map.size // 2)  # the stance leg's
    size = abs(float(start[0, rate]))

    share = np.arange(1, _PUSHES + 1) / _PUSHES

    def limit(direction: float) -> float:
        def survived(changes: NDArray) -> NDArray[np.bool_]:
            points = np.repeat(start, changes.size, axis=0)
            points[:, rate] += direction * changes[0]
            settled = walk_until_settled(stride_map, points, slope, attractors, strides)[0]
            return (settled != FELL)[None]

        high, count = np.array([3.0 * size]), 0
        while count < _PUSHES - 1:  # a basin's edge may be ragged: try smaller ones
            low, high, count = narrowed(survived, np.zeros(1), high, share)
            if count == _PUSHES:
                return np.inf
            if high < accuracy * size:
                return 0.0
        while high - low > accuracy * size:
            between, high, count = narrowed(survived, low, high, share)
            if count == _PUSHES:  # the limit is within rounding of the last one
                break
            low = between
        return float(low[0])

    # The stance leg's angular velocity is negative when it falls forward.
    time = stride_map.units.time
    with progress("ways to push", 2) as pushed:
        forward = limit(-1.0) / time
        pushed()
        return VelocityPerturbations(forward, limit(1.0) / time, stride_map.walker)
