"""Periodic gaits (limit cycles): their measures, and the equations that they solve."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker._tools.shown import Table
from gym_passive_walker.gaits.map_result import Change, Passage
from gym_passive_walker.gaits.measures import MEASURES, Measured, in_words
from gym_passive_walker.gaits.section import Points
from gym_passive_walker.gaits.stride import Stride, one_of, together
from gym_passive_walker.gaits.stride_map import StrideMap
from gym_passive_walker.models.walkers import Walker, name_of

GaitKind = Literal["long", "short"]

_EXACT = 1e-13  # tolerance of the integration when gaits are measured


class GaitNotFound(Exception):
    """There is no such gait; the message names walker, slope and the search."""


@dataclass(frozen=True, repr=False)
class Gait(Measured, Table):
    """A periodic gait (limit cycle), passive or under a controller, in the walker's own units.

    Its step length, speed, energies and costs are those of `gaits.measures.MEASURES`: means over
    the strides of one period. `dimensionless` has the same attributes.

    Attributes:
        stride_map: The stride map of which this gait is a fixed point.
        slope: Slope in rad.
        kind: "long" or "short" step. An untuned walker's slowest gaits lie beyond a fold of its
            long-step branch. They belong to that branch and are "long".
        period: Strides until the motion repeats. On a terrain that repeats after L strides, the
            motion repeats after L times as many; with unequal legs, L is 2.
        state: State on the Poincaré section, just after heelstrike, (6,): angles in rad, then
            angular velocities.
        multipliers: Floquet multipliers, the eigenvalues of the stride map's derivative over one
            period, largest modulus first, (m,). One of a kneed walker's four is zero, as is one of
            the simplest walker's three: an impact (kneestrike, heelstrike) makes one angular
            velocity depend on the others.
        multipliers_error: Estimated error of the moduli of the multipliers, where derivatives of
            the stride map are differences; 0 where they are exact.
        violation: Largest distance between the period's end and its start, dimensionless.
        cycle: The strides of one period, a `Stride` of arrays.
    """

    stride_map: StrideMap
    slope: float
    kind: str
    period: int
    state: NDArray[np.float64]
    multipliers: NDArray[np.complex128]
    multipliers_error: float
    violation: float
    cycle: Stride

    @property
    def walker(self) -> Walker:
        """The walker."""
        return self.stride_map.walker

    @property
    def controller(self) -> Any:
        """The controller: an `Actuation`, or a controller with feedback; None if passive."""
        return self.stride_map.controller

    @cached_property
    def point(self) -> Points:
        """The gait's point of the Poincaré section."""
        return self.stride_map.points(self.state)

    @cached_property
    def stride(self) -> Stride:
        """The first stride of the gait, with its energy balance."""
        return one_of(self.cycle, lambda values: values[0])

    @cached_property
    def mean(self) -> Stride:
        """A stride with the mean of each quantity; its state is that after the first."""
        return one_of(self.cycle, lambda x: x[0] if x.ndim > 1 else sum(x.tolist()) / len(x))

    @property
    def stance_angle(self) -> float:
        """Stance angle in rad just after heelstrike."""
        return float(self.state[0])

    @property
    def cost_of_transport(self) -> float:
        """Energy spent over weight and distance, with absolute work of torques.

        On a passive gait it equals the losses to impacts and friction (Eq. 4.3), which are used
        because they keep their digits at small slopes.
        """
        if self.controller is not None:
            return self.mean.cost_of_transport
        return (self.collision_loss + self.friction_loss) / (self.weight * self.step_length)

    @property
    def beyond_fold(self) -> bool:
        """Whether a real multiplier exceeds 1, as on short-step gaits and the slowest gaits."""
        return bool(np.prod(1.0 - self.multipliers).real < 0.0)

    def facts(self) -> dict[str, str]:
        """Measures of the gait, dimensionless."""
        error = f" ± {self.multipliers_error:.0e}" if self.multipliers_error else ""
        return {
            **({"controller": name} if (name := self.stride_map.controller_name) else {}),
            "walker": name_of(self.walker),
            "slope": f"{self.slope:.6g} rad",
            "step": self.kind,
            "period": str(self.period),
            "stance angle": f"{self.stance_angle:.6g} rad",
            "speed": in_words(self, "speed"),
            "cost of transport": f"{self.cost_of_transport:.6g}",
            "largest multiplier": f"{abs(self.multipliers[0]):.6g}{error}",
            "": "stable" if self.stable else "unstable",
        }

    def columns(self) -> dict[str, NDArray]:
        """One row: the state, all measures and the multipliers."""
        names = [each.name for each in MEASURES if each.name != "duration"]
        return {
            "slope": np.array([self.slope]),
            "kind": np.array([self.kind]),
            "period": np.array([self.period]),
            **state_columns(self.walker, self.state[None]),
            **{name: np.array([float(getattr(self, name))]) for name in names},
            "largest_multiplier": np.abs(self.multipliers[:1]),
            **multiplier_columns(self.multipliers[None]),
            "stable": np.array([self.stable]),
        }


def state_columns(walker: Walker, states: NDArray) -> dict[str, NDArray]:
    """Columns of states (n, 6) on the section: those numbers that do not follow from others."""
    follows = walker.chart.trailing_leg_follows
    places = [0, 3, 4, 5] if follows else range(states.shape[1])
    return {walker.state_names[i]: states[:, i] for i in places}


def multiplier_columns(multipliers: NDArray) -> dict[str, NDArray]:
    """Columns of real and imaginary parts of multipliers (n, m)."""
    return {
        f"multiplier_{k}_{part}": getattr(each, part)
        for k, each in enumerate(multipliers.T, 1)
        for part in ("real", "imag")
    }


class Violation(NamedTuple):
    """Residuals of the gait equations at n points, with exact derivatives; NaN where strides fail.

    Attributes:
        values: Residuals, which vanish on a gait, (n, m).
        derivatives: Derivatives of `values` by the coordinates, then by the other quantities
            asked for, (n, m, columns).
        map: Derivative of the strides' end by their start, (n, m, m). Its eigenvalues are the
            Floquet multipliers.
        passage: Measures of the strides.
        change: Derivatives of `passage`, by the columns of `derivatives`.
    """

    values: NDArray[np.float64]
    derivatives: NDArray[np.float64]
    map: NDArray[np.float64]
    passage: Passage
    change: Change


def gait_equations(
    stride_map: StrideMap,
    u: NDArray,
    slopes: ArrayLike,
    *,
    period: int = 1,
    by: Sequence[str] = (),
) -> Violation:
    """Return the residuals of the gait equations, with their exact derivatives.

    The energy balance replaces the equation for the stance leg's angular velocity. On a gait the
    two are equivalent. At small slopes the map is nearly the identity along one direction, and
    only the energy balance keeps its digits.

    Args:
        stride_map: The stride map.
        u: Points in logarithmic coordinates, (n, m).
        slopes: Slope in rad, one for all or (n,).
        period: Strides of the gait.
        by: Quantities to differentiate by besides the coordinates, as for `StrideMap.linearize`.
    """
    points, m = stride_map.searched(u), u.shape[1]
    passage, change = stride_map.linearize(
        points.values, slopes, strides=period, by=("state", *by), along=points.by_search
    )
    ends = stride_map.at(passage.ends)
    values, derivatives = ends.search - u, ends.in_search(change.ends)
    map_derivatives = derivatives[:, :, :m].copy()
    derivatives[:, :, :m] -= np.eye(m)
    balance = stride_map.chart.balance
    if balance is not None:
        values[:, balance], derivatives[:, balance] = passage.imbalance, change.imbalance
    return Violation(values, derivatives, map_derivatives, passage, change)


def step_kind(walker: Walker, multipliers: NDArray, duration: float) -> GaitKind:
    """Return the kind of a gait from the part of the branch on which it lies.

    The sign of det(1 - D), a product over the multipliers, changes at a fold of the branch. It is
    positive on the long-step part. There are two parts where it is negative. On the short-step part
    a stride takes less than about half a period of the hanging leg (0.7 to 1.05 times that on the
    published walkers). On the slow end of an untuned walker's long-step branch it takes 1.2 to 1.9
    times that.

    Args:
        walker: The walker.
        multipliers: Floquet multipliers, (m,).
        duration: Time of a stride in sqrt(l/g).
    """
    if "step kinds" not in walker.supports or np.prod(1.0 - multipliers).real > 0.0:
        return "long"
    return "short" if duration < 1.1 * _half_swing(walker) else "long"


def _half_swing(walker: Walker) -> float:
    """Half a period, in sqrt(l/g), of the straight leg that hangs from a hip at rest."""
    if walker.massless_legs:
        return math.pi
    body = walker.body
    weight = math.hypot(body.swing_along, body.swing_across)
    return math.pi * (math.sqrt(body.swing_inertia / weight) if weight > 0.0 else 1.0)


def multipliers_of(map_derivative: NDArray) -> NDArray[np.complex128]:
    """Floquet multipliers (m,) from the stride map's derivative (m, m), largest modulus first."""
    values = np.linalg.eigvals(map_derivative).astype(complex)
    return values[np.argsort(-np.abs(values), kind="stable")]


def gait_at(point: Points, slope: float, period: int) -> Gait:
    """Measure the gait at a fixed point.

    Args:
        point: The fixed point of a stride map, its section.
        slope: Slope in rad.
        period: Strides until the motion repeats.
    """
    exact: StrideMap = point.section.with_tolerance(_EXACT)
    gait = gait_equations(exact, point.search, slope, period=period)
    multipliers = multipliers_of(gait.map[0])  # first, as it raises if no stride exists
    error = 0.0
    if not exact.exact:
        coarse = gait_equations(exact.coarser(), point.search, slope, period=period).map[0]
        error = float(np.abs(np.abs(multipliers_of(coarse)) - np.abs(multipliers)).max())
    state = point.states[0]
    strides = together(exact.walk(state, slope, period))
    duration = sum(np.asarray(strides.duration).tolist()) / len(strides.duration)
    return Gait(
        stride_map=replace(exact, slope=slope),
        slope=slope,
        kind=step_kind(exact.walker, multipliers, duration / exact.units.time),
        period=period,
        state=state,
        multipliers=multipliers,
        multipliers_error=error,
        violation=float(np.abs(gait.passage.ends - point.values).max()),
        cycle=strides,
    )
