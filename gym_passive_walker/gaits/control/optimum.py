"""One gait of least cost: its unknowns, cost and constraints, and the search for it.

Unknown are a point of the section, the torques of each tick and the push-off; wanted is that the
stride ends where it began, at the speed asked for, for the least work of the motors. Each torque is
the difference of a driving and a braking part, neither of them negative, so that absolute work is
smooth. SciPy's SLSQP solves it with exact derivatives (see `ticks`).
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker.gaits.control.ticks import (
    PiecewiseConstantStride,
    before_kneestrike,
    ticked_stride,
)
from gym_passive_walker.gaits.design.design_nlp import slsqp
from gym_passive_walker.gaits.flow import Walkers
from gym_passive_walker.gaits.gait import GaitNotFound, multipliers_of
from gym_passive_walker.gaits.map_result import NoStride
from gym_passive_walker.gaits.scenes.rules import CHANNELS
from gym_passive_walker.gaits.scenes.scene import Scene
from gym_passive_walker.models.model import check_supports

_ITERATIONS = 600
_FIRST = 6  # iterations among all unknowns, before those are set aside that stay at their bounds
_PATIENCE, _GAIN = 40, 1e-7  # iterations without that gain, relative, that end a search
_LITTLE = 10  # of them, where a solution nearby is known
_OPEN = 1e-3  # from the end of a stride to its start, after one round: that will hardly close
_WORTH = 1e-6  # gain, relative, that is worth another round
_ROUNDS = 8  # of setting unknowns aside, and of taking them up again
_AT_BOUND, _PULL = 1e-9, 1e-6  # distance from a bound; share of the gradient that is one off it
_NEWTON = 3  # iterations that close a stride, from where the optimization left it
_CLOSED = 1e-9  # from its end to its start, at most, for a stride to be a gait
_NEAR = 1e-7  # a bound, at which an unknown counts as at it
_AHEAD = np.array([[-1.0, 1.0], [1.0, 1.0]])
"""Derivatives, by stance and swing angle, of the swing leg's lead and of its extra inclination."""

_CLEAR = 1e-3  # rad of either as the knee locks, at the least, where the toe has to clear
_SHARES = {"absolute": (1.0, 0.0), "positive": (0.5, 0.5), "net": (0.0, 1.0)}
"""Shares of absolute and of net work in the energy that is charged."""


@dataclass(frozen=True, kw_only=True)
class OptimalGait:
    """A gait of least cost at its speed; dimensionless, energies over weight and distance.

    Attributes:
        slope: Slope in rad.
        speed: Speed over sqrt(g l).
        cost_of_transport: Gravity's work and the motors' charge.
        hip_cost: The charge of the hip's motor.
        step_period: Time of a stride.
        step_length: Length of a step.
        point: Dimensionless point on the section at which it starts, (m,).
        torques: Torque of each tick, in units of m g l; the last is held until heelstrike.
        multipliers: Moduli of the eigenvalues of the stride map with these torques, open loop.
        kneestrike_time: Time of kneestrike over sqrt(l/g); 0 without knees.
        on_edge: Whether that is where a tick ends and has to be: there the cost has a corner, and
            its gradient may have any size along that of the kneestrike's time.
        violation: Largest distance between the end of the stride and its start.
        optimality: Largest entry of the Lagrangian's gradient that bounds do not explain, over the
            largest entry of the cost's own.
        stubs: Whether the toe would stub on it.
        ankle_torques: Torques of the ankle; empty if there is none.
        ankle_cost: The charge of the ankle's motor.
        push_off: Impulse just before heelstrike, in units of m sqrt(g l).
        push_off_cost: Work of the push-off.
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
    ankle_torques: list[float] = field(default_factory=list)
    ankle_cost: float = 0.0
    push_off: float = 0.0
    push_off_cost: float = 0.0

    @property
    def motor_cost(self) -> float:
        """The charge of all motors."""
        return self.hip_cost + self.ankle_cost + self.push_off_cost

    @property
    def stable(self) -> bool:
        """Whether small disturbances die out with these torques."""
        return self.multipliers[0] < 1.0


class _StandsStill(Exception):
    """An optimization makes no progress: it zigzags about a corner of the cost."""


def slope_of(scene: Scene) -> float:
    """The one slope that a gait has.

    Raises:
        ValueError: if the scene has a range of slopes.
    """
    check_supports(scene.walker, "optimal gait")
    if isinstance(scene.slope, tuple):
        raise ValueError(
            f"a gait is of one slope, and this scene has those from {scene.slope[0]:g} to "
            f"{scene.slope[1]:g}: choose one by make_scene(scene, slope=...)"
        )
    return scene.slope


class Problem:
    """Cost and constraints over z = (point, driving parts, braking parts, push-off).

    Parts are from 0 to 1, those of the hip's ticks before those of the ankle's; so is the push-off.
    """

    def __init__(self, scene: Scene, speed: float, ticks: int, m: int) -> None:
        self.slope = slope_of(scene)
        self.scene, self.speed, self.ticks, self.m = scene, speed, ticks, m
        self.tick = scene.tick if scene.control == "tick" else math.inf
        self.absolute, self.net = _SHARES[scene.energy]
        self.edge: float | None = None  # when the knee has to lock, if that is fixed
        self.clears = False  # whether the swing leg has to be clear of the ground as the knee locks
        self.motors = 2 if "ankle" in scene.actions else 1
        self.pushes = "push_off" in scene.actions and scene.max_push_off > 0.0
        largest = [scene.largest(name) * (name in scene.actions) for name in CHANNELS]
        self.largest = np.repeat(largest[: self.motors], ticks)  # torque of each part
        self.largest_push = largest[-1]
        works = Walkers(walker=scene.walker).system().works  # 0 of a hip, with feet of no mass
        self.works = np.repeat(np.array(works)[: self.motors], ticks)
        self._last: tuple[Any, Any] = None, None

    def parts(self, z: NDArray) -> tuple[NDArray, NDArray]:
        """Driving and braking parts of z, views of it."""
        driving, braking = z[self.m : self.m + 2 * len(self.largest)].reshape(2, -1)
        return driving, braking

    def torques(self, z: NDArray) -> NDArray:
        """Torque of each tick, (ticks,); of hip and ankle, (2, ticks)."""
        driving, braking = self.parts(z)
        torques = self.largest * (driving - braking)
        return torques if self.motors == 1 else torques.reshape(2, -1)

    def push_off(self, z: NDArray) -> float | None:
        """The push-off, if there may be any."""
        return self.largest_push * float(z[-1]) if self.pushes else None

    def walk(self, z: NDArray, *, end_on_toe_stub: bool = False) -> PiecewiseConstantStride:
        """The stride."""
        return ticked_stride(
            self.scene.walker, self.slope, z[: self.m], self.torques(z), tick=self.tick,
            push_off=self.push_off(z), end_on_toe_stub=end_on_toe_stub,
        )  # fmt: skip

    def at(self, z: NDArray) -> tuple[float, NDArray, NDArray, NDArray]:
        """Return the motors' cost with its gradient, and the equality constraints with theirs."""
        cost, gradient, gap, by_gap, _, _ = self._known(z)
        if self.edge is None:  # the last one is when the knee locks
            return cost, gradient, gap[:-1], by_gap[:-1]
        return cost, gradient, gap - np.append(np.zeros(self.m + 1), self.edge), by_gap

    def room(self, z: NDArray) -> tuple[NDArray, NDArray]:
        """Return conditions that must not be negative for the toe to clear the ground; derivatives.

        As the knee locks, a straight leg is above the ground if it is ahead of the stance leg and
        further from the vertical. Empty where that is no condition.
        """
        return self._known(z)[4:]

    def _known(self, z: NDArray) -> tuple[float, NDArray, NDArray, NDArray, NDArray, NDArray]:
        """Return cost, constraints and derivatives at z; those of the last z are kept."""
        key = z.tobytes(), self.clears
        if key != self._last[0]:
            try:
                self._last = key, self._evaluate(z)
            except NoStride:  # no step of a line search ends here
                size, gaps, sides = len(z), self.m + 2, len(_AHEAD) * self.clears
                nowhere = math.inf, np.zeros(size), np.ones(gaps), np.zeros((gaps, size))
                self._last = key, (*nowhere, -np.ones(sides), np.zeros((sides, size)))
        return self._last[1]

    def charges(self, z: NDArray, walked: PiecewiseConstantStride) -> tuple[NDArray, float]:
        """Return the charges for each torque, and the charge for the push-off."""
        held, torques = self.largest * sum(self.parts(z)), self.torques(z).ravel()
        of_torques = self.absolute * held * walked.turn.ravel()
        of_torques += self.net * torques * walked.swing.ravel()
        return self.works * of_torques, float(walked.push_work)

    def _by_unknowns(self, by: NDArray) -> NDArray:
        """Derivatives by z, of those by point, torques and push-off."""
        m, n = self.m, len(self.largest)
        by_torque, by_push = self.largest * by[:, m : m + n], self.largest_push * by[:, m + n :]
        return np.hstack([by[:, :m], by_torque, -by_torque, by_push])

    def _room(self, z: NDArray, walked: PiecewiseConstantStride) -> tuple[NDArray, NDArray]:
        """Compute the result of `room`."""
        if not self.clears:
            return np.empty(0), np.empty((0, len(z)))
        walkers = Walkers(walker=self.scene.walker, using=("ankle_torque",) * (self.motors == 2))
        state, by = before_kneestrike(walkers, walked)
        return _AHEAD @ state[:2] - _CLEAR, _AHEAD @ self._by_unknowns(by[:2])

    def _evaluate(self, z: NDArray) -> tuple[float, NDArray, NDArray, NDArray, NDArray, NDArray]:
        m, n = self.m, len(self.largest)
        walked = self.walk(z)
        by = self._by_unknowns(walked.by)
        length, by_length = walked.length, by[m + 1]
        absolute, net = self.absolute * self.works, self.net * self.works
        held, torques = self.largest * sum(self.parts(z)), self.torques(z).ravel()
        of_torques, of_push = self.charges(z, walked)
        by_work = by[-2] + (net * torques) @ by[m + 2 : m + 2 + n]
        by_work += (absolute * held) @ by[m + 2 + n : m + 2 + 2 * n]
        turn = absolute * self.largest * walked.turn.ravel()
        swing = net * self.largest * walked.swing.ravel()
        by_work[m : m + 2 * n] += np.concatenate([turn + swing, turn - swing])
        cost = (of_torques.sum() + of_push) / length
        late = length - self.speed * walked.duration
        gap = np.concatenate([walked.end - z[:m], [late, walked.kneestrike]])
        by_gap = np.vstack([by[:m], by_length - self.speed * by[m], by[-1]])
        by_gap[:m, :m] -= np.eye(m)
        return cost, (by_work - cost * by_length) / length, gap, by_gap, *self._room(z, walked)

    def solve(self, start: NDArray, *, known: float | None = None) -> NDArray:
        """Return the solution nearest to a start.

        The algebra of SLSQP grows with the cube of the unknowns, and most parts end at a bound:
        after a few iterations those are set aside that are there and would not leave.

        Args:
            start: The start.
            known: Where it is the solution of a problem that is much the same, the cost of that
                one: the search is given up if it costs more and does not close.

        Raises:
            GaitNotFound: if SLSQP finds none.
        """
        z, free = start, np.zeros(len(start), bool)
        patience = _PATIENCE if known is None else _LITTLE
        if known is None:
            z = self._minimised(start, self.box[:, 0] < self.box[:, 1], _FIRST)
        cost = math.inf
        for _ in range(_ROUNDS):
            wanted, before, cost = self._leaving(z), cost, self.at(z)[0]
            if not np.any(wanted & ~free) and not cost < before * (1.0 - _WORTH):
                break
            free |= wanted
            z = self._minimised(z, free, _ITERATIONS, patience)
            if known is not None:
                cost_now, _, gap, _ = self.at(z)
                if cost_now > known and float(np.max(np.abs(gap))) > _OPEN:
                    break
        z = self._closed(z)
        driving, braking = self.parts(z)
        both = np.minimum(driving, braking)  # to push both ways at once does nothing, and costs
        driving -= both
        braking -= both
        if not float(np.max(np.abs(self.at(z)[2]))) < _CLOSED:
            raise GaitNotFound(
                f"no gait at speed {self.speed:g} by motors of {self._motors()} was found"
            )
        if self.clears and not self.allowed(z):
            raise GaitNotFound(
                f"no gait at speed {self.speed:g} by motors of {self._motors()} was found on which "
                "the toe clears the ground, as the scene's rule `end_on_toe_stub` asks for; try "
                "another `start`, or a scene with end_on_toe_stub=False"
            )
        return z

    def allowed(self, z: NDArray) -> bool:
        """Return whether the scene allows a gait: no toe stubs where that ends an episode."""
        return not (self.scene.end_on_toe_stub and self._stubs(z))

    def _stubs(self, z: NDArray) -> bool:
        """Return whether the toe would stub."""
        if not self.scene.walker.knees:
            return False
        try:
            self.walk(z, end_on_toe_stub=True)
        except NoStride:
            return True
        return False

    def _motors(self) -> str:
        """Return a description of the actuators, for messages."""
        units = ("m g l at the hip", "m g l at the ankle", "m sqrt(g l) as a push-off")
        return " and ".join(
            f"up to {self.scene.largest(name):g} {unit}"
            for name, unit in zip(CHANNELS, units, strict=True)
            if name in self.scene.actions
        )

    def _minimised(
        self, start: NDArray, free: NDArray, iterations: int, patience: int = _PATIENCE
    ) -> NDArray:
        """Return z with some of the unknowns optimized, the others held."""
        scale = 100.0  # of the cost, to the size of the constraints
        z, best = start.copy(), start[free]
        least, since = math.inf, 0  # the best merit so far, and points since it became better

        def at(unknown: NDArray) -> tuple[Any, ...]:
            z[free] = unknown
            return *self.at(z), *self.room(z)

        def look(unknown: NDArray) -> None:
            nonlocal best, least, since
            cost, _, gap, _, room, _ = at(unknown)
            merit = cost + 10.0 * float(np.abs(gap).sum() + np.maximum(-room, 0.0).sum())
            since = 0 if merit < least * (1.0 - _GAIN) else since + 1
            if merit < least:
                best, least = unknown.copy(), merit
            if since > patience:
                raise _StandsStill

        look(start[free])
        with warnings.catch_warnings(), suppress(_StandsStill):
            # Before SciPy 1.15 a step out of the box by rounding is said to be clipped to it.
            warnings.filterwarnings("ignore", "Values in x were outside bounds", RuntimeWarning)
            found = slsqp(
                lambda unknown: (scale * at(unknown)[0], scale * at(unknown)[1][free]),
                start[free], [*self.box[free]],
                equal=lambda unknown: (at(unknown)[2], at(unknown)[3][:, free]),
                beyond=lambda unknown: (at(unknown)[4], at(unknown)[5][:, free]),
                iterations=iterations, accuracy=1e-11, callback=look,
            )  # fmt: skip
            look(found.x)
        z[free] = best
        return np.clip(z, *self.box.T)

    def _leaving(self, z: NDArray) -> NDArray[np.bool_]:
        """Return the unknowns to vary as booleans: not held by a bound, and with an effect."""
        _, gradient, _, by_gap = self.at(z)
        low, high = self.box.T
        rest = self._lagrangian(z)
        pull = _PULL * np.max(np.abs(gradient))
        stays = (z <= low + _AT_BOUND) & (rest > -pull) | (z >= high - _AT_BOUND) & (rest < pull)
        return ~stays & (np.any(by_gap != 0.0, axis=0) | (gradient != 0.0))

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
        state = [[0.01, 1.0]] + [[-3.0, 3.0]] * (self.m - 1)
        parts = np.stack([np.zeros(len(self.largest)), self.largest > 0.0], axis=1)
        push = np.tile([0.0, 1.0], (int(self.pushes), 1))
        return np.concatenate([state, parts, parts, push])

    def _lagrangian(self, z: NDArray) -> NDArray:
        """Return the Lagrangian's gradient."""
        _, gradient, _, by_gap = self.at(z)
        room, by_room = self.room(z)
        by_gap = np.vstack([by_gap, by_room[room < _NEAR]])
        low, high = self.box.T
        free = (z >= low + _NEAR) & (z <= high - _NEAR)
        multipliers = np.linalg.lstsq(by_gap[:, free].T, gradient[free], rcond=None)[0]
        return gradient - by_gap.T @ multipliers

    def optimality(self, z: NDArray) -> float:
        """Return the violation of the Karush-Kuhn-Tucker conditions at z; see `OptimalGait`."""
        rest, (low, high) = self._lagrangian(z), self.box.T
        at_low, at_high = z < low + _NEAR, z > high - _NEAR
        rest[at_low], rest[at_high] = np.minimum(rest[at_low], 0.0), np.maximum(rest[at_high], 0.0)
        rest[low == high] = 0.0
        largest = float(np.max(np.abs(self.at(z)[1])))
        return float(np.max(np.abs(rest))) / largest if largest else 0.0

    def begun(self, point: ArrayLike, torques: Iterable[ArrayLike], push_off: float) -> NDArray:
        """Return the z at a point of the section, under torques of hip and ankle and a push-off."""
        shares = np.zeros((self.motors, self.ticks))
        for row, held, most in zip(shares, torques, self.largest[:: self.ticks], strict=False):
            held = np.asarray(held)
            if len(held) and most:
                there = np.minimum(np.arange(self.ticks), len(held) - 1)  # the last one is held
                row[:] = held[there] / most
        push = [push_off / self.largest_push] if self.pushes else []
        parts = np.clip(np.concatenate([shares.ravel(), -shares.ravel(), push]), 0.0, 1.0)
        return np.concatenate([np.asarray(point), parts])

    def begun_at(self, gait: OptimalGait) -> NDArray:
        """Return the z of another gait."""
        return self.begun(gait.point, (gait.torques, gait.ankle_torques), gait.push_off)

    def measured(self, z: NDArray) -> OptimalGait:
        """Return the gait of a solution."""
        cost, _, gap, _ = self.at(z)
        walked, scene = self.walk(z), self.scene
        taken = 1 if scene.control == "stride" else math.ceil(walked.duration / scene.tick)
        of_torques, of_push = self.charges(z, walked)
        of_hip, of_ankle, *_ = *np.split(of_torques, self.motors), np.zeros(1)
        hip, ankle, *_ = *self.torques(z).reshape(self.motors, -1), np.zeros(0)
        return OptimalGait(
            slope=self.slope,
            speed=float(walked.length / walked.duration),
            cost_of_transport=math.sin(self.slope) + cost,
            hip_cost=float(of_hip.sum() / walked.length),
            step_period=float(walked.duration),
            step_length=float(walked.length),
            point=z[: self.m].tolist(),
            torques=hip[:taken].tolist(),
            multipliers=np.abs(multipliers_of(walked.by_point)).tolist(),
            kneestrike_time=float(walked.kneestrike),
            on_edge=self.edge is not None,
            violation=float(np.max(np.abs(gap))),
            optimality=self.optimality(z),
            stubs=self._stubs(z),
            ankle_torques=ankle[:taken].tolist(),
            ankle_cost=float(of_ankle.sum() / walked.length),
            push_off=self.push_off(z) or 0.0,
            push_off_cost=float(of_push / walked.length),
        )
