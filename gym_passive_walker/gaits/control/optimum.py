"""One gait of least cost or most reward: its unknowns, cost and constraints, and the search for it.

Unknown are a point of the section, the torques of each tick and the push-off; wanted is that the
stride ends where it began, at the speed asked for, for the least work of the motors; or that it
earns the most reward in a number of control steps. Each torque is the difference of a driving and a
braking part, neither of them negative, so that absolute work is smooth. SciPy's SLSQP solves it
with exact derivatives (see `ticks` and `stride_reward`).
"""

from __future__ import annotations

import json
import math
import time
import warnings
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker._tools.shown import Table
from gym_passive_walker.gaits.actuation import Actuation, to_own
from gym_passive_walker.gaits.control.stride_reward import StrideReward
from gym_passive_walker.gaits.control.ticks import (
    PiecewiseConstantStride,
    before_kneestrike,
    control_steps,
    hold_time,
    ticked_stride,
)
from gym_passive_walker.gaits.design.design_nlp import slsqp
from gym_passive_walker.gaits.flow import Walkers
from gym_passive_walker.gaits.gait import GaitNotFound, multipliers_of
from gym_passive_walker.gaits.map_result import NoStride
from gym_passive_walker.gaits.measures import SHARES, Measured, in_words
from gym_passive_walker.gaits.scenes.rules import CHANNELS
from gym_passive_walker.gaits.scenes.scene import Scene, recorded_weight
from gym_passive_walker.gaits.section import Points, Section
from gym_passive_walker.gaits.stride import Stride, account, one_of, reported_as
from gym_passive_walker.models.model import check_supports
from gym_passive_walker.models.walkers import Walker, describe, name_of

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

_SPACE = 1e-6  # of a control step, between the heelstrike and the ends of its control step
_LARGE = 100.0  # size of the cost's gradient in the search, beside the constraints

_CLEAR = 1e-3  # rad of either as the knee locks, at the least, where the toe has to clear


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class OptimalGait(Measured, Table):
    """A gait of least cost or most reward, in the walker's own units; a table of its controls.

    It has the quantities of its stride, as a `Gait` has those of its own; so `froude_speed` is the
    speed over sqrt(g l), and `dimensionless` has the same attributes without units.

    Attributes:
        slope: Slope in rad.
        state: State on the Poincaré section, (6,).
        controller: `Actuation` with the hip torque and the ankle torque of each control step, (N,)
            each, the last held until heelstrike; and the push-off. Of a `System`, its controls by
            name.
        mean: The stride, with its energy balance.
        multipliers: Floquet multipliers of the stride map with these torques, open loop, (m,).
        charged_cost: Work of the actuators that the scene charges, over weight and distance.
        on_edge: Whether the knee locks where a control step ends and has to: there the cost has a
            corner, and its gradient may have any size along that of the kneestrike's time.
        violation: Largest distance between the end of the stride and its start, dimensionless.
        optimality: Largest entry of the Lagrangian's gradient that bounds do not explain, over the
            largest entry of the cost's own.
        stubs: Whether the toe would stub on it.
        reward: Sum of the rewards of the stride's control steps; None of a gait of least cost.
    """

    slope: float
    state: NDArray[np.float64]
    controller: Actuation | dict[str, NDArray[np.float64]]
    mean: Stride
    multipliers: NDArray[np.complex128]
    charged_cost: float
    on_edge: bool
    violation: float
    optimality: float
    stubs: bool
    reward: float | None = None

    @property
    def control_steps(self) -> int:
        """Number of control steps in a stride."""
        return len(next(iter(self.held.values())))

    @property
    def reward_per_control_step(self) -> float:
        """Reward of a stride over its control steps; NaN of a gait of least cost.

        An episode of N control steps earns N times it.
        """
        return math.nan if self.reward is None else self.reward / self.control_steps

    @property
    def walker(self) -> Walker:
        """The walker."""
        return self.mean.walker

    @property
    def point(self) -> Points:
        """The gait's point of the Poincaré section."""
        return Section(walker=self.walker).points(self.state)

    @property
    def held(self) -> dict[str, NDArray[np.float64]]:
        """Dimensionless controls of each control step, (N,), by the scene's name of their motor."""
        held: Any = self.dimensionless.controller
        if "actuation" in self.walker.supports:
            held = zip(CHANNELS, np.broadcast_arrays(*held), strict=True)
        return dict(held)

    def facts(self) -> dict[str, str]:
        """Measures of the gait; its work is that which the scene charges."""
        return {
            "walker": name_of(self.walker),
            "slope": f"{self.slope:.6g} rad",
            "speed": in_words(self, "speed"),
            "cost of motors": f"{self.charged_cost:.6g}",
            "cost of transport": f"{self.cost_of_transport:.6g}",
            **({} if self.reward is None else {"reward of a stride": f"{self.reward:.6g}"}),
            "largest multiplier": f"{abs(self.multipliers[0]):.6g}",
            "": ("stable" if self.stable else "unstable") + ", the toe stubs" * self.stubs,
        }

    def columns(self) -> dict[str, NDArray]:
        """One row for each control step; a push-off acts at the end."""
        held: Any = self.controller
        controls = held._asdict() if "actuation" in self.walker.supports else held
        count = max(np.size(values) for values in controls.values())
        steps = {"control_step": np.arange(count)}
        return steps | {name: np.broadcast_to(x, count) for name, x in controls.items()}

    def to_json(self) -> dict[str, Any]:
        """Return the gait as numbers, text and lists by name.

        Raises:
            ValueError: if it is one of a `System`: equations are no numbers.
        """
        check_supports(self.walker, "McGeer's parameters")
        parts = vars(self) | {
            "controller": self.controller._asdict(),  # type: ignore[union-attr]
            "mean": self.mean._asdict() | {"walker": asdict(self.walker)},
            "multipliers": [[x.real, x.imag] for x in self.multipliers],
        }
        return json.loads(json.dumps(parts, default=lambda x: x.tolist()))

    @classmethod
    def from_json(cls, parts: Mapping[str, Any]) -> Self:
        """Return a gait from the result of `to_json`."""
        mean = Stride(**parts["mean"] | {"walker": Walker(**parts["mean"]["walker"])})
        own = {
            "state": np.array(parts["state"]),
            "controller": Actuation(**{x: np.array(y) for x, y in parts["controller"].items()}),
            "mean": one_of(mean, lambda x: np.array(x) if isinstance(x, list) else x),
            "multipliers": np.array([complex(*x) for x in parts["multipliers"]]),
        }
        return cls(**{**parts, **own})


class _StandsStill(Exception):
    """An optimization makes no progress: it zigzags about a corner of the cost."""


def slope_of(scene: Scene) -> float:
    """The one slope that a gait has.

    Raises:
        ValueError: if the scene has a range of slopes, or no actuator.
    """
    if not scene.actions:
        raise ValueError(
            f"an optimal gait is one of least work of actuators, and {describe(scene.walker)} has "
            "none: give it a control"
        )
    if isinstance(scene.slope, tuple):
        raise ValueError(
            f"a gait is of one slope, and this scene has those from {scene.slope[0]:g} to "
            f"{scene.slope[1]:g}: choose one by make_scene(scene, slope=...)"
        )
    return scene.slope


class Problem:
    """Cost and constraints over z = (point, driving parts, braking parts, push-off).

    Parts are from 0 to 1, those of the first motor's ticks before those of the second's; so is the
    push-off. With a reward, the cost is minus its mean over the control steps, of which there are
    as many as ticks.

    Attributes:
        deadline: Time of `time.monotonic` after which a search raises a `TimeoutError`.
        iterated: Function that is called in each iteration.
    """

    deadline: float = math.inf
    iterated: Callable[[], object] = staticmethod(int)

    def __init__(
        self, scene: Scene, speed: float | None, ticks: int, reward: StrideReward | None = None
    ) -> None:
        self.scene, self.speed, self.ticks, self.reward = scene, speed, ticks, reward
        self.slope, self.m = slope_of(scene), scene.walker.chart.dimension
        self.steps = ticks if reward is not None and scene.control == "tick" else 0
        self.tick = hold_time(scene)
        self.absolute, self.net = SHARES[scene.energy]
        self.edge: float | None = None  # when the knee has to lock, if that is fixed
        self.clears = False  # whether the swing leg has to be clear of the ground as the knee locks
        largest = {name: scene.largest(name) * (name in scene.actions) for name in scene.channels}
        self.largest_push = largest.pop("push_off", 0.0)
        self.pushes = self.largest_push > 0.0
        self.channels = [*largest]
        used = [motor for motor, name in enumerate(largest) if name in scene.actions]
        self.motors = max(used, default=0) + 1
        self.largest = np.repeat([*largest.values()][: self.motors], ticks)  # torque of each part
        works = Walkers(walker=scene.walker).system().works  # 0 of a hip, with feet of no mass
        works = np.divide(works, recorded_weight(scene.walker))
        self.works = np.repeat(works[: self.motors], ticks)
        self._last: tuple[Any, Any] = None, None

    def with_ticks(self, ticks: int) -> Problem:
        """Return the problem with another number of ticks."""
        other = Problem(self.scene, self.speed, ticks, self.reward)
        other.deadline, other.iterated = self.deadline, self.iterated
        return other

    def parts(self, z: NDArray) -> tuple[NDArray, NDArray]:
        """Driving and braking parts of z, views of it."""
        driving, braking = z[self.m : self.m + 2 * len(self.largest)].reshape(2, -1)
        return driving, braking

    def torques(self, z: NDArray) -> NDArray:
        """Torque of each motor in each tick, (motors, ticks)."""
        driving, braking = self.parts(z)
        return (self.largest * (driving - braking)).reshape(self.motors, -1)

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
        """Return the cost with its gradient, and the equality constraints with theirs."""
        return self._known(z)[:4]

    def room(self, z: NDArray) -> tuple[NDArray, NDArray]:
        """Return conditions that must not be negative, and their derivatives.

        For the toe to clear the ground: as the knee locks, a straight leg is above the ground if it
        is ahead of the stance leg and further from the vertical. With a reward: the heelstrike
        comes in the last control step. Empty where these are no conditions.
        """
        return self._known(z)[4:]

    def _known(self, z: NDArray) -> tuple[float, NDArray, NDArray, NDArray, NDArray, NDArray]:
        """Return cost, constraints and derivatives at z; those of the last z are kept."""
        key = z.tobytes(), self.clears, self.edge
        if key != self._last[0]:
            try:
                self._last = key, self._evaluate(z)
            except NoStride:  # no step of a line search ends here
                size, gaps = len(z), self.m + (self.speed is not None) + (self.edge is not None)
                sides = len(_AHEAD) * self.clears + 2 * (self.steps > 0)
                nowhere = math.inf, np.zeros(size), np.ones(gaps), np.zeros((gaps, size))
                self._last = key, (*nowhere, -np.ones(sides), np.zeros((sides, size)))
        return self._last[1]

    def _by_unknowns(self, by: NDArray) -> NDArray:
        """Derivatives by z, of those by point, torques and push-off."""
        m, n = self.m, len(self.largest)
        by_torque, by_push = self.largest * by[:, m : m + n], self.largest_push * by[:, m + n :]
        return np.hstack([by[:, :m], by_torque, -by_torque, by_push])

    def _room(self, z: NDArray, walked: PiecewiseConstantStride) -> tuple[NDArray, NDArray]:
        """Compute the result of `room`."""
        room, by_room = np.empty(0), np.empty((0, len(z)))
        if self.steps:
            late = walked.duration / self.tick - self.steps
            room = np.array([-late, 1.0 + late]) - _SPACE
            by_late = self._by_unknowns(walked.by[self.m : self.m + 1]) / self.tick
            by_room = np.vstack([-by_late, by_late])
        if not self.clears:
            return room, by_room
        walkers = Walkers(walker=self.scene.walker, using=("ankle_torque",) * (self.motors == 2))
        state, by = before_kneestrike(walkers, walked)
        ahead, by_ahead = _AHEAD @ state[:2] - _CLEAR, _AHEAD @ self._by_unknowns(by[:2])
        return np.append(room, ahead), np.vstack([by_room, by_ahead])

    def _evaluate(self, z: NDArray) -> tuple[float, NDArray, NDArray, NDArray, NDArray, NDArray]:
        m, walked = self.m, self.walk(z)
        by = self._by_unknowns(walked.by)
        cost, gradient = self._work(z, walked, by) if self.reward is None else self._paid(z, walked)
        gap, by_gap = walked.end - z[:m], by[:m]
        by_gap[:, :m] -= np.eye(m)
        if self.speed is not None:
            gap = np.append(gap, walked.length - self.speed * walked.duration)
            by_gap = np.vstack([by_gap, by[m + 1] - self.speed * by[m]])
        if self.edge is not None:
            gap = np.append(gap, walked.kneestrike - self.edge)
            by_gap = np.vstack([by_gap, by[-1]])
        return cost, gradient, gap, by_gap, *self._room(z, walked)

    def _work(
        self, z: NDArray, walked: PiecewiseConstantStride, by: NDArray
    ) -> tuple[float, NDArray[np.float64]]:
        """Return the motors' cost with its gradient, from the stride's derivatives by z."""
        m, n = self.m, len(self.largest)
        length, by_length = walked.length, by[m + 1]
        absolute, net = self.absolute * self.works, self.net * self.works
        held, torques = self.largest * sum(self.parts(z)), self.torques(z).ravel()
        of_torques = absolute * held * walked.turn.ravel() + net * torques * walked.swing.ravel()
        by_work = by[-2] + (net * torques) @ by[m + 2 : m + 2 + n]
        by_work += (absolute * held) @ by[m + 2 + n : m + 2 + 2 * n]
        turn = absolute * self.largest * walked.turn.ravel()
        swing = net * self.largest * walked.swing.ravel()
        by_work[m : m + 2 * n] += np.concatenate([turn + swing, turn - swing])
        cost = (of_torques.sum() + walked.push_work) / length
        return cost, (by_work - cost * by_length) / length

    def _paid(self, z: NDArray, walked: PiecewiseConstantStride) -> tuple[float, NDArray]:
        """Return minus the mean reward of the control steps, with its gradient."""
        assert self.reward is not None
        m, n, ticks = self.m, len(self.largest), self.ticks
        driving, braking = self.parts(z)
        held = (self.largest * (driving + braking)).reshape(-1, ticks)
        by_motor = dict(
            zip(self.channels, np.reshape(driving - braking, (-1, ticks)), strict=False)
        )
        pushed = np.full(ticks, z[-1])
        shares = np.array([by_motor.get(name, pushed) for name in self.scene.actions])
        total, by = self.reward.at(walked, self.torques(z), held, shares)
        if not (math.isfinite(total) and np.isfinite(by).all()):
            raise NoStride("the reward of this stride is not finite")
        own, by_held, by_shares = np.split(by, [walked.by.shape[1], walked.by.shape[1] + n])
        gradient = self._by_unknowns(own[None])[0]
        gradient[m : m + 2 * n] += np.tile(by_held * self.largest, 2)
        for name, slope in zip(self.scene.actions, by_shares.reshape(-1, ticks), strict=True):
            if name in by_motor:
                first = m + self.channels.index(name) * ticks
                gradient[first : first + ticks] += slope
                gradient[first + n : first + n + ticks] -= slope
            else:
                gradient[-1] += slope.sum()
        return -total / ticks, -gradient / ticks

    def solve(self, start: NDArray, *, known: float | None = None) -> NDArray:
        """Return the solution nearest to a start.

        The algebra of SLSQP grows with the cube of the unknowns, and most parts end at a bound:
        after a few iterations those are set aside that are there and would not leave.

        Args:
            start: The start.
            known: Where it is the solution of a problem that is much the same, the cost of that
                one: the search is given up if it costs more and does not close. With a reward it is
                one in other control steps, and the search is given up if it does not close.

        Raises:
            GaitNotFound: if SLSQP finds none.
        """
        z, free = start, np.zeros(len(start), bool)
        alike = known is not None and self.reward is None
        patience = _LITTLE if alike else _PATIENCE
        if not alike:
            z = self._minimised(start, self.box[:, 0] < self.box[:, 1], _FIRST)
        cost = math.inf
        for _ in range(_ROUNDS):
            wanted, before, cost = self._leaving(z), cost, self.at(z)[0]
            if not np.any(wanted & ~free) and not _is_less(cost, before, _WORTH):
                break
            free |= wanted
            z = self._minimised(z, free, _ITERATIONS, patience)
            if known is not None:
                costs_more = self.reward is not None or self.at(z)[0] > known
                if costs_more and max(self._apart(z)) > _OPEN:
                    break
        z = self._closed(z)
        cost = self.at(z)[0]
        driving, braking = self.parts(z)
        both = np.minimum(driving, braking)  # to push both ways at once does nothing, and costs
        driving -= both
        braking -= both
        if self.reward is not None and _is_less(cost, self.at(z)[0], _WORTH):
            raise ValueError(
                "the reward grows with the absolute work of an actuator, and so it has a corner "
                "where a torque changes its sign: leave out step.energy, or reward net work"
            )
        if not max(self._apart(z)) < _CLOSED:
            raise GaitNotFound(f"{self._no_gait()} was found")
        if self.clears and not self.allowed(z):
            raise GaitNotFound(
                f"{self._no_gait()} was found on which "
                "the toe clears the ground, as the scene's rule `end_on_toe_stub` asks for; try "
                "another `start`, or a scene with end_on_toe_stub=False"
            )
        return z

    def _apart(self, z: NDArray) -> tuple[float, float]:
        """Return how far a stride is from closing, and from ending in its last control step."""
        late = self.room(z)[0][: 2 * (self.steps > 0)]
        return float(np.max(np.abs(self.at(z)[2]))), max(-late.min(initial=0.0), 0.0)

    def allowed(self, z: NDArray) -> bool:
        """Return whether the scene allows a gait: no toe stubs where that ends an episode."""
        return not (self.scene.end_on_toe_stub and self._stubs(z))

    def _stubs(self, z: NDArray) -> bool:
        """Return whether the toe would stub."""
        if not self.scene.walker.toe_stubs:
            return False
        try:
            self.walk(z, end_on_toe_stub=True)
        except NoStride:
            return True
        return False

    def _no_gait(self) -> str:
        """Return the beginning of a message on a gait that is not found."""
        at = "" if self.speed is None else f" at speed {self.speed:g}"
        steps = f" in {self.steps} control steps" * (self.steps > 0)
        there = {"hip": "at the hip", "ankle": "at the ankle", "push_off": "as a push-off"}
        said = []
        for name in self.scene.actions:
            most, unit = self.scene.largest(name), self.scene.actuator(name).unit
            said.append(f"up to {most:g} {unit}".rstrip() + f" {there.get(name, 'as ' + name)}")
        return f"no gait{at}{steps} by motors of {' and '.join(said)}"

    def _minimised(
        self, start: NDArray, free: NDArray, iterations: int, patience: int = _PATIENCE
    ) -> NDArray:
        """Return z with some of the unknowns optimized, the others held."""
        # Of the cost, to the size of the constraints; costs of transport have small gradients.
        largest = 1.0 if self.reward is None else float(np.max(np.abs(self.at(start)[1])))
        scale = _LARGE if self.reward is None else 1.0 / (largest or 1.0)
        z, best = start.copy(), start[free]
        least, since = math.inf, 0  # the best merit so far, and points since it became better

        def at(unknown: NDArray) -> tuple[Any, ...]:
            z[free] = unknown
            return *self.at(z), *self.room(z)

        def look(unknown: NDArray) -> None:
            nonlocal best, least, since
            self.iterated()
            if time.monotonic() > self.deadline:
                raise TimeoutError
            cost, _, gap, _, room, _ = at(unknown)
            merit = cost * (scale / _LARGE)
            merit += 10.0 * float(np.abs(gap).sum() + np.maximum(-room, 0.0).sum())
            since = 0 if _is_less(merit, least, _GAIN) else since + 1
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
        parts = np.stack([np.zeros(len(self.largest)), self.largest > 0.0], axis=1)
        push = np.tile([0.0, 1.0], (int(self.pushes), 1))
        return np.concatenate([self.scene.walker.chart.box, parts, parts, push])

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

    def begun(self, point: ArrayLike, controls: Mapping[str, ArrayLike]) -> NDArray:
        """Return the z at a point of the section, under controls as those of `OptimalGait.held`.

        Motors without a control are at rest.
        """
        shares = np.zeros((self.motors, self.ticks))
        for row, name, most in zip(
            shares, self.channels, self.largest[:: self.ticks], strict=False
        ):
            held = np.asarray(controls.get(name, ()))
            if len(held) and most:
                there = np.minimum(np.arange(self.ticks), len(held) - 1)  # the last one is held
                row[:] = held[there] / most
        pushed = np.ravel(controls.get("push_off", 0.0))[0]
        push = [pushed / self.largest_push] if self.pushes else []
        parts = np.clip(np.concatenate([shares.ravel(), -shares.ravel(), push]), 0.0, 1.0)
        return np.concatenate([np.asarray(point), parts])

    def begun_at(self, gait: OptimalGait) -> NDArray:
        """Return the z of another gait."""
        return self.begun(gait.point.values[0], gait.held)

    def measured(self, z: NDArray) -> OptimalGait:
        """Return the gait of a solution."""
        gap, walked, scene = self.at(z)[2], self.walk(z), self.scene
        walker, units = scene.walker, scene.walker.units
        taken = control_steps(scene, float(walked.duration))
        walkers, pushes = Walkers(walker=walker), np.array([walked.push_work])
        torques, works = np.zeros((len(self.channels), self.ticks)), np.zeros((2, 2, 1))
        torques[: self.motors] = self.torques(z)
        working = (torques * np.array(walkers.system().works)[:, None])[: self.motors]
        places = reported_as(walker)[: self.motors]
        np.add.at(works[:, 0, 0], places, (working * walked.swing).sum(axis=1))
        np.add.at(works[:, 1, 0], places, (np.abs(working) * walked.turn).sum(axis=1))
        stride = account(
            walker, walkers.system(), walkers.constants, walked.steps.after[-1:, 0].copy(),
            works * units.energy, pushes * units.energy, (),
        )  # fmt: skip
        controller: Any = dict(zip(self.channels, torques[:, :taken], strict=True))
        if "actuation" in walker.supports:
            push_off = self.push_off(z) or 0.0
            held = Actuation(controller["hip"], controller["ankle"], push_off)
            controller = to_own(units, held)
        return OptimalGait(
            slope=self.slope,
            state=Section(walker=walker).states_at(z[None, : self.m])[0],
            controller=controller,
            mean=stride,
            multipliers=multipliers_of(walked.by_point),
            charged_cost=float(self._work(z, walked, self._by_unknowns(walked.by))[0]),
            on_edge=self.edge is not None,
            violation=float(np.max(np.abs(gap))),
            optimality=self.optimality(z),
            stubs=self._stubs(z),
            reward=None if self.reward is None else -self.at(z)[0] * self.ticks,
        )


def _is_less(number: float, other: float, gain: float) -> bool:
    """Return whether a number is less than another one by a gain, relative to that."""
    return number < other * (1.0 - math.copysign(gain, other))
