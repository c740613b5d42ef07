"""Families of gaits: how a gait changes with slope, or with the walker, to where it ends."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gym_passive_walker.arguments import gait_kind, instance, number, one_slope, shown
from gym_passive_walker.gaits.continuation import follow
from gym_passive_walker.gaits.curve import Axis, Curve, Point, locate
from gym_passive_walker.gaits.drive import PASSIVE, Drive, drive_units, one_drive
from gym_passive_walker.gaits.ends import BOUND, STANCE_STOPS, End, margins
from gym_passive_walker.gaits.fixed_point import find_gait
from gym_passive_walker.gaits.gait import Gait, GaitKind, GaitNotFound, multipliers_of
from gym_passive_walker.gaits.log_chart import logarithms
from gym_passive_walker.gaits.search import glance, seek
from gym_passive_walker.gaits.stride_map import StrideMap
from gym_passive_walker.shown import Table
from gym_passive_walker.units import units_of
from gym_passive_walker.walkers import (
    PARAMETERS,
    Walker,
    WalkerLike,
    as_walker,
    describe,
    name_of,
)

_TOLERANCE = 1e-12
_FINEST = 1e-3  # resolution
_WIDEST = 1e6  # of a range, over what the walker has there


@dataclass(frozen=True, repr=False)
class GaitFamily(Table):
    """A curve of gaits, in order along the curve; arrays have one entry per gait.

    Attributes:
        walker: Who walks (at the first gait, if a parameter of the walker is varied).
        parameter: "slope", or the part of the drive or the walker's parameter that is varied.
        period: Strides until each motion repeats.
        value: The varied quantity.
        slope: Slope in rad.
        state: Section states, shape (n, 6), in the walker's own units.
        stance_angle: rad.
        step_period: Mean over the period, in the walker's units of time.
        step_length: Mean over the period, along the slope.
        multipliers: Shape (n, m), largest modulus first.
        folds: Values of the varied quantity where the family turns back.
        period_doublings: Values where a multiplier passes -1.
        halts: Values where the stance leg stops in mid-stride, to about 1e-5 of them. On one side
            of each it barely passes the vertical; on the other it turns back for a while first.
        ends: The first and the last gait's end of the curve, with the reason of each.
        drive: What motors do, but for what is varied.
    """

    walker: Walker
    parameter: str
    period: int
    value: NDArray[np.float64]
    slope: NDArray[np.float64]
    state: NDArray[np.float64]
    stance_angle: NDArray[np.float64]
    step_period: NDArray[np.float64]
    step_length: NDArray[np.float64]
    multipliers: NDArray[np.complex128]
    folds: tuple[float, ...]
    period_doublings: tuple[float, ...]
    halts: tuple[float, ...]
    ends: tuple[End, End]
    drive: Drive = PASSIVE

    @property
    def speed(self) -> NDArray[np.float64]:
        """Speed along the slope."""
        return self.step_length / self.step_period

    @property
    def froude_speed(self) -> NDArray[np.float64]:
        """Speed over sqrt(g l) of `walker`."""
        return self.speed / units_of(self.walker).speed

    @property
    def stable(self) -> NDArray[np.bool_]:
        """Whether each gait is stable."""
        return np.abs(self.multipliers[:, 0]) < 1.0

    def __len__(self) -> int:
        return len(self.value)

    def facts(self) -> dict[str, str]:
        """From where to where it leads, and what happens on the way."""
        marks = {
            "folds": self.folds, "period doublings": self.period_doublings, "halts": self.halts
        }  # fmt: skip
        return {
            "walker": name_of(self.walker),
            "gaits": f"{len(self)} of period {self.period}, {self.stable.sum()} stable",
            self.parameter: f"{self.value.min():.6g} to {self.value.max():.6g}",
            **{name: ", ".join(f"{x:.6g}" for x in at) for name, at in marks.items() if at},
            "ends": " and ".join(f"at {value:.6g} ({reason})" for value, reason in self.ends),
        }

    def columns(self) -> dict[str, NDArray]:
        """A row for each gait, in order along the curve."""
        varied = {} if self.parameter == "slope" else {self.parameter: self.value}
        return varied | {
            "slope": self.slope,
            "stance_angle": self.stance_angle,
            "stance_rate": self.state[:, 3],
            "thigh_rate": self.state[:, 4],
            "shank_rate": self.state[:, 5],
            "step_length": self.step_length,
            "step_period": self.step_period,
            "speed": self.speed,
            "froude_speed": self.froude_speed,
            "largest_multiplier": np.abs(self.multipliers[:, 0]),
            "stable": self.stable,
        }


def _family(
    walker: Walker,
    axis: Axis,
    gait: Gait,
    value: float,
    bounds: tuple[float, float],
    resolution: float,
) -> GaitFamily:
    """The family of a gait at a value of what is varied, both ways from it."""
    period = gait.period
    curve = Curve(StrideMap.of(walker, tolerance=_TOLERANCE, drive=gait.drive), axis, period)
    u = logarithms(StrideMap.of(gait.walker).points_at(gait.state))[0]
    start = curve.correct(np.append(u, axis.coordinate(value)))
    if start is None:
        raise GaitNotFound(f"the gait of {describe(walker)} at {value} could not be followed")
    low, high = (axis.coordinate(bound) for bound in bounds)
    up = follow(curve, start, low, high, resolution)
    down = follow(curve, start._replace(tangent=-start.tangent), low, high, resolution)
    along = down.points[:0:-1] + up.points
    stride_map, points, slopes, values = curve.gaits_at(along)
    passage, units = stride_map.apply(points, slopes, strides=period), stride_map.units
    halts, ends = _halts(curve, along, (down.end, up.end))
    return GaitFamily(
        walker=walker,
        parameter=axis.parameter,
        period=period,
        value=values,
        slope=slopes,
        state=stride_map.states_at(points),
        stance_angle=points[:, 0],
        step_period=passage.durations / period * units.time,
        step_length=passage.lengths / period * units.length,
        multipliers=np.array([multipliers_of(point.map) for point in along]),
        folds=tuple(sorted(down.folds + up.folds)),
        period_doublings=tuple(sorted(down.doublings + up.doublings)),
        halts=halts,
        ends=ends,
        drive=gait.drive,
    )


def _halts(
    curve: Curve, points: list[Point], ends: tuple[End, End]
) -> tuple[tuple[float, ...], tuple[End, End]]:
    """Where the stance leg stops in mid-stride, and the ends, said to lie beyond if they do."""

    def pace(points: list[Point]) -> NDArray:
        gaits = curve.gaits_at(points)
        return margins(gaits.stride_map, gaits.points, gaits.slopes, curve.period).pace

    paces = pace(points)
    halts = []
    for i in np.flatnonzero(paces[:-1] * paces[1:] < 0.0):
        located = locate(curve, points[i], points[i + 1], lambda point: float(pace([point])[0]))
        if located:
            halts.append(curve.value_at(located))

    def said(end: End, turned: bool, halt: float) -> End:
        beyond = turned and end.reason != BOUND
        return end._replace(reason=f"{end.reason}; {STANCE_STOPS} at {halt:.6g}") if beyond else end

    if halts:
        ends = (said(ends[0], paces[0] < 0.0, halts[0]), said(ends[1], paces[-1] < 0.0, halts[-1]))
    return tuple(halts), ends


def _some_gait(walker: Walker, slopes: NDArray, kind: GaitKind, drive: Drive) -> Gait:
    """The gait at the lowest of some slopes that has one; searched thoroughly only if need be."""
    for slope in slopes.tolist():
        gait = glance(walker, slope, kind, drive)
        if gait is not None:
            return gait
    for slope in slopes[::4].tolist():
        gait = seek(walker, slope, kind, drive=drive).gait
        if gait is not None:
            return gait
    driven = "" if drive.passive else f" with {drive}"
    raise GaitNotFound(
        f"no {kind}-step gait of {describe(walker)}{driven} at any of {len(slopes)} slopes from "
        f"{min(slopes):.3g} to {max(slopes):.3g} rad"
    )


def gait_family(
    walker: WalkerLike,
    slope_min: float,
    slope_max: float,
    kind: GaitKind = "long",
    *,
    start: Gait | None = None,
    resolution: float = 0.05,
    drive: Drive = PASSIVE,
) -> GaitFamily:
    """Follow a gait over slopes, through folds and to its ends.

    Begins at the lowest slope of the range where such a gait is found. Some walkers have further
    gaits at steep slopes on a curve of their own: reach those with another `slope_min`.

    Args:
        walker: The walker, in a form that `as_walker` takes.
        slope_min: Lowest slope in rad; positive, unless motors drive the walker.
        slope_max: Highest slope in rad.
        kind: Which gait to begin with, "long" or "short".
        start: A gait to begin with instead; of any period.
        resolution: Longest step along the curve, in ln(angle), rates over angle and ln(slope); of a
            range that is not all downhill, in shares of it.
        drive: What motors do in each stride, at all slopes alike; that of `start`, if there is one.

    Returns:
        The family: both directions from the gait it began with, in order along the curve.

    Raises:
        GaitNotFound: if no gait to begin with is found in the range.
    """
    walker = as_walker(walker)
    low, high = one_slope(slope_min, "slope_min"), one_slope(slope_max, "slope_max")
    kind = gait_kind(kind)
    resolution = number(resolution, "resolution", least=_FINEST, most=1.0)
    if start is not None:
        drive = instance(start, Gait, "start", "gpw.find_gait returns").drive
    drive = one_drive(walker, drive)
    if not low < high or (low <= 0.0 and drive.passive):
        raise ValueError(
            f"slopes must be 0 < slope_min < slope_max, not {slope_min}, {slope_max}; only motors "
            "(drive=) walk uphill"
        )
    if start is None:
        slopes = np.geomspace(low, high, 16) if low > 0.0 else np.linspace(low, high, 16)
        start = _some_gait(walker, slopes, kind, drive)
    elif not low <= start.slope <= high:
        raise ValueError(f"the gait to start with stands at slope {start.slope}, out of the range")
    return _family(walker, Axis("slope", low, high), start, start.slope, (low, high), resolution)


def _size(walker: Walker, parameter: str) -> float:
    """What a parameter of a walker or of its drive is measured by, in the walker's own units."""
    units = units_of(walker)
    if parameter in Drive._fields:
        return float(getattr(drive_units(units), parameter))
    mass, springs = walker.total_mass, ("hip_stiffness", "knee_stiffness", "hip_friction")
    sizes = dict.fromkeys(springs, units.torque) | {"foot_angle": 1.0, "gravity": walker.gravity}
    return sizes.get(parameter, mass if parameter.endswith("mass") else units.length)


def parameter_family(
    walker: WalkerLike,
    parameter: str,
    low: float,
    high: float,
    *,
    slope: float,
    kind: GaitKind = "long",
    resolution: float = 0.05,
    drive: Drive = PASSIVE,
) -> GaitFamily:
    """Follow a gait at a fixed slope as a parameter of the walker or of its drive changes.

    Args:
        walker: The walker to begin with; its own parameter must lie in the range.
        parameter: A numerical parameter of `Walker`, such as "shank_offset", or of `Drive`, such as
            "push_off".
        low: Lowest value.
        high: Highest value.
        slope: Slope in rad.
        kind: Which gait to begin with.
        resolution: Longest step along the curve; the range counts as one.
        drive: What motors do in each stride. As a parameter of the walker changes, it stays what it
            is over the walker's units, which change with sizes and masses.

    Raises:
        GaitNotFound: if the walker has no such gait at this slope.
        ValueError: if there is no such parameter, or the range is empty or leaves it out.
    """
    walker = as_walker(walker)
    slope, resolution = one_slope(slope), number(resolution, "resolution", least=_FINEST, most=1.0)
    low, high = number(low, "low"), number(high, "high")
    kind = gait_kind(kind)
    known = (*PARAMETERS, *Drive._fields)
    if not isinstance(parameter, str) or parameter not in known:
        raise ValueError(f"no parameter {shown(parameter)} to vary: choose from {', '.join(known)}")
    drive, driven = one_drive(walker, drive), parameter in Drive._fields
    here = getattr(drive if driven else walker, parameter)
    if not low < high or not low <= here <= high:
        raise ValueError(f"{parameter} of this walker is {here}: give low <= {here} <= high")
    size = max(abs(here), _size(walker, parameter))
    if not high - low <= _WIDEST * size:
        raise ValueError(
            f"high is too far from low: of {parameter} of this walker, a range may be "
            f"{_WIDEST * size:g} wide, not {high - low:g}"
        )
    for value in (low, high):
        try:
            if driven:
                one_drive(walker, drive._replace(**{parameter: value}))
            else:
                replace(walker, **{parameter: value})
        except ValueError as error:
            raise ValueError(f"the range leaves what a walker can be: {error}") from error
    start = find_gait(walker, slope, kind, drive=drive)
    unit = getattr(drive_units(units_of(walker)), parameter) if driven else 1.0
    axis = Axis(parameter, low, high, slope, unit)
    return _family(walker, axis, start, here, (low, high), resolution)
