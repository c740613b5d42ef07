"""What a gait is, and its measures."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from gym_passive_walker.gaits.drive import PASSIVE, Drive, to_own
from gym_passive_walker.gaits.equations import gait_equations
from gym_passive_walker.gaits.log_chart import from_logarithms
from gym_passive_walker.gaits.posture import half_swing
from gym_passive_walker.gaits.stride import Stride, stride
from gym_passive_walker.gaits.stride_map import StrideMap
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
    """A periodic walk, in the walker's own units.

    Attributes:
        walker: Who walks.
        slope: Slope in rad.
        kind: "long" or "short" step. An untuned walker's slowest gaits, beyond the fold at the
            foot of its long-step curve, belong to that curve and are "long" like the rest of it.
        period: Strides until the motion repeats.
        state: Section state (6,): angles in rad and rates, just after heelstrike.
        multipliers: Eigenvalues of the stride map's derivative over one period, largest modulus
            first. One of a kneed walker's four, and of the simplest walker's three, is zero: the
            walker forgets it at kneestrike (at heelstrike), where two rates become one.
        stride: The first stride of the gait with its ledger.
        step_period: Mean time of a stride.
        step_length: Mean distance between contacts along the slope.
        collision_loss: Mean energy lost at the strikes of a stride.
        friction_loss: Mean energy lost to friction in a stride.
        drive: What its motors do in each stride; `PASSIVE` without.
    """

    walker: Walker
    slope: float
    kind: str
    period: int
    state: NDArray[np.float64]
    multipliers: NDArray[np.complex128]
    stride: Stride
    step_period: float
    step_length: float
    collision_loss: float
    friction_loss: float
    drive: Drive = PASSIVE

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

    @property
    def cost_of_transport(self) -> float:
        """Energy lost at collisions and to friction over weight times distance (Eq. 4.3)."""
        lost = self.collision_loss + self.friction_loss
        return lost / (self.stride.weight * self.step_length)

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


def _kind(walker: Walker, map_derivative: NDArray, duration: float) -> GaitKind:
    """Which gait this is, by the part of the curve of gaits that it lies on.

    The sign of det(1 - D) changes where a curve folds, and it is positive on the long-step part.
    Of the parts where it is negative, the short-step one swings its leg in less than about half a
    period of the hanging leg, from 0.7 to 1.05 of it on the published walkers. The other is the
    slow end of an untuned walker's long-step curve, from 1.2 to 1.9.
    """
    if np.linalg.det(np.eye(len(map_derivative)) - map_derivative) > 0.0:
        return "long"
    return "short" if duration < 1.1 * half_swing(walker) else "long"


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
    drive = to_own(exact.units, exact.drive)
    map_derivative = gait_equations(exact, u[None], slope, period=period).map[0]
    multipliers = multipliers_of(map_derivative)  # first of all: refuses where no stride exists
    state = exact.states_at(from_logarithms(u[None]))[0]
    walks = [stride(walker, slope, state, tolerance=_EXACT, **drive._asdict())]
    for _ in range(period - 1):
        last = walks[-1].state
        walks.append(stride(walker, slope, last, tolerance=_EXACT, **drive._asdict()))
    duration = sum(float(walk.duration) for walk in walks) / period
    return Gait(
        walker=walker,
        slope=slope,
        kind=_kind(walker, map_derivative, duration / exact.units.time),
        period=period,
        state=state,
        multipliers=multipliers,
        stride=walks[0],
        step_period=duration,
        step_length=sum(float(walk.step_length) for walk in walks) / period,
        collision_loss=sum(float(walk.collision_loss) for walk in walks) / period,
        friction_loss=sum(float(walk.friction_loss) for walk in walks) / period,
        drive=drive,
    )
