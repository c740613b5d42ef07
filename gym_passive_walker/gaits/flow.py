"""The flow: where walkers come to, through impacts, by a heelstrike or a time; with tangents.

Every analysis follows walkers by `flow`, or by `go_on` from where that has left them; nothing else
above the engine calls it, but kernels of environments and devices that it runs inside. Tangents are
carried beside the values through the motion, the impacts and the moments at which they happen
(which saltation matrices account for elsewhere). Everything is dimensionless (see `units`).
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache, partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker.engine.layout import Layout, layout_in, layout_of, record_for
from gym_passive_walker.engine.run import (
    LONGEST_STRIDE,
    advance,
    new_records,
    put_states,
    states_in,
)
from gym_passive_walker.gaits.actuation import USES
from gym_passive_walker.gaits.measures import RECORDED
from gym_passive_walker.gaits.section import Section
from gym_passive_walker.models.equations.hybrid import Ground, Guard, Outcome, Phase, State, System
from gym_passive_walker.models.equations.numbers import complex_step, step_derivative
from gym_passive_walker.models.equations.systems import UNEVEN
from gym_passive_walker.models.model import bodies, constants_by
from gym_passive_walker.models.walkers import Walker

_SIZE = len(State._fields)
_STRUCK = int(Outcome.HEELSTRIKE)  # greater outcomes are falls: no strike but this ends a flow

_ALL = slice(None)
_OF_ONE_STRIDE = ("time", "step", "knee_time", "knee_loss", "friction_loss", "moved", "turned")

STATE_BEFORE = 1e-8
"""Share of the time until an impact at which a state before it is taken: large enough that the
impact has not come by its error, and small enough that its square is below rounding."""
RATE_BEFORE = 1e-9
"""Share of the time until an impact at which rates before it are taken: they err by as much."""


Entry = str | tuple[str, int]
"""A number of a record: a field, or a field and an index in it."""


class Reported(NamedTuple):
    """The numbers that are reported of a walker, its state first.

    Of a stride that has not ended, its step length and its works are 0 so far.

    Attributes:
        entries: Each as an entry of a record, for `rows_of`.
        size: Numbers of a state; after a heelstrike it is that of the next stride.
        at: Place of each entry. What control j has moved is ("moved", j), net: the work of a unit;
            and ("turned", j), either way.
    """

    entries: tuple[Entry, ...]
    size: int
    at: dict[Entry, int]


def report_of(system: System) -> Reported:
    """Return what is reported of the walkers of a system."""
    return _report(system.coordinates, len(system.works), layout_of(system).links)


@lru_cache
def _report(coordinates: int, controls: int, room: int) -> Reported:
    states = [("state", i + part) for part in (0, room) for i in range(coordinates)]
    angles = [(name, j) for name in ("moved", "turned") for j in range(controls)]
    entries: tuple[Entry, ...] = (*states, *(each.of for each in RECORDED), *angles, "passed")
    return Reported(entries, len(states), {entry: place for place, entry in enumerate(entries)})


@lru_cache
def offsets(entries: tuple[Entry, ...], layout: Layout) -> list[int]:
    """Places of entries among the numbers of a record."""
    fields: Any = record_for(layout).fields
    pairs = [entry if isinstance(entry, tuple) else (entry, 0) for entry in entries]
    return [fields[name][1] // 8 + index for name, index in pairs]


def numbers_of(records: NDArray) -> NDArray[np.float64]:
    """View records (...) as plain numbers, (..., m): NumPy copies these several times as fast."""
    return records.view(float).reshape(*records.shape, records.itemsize // 8)  # also of none


def rows_of(records: NDArray, entries: tuple[Entry, ...]) -> NDArray[np.float64]:
    """Return entries of records (n, 1 + k): values, then tangents, which are 0 after a fall.

    Returns:
        Shape (n, entries, 1 + k).
    """
    places = offsets(entries, layout_in(records.dtype))
    rows = numbers_of(records).swapaxes(1, 2)[:, places]
    rows[records["outcome"][:, 0] > _STRUCK, :, 1:] = 0.0
    return rows


class FlowTangents(NamedTuple):
    """Variables of k tangents, and the changes of inputs along each.

    Attributes:
        names: Variable of each, (k,).
        states: Changes of the state, (k, 6) or (n, k, 6).
        slopes: Changes of the slope, (k,).
        inputs: Other changes: the field of a record, an index into it, and values (k, ...).
    """

    names: tuple[str, ...]
    states: NDArray[np.float64]
    slopes: NDArray[np.float64]
    inputs: tuple[tuple[str, Any, NDArray[np.float64]], ...] = ()


_NONE = FlowTangents((), np.empty((0, _SIZE)), np.empty(0))


@lru_cache
def _tangents(walker: Walker, by: tuple[str, ...], directions: int | None = None) -> FlowTangents:
    """Tangents by name; of "point" as many as directions are given, else one a coordinate."""
    section = Section(walker=walker)
    size = section.size
    points = np.eye(section.dimension)
    if directions is not None:
        points = np.zeros((directions, section.dimension))
    starts = section.chart.starts
    of_start = np.zeros((len(starts), size))
    of_state = {"state": np.eye(size), "point": section.state(points), "start": of_start}
    states = [of_state.get(name, np.zeros((1, size))) for name in by]
    names = tuple(name for name, rows in zip(by, states, strict=True) for _ in rows)

    def by_each(*wanted: str) -> NDArray:
        return np.array([[float(x == name) for name in wanted] for x in names])

    controls = tuple(name for name in walker.inputs if name != "push_off")
    began = np.zeros((len(names), size // 2))
    began[[i for i, name in enumerate(names) if name == "start"]] = starts[: names.count("start")]
    inputs = (
        ("control", (..., slice(len(controls))), by_each(*controls)),
        ("push_off", ..., by_each("push_off").ravel()),
        ("ground", (..., slice(2, None)), by_each(*UNEVEN)),
        ("start", (..., slice(size // 2)), began),
        ("end", ..., by_each("end").ravel()),
    )
    return FlowTangents(
        names, np.concatenate([np.zeros((0, size)), *states]), by_each("slope").ravel(),
        tuple(entry for entry in inputs if entry[2].any()),
    )  # fmt: skip


@dataclass(kw_only=True, eq=False)  # not frozen: one walker's stride waits for each of these
class Walkers:
    """One walker, or n that differ from it in some parameters, and how exactly to follow them.

    Attributes:
        walker: The walker.
        parameters: Values of parameters in which walkers differ from it, a number or (n,).
        using: Actuators besides the hip's: "ankle_torque", "push_off".
        tolerance: Error of the integration, relative to the largest angle or rate.
        end_on_toe_stub: Whether a kneed walker's locked swing leg below the ground ends the stride.
    """

    walker: Walker
    parameters: Mapping[str, ArrayLike] = field(default_factory=dict)
    using: tuple[str, ...] = ()
    tolerance: float = 1e-12
    end_on_toe_stub: bool = False

    def system(self, moving: Collection[str] = ()) -> System:
        """Return the system of the walkers, in which the named quantities can change too."""
        if not (self.parameters or self.using or moving):
            return self.walker.equations()
        using = {*self.parameters, *self.using, *moving}
        return self.walker.equations({USES.get(name, name) for name in using})

    @cached_property
    def section(self) -> Section:
        """Poincaré section of the walkers."""
        return Section(walker=self.walker)

    @cached_property
    def constants(self) -> NDArray[np.float64]:
        """The walkers' constants, (1 or n, 1, constants): one for all, or each."""
        if not self.parameters:
            return bodies(self.walker)
        return self.walker.constants(**self.parameters)[:, None]

    @cached_property
    def _changes(self) -> dict[str, NDArray[np.float64]]:
        """Derivatives of the constants by the parameters used so far."""
        return {}

    @cached_property
    def _numbers(self) -> Mapping[str, float]:
        """Parameters of the walker; a search for a gait asks for them in each step."""
        return self.walker.parameters

    def bodies(
        self, names: Sequence[str] = (), lanes: NDArray | slice = _ALL
    ) -> NDArray[np.float64]:
        """Constants of some walkers, and their tangents: (1 or n, 1 or 1 + k, constants)."""
        own = self.constants if len(self.constants) == 1 else self.constants[lanes]
        if not names:
            return own
        moving = [name for name in names if name in self._numbers]
        if not moving:
            return own
        planes = np.zeros((len(own), 1 + len(names), own.shape[2]))
        planes[:, :1] = own
        for name in moving:
            if name not in self._changes:
                self._changes[name] = constants_by(self.walker, self.parameters, name)
            change = self._changes[name]
            planes[:, 1 + names.index(name)] = change if len(change) == 1 else change[lanes]
        return planes


@dataclass(eq=False)
class Flow:
    """Result of a flow of n walkers; dimensionless.

    Attributes:
        walkers: The walkers.
        system: Equations of the walkers.
        tangents: Variables of the tangents.
        bodies: The walkers' constants with their tangents, as in `Walkers.bodies`.
        records: Records at the end, of `engine.layout.RECORD`: values, and k tangents behind each,
            (n, 1 + k).
        began: Gives the records from which they came; None for strides after the first.
        on_section: Whether a stride began there.
        instants: Number n of walkers, and number k of records in a row for each, followed to a time
            each; None where there is one.
    """

    walkers: Walkers
    system: System
    tangents: FlowTangents
    bodies: NDArray
    records: NDArray
    began: Callable[[], NDArray] | None
    on_section: bool
    instants: tuple[int, int] | None = None

    @cached_property
    def before(self) -> NDArray:
        """Records from which walkers came, (n, 1)."""
        if self.began is None:
            raise ValueError("where a later stride began is not kept: follow it by itself")
        return self.began()

    @property
    def here(self) -> NDArray:
        """Records to continue from, (n, 1)."""
        return self.records[:, :1]

    @property
    def outcomes(self) -> NDArray[np.int64]:
        """`Outcome` of each walker, (n,); RUNNING where the time was up."""
        return self.records["outcome"][:, 0]

    @property
    def struck(self) -> NDArray[np.bool_]:
        """Whether each stride has ended with a heelstrike, (n,)."""
        return self.outcomes == _STRUCK

    @property
    def locked(self) -> NDArray[np.bool_]:
        """Whether each knee has locked on the way, (n,)."""
        before = 0.0 if self.on_section else self.before["knee_time"][:, 0]
        return self.records["knee_time"][:, 0] != before

    @property
    def states(self) -> NDArray[np.float64]:
        """States at the end, (n, 6); (n, k, 6) at k instants."""
        return self._shaped(states_in(self.records[:, 0], self.system.coordinates))

    @property
    def stages(self) -> NDArray[np.int64]:
        """`Stage` of the swing leg, (n,); (n, k) at k instants."""
        stages = np.array([phase.stage for phase in self.system.phases])
        return self._shaped(stages[self.records["phase"][:, 0]])

    def _shaped(self, each: NDArray) -> NDArray:
        return each if self.instants is None else each.reshape(*self.instants, *each.shape[1:])

    @property
    def rows(self) -> NDArray[np.float64]:
        """The numbers of `report_of`, as from `rows_of`, (n, entries, 1 + k)."""
        return rows_of(self.records, report_of(self.system).entries)

    @cached_property
    def distance(self) -> NDArray[np.float64]:
        """Distance of hips along the ground that they stood on, with tangents, (n, 1 + k).

        Of a user's system it is the centre of mass.
        """
        shape = *self.records.shape, 2 * self.system.coordinates
        states = np.empty(shape)
        states[:, :1] = states_in(self.before, self.system.coordinates)
        states[:, 1:] = self.tangents.states
        before = hip_places(self.system, self.bodies, states)
        places = hip_places(self.system, self.bodies, states_in(self.records, shape[-1] // 2))
        travelled = np.where(self.struck[:, None], self.records["passed"], places) - before
        travelled[self.outcomes > _STRUCK, 1:] = 0.0
        return travelled

    @cached_property
    def margins(self) -> NDArray[np.float64]:
        """Distances of the strikes from grazing, (n,).

        The rate with which what ends a phase falls through zero: of the angle between the links
        that a kneestrike brings together, or of the legs' sum at a heelstrike, in rad over
        sqrt(l/g); the least where there were two strikes. Derivatives of what a strike decides
        have it in their denominator. Infinite without strikes, NaN where a walker fell.
        """
        margins, fell = np.full(len(self.records), np.inf), self.outcomes > _STRUCK
        margins[fell] = np.nan
        for struck, time, outcome in (
            (self.locked, "knee_time", Outcome.KNEESTRIKE),
            (self.struck, "time", Outcome.HEELSTRIKE),
        ):
            lanes = np.flatnonzero(struck & ~fell)
            for on, verge, phase, falls in self._verges(lanes, time, outcome):
                record, states = verge.records[:, 0], verge.states
                bodies, ground = verge.bodies[:, 0], Ground(*record["ground"].T)
                turns = accelerations_at(
                    self.system, phase, bodies, states, record["control"], ground
                )
                moving = np.concatenate([np.split(states, 2, axis=1)[1], turns], axis=1)
                rates = step_derivative(falls(complex_step(states, moving)))
                margins[on] = np.minimum(margins[on], -rates)
        return margins

    @property
    def steepness(self) -> NDArray[np.float64]:
        """How steeply the foot comes down at the heelstrike, (n,): 1 at most, 0 where it grazes.

        The cosine between the motion and the steepest descent of the guard, in the space of the
        coordinates; NaN where a stride has no heelstrike.
        """
        found, half = np.full(len(self.records), np.nan), self.system.coordinates
        lanes = np.flatnonzero(self.struck)
        for on, verge, _, falls in self._verges(lanes, "time", Outcome.HEELSTRIKE):
            states, ways = verge.states, np.eye(2 * half)[:half]
            by = [step_derivative(falls(complex_step(states, way))) for way in ways]
            steepest = np.stack(np.broadcast_arrays(*by), axis=-1)
            steepest = steepest / np.linalg.norm(by, axis=0)[:, None]
            rates = states[:, half:]
            found[on] = -(steepest * rates).sum(axis=1) / np.linalg.norm(rates, axis=1)
        return found

    def _verges(
        self, lanes: NDArray, time: str, outcome: Outcome
    ) -> Iterator[tuple[NDArray, Flow, Phase, Callable[[NDArray], NDArray]]]:
        """Yield walkers just before a strike, for each phase that it ends.

        `time` names the strike's time in records. Yielded are the phase's walkers, their flow to
        just before the strike, the phase, and its guard as a function of states.
        """
        if len(lanes) == 0:
            return
        times, system = self.records[time][lanes, 0], self.system
        way, share = times - self.before["time"][lanes, 0], np.full(len(lanes), RATE_BEFORE)
        guards = [{guard.outcome: guard for guard in phase.guards} for phase in system.phases]
        ahead = np.array([outcome in each for each in guards]) | (outcome == Outcome.HEELSTRIKE)
        while True:
            verge = self.again(lanes, times - share * way)
            phases = verge.records["phase"][:, 0]
            early = (verge.outcomes != Outcome.RUNNING) | ~ahead[phases]
            if not early.any():
                break
            share[early] *= 10.0  # a way so short that the strike's error is as long
        for number in np.unique(phases):
            if outcome not in guards[number]:  # a kneestrike comes between
                continue
            on, phase, there = phases == number, system.phases[number], verge
            if not on.all():
                there = self.again(lanes[on], (times - share * way)[on])
            body, ground = there.bodies[:, 0], there.records["ground"][:, 0]
            here = guards[number][outcome], system.Body(*body.T), Ground(*ground.T)
            yield lanes[on], there, phase, partial(_height, system, *here)

    def next_stride(
        self, on: NDArray[np.bool_], ground: tuple[NDArray, float, float] | None = None
    ) -> Flow:
        """The next stride of some walkers, (n,), after a heelstrike.

        Tangents go on from this one: they are of all strides since the first. Legs exchange the
        parameters in which they differ.

        Args:
            on: Whether to continue each walker, (n,).
            ground: Slopes of their footholds, and rise and turn of the next; as before when None.
        """
        records, bodies = self.records, self.walkers.walker.swap(self.bodies)
        if not on.all():
            records, bodies = records[on], bodies[on] if len(bodies) > 1 else bodies
        for name in _OF_ONE_STRIDE:
            records[name] = 0.0
        records["outcome"] = 0
        if ground is not None:
            slopes, *foothold = ground
            turned = np.stack([np.sin(slopes), np.cos(slopes)], axis=-1)
            records["ground"][:, 0, :2], records["ground"][:, 0, 2:] = turned, foothold
            records["ground"][:, 1:, :2] = ground_changes(turned, self.tangents.slopes)
        later = Flow(self.walkers, self.system, self.tangents, bodies, records, None, True)
        return later.integrate()

    def again(self, lanes: NDArray, until: NDArray) -> Flow:
        """The same way once more for some walkers, to other times, without tangents."""
        records = self.before[lanes]
        records["end"], records["outcome"] = until[:, None], 0
        bodies = (self.bodies if len(self.bodies) == 1 else self.bodies[lanes])[:, :1]
        once_more = Flow(self.walkers, self.system, _NONE, bodies, records, None, self.on_section)
        return once_more.integrate()

    def integrate(
        self, backend: Callable[..., object] = advance, threads: int | None = None
    ) -> Flow:
        """Carry the records on, in place; arguments as for `flow`."""
        backend(
            self.system, self.bodies, self.records, tolerance=self.walkers.tolerance,
            scuff=self.walkers.end_on_toe_stub, from_section=self.on_section, threads=threads,
        )  # fmt: skip
        return self


def flow(
    walkers: Walkers,
    states: NDArray,
    slopes: ArrayLike,
    *,
    controls: ArrayLike = 0.0,
    push_offs: ArrayLike = 0.0,
    rises: ArrayLike | None = None,
    turns: ArrayLike | None = None,
    until: ArrayLike = LONGEST_STRIDE,
    save_at: NDArray | None = None,
    by: Sequence[str] = (),
    along: NDArray | None = None,
    lanes: NDArray | slice = _ALL,
    threads: int | None = None,
    backend: Callable[..., object] = advance,
) -> Flow:
    """Follow walkers from just after a heelstrike to the next, their fall, or a time.

    Args:
        walkers: The walkers.
        states: Initial states, (n, 6).
        slopes: Slope in rad, one for all or (n,).
        controls: Torques that are held: of the hip, one for all or (n,); or of hip and ankle,
            (n, 2).
        push_offs: Impulses just before heelstrike, one for all or (n,).
        rises: Heights of the next footholds, one for all or (n,); None on smooth ground.
        turns: Slope changes to these in rad, one for all or (n,).
        until: Latest time to stop, one for all or (n,).
        save_at: Times (n, k) instead, in any order, each as exact as any other: every walker is
            followed to k times, side by side. Later ones than its stride's end give the state that
            it ends with; one that is not finite gives nothing.
        by: Variables of the tangents, in order; see `go_on`.
        along: Changes of the states along all k tangents, (n, 6, k), instead of those that `by`
            names; "point" then stands for any number of them.
        lanes: Indices of these walkers, if parameters are given for more.
        threads: Number of threads; as many as there are free CPUs when None. It changes no result.
        backend: Function that integrates: `engine.run.advance`, or `gpu.advance` on a GPU.
    """
    instants = None
    if save_at is not None:
        instants = count, each = save_at.shape
        until, lanes = save_at.ravel(), np.repeat(np.arange(count)[lanes], each)
        states, slopes, controls, push_offs, rises, turns = (
            np.repeat(x, each, axis=0) if np.ndim(x) else x  # type: ignore[arg-type]
            for x in (states, slopes, controls, push_offs, rises, turns)
        )
    uneven = rises is not None or turns is not None
    tangents = _tangents_by(walkers, by, along) if by else _NONE
    system = walkers.system((*by, *UNEVEN) if uneven else by)

    def began(planes: int = 0) -> NDArray:
        records = new_records(
            states, slopes, controls, push_off=push_offs, end=until, tangents=planes,
            height_change=0.0 if rises is None else rises,
            slope_change=0.0 if turns is None else turns, layout=layout_of(system),
        )  # fmt: skip
        if instants is not None:
            records[~np.isfinite(until)] = np.zeros((), records.dtype)  # nothing to follow
        return records

    records = began(len(tangents.names))
    if by:
        _seed(records, tangents)
    bodies = walkers.bodies(tangents.names, lanes)
    walked = Flow(walkers, system, tangents, bodies, records, began, True, instants)
    return walked.integrate(backend, threads)


def go_on(
    walkers: Walkers,
    records: NDArray,
    by: Sequence[str] = (),
    *,
    lanes: NDArray | slice = _ALL,
    on_section: bool = False,
) -> Flow:
    """Integrate walkers from their states, each to its `end`, its heelstrike or its fall.

    Args:
        walkers: The walkers.
        records: States, controls and end times, as in `Flow.here`, (n, 1); not changed.
        by: Variables of the derivatives, in order. "state" gives one tangent for each of its six
            numbers, "point" one for each coordinate of the section. Others are "slope",
            "hip_torque", "ankle_torque", "push_off", "height_change" and "slope_change" of the next
            foothold, a parameter of the walker, "start" and "end". "start" is the stance angle at
            the beginning of the stride (legs mirrored), "end" the time to stop. Of a user's system,
            "start" gives one tangent for each coordinate; its controls are among `Model.inputs`.
        lanes: Indices of these walkers, if parameters are given for more.
        on_section: Whether a stride begins here.
    """
    uneven = np.count_nonzero(records["ground"][..., 2:])  # heights, slopes of next footholds
    tangents = _tangents_by(walkers, by) if by else _NONE
    walked = np.zeros((len(records), 1 + len(tangents.names)), records.dtype)
    numbers_of(walked)[:, :1] = numbers_of(records)
    walked["outcome"] = 0
    if by:
        _seed(walked, tangents)
    system = walkers.system((*by, *UNEVEN) if uneven else by)
    bodies = walkers.bodies(tangents.names, lanes)
    return Flow(walkers, system, tangents, bodies, walked, lambda: records, on_section).integrate()


def _tangents_by(walkers: Walkers, by: Sequence[str], along: NDArray | None = None) -> FlowTangents:
    """Tangents by name, with changes of the states (n, 6, k) if they are given."""
    if along is None:
        return _tangents(walkers.walker, tuple(by))
    others = sum(name != "point" for name in by)
    tangents = _tangents(walkers.walker, tuple(by), along.shape[2] - others)
    return tangents._replace(states=along.swapaxes(1, 2))


def _seed(records: NDArray, tangents: FlowTangents) -> None:
    """Write the changes along tangents into the planes behind records, (n, 1 + k)."""
    changes = records[:, 1:]  # zero but for what is written here, which takes as long as walking
    if "state" in tangents.names or "point" in tangents.names:
        put_states(changes, tangents.states)
    if "slope" in tangents.names:
        changes["ground"][..., :2] = ground_changes(records["ground"][:, 0, :2], tangents.slopes)
    for name, index, values in tangents.inputs:
        changes[name][index] = values


def ground_changes(ground: NDArray, slopes: NDArray) -> NDArray[np.float64]:
    """Return changes of sine and cosine, (n, 2), along tangents of the slope, (k,): (n, k, 2)."""
    return slopes[:, None] * (ground[:, None, ::-1] * [1.0, -1.0])


def accelerations_at(
    system: System,
    phase: Phase,
    bodies: NDArray,
    states: NDArray,
    controls: NDArray,
    ground: Ground,
) -> NDArray[np.float64]:
    """Return the acceleration of each coordinate, of walkers in a phase, (n, m).

    Args:
        system: Equations of the walkers.
        phase: The phase.
        bodies: Constants of the walkers, (1 or n, constants).
        states: States, (n, 2 m).
        controls: Controls, (n, controls) or more.
        ground: The ground.
    """
    held = system.Control(*controls.T[: len(system.Control._fields)])  # type: ignore[attr-defined]
    links = phase.accelerations(system.Body(*bodies.T), system.State(*states.T), held, ground)
    return np.stack([links[min(i, phase.links - 1)] for i in range(system.coordinates)], axis=-1)


def _height(
    system: System, guard: Guard, body: Any, ground: Ground, states: NDArray
) -> NDArray[np.float64]:
    """Return a guard of states (n, 6)."""
    return guard.falls(body, system.State(*states.T), ground)


def hip_places(system: System, bodies: NDArray, states: NDArray) -> NDArray:
    """Return positions of hips with tangents, (n, 1 + k).

    Args:
        system: Equations of the walkers.
        bodies: Constants with their tangents, (1 or n, 1 or 1 + k, constants).
        states: States with their tangents, (n, 1 + k, 2 m).
    """

    def at(bodies: NDArray, states: NDArray) -> NDArray:
        body, state = (np.moveaxis(values, -1, 0) for values in (bodies, states))
        return system.place(system.Body(*body), system.State(*state))

    changed = step_derivative(at(_changed(bodies), _changed(states)))
    return np.concatenate([at(bodies[:, :1], states[:, :1]), changed], axis=1)


def _changed(values: NDArray) -> NDArray:
    """Values (n, 1 + k, ...) changed infinitesimally, (n, k, ...); or none of them."""
    if values.shape[1] == 1:
        return values + 0j
    return complex_step(values[:, :1], values[:, 1:])
