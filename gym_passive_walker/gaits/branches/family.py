"""Families of gaits: how a gait changes with slope, or with the walker, to where it ends."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import chain
from typing import Any, overload

import numpy as np
from numpy.typing import NDArray

from gym_passive_walker._tools.arguments import gait_kind, instance, number, one_slope, shown
from gym_passive_walker._tools.shown import Table
from gym_passive_walker.gaits.actuation import Actuation, one_actuation
from gym_passive_walker.gaits.branches.continuation import (
    BOUND,
    CLOSED_CURVE,
    STANCE_STOPS,
    Axis,
    Branch,
    Curve,
    End,
    Point,
    follow_branch,
    locate,
    margins,
)
from gym_passive_walker.gaits.branches.sensitivity import size_of
from gym_passive_walker.gaits.branches.varied_map import MapOfValue, map_at
from gym_passive_walker.gaits.find.fixed_point import find_gait
from gym_passive_walker.gaits.find.search import seek
from gym_passive_walker.gaits.gait import (
    Gait,
    GaitKind,
    GaitNotFound,
    gait_at,
    multiplier_columns,
    multipliers_of,
    state_columns,
    step_kind,
)
from gym_passive_walker.gaits.measures import InUnits, StrideQuantities
from gym_passive_walker.gaits.stride_map import MapLike, StrideMap, map_of
from gym_passive_walker.models.model import check_row
from gym_passive_walker.models.units import Units
from gym_passive_walker.models.walkers import Walker, describe, name_of

TOLERANCE = 1e-12
"""Of the integration, in which families are followed."""

FINEST = 1e-3
"""Least resolution."""
_WIDEST = 1e6  # of a range, over what the walker has there
_TRIED = 9  # values of a function's parameter at which a gait to begin with is sought


@dataclass(frozen=True, repr=False)
class GaitFamily(InUnits, Table):
    """A curve of gaits, in order along the curve; arrays have one entry per gait.

    It is also a sequence of gaits: ``family[3]``, ``family[-5:]``, ``for gait in family``. Each is
    made when it is asked for, with all that `find_gait` reports.

    Attributes:
        walker: The walker (at the first gait, if a parameter of the walker is varied).
        period: Strides until each motion repeats.
        value: Varied quantity, in the walker's own units, (n,).
        slope: Slope in rad, (n,).
        state: States on the Poincaré section, (n, 6), in the walker's own units.
        stance_angle: Stance angle in rad just after heelstrike, (n,).
        step_period: Mean over the period, in the walker's units of time.
        step_length: Mean over the period, along the slope.
        cost_of_transport: Energy spent over weight and distance, as that of a `Gait`, (n,).
        multipliers: Floquet multipliers (n, m), largest modulus first.
        folds: Values of the varied quantity where the family turns back.
        period_doublings: Values where a multiplier passes -1.
        neimark_sackers: Values where a complex pair of multipliers crosses the unit circle.
        halts: Values where the stance leg stops in mid-stride, to about 1e-5 of them. On one side
            of each it barely passes the vertical; on the other it turns back for a while first.
        ends: The first and the last gait's end of the curve, with the reason of each. On a closed
            curve the last gait is the first.
        stride_map: The stride map, apart from the varied quantity.
        axis: The varied quantity and its range.
    """

    walker: Walker
    period: int
    value: NDArray[np.float64]
    slope: NDArray[np.float64]
    state: NDArray[np.float64]
    stance_angle: NDArray[np.float64]
    step_period: NDArray[np.float64]
    step_length: NDArray[np.float64]
    cost_of_transport: NDArray[np.float64]
    multipliers: NDArray[np.complex128]
    folds: tuple[float, ...]
    period_doublings: tuple[float, ...]
    neimark_sackers: tuple[float, ...]
    halts: tuple[float, ...]
    ends: tuple[End, End]
    stride_map: StrideMap
    axis: Axis

    @property
    def parameter(self) -> str:
        """The quantity that is varied.

        "slope", a part of `Actuation`, a parameter of the walker, or the name of what a function
        varies.
        """
        return self.axis.parameter

    @property
    def controller(self) -> Any:
        """The controller, apart from a varied part; None if passive."""
        return self.stride_map.controller

    speed = StrideQuantities.speed
    froude_speed = StrideQuantities.froude_speed

    @property
    def units(self) -> Any:
        """Dimensionless units of each gait's walker, in the walker's own."""
        if self.axis.make is not None:
            return Units(*np.array([each.units for each in self._walkers]).T)  # type: ignore[arg-type]
        varied = self.parameter in self.walker.parameters
        return self.walker.units_with(**{self.parameter: self.value} if varied else {})

    @cached_property
    def _walkers(self) -> list[Any]:
        """The walker of each gait."""
        setting, own = self.axis.setting, self.stride_map
        return [setting(own, value)[0].walker for value in self.value.tolist()]

    @property
    def kind(self) -> NDArray[Any]:
        """Kind of each gait, "long" or "short", as that of a `Gait`, (n,)."""
        periods = self.step_period / np.broadcast_to(self.units.time, len(self))
        each = zip(self._walkers, self.multipliers, periods, strict=True)
        return np.array([step_kind(*gait) for gait in each])

    @property
    def stable(self) -> NDArray[np.bool_]:
        """Whether each gait is stable."""
        return np.abs(self.multipliers[:, 0]) < 1.0

    def __len__(self) -> int:
        return len(self.value)

    @overload
    def __getitem__(self, index: int) -> Gait: ...

    @overload
    def __getitem__(self, index: slice) -> list[Gait]: ...

    def __getitem__(self, index: int | slice) -> Gait | list[Gait]:
        count = len(self)
        if isinstance(index, slice):
            return [self[i] for i in range(count)[index]]
        try:
            i = range(count)[index]
        except IndexError:
            raise IndexError(
                f"this family has {count} gaits: family[i] takes i from {-count} to {count - 1}, "
                f"not {index}"
            ) from None
        except TypeError:
            raise TypeError(
                "family[i] takes a whole number or a slice; family.at(value) finds the gaits at a "
                f"value of {self.parameter}, not {shown(index)}"
            ) from None
        return self._gait(self.value[i], self.state[i])

    def __iter__(self) -> Iterator[Gait]:
        return (self[i] for i in range(len(self)))

    def at(self, value: float) -> list[Gait]:
        """Find the gaits of the family at a value of the varied quantity, in order along the curve.

        Beyond a fold there are two or more.

        Args:
            value: The value, such as a slope in rad.

        Raises:
            GaitNotFound: if the family has none there.
        """
        value = number(value, self.parameter)
        ends = np.array([self.value.min(), self.value.max()])
        # The ends are those of the range that was asked for, but for rounding.
        if np.any(at_end := np.isclose(ends, value, rtol=1e-12, atol=0.0)):
            value = float(ends[at_end][0])
        passed, states = states_between(self, value)
        once = self.value[passed + 1] != value
        if self.ends[1].reason != CLOSED_CURVE:  # there the last gait is the first
            once |= passed == len(self) - 2
        if len(passed) == 0:
            reach = min(*ends, *self.folds), max(*ends, *self.folds)
            low, high = (f"{end:.12g}{' (a fold)' * (end in self.folds)}" for end in reach)
            raise GaitNotFound(
                f"no gait of this family at {self.parameter} {value:g}: it reaches from {low} to "
                f"{high}"
            )
        return [self._gait(value, state) for state in states[once]]

    def _gait(self, value: float, state: NDArray) -> Gait:
        """Return the gait at a value, near a state.

        Raises:
            GaitNotFound: if there is none near.
        """
        curve = Curve(self.stride_map.with_tolerance(TOLERANCE), self.axis, self.period)
        there, slope = self.axis.setting(curve.stride_map, float(value))
        guess = there.points(state[None]).search[0]
        found = curve.correct(np.append(guess, self.axis.coordinate(value)))
        if found is None:
            raise GaitNotFound(
                f"no gait near those of this family beside {self.parameter} {value:g}: follow it "
                "again with a smaller resolution"
            )
        return gait_at(there.searched(found.y[None, :-1]), slope, self.period)

    def facts(self) -> dict[str, str]:
        """Range of the family, its bifurcations and its ends."""
        marks = {
            "folds": self.folds,
            "period doublings": self.period_doublings,
            "Neimark-Sacker bifurcations": self.neimark_sackers,
            "halts": self.halts,
        }
        name = self.stride_map.controller_name
        return {
            **({"controller": name} if name else {}),
            "walker": name_of(self.walker),
            "gaits": f"{len(self)} of period {self.period}, {self.stable.sum()} stable",
            self.parameter: f"{self.value.min():.6g} to {self.value.max():.6g}"
            + " rad" * (self.parameter == "slope"),
            **{name: ", ".join(f"{x:.6g}" for x in at) for name, at in marks.items() if at},
            "ends": CLOSED_CURVE
            if self.ends[0].reason == CLOSED_CURVE
            else " and ".join(f"at {value:.6g} ({reason})" for value, reason in self.ends),
        }

    def columns(self) -> dict[str, NDArray]:
        """A row for each gait, in order along the curve."""
        return {
            self.parameter: self.value,
            "slope": self.slope,
            "kind": self.kind,
            **state_columns(self.walker, self.state),
            "step_length": self.step_length,
            "step_period": self.step_period,
            "speed": self.speed,
            "froude_speed": self.froude_speed,
            "cost_of_transport": self.cost_of_transport,
            "largest_multiplier": np.abs(self.multipliers[:, 0]),
            **multiplier_columns(self.multipliers),
            "stable": self.stable,
        }


def states_between(family: GaitFamily, value: float) -> tuple[NDArray, NDArray]:
    """Return the places where a family passes a value, and the states there, by interpolation.

    Returns:
        Numbers of the gaits before, (n,), and states, (n, 6) for a `Walker`.
    """
    here, there = family.value[:-1], family.value[1:]
    low, high = np.minimum(here, there), np.maximum(here, there)
    passed = np.flatnonzero((low <= value) & (value <= high) & (low < high))
    share = (value - here[passed]) / (there[passed] - here[passed])
    first, second = family.state[passed], family.state[passed + 1]
    return passed, first + share[:, None] * (second - first)


def _family(
    stride_map: StrideMap, axis: Axis, gait: Gait, value: float, resolution: float
) -> GaitFamily:
    """Return the family of a gait, followed in both directions from a value."""
    period, walker = gait.period, stride_map.walker
    curve = Curve(stride_map.with_tolerance(TOLERANCE), axis, period)
    start = curve.correct(np.append(gait.point.search[0], axis.coordinate(value)))
    if start is None:
        raise GaitNotFound(f"the gait of {describe(walker)} at {value} could not be followed")
    up = follow_branch(curve, start, resolution)
    if up.end.reason == CLOSED_CURVE:
        down = Branch([start], [], [], [], up.end)
    else:
        down = follow_branch(curve, start._replace(tangent=-start.tangent), resolution)
    along = down.points[:0:-1] + up.points
    there, points, slopes, values = curve.gaits_at(along)
    passage, units = there.apply(points, slopes, strides=period), there.units
    strides = period * len(stride_map.ground)
    # The losses keep their digits at small slopes.
    spent = passage.lost if there.passive else passage.supplied + passage.braked
    halts, ends = _halts(curve, along, (down.end, up.end))
    return GaitFamily(
        walker=walker,
        period=period,
        value=values,
        slope=slopes,
        state=there.states_at(points),
        stance_angle=points[:, 0],
        step_period=passage.durations / strides * units.time,
        step_length=passage.lengths / strides * units.length,
        cost_of_transport=spent / (there.weights * passage.lengths),
        multipliers=np.array([multipliers_of(point.map) for point in along]),
        folds=tuple(sorted(down.folds + up.folds)),
        period_doublings=tuple(sorted(down.doublings + up.doublings)),
        neimark_sackers=tuple(sorted(down.torus + up.torus)),
        halts=halts,
        ends=ends,
        stride_map=stride_map,
        axis=axis,
    )


def _halts(
    curve: Curve, points: list[Point], ends: tuple[End, End]
) -> tuple[tuple[float, ...], tuple[End, End]]:
    """Return the halts of the stance leg, and the ends with a note on halts before them."""

    def pace(point: Point) -> float:
        return float(margins(curve, [point]).pace[0])

    if "contact margins" not in curve.stride_map.walker.supports:
        return (), ends
    paces = margins(curve, points).pace
    halts = []
    for i in np.flatnonzero(paces[:-1] * paces[1:] < 0.0):
        located = locate(curve, points[i], points[i + 1], pace)
        if located:
            halts.append(curve.value_at(located))

    def said(end: End, turned: bool, halt: float) -> End:
        beyond = turned and end.reason != BOUND
        return end._replace(reason=f"{end.reason}; {STANCE_STOPS} at {halt:.6g}") if beyond else end

    if halts:
        ends = (said(ends[0], paces[0] < 0.0, halts[0]), said(ends[1], paces[-1] < 0.0, halts[-1]))
    return tuple(halts), ends


def _some_gait(stride_map: StrideMap, slopes: NDArray, kind: GaitKind) -> Gait:
    """Return the gait at the lowest of some slopes that has one; quick searches come first.

    A quick search for a gait of no kind may end at another gait than `find_gait`.
    """
    quick = (seek(stride_map, slope, kind, quick=True).gait for slope in slopes.tolist())
    thorough = (seek(stride_map, slope, kind).gait for slope in slopes[::4].tolist())
    kinds = "step kinds" in stride_map.walker.supports
    for gait in chain(quick, thorough) if kinds else thorough:
        if gait is not None:
            return gait
    name = stride_map.controller_name
    raise GaitNotFound(
        f"no {kind}-step gait of {describe(stride_map.walker)}{f' under {name}' if name else ''} "
        f"at any of {len(slopes)} slopes from {min(slopes):.3g} to {max(slopes):.3g} rad"
    )


def gait_family(
    walker: MapLike,
    slope_min: float,
    slope_max: float,
    kind: GaitKind = "long",
    *,
    start: Gait | None = None,
    resolution: float = 0.05,
) -> GaitFamily:
    """Follow a gait over slopes, through folds and to its ends, by numerical continuation.

    Begins at the lowest slope of the range where such a gait is found. Some walkers have further
    gaits at steep slopes on a curve of their own: reach those with another `slope_min`. Under a
    controller it begins at the map's own slope, if that lies in the range and has a gait.

    Args:
        walker: The walker, in a form that `as_walker` takes; or a map of `stride_map`. Its
            controller then acts at all slopes.
        slope_min: Lowest slope in rad; positive, unless motors drive the walker.
        slope_max: Highest slope in rad.
        kind: Gait to begin with, "long" or "short".
        start: Gait to begin with instead, of any period and with its own controller.
        resolution: Longest step along the curve, in ln(angle), rates over angle and ln(slope); of a
            range that is not all downhill, in shares of it.

    Returns:
        The family: both directions from the gait it began with, in order along the curve.

    Raises:
        GaitNotFound: if no gait to begin with is found in the range.
    """
    stride_map = map_of(walker, tolerance=TOLERANCE)
    low, high = one_slope(slope_min, "slope_min"), one_slope(slope_max, "slope_max")
    kind = gait_kind(kind)
    resolution = number(resolution, "resolution", least=FINEST, most=1.0)
    if start is not None:
        own = instance(start, Gait, "start", "gpw.find_gait returns").stride_map
        stride_map = own.with_walker(stride_map.walker)
    uphill = not stride_map.passive or stride_map.terrain is not None
    if not low < high or (low <= 0.0 and not uphill):
        raise ValueError(
            f"slopes must be 0 < slope_min < slope_max, not {slope_min}, {slope_max}; only motors "
            "walk uphill: give stride_map(walker, controller=...)"
        )
    if start is None:
        slopes = np.geomspace(low, high, 16) if low > 0.0 else np.linspace(low, high, 16)
        home = stride_map.slope if stride_map.controlled else None  # where a controller is at home
        if home is not None and low <= home <= high:
            slopes = np.append(home, slopes)
        start = _some_gait(stride_map, slopes, kind)
    elif not low <= start.slope <= high:
        raise ValueError(f"the gait to start with stands at slope {start.slope}, out of the range")
    return _family(stride_map, Axis("slope", low, high), start, start.slope, resolution)


def parameter_family(
    walker: MapLike | MapOfValue,
    parameter: str,
    low: float,
    high: float,
    *,
    slope: float | None = None,
    kind: GaitKind = "long",
    resolution: float = 0.05,
) -> GaitFamily:
    """Follow a gait as a parameter of the walker, its controller, its slope or its ground changes.

    Example:
        >>> import gym_passive_walker as gpw
        >>> def downstairs(height):
        ...     return gpw.stride_map("lab", 0.036, terrain=gpw.stairs(-height))
        >>> family = gpw.parameter_family(downstairs, "height", 0.001, 0.005)
        >>> len(family) > 5
        True

    Args:
        walker: The walker to begin with, or a map of `stride_map`; its own parameter must lie in
            the range. As a parameter of the walker changes, what its motors do stays what it is
            over the walker's units, which change with sizes and masses. Or a function from a value
            to a stride map, for any other parameter: a controller's gain, a command, terrain, or
            several parameters at once. The family then begins at the lowest value of nine that has
            a gait, and derivatives by the parameter are central differences.
        parameter: A numerical parameter of `Walker`, such as "shank_offset", or of `Actuation`,
            such as "push_off"; or "slope", in rad, for the family of `gait_family`. Of a function,
            any name.
        low: Lowest value.
        high: Highest value.
        slope: Slope in rad; the map's own when None. Where "slope" varies, the slope of the gait
            to begin with.
        kind: Gait to begin with, "long" or "short".
        resolution: Longest step along the curve; the range counts as one.

    Raises:
        GaitNotFound: if the walker has no such gait at this slope.
        ValueError: if there is no such parameter, or the range is empty or leaves it out; or if a
            function does not return a stride map.
    """
    resolution = number(resolution, "resolution", least=FINEST, most=1.0)
    kind = gait_kind(kind)
    if parameter == "slope" and not callable(walker):
        low, high = one_slope(low, "low"), one_slope(high, "high")
        start = None if slope is None else find_gait(walker, slope, kind)
        return gait_family(walker, low, high, kind, start=start, resolution=resolution)
    stride_map, axis = axis_of(walker, parameter, low, high, slope)
    if axis.make is not None:
        return _made_family(stride_map, axis, kind, resolution)
    here = stride_map.parameters[parameter]
    if not axis.low <= here <= axis.high:
        raise ValueError(f"{parameter} of this walker is {here}: give low <= {here} <= high")
    return _family(stride_map, axis, find_gait(stride_map, axis.slope, kind), here, resolution)


def axis_of(
    walker: MapLike | MapOfValue,
    parameter: str,
    low: float,
    high: float,
    slope: float | None = None,
    *,
    tolerance: float = TOLERANCE,
) -> tuple[StrideMap, Axis]:
    """Return a stride map and what varies in it, from the arguments of `parameter_family`.

    Raises:
        ValueError: if there is no such parameter, or a walker cannot have its lowest or its highest
            value.
    """
    if callable(walker):
        low, high = number(low, "low"), number(high, "high")
        if not isinstance(parameter, str) or parameter in ("", "slope", "point", "state"):
            raise ValueError(
                "parameter must be a name for what the function varies, other than 'slope', "
                f"'point' and 'state', not {shown(parameter)}"
            )
        if not low < high:
            raise ValueError(f"give low < high, not {low:g} and {high:g}")
        slope = None if slope is None else one_slope(slope)
        there = map_at(walker, parameter, low, tolerance)
        return there, Axis(parameter, low, high, slope, make=walker)
    stride_map = map_of(walker, tolerance=tolerance)
    if parameter == "slope":
        return stride_map, Axis("slope", one_slope(low, "low"), one_slope(high, "high"))
    known = stride_map.parameters
    if not isinstance(parameter, str) or parameter not in known:
        choices = ", ".join(("slope", *known))
        raise ValueError(f"no parameter {shown(parameter)} to vary: choose from {choices}")
    slope, here = stride_map.chosen(slope), known[parameter]
    low, high = number(low, "low"), number(high, "high")
    if not low < high:
        raise ValueError(f"give low < high, not {low:g} and {high:g}")
    own = parameter in stride_map.walker.parameters
    unit = stride_map.unit(parameter)
    size = max(abs(here), size_of(parameter, stride_map.walker, slope) if own else unit)
    if not high - low <= _WIDEST * size:
        raise ValueError(
            f"high is too far from low: of {parameter} of this walker, a range may be "
            f"{_WIDEST * size:g} wide, not {high - low:g}"
        )
    for value in (low, high):
        try:
            if own:
                there = check_row(stride_map.walker, (parameter,), (value,))
                if isinstance(stride_map.controller, Actuation):
                    one_actuation(there, stride_map.controller)
            else:
                held = stride_map.controller or Actuation()
                one_actuation(stride_map.walker, held._replace(**{parameter: value}))
        except ValueError as error:
            raise ValueError(f"the range leaves what a walker can be: {error}") from error
    return stride_map, Axis(parameter, low, high, slope, unit)


def _made_family(
    stride_map: StrideMap, axis: Axis, kind: GaitKind, resolution: float
) -> GaitFamily:
    """Return the family of the maps that a function returns, see `parameter_family`."""
    for value in np.linspace(axis.low, axis.high, _TRIED).tolist():
        there, slope = axis.setting(stride_map, value)
        gait = seek(there, slope, kind).gait
        if gait is not None:
            return _family(there, axis, gait, value, resolution)
    raise GaitNotFound(
        f"no {kind}-step gait at any of {_TRIED} values from {axis.low:g} to {axis.high:g}"
    )
