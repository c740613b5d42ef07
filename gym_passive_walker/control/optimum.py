"""One gait of least cost: its unknowns, cost and constraints, and the search for it.

Unknown are a point of the section and the torque of each tick; wanted is that the stride ends where
it began, at the speed asked for, for the least work of the motor. Each torque is the difference of
a driving and a braking part, neither of them negative, so that absolute work is smooth. SciPy's
SLSQP solves it with exact derivatives (see `ticks`).
"""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import minimize

from gym_passive_walker.control.ticks import TickedStride, ticked_stride
from gym_passive_walker.envs.scene import Scene, by_hip_alone
from gym_passive_walker.gaits.gait import GaitNotFound, multipliers_of
from gym_passive_walker.gaits.stability import NoStride

_ITERATIONS = 600
_NEWTON = 3  # iterations that close a stride, from where the optimisation left it
_CLOSED = 1e-9  # from its end to its start, at most, for a stride to be a gait
_SHARES = {"absolute": (1.0, 0.0), "positive": (0.5, 0.5), "net": (0.0, 1.0)}
"""Of absolute and of net work, in what the motor is charged for."""


@dataclass(frozen=True, kw_only=True)
class OptimalGait:
    """A gait of least cost at its speed; dimensionless, energies over weight and distance.

    Attributes:
        slope: Slope in rad.
        speed: Speed over sqrt(g l).
        cost_of_transport: Gravity's work and the motor's charge.
        hip_cost: The motor's charge.
        step_period: Time of a stride.
        step_length: Length of a step.
        point: Where it starts on the section.
        torques: Torque of each tick, in units of m g l; the last is held until heelstrike.
        multipliers: Moduli of the eigenvalues of the stride map with these torques, open loop.
        kneestrike_time: When the knee locks; 0 without knees.
        on_edge: Whether that is where a tick ends and has to be: there the cost has a corner, and
            its gradient may have any size along that of the kneestrike's time.
        violation: Largest distance between the end of the stride and its start.
        optimality: Largest entry of the Lagrangian's gradient that bounds do not explain, over the
            largest entry of the cost's own.
        stubs: Whether the toe would stub on it.
    """

    slope: float
    speed: float
    cost_of_transport: float
    hip_cost: float
    step_period: float
    step_length: float
    point: list[float]
    torques: list[float]
    multipliers: list[float]
    kneestrike_time: float
    on_edge: bool
    violation: float
    optimality: float
    stubs: bool

    @property
    def stable(self) -> bool:
        """Whether small disturbances die out with these torques."""
        return self.multipliers[0] < 1.0


def slope_of(scene: Scene) -> float:
    """The one slope that a gait has.

    Raises:
        ValueError: if the scene has a range of slopes.
    """
    if isinstance(scene.slope, tuple):
        raise ValueError(
            f"a gait is of one slope, and this scene has those from {scene.slope[0]:g} to "
            f"{scene.slope[1]:g}: choose one by make_scene(scene, slope=...)"
        )
    return scene.slope


class Problem:
    """Cost and constraints over z = (point, driving parts, braking parts), parts from 0 to 1."""

    def __init__(self, scene: Scene, speed: float, ticks: int, m: int) -> None:
        self.slope = slope_of(by_hip_alone(scene, "optimal gaits are driven"))
        self.scene, self.speed, self.ticks, self.m = scene, speed, ticks, m
        self.tick = scene.tick if scene.control == "tick" else math.inf
        self.absolute, self.net = _SHARES[scene.energy]
        self.edge: float | None = None  # when the knee has to lock, if that is fixed
        self._last: tuple[bytes, Any] = b"", None

    def torques(self, z: NDArray) -> NDArray:
        """Torque of each tick."""
        driving, braking = z[self.m :].reshape(2, self.ticks)
        return self.scene.max_hip_torque * (driving - braking)

    def walk(self, z: NDArray, *, stub: bool = False) -> TickedStride:
        """The stride."""
        scene = self.scene
        return ticked_stride(
            scene.walker, self.slope, z[: self.m], self.torques(z), tick=self.tick, stub=stub
        )

    def at(self, z: NDArray) -> tuple[float, NDArray, NDArray, NDArray]:
        """The motor's cost with its gradient, and what has to vanish with its derivative."""
        key = z.tobytes()
        if key != self._last[0]:
            try:
                self._last = key, self._evaluate(z)
            except NoStride:  # no step of a line search ends here
                size, gaps = len(z), self.m + 2
                nowhere = math.inf, np.zeros(size), np.ones(gaps), np.zeros((gaps, size))
                self._last = key, nowhere
        cost, gradient, gap, by_gap = self._last[1]
        if self.edge is None:  # the last one is when the knee locks
            return cost, gradient, gap[:-1], by_gap[:-1]
        return cost, gradient, gap - np.append(np.zeros(self.m + 1), self.edge), by_gap

    def _evaluate(self, z: NDArray) -> tuple[float, NDArray, NDArray, NDArray]:
        m, n, most = self.m, self.ticks, self.scene.max_hip_torque
        walked, torque = self.walk(z), self.torques(z)
        held = most * z[m:].reshape(2, n).sum(axis=0)
        by_torque = most * walked.by[:, m:]
        by = np.hstack([walked.by[:, :m], by_torque, -by_torque])
        length, by_length = walked.length, by[m + 1]
        work = self.absolute * held @ walked.turn + self.net * torque @ walked.swing
        by_work = (
            self.absolute * held @ by[m + 2 + n : -2] + self.net * torque @ by[m + 2 : m + 2 + n]
        )
        turn, swing = self.absolute * most * walked.turn, self.net * most * walked.swing
        by_work[m:] += np.concatenate([turn + swing, turn - swing])
        cost = work / length
        late = length - self.speed * walked.duration
        gap = np.concatenate([walked.end - z[:m], [late, walked.kneestrike]])
        by_gap = np.vstack([by[:m], by_length - self.speed * by[m], by[-1]])
        by_gap[:m, :m] -= np.eye(m)
        return cost, (by_work - cost * by_length) / length, gap, by_gap

    def solve(self, start: NDArray) -> NDArray:
        """The solution nearest to a start.

        Raises:
            GaitNotFound: if SLSQP finds none.
        """
        scale = 100.0  # of the cost, to the size of the constraints
        with warnings.catch_warnings():
            # Before SciPy 1.15 a step out of the box by rounding is said to be clipped to it.
            warnings.filterwarnings("ignore", "Values in x were outside bounds", RuntimeWarning)
            found = minimize(
                lambda z: scale * self.at(z)[0],
                start,
                jac=lambda z: scale * self.at(z)[1],
                method="SLSQP",
                bounds=[*self.box],
                constraints={
                    "type": "eq",
                    "fun": lambda z: self.at(z)[2],
                    "jac": lambda z: self.at(z)[3],
                },
                options={"maxiter": _ITERATIONS, "ftol": 1e-11},
            )
        z = self._closed(np.clip(found.x, *self.box.T))
        violation = float(np.max(np.abs(self.at(z)[2])))
        if not violation < _CLOSED:
            raise GaitNotFound(
                f"no gait at speed {self.speed:g} with torques up to "
                f"{self.scene.max_hip_torque:g} m g l was found: {found.message}, {violation:.1e} "
                "from closing; try a speed nearer to one that has a gait"
            )
        return z

    def _closed(self, z: NDArray) -> NDArray:
        """The point nearby at which the stride closes; SLSQP stops short of it at a corner."""
        low, high = self.box.T
        for _ in range(_NEWTON):
            _, _, gap, by_gap = self.at(z)
            free = (z > low) & (z < high)
            change = np.zeros(len(z))
            change[free] = np.linalg.lstsq(by_gap[:, free], -gap, rcond=1e-12)[0]
            z = np.clip(z + change, low, high)
        return z

    @property
    def box(self) -> NDArray:
        """Bounds of z, (size, 2)."""
        angle, rates, parts = [[0.01, 1.0]], [[-3.0, 3.0]] * (self.m - 1), [[0.0, 1.0]]
        return np.array(angle + rates + parts * 2 * self.ticks)

    def optimality(self, z: NDArray) -> float:
        """How far z is from fulfilling the Karush-Kuhn-Tucker conditions; see `OptimalGait`."""
        _, gradient, _, by_gap = self.at(z)
        low, high = self.box.T
        at_low, at_high = z < low + 1e-7, z > high - 1e-7
        free = ~(at_low | at_high)
        multipliers = np.linalg.lstsq(by_gap[:, free].T, gradient[free], rcond=None)[0]
        rest = gradient - by_gap.T @ multipliers
        rest[at_low], rest[at_high] = np.minimum(rest[at_low], 0.0), np.maximum(rest[at_high], 0.0)
        return float(np.max(np.abs(rest)) / np.max(np.abs(gradient)))

    def guess(self, point: ArrayLike, torques: ArrayLike) -> NDArray:
        """The z of a gait with other torques."""
        torques = np.asarray(torques)
        shares = np.pad(torques, (0, max(0, self.ticks - len(torques))), mode="edge")
        shares = shares[: self.ticks] / self.scene.max_hip_torque
        parts = np.clip(np.concatenate([shares, -shares]), 0.0, 1.0)
        return np.concatenate([np.asarray(point), parts])

    def measured(self, z: NDArray) -> OptimalGait:
        """What there is to say of a solution."""
        cost, _, gap, _ = self.at(z)
        walked, scene = self.walk(z), self.scene
        stubs = False
        if scene.walker.knees:
            try:
                self.walk(z, stub=True)
            except NoStride:
                stubs = True
        taken = 1 if scene.control == "stride" else math.ceil(walked.duration / scene.tick)
        return OptimalGait(
            slope=self.slope,
            speed=float(walked.length / walked.duration),
            cost_of_transport=math.sin(self.slope) + cost,
            hip_cost=cost,
            step_period=float(walked.duration),
            step_length=float(walked.length),
            point=z[: self.m].tolist(),
            torques=self.torques(z)[:taken].tolist(),
            multipliers=np.abs(multipliers_of(walked.by_point)).tolist(),
            kneestrike_time=float(walked.kneestrike),
            on_edge=self.edge is not None,
            violation=float(np.max(np.abs(gap))),
            optimality=self.optimality(z),
            stubs=stubs,
        )
