"""What a gait is: a periodic walk, its measures, and the equations that it solves."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker.gaits.passage import Change, Passage
from gym_passive_walker.gaits.section import (
    by_logarithms,
    from_logarithms,
    in_logarithms,
    logarithms,
)
from gym_passive_walker.gaits.stride import Stride, together
from gym_passive_walker.gaits.stride_map import StrideMap
from gym_passive_walker.physics.hybrid import Outcome
from gym_passive_walker.physics.systems import body_of
from gym_passive_walker.shown import Shown
from gym_passive_walker.units import units_of
from gym_passive_walker.walkers import Walker, name_of

GaitKind = Literal["long", "short"]

_EXACT = 1e-13  # tolerance with which gaits are measured


class GaitNotFound(Exception):
    """No such gait; the message says for whom, where, what was tried and what would help.

    Attributes:
        slope: A slope in rad near the one asked for at which there is one; None if none is known.
        walker: A walker near the one asked for that has one; None if none is known.
    """

    def __init__(
        self, message: str, *, slope: float | None = None, walker: Walker | None = None
    ) -> None:
        super().__init__(message)
        self.slope, self.walker = slope, walker


@dataclass(frozen=True, repr=False)
class Gait(Shown):
    """A periodic walk (a limit cycle), passive or under a controller, in the walker's own units.

    Attributes:
        stride_map: Whose fixed point it is: its walker, and what works its motors.
        slope: Slope in rad.
        kind: "long" or "short" step. An untuned walker's slowest gaits, beyond the fold at the
            foot of its long-step curve, belong to that curve and are "long" like the rest of it.
        period: Strides until the motion repeats; of a terrain that repeats after several, times
            as many.
        state: Section state (6,): angles in rad and rates, just after heelstrike.
        multipliers: Floquet multipliers, the eigenvalues of the stride map's derivative over one
            period, largest modulus first. One of a kneed walker's four, and of the simplest
            walker's three, is zero: the walker forgets it at kneestrike (at heelstrike), where two
            rates become one.
        violation: Largest distance between the period's end and its start, dimensionless.
        strides: The strides of one period, a `Stride` of arrays.
    """

    stride_map: StrideMap
    slope: float
    kind: str
    period: int
    state: NDArray[np.float64]
    multipliers: NDArray[np.complex128]
    violation: float
    strides: Stride

    @property
    def walker(self) -> Walker:
        """The walker."""
        return self.stride_map.walker

    @property
    def controller(self) -> Any:
        """What works the motors: an `Actuation`, or what observes the walker; None if passive."""
        return self.stride_map.controller

    @cached_property
    def stride(self) -> Stride:
        """The first stride of the gait with its ledger."""
        first = Stride(*(np.asarray(x)[0] for x in self.strides._replace(weight=[0.0])))
        outcome = Outcome(int(first.outcome))
        return first._replace(weight=self.strides.weight, outcome=outcome)  # type: ignore[arg-type]

    def _mean(self, values: NDArray) -> float:
        return sum(np.asarray(values).tolist()) / len(self.strides.duration)

    @property
    def step_period(self) -> float:
        """Mean time of a stride."""
        return self._mean(self.strides.duration)

    @property
    def step_length(self) -> float:
        """Mean distance between contacts along the slope."""
        return self._mean(self.strides.step_length)

    @property
    def collision_loss(self) -> float:
        """Mean energy lost at the strikes of a stride."""
        return self._mean(self.strides.collision_loss)

    @property
    def friction_loss(self) -> float:
        """Mean energy lost to friction in a stride."""
        return self._mean(self.strides.friction_loss)

    @property
    def stance_angle(self) -> float:
        """Stance angle in rad just after heelstrike."""
        return float(self.state[0])

    @property
    def speed(self) -> float:
        """Mean speed along the slope."""
        return self.step_length / self.step_period

    @property
    def froude_speed(self) -> float:
        """Speed over sqrt(g l), the square root of the Froude number (Eq. 4.6)."""
        return self.speed / units_of(self.walker).speed

    def _cost(self, energies: NDArray) -> float:
        """Energies over weight times distance."""
        return self._mean(energies) / (self.strides.weight * self.step_length)

    @property
    def gravity_cost(self) -> float:
        """Gravity's work over weight times distance."""
        return self._cost(self.strides.gravity_work)

    @property
    def hip_cost(self) -> float:
        """Absolute work of the hip's motor, likewise."""
        return self._cost(self.strides.hip_work_absolute)

    @property
    def net_hip_cost(self) -> float:
        """Its net work."""
        return self._cost(self.strides.hip_work)

    @property
    def positive_hip_cost(self) -> float:
        """Its work where it drives."""
        return self._cost(self.strides.hip_work_positive)

    @property
    def ankle_cost(self) -> float:
        """Absolute work of the ankle's motor."""
        return self._cost(self.strides.ankle_work_absolute)

    @property
    def net_ankle_cost(self) -> float:
        """Its net work."""
        return self._cost(self.strides.ankle_work)

    @property
    def push_off_cost(self) -> float:
        """Work of the push-off."""
        return self._cost(self.strides.push_off_work)

    @property
    def motor_cost(self) -> float:
        """Absolute work of all motors."""
        return self.hip_cost + self.ankle_cost + self.push_off_cost

    @property
    def cost_of_transport(self) -> float:
        """Energy spent over weight times distance (Eq. 4.3).

        Gravity's work and the motors' absolute work. Of a passive gait it is what collisions and
        friction take, which is the same and keeps its digits at small slopes.
        """
        if self.controller is not None:
            return self.gravity_cost + self.motor_cost
        lost = self.collision_loss + self.friction_loss
        return lost / (self.strides.weight * self.step_length)

    @property
    def kneestrike_time(self) -> float:
        """Time from heelstrike to kneestrike in the first stride; NaN without knees."""
        return float(self.stride.kneestrike_time)

    @property
    def kneestrike_loss(self) -> float:
        """Energy lost at kneestrike in the first stride."""
        return float(self.stride.kneestrike_loss)

    @property
    def heelstrike_loss(self) -> float:
        """Energy lost at heelstrike in the first stride."""
        return float(self.stride.heelstrike_loss)

    @property
    def beyond_fold(self) -> bool:
        """Whether one real multiplier exceeds 1: so on short-step gaits and the slowest ones."""
        return bool(np.prod(1.0 - self.multipliers).real < 0.0)

    @property
    def stable(self) -> bool:
        """Whether small disturbances die out: all multipliers inside the unit circle."""
        return bool(np.abs(self.multipliers[0]) < 1.0)

    def facts(self) -> dict[str, str]:
        """Its measures, dimensionless."""
        return {
            **({"controller": name} if (name := self.stride_map.controller_name) else {}),
            "walker": name_of(self.walker),
            "slope": f"{self.slope:.6g} rad",
            "step": self.kind,
            "period": str(self.period),
            "stance angle": f"{self.stance_angle:.6g} rad",
            "speed": f"{self.froude_speed:.6g} √(g l)",
            "cost of transport": f"{self.cost_of_transport:.6g}",
            "largest multiplier": f"{abs(self.multipliers[0]):.6g}",
            "": "stable" if self.stable else "unstable",
        }


class Violation(NamedTuple):
    """How far n points are from being gaits, exactly derived; NaN where strides fail.

    Attributes:
        values: What vanishes on a gait, (n, m).
        derivatives: By the coordinates, and by what else was asked for, (n, m, columns).
        map: Derivative of the strides' end by their start, (n, m, m): the multipliers' matrix.
        passage: Where the strides lead.
        change: Its derivatives, by the same columns.
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
    """What vanishes on a gait, with its exact derivative.

    The equation for the stance leg's rate is replaced by the balance of energy, which says the
    same on a gait but keeps its digits at small slopes, where the map is nearly the identity along
    one direction.

    Args:
        stride_map: Whose gait.
        u: Points in logarithmic coordinates, (n, m).
        slopes: Slope in rad, one for all or (n,).
        period: Strides of the gait.
        by: What to differentiate by besides the coordinates, as for `StrideMap.linearize`.
    """
    points, m = from_logarithms(u), u.shape[1]
    passage, change = stride_map.linearize(
        points, slopes, strides=period, by=("state", *by), along=by_logarithms(points)
    )
    values = logarithms(passage.ends) - u
    values[:, 1] = passage.imbalance
    derivatives = in_logarithms(passage.ends, change.ends)
    map_derivatives = derivatives[:, :, :m].copy()
    derivatives[:, :, :m] -= np.eye(m)
    derivatives[:, 1] = change.imbalance
    return Violation(values, derivatives, map_derivatives, passage, change)


def _kind(walker: Walker, map_derivative: NDArray, duration: float) -> GaitKind:
    """Which gait this is, by the part of the curve of gaits that it lies on.

    The sign of det(1 - D) changes where a curve folds, and it is positive on the long-step part.
    Of the parts where it is negative, the short-step one swings its leg in less than about half a
    period of the hanging leg, from 0.7 to 1.05 of it on the published walkers. The other is the
    slow end of an untuned walker's long-step curve, from 1.2 to 1.9.
    """
    if np.linalg.det(np.eye(len(map_derivative)) - map_derivative) > 0.0:
        return "long"
    return "short" if duration < 1.1 * _half_swing(walker) else "long"


def _half_swing(walker: Walker) -> float:
    """Half a period over sqrt(l/g) of the straight leg as it hangs from a resting hip."""
    if walker.massless_legs:
        return math.pi
    body = body_of(walker)
    weight = math.hypot(body.swing_along, body.swing_across)
    return math.pi * (math.sqrt(body.swing_inertia / weight) if weight > 0.0 else 1.0)


def multipliers_of(map_derivative: NDArray) -> NDArray[np.complex128]:
    """Eigenvalues of the stride map's derivative, largest modulus first."""
    values = np.linalg.eigvals(map_derivative).astype(complex)
    return values[np.argsort(-np.abs(values), kind="stable")]


def measure(stride_map: StrideMap, u: NDArray, slope: float, period: int) -> Gait:
    """Measure the gait at a fixed point.

    Args:
        stride_map: Whose gait.
        u: The fixed point in logarithmic coordinates, (m,).
        slope: Slope in rad.
        period: Strides until it repeats.
    """
    exact, walker = stride_map.with_tolerance(_EXACT), stride_map.walker
    gait = gait_equations(exact, u[None], slope, period=period)
    multipliers = multipliers_of(gait.map[0])  # first of all: refuses where no stride exists
    point = from_logarithms(u[None])
    state = exact.states_at(point)[0]
    strides = together(exact.walk(state, slope, period))
    duration = sum(np.asarray(strides.duration).tolist()) / len(strides.duration)
    return Gait(
        stride_map=replace(exact, slope=slope),
        slope=slope,
        kind=_kind(walker, gait.map[0], duration / exact.units.time),
        period=period,
        state=state,
        multipliers=multipliers,
        violation=float(np.abs(gait.passage.ends - point).max()),
        strides=strides,
    )
