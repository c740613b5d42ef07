"""Periodic gaits of least cost of transport at a given speed, by direct optimisation.

Unknown are a point of the section and the torque of each tick; wanted is that the stride ends where
it began, at the speed asked for, for the least work of the motor. Each torque is the difference of
a driving and a braking part, neither of them negative, so that absolute work is smooth. SciPy's
SLSQP solves it with exact derivatives (see `ticks`), from gaits at neighbouring speeds.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from agents.feedback import powered_gait
from agents.files import replacing
from agents.ticks import TickedStride, section_point, ticked_stride
from gym_passive_walker import GaitNotFound
from gym_passive_walker.envs.scene import Scene, make_scene
from gym_passive_walker.gaits.gait import multipliers_of
from gym_passive_walker.gaits.stability import NoStride
from gym_passive_walker.physics.stride import frame_of

STORE = Path(__file__).parent / "gaits"
"""Where the optimal gaits of named scenes are kept."""

_SPARE = 1.5  # ticks given to a stride, over those it takes at first
_ITERATIONS = 600
_NEWTON = 3  # iterations that close a stride, from where the optimisation left it
_ALIKE = 1e-6  # relative difference of costs that is none
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


class _Problem:
    """Cost and constraints over z = (point, driving parts, braking parts), parts from 0 to 1."""

    def __init__(self, scene: Scene, speed: float, ticks: int, m: int) -> None:
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
            scene.walker, scene.slope, z[: self.m], self.torques(z), tick=self.tick, stub=stub
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
            self.absolute * held @ by[m + 2 + n : -1] + self.net * torque @ by[m + 2 : m + 2 + n]
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

    def guess(self, point: Sequence[float], torques: Sequence[float]) -> NDArray:
        """The z of a gait with other torques."""
        torques = np.asarray(torques)
        shares = np.pad(torques, (0, max(0, self.ticks - len(torques))), mode="edge")
        shares = shares[: self.ticks] / self.scene.max_hip_torque
        return np.concatenate([point, np.clip(np.concatenate([shares, -shares]), 0.0, 1.0)])

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
            slope=float(scene.slope),
            speed=walked.length / walked.duration,
            cost_of_transport=math.sin(scene.slope) + cost,
            hip_cost=cost,
            step_period=walked.duration,
            step_length=walked.length,
            point=z[: self.m].tolist(),
            torques=self.torques(z)[:taken].tolist(),
            multipliers=np.abs(multipliers_of(walked.by_point)).tolist(),
            kneestrike_time=walked.kneestrike,
            on_edge=self.edge is not None,
            violation=float(np.max(np.abs(gap))),
            optimality=self.optimality(z),
            stubs=stubs,
        )


def optimal_gait(
    scene: Scene | str | dict[str, Any], speed: float, *, start: OptimalGait | None = None
) -> OptimalGait:
    """The periodic gait of least cost of transport at a speed.

    The optimum is a local one: that which lies nearest to where the search starts.

    Args:
        scene: A `Scene`, its name, or a mapping of its arguments, of one slope: says which torques
            there are, for how long they are held and how the motor is charged.
        speed: Speed over sqrt(g l).
        start: A gait at a neighbouring speed; None is one with a constant torque.

    Raises:
        GaitNotFound: if none is found at that speed.
        ValueError: if the scene has a range of slopes, or the speed is not positive.
    """
    scene = make_scene(scene)
    if isinstance(scene.slope, tuple):
        raise ValueError(
            f"a gait is of one slope, and this scene has those from {scene.slope[0]:g} to "
            f"{scene.slope[1]:g}: choose one by make_scene(scene, slope=...)"
        )
    if not 0.0 < speed < 2.0:
        raise ValueError(f"speed must lie between 0 and 2, over sqrt(g l), not {speed!r}")
    start = start or constant_torque_gait(scene)
    ticks = 1 if scene.control == "stride" else math.ceil(_SPARE * start.step_period / scene.tick)
    problem = _Problem(scene, speed, ticks, len(start.point))
    z = problem.solve(problem.guess(start.point, start.torques))
    best = problem.measured(z)
    for edge in _edges(best, problem.tick):
        problem.edge = edge
        try:
            found = problem.measured(problem.solve(z))
        except GaitNotFound:
            continue
        if found.hip_cost <= best.hip_cost * (1.0 + _ALIKE):
            best = found
    return best


def _edges(gait: OptimalGait, tick: float) -> list[float]:
    """The ends of ticks about a gait's kneestrike.

    A torque that changes just as the knee locks makes a corner in the cost, and most optima lie in
    one; smooth optimisation finds them by holding the kneestrike there.
    """
    if gait.kneestrike_time == 0.0 or math.isinf(tick):
        return []
    before = round(gait.kneestrike_time / tick, 2)
    return [edge * tick for edge in range(math.floor(before), math.ceil(before) + 1)]


def constant_torque_gait(scene: Scene) -> OptimalGait:
    """The gait under a constant torque, passive where there is one, as a start for a search.

    Raises:
        GaitNotFound: if there is none.
    """
    walker, slope = scene.walker, float(np.mean(scene.slope))
    powered = powered_gait(walker, slope)
    point = section_point(walker, powered.state)
    torque = np.array([powered.hip_torque / frame_of(walker).torque])
    walked = ticked_stride(walker, slope, point, torque, tick=math.inf)
    ticks = 1 if scene.control == "stride" else math.ceil(walked.duration / scene.tick)
    problem = _Problem(scene, walked.length / walked.duration, ticks, len(point))
    return problem.measured(problem.guess(point, torque))


def optimal_gaits(
    scene: Scene | str | dict[str, Any], speeds: Iterable[float]
) -> list[OptimalGait]:
    """Optimal gaits at several speeds, each found from its neighbours; those that exist.

    The search goes outwards from the constant torque's own speed until there is no gait any more,
    and then once back; of two optima at one speed the cheaper one is kept.

    Args:
        scene: As of `optimal_gait`.
        speeds: Speeds over sqrt(g l).
    """
    scene = make_scene(scene)
    natural = constant_torque_gait(scene)
    speeds = sorted(speeds, key=lambda speed: abs(speed - natural.speed))
    best: dict[float, OptimalGait] = {}
    for way in (
        [speed for speed in speeds if speed >= natural.speed],
        [speed for speed in speeds if speed < natural.speed],
    ):
        last = natural
        for speed in [*way, *way[::-1]]:
            if speed in best and last is best[speed]:
                continue
            try:
                last = found = optimal_gait(scene, speed, start=last)
            except GaitNotFound:
                if speed not in best:
                    break
                last = best[speed]
                continue
            if speed not in best or found.hip_cost < best[speed].hip_cost:
                best[speed] = found
            last = best[speed]
    return [best[speed] for speed in sorted(best)]


def save(path: Path, gaits: list[OptimalGait]) -> None:
    """Write gaits as JSON."""
    with replacing(path) as aside:
        lines = ",\n".join(json.dumps(asdict(gait)) for gait in gaits)
        aside.write_text(f"[\n{lines}\n]\n", encoding="utf-8")


def load(scene: str) -> list[OptimalGait]:
    """The stored gaits of a named scene, by growing speed.

    Raises:
        ValueError: if there are none.
    """
    path = STORE / f"{scene}.json"
    if not path.is_file():
        known = ", ".join(sorted(path.stem for path in STORE.glob("*.json"))) or "none"
        raise ValueError(
            f"no optimal gaits of scene {scene!r} are stored, only those of: {known}; "
            f"`python train.py optimal --scene {scene}` computes them"
        )
    return [OptimalGait(**entry) for entry in json.loads(path.read_text(encoding="utf-8"))]


def stored_name(scene: Scene) -> str:
    """The name of the stored gaits that are of a scene: of its walker, slope, motor and charge.

    Raises:
        ValueError: if there are none.
    """
    kept = ("walker", "slope", "control", "tick", "max_hip_torque", "energy")
    for path in sorted(STORE.glob("*.json")):
        other = make_scene(path.stem)
        if all(getattr(scene, name) == getattr(other, name) for name in kept):
            return path.stem
    raise ValueError(
        "no optimal gaits of this scene are stored: find one by "
        "agents.optimal.optimal_gait(scene, speed)"
    )


def least_cost(gaits: list[OptimalGait], speed: float) -> float:
    """Cost of transport of the optimum at a speed, between the stored ones; NaN outside them."""
    speeds = [gait.speed for gait in gaits]
    costs = [gait.cost_of_transport for gait in gaits]
    return float(np.interp(speed, speeds, costs, left=math.nan, right=math.nan))
