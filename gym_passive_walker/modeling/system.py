"""A walker of one's own: a hybrid system stated by the positions of its masses."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gym_passive_walker.engine import compiled
from gym_passive_walker.engine.layout import MOST_CONSTANTS, MOST_GUARDS, WIDE
from gym_passive_walker.modeling.mechanics import Derived, Link, Motion, is_zero, rates_by, solve
from gym_passive_walker.physics import hybrid
from gym_passive_walker.physics.hybrid import Ground, Guard, Outcome, Watch
from gym_passive_walker.physics.systems import SYSTEMS
from gym_passive_walker.walkers import Mechanism

_BETWEEN = 7  # looks at a guard within a step; a foot may dip and rise between its ends
_TRIALS, _CLOSE = 3, 1e-9  # random states of a check, and the largest relative error
_ITERATIONS = 30  # of Newton's method
_FALLS = tuple(
    outcome.name.lower()
    for outcome in Outcome
    if Outcome.FELL_FORWARD <= outcome <= Outcome.SWING_OVERROTATION
)


class StatementError(ValueError):
    """A statement of a system is wrong; the message names the function."""


class Free(NamedTuple):
    """The controls of a system without actuators: none."""


def _uncontrolled(state: Any) -> Free:
    return Free()


@dataclass(frozen=True, eq=False, kw_only=True)
class System(Mechanism):
    """A walker of one's own, by where its masses are and what its landing foot does.

    Equations of motion, the plastic impact at heelstrike, energies and all derivatives follow from
    these functions. Choose units of length and mass as you like; gravity is 1, so that the unit of
    time is sqrt(l/g). All functions are plain arithmetic with `gym_passive_walker.math`; they take
    the `body` and the state, both named tuples. Positions are those of a frame at the stance foot:
    x along the ground in the walking direction (downhill), y up from the ground.

    Attributes:
        name: What it is called.
        body: Its parameters: an instance of a named tuple.
        State: Named tuple of up to eight coordinates, and of their rates in the same order.
        links: Function of body and state: the masses, a `Link` for each rigid body or point mass.
        landing: Function of body and state: x and y of the swing foot. The foot strikes where y
            falls through zero; it stays where it lands. If a foot rolls, x is the position of its
            centre less the distance that it has rolled.
        relabel: Function of body and state: the coordinates after a heelstrike, when the legs have
            exchanged their roles, by those before it.
        falls: By the name of an outcome ("fell_forward", "fell_backward", "swing_overrotation"), a
            function of body and state that is positive until the walker has fallen.
        counts: Functions of body and state that are positive where a heelstrike counts, for feet
            that scuff the ground at midstance.
        potential: Function of body and state: energy of springs.
        dissipation: Function of body and state: half the power that friction takes, a quadratic
            form of the rates (Rayleigh's dissipation function).
        forces: Function of body and state: generalized forces, one for each coordinate, of
            feedback that is part of the walker. Their work counts as negative friction.
        Control: Named tuple of the controls, held constant while the engine integrates.
        travel: Function of the state: for each control the coordinate that it moves, as a
            `Control`. Its torque acts along that coordinate.
        start: A state just after heelstrike near a gait, (2 m,), with which searches begin.
        limits: By the name of a control, its largest size: what the action 1 of an environment
            does. Of other controls it is the scene's `max_hip_torque` times the system's weight.
        pose: Function of body and state: what pictures show, lines of points (x, y). None draws a
            line from the foot to each mass.

    Raises:
        StatementError: if a function does not fit the others. The message names it.
    """

    name: str
    body: Any
    State: type
    links: Callable[[Any, Any], Sequence[Link]]
    landing: Callable[[Any, Any], tuple[Any, Any]]
    relabel: Callable[[Any, Any], Sequence[Any]]
    falls: Mapping[str, Callable[[Any, Any], Any]]
    counts: Sequence[Callable[[Any, Any], Any]] = ()
    potential: Callable[[Any, Any], Any] | None = None
    dissipation: Callable[[Any, Any], Any] | None = None
    forces: Callable[[Any, Any], Sequence[Any]] | None = None
    Control: type = Free
    travel: Callable[[Any], Any] = _uncontrolled
    start: Sequence[float] | None = None
    limits: Mapping[str, float] = field(default_factory=dict)
    pose: Callable[[Any, Any], Sequence[Sequence[tuple[Any, Any]]]] | None = None
    _made: dict[str, Any] = field(default_factory=dict, init=False, repr=False)

    def __post_init__(self) -> None:
        _check(self)

    def vary(self, **parameters: float) -> System:
        """This system with other values of some fields of its body."""
        unknown = [name for name in parameters if name not in self.body._fields]
        if unknown:
            raise StatementError(
                f"body of system {self.name!r} has no {', '.join(unknown)}: it has "
                f"{', '.join(self.body._fields)}"
            )
        made = self.with_body(parameters)
        _check(made)
        return made

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"_made": {}}  # what is compiled stays in its process

    @property
    def title(self) -> str:  # type: ignore[override]
        """Its name."""
        return self.name

    @property
    def controls(self) -> tuple[str, ...]:
        """Names of its controls."""
        return self.Control._fields  # type: ignore[attr-defined]

    def drawn(self, state: Sequence[float]) -> list[NDArray[np.float64]]:
        """Lines of points (x, y) that show a state (2 m,), each of shape (points, 2)."""
        given = self.State(*state)
        if self.pose is not None:
            return [np.array(line, dtype=float) for line in self.pose(self.body, given)]
        links = [Link(*link) for link in self.links(self.body, given)]
        return [np.array([(0.0, 0.0), (link.x, link.y)], dtype=float) for link in links]

    def centre_of_mass(self, state: Sequence[float]) -> NDArray[np.float64]:
        """Position (x, y) of the centre of mass in a state (2 m,), from the stance foot, (2,)."""
        mass, x, y = self._centre(self.body, self.State(*state))
        return np.array([x / mass, y / mass], dtype=float)

    def with_both_feet_down(self, coordinates: NDArray[np.float64]) -> NDArray[np.float64]:
        """Coordinates (n, m) nearby at which the swing foot touches the ground.

        The first coordinate stays as it is; the others change as little as Newton's method allows.
        They are not a number where it does not converge.
        """
        rates = np.zeros_like(coordinates)

        def foot(body: Any, state: Any) -> tuple:
            height = self.landing(body, state)[1]
            return height, *rates_by(height, state[1 : self.coordinates])

        found = np.array(coordinates, dtype=float)
        height = np.full(len(found), np.inf)
        with np.errstate(divide="ignore", invalid="ignore"):
            for _ in range(_ITERATIONS):
                parts = Derived(foot)(self.body, self.State(*found.T, *rates.T))
                height, *slopes = (np.broadcast_to(part, len(found)) for part in parts)
                step = np.stack(slopes, axis=-1) * (height / sum(s**2 for s in slopes))[:, None]
                found[:, 1:] -= np.where(height[:, None] == 0.0, 0.0, step)
        found[~(np.abs(height) < _CLOSE)] = np.nan
        return found

    def struck(self, states: NDArray[np.float64]) -> NDArray[np.float64]:
        """States (n, 2 m) after a heelstrike in each of these."""
        strike = Derived(lambda body, state: self._strike(body, state, 0.0, Ground(0.0, 1.0)).after)
        after = strike(self.body, self.State(*states.T))
        return np.stack([np.broadcast_to(part, len(states)) for part in after], axis=-1)

    def exchanged(self, coordinates: NDArray[np.float64]) -> NDArray[np.float64]:
        """Coordinates (n, m) after the legs have exchanged their roles."""
        state = self.State(*coordinates.T, *np.zeros_like(coordinates).T)
        found = self.relabel(self.body, state)
        return np.stack([np.broadcast_to(part, len(coordinates)) for part in found], axis=-1)

    def standing(self, state: Sequence[float]) -> bool:
        """Whether no rule of `falls` says that a state (2 m,) has fallen."""
        given = self.State(*state)
        return all(float(upright(self.body, given)) > 0.0 for upright in self.falls.values())

    @property
    def coordinates(self) -> int:
        """Number m of its coordinates."""
        return len(self.State._fields) // 2  # type: ignore[attr-defined]

    @property
    def total_mass(self) -> float:  # type: ignore[override]
        """Its mass, which is also its weight."""
        return float(self._centre(self.body, self.State(*[0.0] * (2 * self.coordinates)))[0])

    @property
    def hybrid(self) -> hybrid.System:  # type: ignore[override]
        """The hybrid system that the engine compiles."""
        if "hybrid" not in self._made:
            self._made["hybrid"] = _registered(self._stated())
        return self._made["hybrid"]

    @property
    def uneven(self) -> hybrid.System:  # type: ignore[override]
        """The same on footholds of different heights."""
        if "uneven" not in self._made:
            absent = tuple(name for name in self.hybrid.absent if name != "height_change")
            self._made["uneven"] = _registered(self.hybrid._replace(absent=absent))
        return self._made["uneven"]

    def with_body(self, values: Mapping[str, float]) -> System:
        """This system with other values of some fields of its body, without checks."""
        made = object.__new__(System)  # with the same equations, which are compiled once
        made.__dict__.update(self.__dict__ | {"body": self.body._replace(**values)})
        return made

    def _stated(self) -> hybrid.System:
        strike = Guard(
            lambda body, state, ground: self.landing(body, state)[1] - ground.height_change,
            Outcome.HEELSTRIKE,
            Watch.STRIKE,
            tuple(_on_ground(counts) for counts in self.counts),
            _BETWEEN,
        )
        falls = tuple(
            Guard(_on_ground(function), Outcome[name.upper()])
            for name, function in self.falls.items()
        )
        phase = hybrid.Phase(
            stage=hybrid.Stage.LOCKED,
            links=self.coordinates,
            accelerations=Derived(self._accelerations),
            guards=(strike, *falls),
            resets={Outcome.HEELSTRIKE: hybrid.Reset(self._strike)},
            push=Derived(self._push),
        )
        takes = self.dissipation is not None or self.forces is not None
        return hybrid.System(
            name=self.name,
            Body=type(self.body),
            phases=(phase,),
            measure=self._measure,
            place=self._place,
            kinetic_energy=Derived(self._kinetic_energy),
            potential_gain=self._potential_gain,
            foot_clearance=lambda body, state: self.landing(body, state)[1],
            mass_matrix=Derived(self._mass_matrix),
            travel=self.travel,
            works=self.Control(*[1.0] * len(self.Control._fields)),  # type: ignore[attr-defined]
            spring_gain=None if self.potential is None else self._spring_gain,
            friction_power=Derived(self._taken) if takes else None,
            absent=("height_change", "slope_change", "push_off"),
            State=self.State,
            Control=self.Control,
        )

    def _motion(self, body: Any, state: Any) -> Motion:
        return Motion([Link(*link) for link in self.links(body, state)], state)

    def _own_forces(self, body: Any, state: Any) -> list[Any]:
        """Generalized forces of friction and feedback."""
        totals: list[Any] = [0.0] * self.coordinates
        if self.dissipation is not None:
            rates = state[self.coordinates :]
            totals = [-force for force in rates_by(self.dissipation(body, state), rates)]
        if self.forces is not None:
            totals = [a + b for a, b in zip(totals, self.forces(body, state), strict=True)]
        return totals

    def _accelerations(self, body: Any, state: Any, control: Any, ground: Ground) -> tuple:
        motion, coordinates = self._motion(body, state), state[: self.coordinates]
        forces = motion.forces((ground.sine, -ground.cosine))
        forces = [a + b for a, b in zip(forces, self._own_forces(body, state), strict=True)]
        if self.potential is not None:
            springs = rates_by(self.potential(body, state), coordinates)
            forces = [a - b for a, b in zip(forces, springs, strict=True)]
        for torque, moved in zip(control, self.travel(state), strict=True):
            if not is_zero(torque):
                ways = rates_by(moved, coordinates)
                forces = [a + b * torque for a, b in zip(forces, ways, strict=True)]
        return tuple(solve(motion.matrix(), forces))

    def _push(self, body: Any, state: Any, back: Any, up: Any) -> tuple:
        """Jumps of the rates by an impulse at the centre of mass, per unit of mass."""
        _, x, y = self._centre(body, state)
        ways = (rates_by(part, state[: self.coordinates]) for part in (x, y))
        impulses = [up * b - back * a for a, b in zip(*ways, strict=True)]
        return tuple(solve(self._motion(body, state).matrix(), impulses))

    def _strike(self, body: Any, before: Any, push_off: Any, ground: Ground) -> hybrid.Strike:
        rates, lost = self._motion(body, before).landing(self.landing(body, before))
        coordinates, after = self.relabel(body, before), []
        for coordinate in coordinates:
            rate: Any = 0.0
            for change, old in zip(
                rates_by(coordinate, before[: self.coordinates]), rates, strict=True
            ):
                rate = rate + change * old
            after.append(rate)
        return hybrid.Strike(self.State(*coordinates, *after), lost)

    def _measure(
        self, system: Any, body: Any, start: Any, before: Any, after: Any, ground: Ground
    ) -> hybrid.Step:
        began = type(before)(*start, *before[self.coordinates :])
        return hybrid.Step(
            self.landing(body, before)[0],
            self._place(body, before),
            -self._potential_gain(body, began, before, ground),
            0.0 if self.potential is None else -self._spring_gain(body, began, before),
        )

    def _centre(self, body: Any, state: Any) -> tuple[Any, Any, Any]:
        """The whole mass, and its first moments along x and y."""
        mass: Any = 0.0
        x: Any = 0.0
        y: Any = 0.0
        for link in self.links(body, state):
            each = Link(*link)
            mass, x, y = mass + each.mass, x + each.mass * each.x, y + each.mass * each.y
        return mass, x, y

    def _place(self, body: Any, state: Any) -> Any:
        """Position of the centre of mass along the ground."""
        mass, x, _ = self._centre(body, state)
        return x / mass

    def _potential_gain(self, body: Any, start: Any, end: Any, ground: Ground) -> Any:
        _, x0, y0 = self._centre(body, start)
        _, x1, y1 = self._centre(body, end)
        return ground.cosine * (y1 - y0) - ground.sine * (x1 - x0)

    def _spring_gain(self, body: Any, start: Any, end: Any) -> Any:
        assert self.potential is not None
        return self.potential(body, end) - self.potential(body, start)

    def _kinetic_energy(self, body: Any, state: Any) -> Any:
        return self._motion(body, state).kinetic_energy()

    def _mass_matrix(self, body: Any, state: Any) -> tuple:
        return tuple(self._motion(body, state).matrix().values())

    def _taken(self, body: Any, state: Any) -> Any:
        """Power that friction takes, less what feedback supplies."""
        power: Any = 0.0
        forces = self._own_forces(body, state)
        for force, rate in zip(forces, state[self.coordinates :], strict=True):
            power = power - force * rate
        return power


def _registered(stated: hybrid.System) -> hybrid.System:
    """Name a system by its compiled text, and make it known by this name."""
    digest = hashlib.sha256(str(compiled.written(stated)).encode()).hexdigest()[:16]
    stated = stated._replace(name=f"own-{digest}")
    SYSTEMS[stated.name] = stated
    return stated


def _on_ground(function: Callable[[Any, Any], Any]) -> Callable[[Any, Any, Ground], Any]:
    """A function of body and state as one of body, state and ground."""
    return lambda body, state, ground: function(body, state)


class _Checks:
    """Trials of a system's functions at random states, before anything is compiled."""

    def __init__(self, system: System) -> None:
        self.system, rng = system, np.random.default_rng(0)
        fields = getattr(system.State, "_fields", ())
        if not fields or len(fields) % 2 or len(fields) // 2 > WIDE.links:
            raise self.error(
                "State", "must be a named tuple of 1 to 8 coordinates and, behind them, their rates"
            )
        if not hasattr(system.body, "_fields"):
            raise self.error("body", "must be an instance of a named tuple of parameters")
        self.body, count = system.body, len(fields) // 2
        self.numbers("body", self.body)
        if system.start is not None and np.shape(system.start) != (2 * count,):
            raise self.error("start", f"must have {2 * count} numbers, not {system.start!r}")
        centre = np.zeros(2 * count) if system.start is None else np.array(system.start)
        states = centre + rng.uniform(-0.3, 0.3, (_TRIALS, 2 * count))
        self.states = [system.State(*state) for state in states.tolist()]
        self.count = count

    def error(self, function: str, said: str) -> StatementError:
        """The error of a function of the system."""
        return StatementError(f"{function} of system {self.system.name!r} {said}")

    def tried(self, name: str, function: Callable[..., Any], *arguments: Any) -> Any:
        """The result of a function of the system; an error that it raises names it."""
        try:
            return function(*arguments)
        except StatementError:
            raise
        except Exception as error:
            raise self.error(name, f"fails: {type(error).__name__}: {error}") from error

    def numbers(self, name: str, values: Any, count: int | None = None) -> NDArray[np.float64]:
        """The result of a function as finite numbers, as many as there have to be."""
        try:
            found = np.array([float(x) for x in values])
        except (TypeError, ValueError) as error:
            raise self.error(name, f"must give numbers, not {values!r}") from error
        if count is not None and len(found) != count:
            raise self.error(name, f"must give {count} numbers, not {len(found)}")
        if not np.all(np.isfinite(found)):
            raise self.error(name, f"must give finite numbers, not {found.tolist()}")
        return found


def _check(system: System) -> None:
    """Refuse functions that do not fit each other.

    Raises:
        StatementError: with the function's name.
    """
    checks = _Checks(system)
    if not system.falls:
        raise checks.error("falls", f"must say when it has fallen: {', '.join(_FALLS)}")
    for name in system.falls:
        if name not in _FALLS:
            raise checks.error("falls", f"has no outcome {name!r}: choose from {', '.join(_FALLS)}")
    for name, limit in system.limits.items():
        if name not in system.controls:
            known = ", ".join(system.controls) or "none"
            raise checks.error("limits", f"has no control {name!r}: choose from {known}")
        if checks.numbers("limits", [limit])[0] <= 0.0:
            raise checks.error("limits", f"must be positive, not {limit!r} of {name!r}")
    controls = len(system.controls)
    rows = 1 + len(system.falls) + len(system.counts) + controls
    if rows > MOST_GUARDS or controls > WIDE.controls or len(system.body) > MOST_CONSTANTS:
        raise checks.error(
            "statement", f"is too large: at most {WIDE.controls} controls, {MOST_CONSTANTS} "
            f"parameters, and {MOST_GUARDS} controls, falls and counts together"
        )  # fmt: skip
    for state in checks.states:
        _check_links(checks, state)
        _check_functions(checks, state)
        _check_equations(checks, state)
        _check_heelstrike(checks, state)


def _check_links(checks: _Checks, state: Any) -> None:
    links = checks.tried("links", checks.system.links, checks.body, state)
    for link in links:
        each = checks.tried("links", lambda link: Link(*link), link)
        mass, *_, inertia, _ = checks.numbers("links", each, 5)
        if mass < 0.0 or inertia < 0.0:
            raise checks.error("links", f"must have no negative mass or inertia, as {each} has")


def _check_functions(checks: _Checks, state: Any) -> None:
    system, body = checks.system, checks.body
    for name, function, size in (
        ("landing", system.landing, 2),
        ("relabel", system.relabel, checks.count),
        ("forces", system.forces, checks.count),
    ):
        if function is not None:
            checks.numbers(name, checks.tried(name, function, body, state), size)
    for name, function in (
        *(("falls", each) for each in system.falls.values()),
        *(("counts", each) for each in system.counts),
        ("potential", system.potential),
        ("dissipation", system.dissipation),
    ):
        if function is not None:
            checks.numbers(name, [checks.tried(name, function, body, state)])
    moved = checks.tried("travel", system.travel, state)
    checks.numbers("travel", moved, len(system.controls))
    for line in checks.tried("pose", system.drawn, state):
        if line.ndim != 2 or line.shape[1] != 2 or not np.all(np.isfinite(line)):
            raise checks.error("pose", "must give lines of finite points (x, y)")


def _check_equations(checks: _Checks, state: Any) -> None:
    system, body, count = checks.system, checks.body, checks.count
    matrix = np.zeros((count, count))
    derived = checks.tried("links", Derived(system._mass_matrix), body, state)
    matrix[np.triu_indices(count)] = derived
    matrix = matrix + np.triu(matrix, 1).T
    if np.linalg.eigvalsh(matrix)[0] <= 1e-12 * np.abs(matrix).max():
        raise checks.error(
            "links", "leave a coordinate without inertia: the mass matrix is not positive at "
            f"{state}"
        )  # fmt: skip
    if system.dissipation is not None and system.dissipation(body, state) < 0.0:
        raise checks.error("dissipation", f"must not be negative, as at {state}")


def _check_heelstrike(checks: _Checks, state: Any) -> None:
    system, body = checks.system, checks.body

    def slopes(body: Any, state: Any) -> tuple:
        return tuple(rates_by(system.landing(body, state)[1], state[: checks.count]))

    if not np.any(checks.tried("landing", Derived(slopes), body, state)):
        raise checks.error("landing", "never falls: its y does not depend on the coordinates")

    def struck(body: Any, state: Any) -> tuple:
        after, lost, _ = system._strike(body, state, 0.0, Ground(0.0, 1.0))
        return system._kinetic_energy(body, state), system._kinetic_energy(body, after), lost

    before, after, lost = checks.tried("relabel", Derived(struck), body, state)
    if abs(before - after - lost) > _CLOSE * before:
        raise checks.error(
            "relabel", "does not name the same motion: just after a heelstrike the kinetic energy "
            f"is {after:.6g} in the new coordinates and {before - lost:.6g} in the old ones"
        )  # fmt: skip
    new = system.State(*system.relabel(body, state), *state[checks.count :])
    height = (
        system._centre(body, state)[2]
        - system._centre(body, state)[0] * (system.landing(body, state)[1])
    )
    if abs(system._centre(body, new)[2] - height) > _CLOSE * (1.0 + abs(height)):
        raise checks.error(
            "relabel", "does not name the same posture: the centre of mass is at another height "
            "over the new foot"
        )  # fmt: skip
