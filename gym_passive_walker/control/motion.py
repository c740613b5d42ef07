"""Walkers carried on for a while, with exact derivatives: what ticks and strides are made of.

Any number of walkers go on from wherever they are, each until a time of its own, its heelstrike or
its fall. Derivatives are carried along through the flow, the strikes and the moments at which they
happen. Everything is dimensionless.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker.engine.layout import RECORD
from gym_passive_walker.engine.run import advance
from gym_passive_walker.gaits.section import Section
from gym_passive_walker.physics import legs
from gym_passive_walker.physics.hybrid import Control, Ground, Outcome, State, System
from gym_passive_walker.physics.systems import bodies_by, system_of, varied_bodies
from gym_passive_walker.walkers import Walker

_RECORDED = (
    "state", "time", "moved", "turned", "knee_time", "knee_loss", "heel_loss", "step_length",
    "gravity_work", "spring_work", "friction_loss",
)  # fmt: skip

ROWS = (*State._fields, *_RECORDED[1:])
"""What is told of a walker, in order: the state, after a heelstrike that of the next stride; the
time since the stride began; how far the hip has opened, net and either way: the work of a unit
torque; when the knee locked, what both strikes cost; the step length and the work of gravity and
of springs in a stride that has ended, 0 where there are none; and what friction has taken."""

MOTORS = ("ankle_moved", "ankle_turned", "push_work")
"""What other motors have done: likewise how far the ankle has tipped, and the push-off's work."""


def _place(name: str, i: int = 0) -> int:
    """Where a number of a record lies among all of them."""
    return RECORD.fields[name][1] // 8 + i  # type: ignore[index]


_PLACES = [
    _place(name, i)
    for name in _RECORDED
    for i in range(len(State._fields) if name == "state" else 1)  # of controls the hip's, the first
]
_MOTOR_PLACES = [_place("moved", 1), _place("turned", 1), _place("push_work")]
_SIZE = len(State._fields)
_MIRRORED = np.array([1.0, -1.0, -1.0])  # angles of a state on the section, by the stance angle's
_STRUCK = int(Outcome.HEELSTRIKE)  # greater outcomes are falls: no strike but this ends a motion
_INFINITESIMAL = 1e-100
_ALL = slice(None)
_VERGE = 1e-9  # of the way to a strike, before it


class _Columns(NamedTuple):
    """What k columns of derivatives are by: their names, and how inputs change in each."""

    names: tuple[str, ...]
    states: NDArray[np.float64]  # (k, 6)
    slopes: NDArray[np.float64]  # (k,)
    controls: NDArray[np.float64]  # (k, 2)
    push_offs: NDArray[np.float64]  # (k,)
    starts: NDArray[np.float64]
    ends: NDArray[np.float64]


@lru_cache
def _columns(walker: Walker, by: tuple[str, ...]) -> _Columns:
    section = Section(walker=walker)
    of_state = {"state": np.eye(_SIZE), "point": section.state(np.eye(section.dimension))}
    states = [of_state.get(name, np.zeros((1, _SIZE))) for name in by]
    names = tuple(name for name, rows in zip(by, states, strict=True) for _ in rows)

    def by_each(*wanted: str) -> NDArray:
        return np.array([[float(x == name) for name in wanted] for x in names])

    return _Columns(
        names,
        np.concatenate([np.zeros((0, _SIZE)), *states]),
        controls=by_each("torque", "ankle").reshape(-1, 2),
        **{f"{name}s": by_each(name).ravel() for name in ("slope", "push_off", "start", "end")},
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion:
    """How walkers of one kind move.

    Attributes:
        walker: The walker.
        parameters: Values of parameters in which walkers differ from it, a number or (n,).
        tolerance: Of the integration.
        stub: Whether a stubbed toe ends a stride.
        motors: Which motors they have besides the hip's: "ankle", "push_off".
    """

    walker: Walker
    parameters: Mapping[str, ArrayLike] = field(default_factory=dict)
    tolerance: float = 1e-12
    stub: bool = False
    motors: tuple[str, ...] = ()

    def system(self, using: Collection[str] = ()) -> System:
        """Which equations the walkers obey, as some of their parameters change."""
        return system_of(self.walker, using={*self.parameters, *self.motors, *using})

    @cached_property
    def section(self) -> Section:
        """Where their strides begin."""
        return Section(walker=self.walker)

    @cached_property
    def _bodies(self) -> NDArray[np.float64]:
        return varied_bodies(self.walker, self.parameters)[:, None]

    @cached_property
    def _changes(self) -> dict[str, NDArray[np.float64]]:
        """How constants change with parameters, as far as anyone has asked."""
        return {}

    def bodies(self, columns: tuple[str, ...]) -> NDArray[np.float64]:
        """Constants of the walkers, and how they change: (1 or n, 1 or 1 + k, constants)."""
        own, moving = self._bodies, [name for name in columns if name in vars(self.walker)]
        if not moving:
            return own
        planes = np.concatenate([own, np.zeros((len(own), len(columns), own.shape[2]))], axis=1)
        for name in moving:
            if name not in self._changes:
                self._changes[name] = bodies_by(self.walker, self.parameters, name)
            planes[:, 1 + columns.index(name)] = self._changes[name]
        return planes

    def follow(
        self,
        records: NDArray,
        by: Sequence[str] = (),
        *,
        lanes: NDArray | slice = _ALL,
        from_section: bool = False,
    ) -> Carried:
        """Carry walkers on, each to its `end`, its heelstrike or its fall.

        Args:
            records: Where they are, what they hold and until when, (n, 1) of `engine.layout.RECORD`
                (see `new_records`); left as they are.
            by: Columns of the derivatives, in order: "state" (one for each of its six numbers) or
                "point" (one for each coordinate of the section), "slope", "torque" of the hip,
                "ankle" and "push_off", a parameter of the walker, "start", the stance angle with
                which the stride began (legs mirrored), by which its length changes, or "end", the
                time to stop.
            lanes: Which walkers these are, where parameters are given for more.
            from_section: Whether a stride begins here.
        """
        columns = _columns(self.walker, tuple(by))
        walked = np.zeros((len(records), 1 + len(columns.names)), RECORD)
        walked[:, :1] = records
        walked["outcome"] = 0
        changes = walked[:, 1:]
        changes["state"], changes["control"] = columns.states, columns.controls
        changes["push_off"] = columns.push_offs
        if "slope" in by:
            turn = records["ground"][:, :, 1::-1] * [1.0, -1.0]
            changes["ground"][..., :2] = columns.slopes[:, None] * turn
        if "start" in by:
            changes["start"] = columns.starts[:, None] * _MIRRORED
        changes["end"] = columns.ends
        bodies = self.bodies(columns.names)
        bodies = bodies if len(bodies) == 1 else bodies[lanes]
        self.advance(columns.names, bodies, walked, from_section=from_section)
        return Carried(self, columns, bodies, records, walked, from_section)

    def advance(
        self, moving: Collection[str], bodies: NDArray, records: NDArray, *, from_section: bool
    ) -> None:
        """Carry records on in place; see `engine.run.advance`."""
        told = {"tolerance": self.tolerance, "scuff": self.stub, "from_section": from_section}
        advance(self.system(moving), bodies, records, **told)


@dataclass(frozen=True, eq=False)
class Carried:
    """What has become of n walkers; derivatives are 0 where one fell.

    Attributes:
        motion: How they moved.
        columns: What k columns of derivatives are by.
        bodies: Their constants, and how these change, as of `Motion.bodies`.
        before: Records from which they came, (n, 1).
        walked: Records, with derivatives behind each, (n, 1 + k).
        from_section: Whether a stride began there.
    """

    motion: Motion
    columns: _Columns
    bodies: NDArray
    before: NDArray
    walked: NDArray
    from_section: bool

    @property
    def records(self) -> NDArray:
        """Where walkers are now, to go on from, (n, 1)."""
        return self.walked[:, :1]

    @property
    def outcomes(self) -> NDArray[np.int64]:
        """How it ended, an `Outcome` for each, (n,); RUNNING where the time was up."""
        return self.walked["outcome"][:, 0]

    @property
    def locked(self) -> NDArray[np.bool_]:
        """Whose knee has locked on the way, (n,)."""
        return self.walked["knee_time"][:, 0] != self.before["knee_time"][:, 0]

    @cached_property
    def told(self) -> NDArray[np.float64]:
        """ROWS of each walker: the value, then its derivatives, (n, rows, 1 + k)."""
        return self._numbers(_PLACES)

    @cached_property
    def told_of_all(self) -> NDArray[np.float64]:
        """ROWS and MOTORS of each walker, likewise."""
        return self._numbers(_PLACES + _MOTOR_PLACES)

    def _numbers(self, places: list[int]) -> NDArray:
        numbers = self.walked.view(float).reshape(*self.walked.shape, -1)
        return self._told(numbers.swapaxes(1, 2)[:, places])

    @cached_property
    def distance(self) -> NDArray[np.float64]:
        """How far hips have come along the slope, and its derivatives, (n, 1 + k)."""
        stances = np.empty(self.walked.shape)
        stances[:, :1], stances[:, 1:] = self.before["state"][..., 0], self.columns.states[:, 0]
        Body = self.motion.system().Body
        before = _places(Body, self.bodies, stances)
        after = _places(Body, self.bodies, self.walked["state"][..., 0])
        return self._told(legs.travelled(before, after, self.outcomes[:, None] == _STRUCK))

    def _told(self, numbers: NDArray) -> NDArray:
        numbers[self.outcomes > _STRUCK, ..., 1:] = 0.0
        return numbers

    @cached_property
    def margins(self) -> NDArray[np.float64]:
        """How far the strikes that happened are from grazing, (n,).

        The rate with which what ends a phase falls through zero: of the angle between the links
        that a kneestrike brings together, or of the legs' sum at a heelstrike, in rad over
        sqrt(l/g); the least where there were two strikes. Derivatives of what a strike decides
        have it in their denominator. Infinite without strikes, NaN where a walker fell.
        """
        margins, fell = np.full(len(self.walked), np.inf), self.outcomes > _STRUCK
        margins[fell] = np.nan
        for struck, time, outcome in (
            (self.locked, "knee_time", Outcome.KNEESTRIKE),
            (self.outcomes == _STRUCK, "time", Outcome.HEELSTRIKE),
        ):
            lanes = np.flatnonzero(struck & ~fell)
            if len(lanes):
                rates = self._rate_of_fall(lanes, self.walked[time][lanes, :1], outcome)
                margins[lanes] = np.minimum(margins[lanes], -rates)
        return margins

    def _rate_of_fall(
        self, lanes: NDArray, times: NDArray, outcome: Outcome
    ) -> NDArray[np.float64]:
        """How fast a strike's guard changes on the verge of it, for some walkers, (lanes,)."""
        motion, verge = self.motion, self.before[lanes]
        system = motion.system()
        bodies = (self.bodies if len(self.bodies) == 1 else self.bodies[lanes])[:, :1]
        verge["end"], verge["outcome"] = times - _VERGE * (times - verge["time"]), 0
        motion.advance((), bodies, verge, from_section=self.from_section)
        record = verge[:, 0]
        phase = system.phases[record["phase"][0]]
        body, state = system.Body(*bodies[:, 0].T), State(*record["state"].T)
        control, ground = Control(*record["control"].T), Ground(*record["ground"].T)
        stance, thigh, *shank = phase.accelerations(body, state, control, ground)
        motion_of = (*state[3:], stance, thigh, *(shank or [thigh]))
        ahead = State(*(x + 1j * _INFINITESIMAL * v for x, v in zip(state, motion_of, strict=True)))
        guard = next(guard for guard in phase.guards if guard.outcome == outcome)
        return np.imag(guard.falls(body, ahead, ground)) / _INFINITESIMAL


def _places(Body: type, bodies: NDArray, stances: NDArray) -> NDArray:
    """Where hips are, by constants (1 or n, 1 or 1 + k, ...) and angles (n, 1 + k); as these."""

    def at(bodies: NDArray, stances: NDArray) -> NDArray:
        return legs.progress(Body(*np.moveaxis(bodies, -1, 0)), stances)

    changed = np.imag(at(_changed(bodies), _changed(stances))) / _INFINITESIMAL
    return np.concatenate([at(bodies[:, :1], stances[:, :1]), changed], axis=1)


def _changed(values: NDArray) -> NDArray:
    """Values (n, 1 + k, ...) changed infinitesimally, (n, k, ...); or none of them."""
    if values.shape[1] == 1:
        return values + 0j
    return values[:, :1] + 1j * _INFINITESIMAL * values[:, 1:]
