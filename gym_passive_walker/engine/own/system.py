"""A user's walker: a hybrid system stated by the positions of its masses, or by equations."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker.engine import compiled
from gym_passive_walker.engine.machine import group
from gym_passive_walker.engine.own.checks import check, check_given
from gym_passive_walker.engine.own.mechanics import (
    Derived,
    Link,
    Motion,
    is_zero,
    rates_by,
    relabelled,
    solve_positive,
)
from gym_passive_walker.engine.own.stated import Stated, StatementError, as_written, stated
from gym_passive_walker.engine.own.statement import push_of
from gym_passive_walker.models.chart import Whole
from gym_passive_walker.models.equations import hybrid
from gym_passive_walker.models.equations.hybrid import SMOOTH, Ground, Guard, Outcome, Watch
from gym_passive_walker.models.equations.systems import UNEVEN, register_system
from gym_passive_walker.models.model import ALIKE, Actuator, Model, check_row, constants_from
from gym_passive_walker.models.units import Units

_FUNCTIONS = (
    "links", "landing", "relabel", "falls", "counts", "potential", "dissipation", "forces",
    "travel", "pose", "centre", "mass",
)  # fmt: skip
_ITERATIONS, _CLOSE = 30, 1e-9  # of Newton's method, and its largest error


class Free(NamedTuple):
    """The controls of a system without actuators: none."""


def _uncontrolled(state: Any) -> Free:
    return Free()


def _falls(guard: Guard, body: Any, state: Any) -> Any:
    """A guard's function on smooth ground."""
    return guard.falls(body, state, SMOOTH)


def _falls_of(equations: hybrid.System) -> dict[str, Callable[[Any, Any], Any]]:
    """The rules by which a walker of given equations has fallen, by the names of outcomes."""
    return {
        guard.outcome.name.lower(): partial(_falls, guard)
        for guard in equations.phases[0].guards
        if guard.watch == Watch.BOUND
    }


@dataclass(frozen=True, eq=False, kw_only=True)
class System(Model):
    """A user's walker, stated by the positions of its masses and its landing foot, or by equations.

    From `links`, `landing`, `relabel` and `falls` follow equations of motion, the plastic impact at
    heelstrike, energies and all derivatives. `System.of` takes given equations instead. Choose
    any units of length and mass; gravity is 1, so the unit of time is sqrt(l/g). All functions are
    plain arithmetic with `gym_passive_walker.math`. They take the `body` and the
    state, both named tuples. Positions are those of a frame at the stance foot: x along the ground
    in the walking direction (downhill), y up from the ground.

    Attributes:
        name: Its name, for messages and pictures.
        body: Its parameters: an instance of a named tuple.
        State: Named tuple of up to eight coordinates, and of their rates in the same order.
        links: Function of body and state: the masses, a `Link` for each rigid body or point mass.
        landing: Function of body and state: x and y of the swing foot. The foot strikes where y
            falls through zero; it stays where it lands. If a foot rolls, x is the position of its
            centre less the distance that it has rolled.
        relabel: Function of body and state: the coordinates after a heelstrike, when the legs have
            exchanged their roles, by those before it.
        exchange: Fields of `body` in which the legs differ, by pairs: that of the stance leg and
            that of the swing leg, as in ``{"stance_mass": "swing_mass"}``. The two values change
            places at each heelstrike. One application of the stride map is then two strides. A walk
            begins on the leg that the fields of the stance leg describe.
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
        limits: By the name of a control, its largest torque: that of the action 1 of an
            environment. For other controls it is the scene's `max_hip_torque` times the weight.
        pose: Function of body and state: lines of points (x, y) for pictures. None draws a
            line from the foot to each mass, or to the centre of mass.
        given: The hybrid system that was given to `of`; None otherwise. `State`, `Control`,
            `travel` and `falls` are then those of the equations.
        mass: Its total mass, a number or a function of body, as given to `of`.
        centre: Function of body and state: x and y of its centre of mass, as given to `of`.

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
    given: hybrid.System | None = None
    mass: float | Callable[[Any], Any] = 1.0
    centre: Any = None
    exchange: Mapping[str, str] = field(default_factory=dict)
    _made: dict[str, Any] = field(default_factory=dict, init=False, repr=False)
    knees = massless_legs = False
    leg_length = gravity = time_unit = 1.0
    foot_radius = 0.0
    units = Units(1.0, 1.0, 1.0, 1.0)

    def __post_init__(self) -> None:
        if self.given is not None:
            check_given(self, self.given)
            given = stated(_pushed(self.given), self.name)
            self.__dict__.update(given=given, falls=_falls_of(given), travel=given.travel)
        self.__dict__.update({name: self._stated_as(name) for name in _FUNCTIONS})
        check(self)
        if self.start is not None:
            self.__dict__["start"] = tuple(map(float, self.start))

    def _stated_as(self, name: str) -> Any:
        """The user's function of a name, or a collection of them, as `Stated`."""

        def of(given: Any) -> Any:
            if isinstance(given, Mapping):
                return {key: of(each) for key, each in given.items()}
            if isinstance(given, tuple | list):
                return tuple(map(of, given))
            return Stated(name, given, self.name) if callable(given) else given

        return of(getattr(self, name))

    @classmethod
    def of(
        cls,
        equations: hybrid.System,
        body: Any,
        *,
        centre: Callable[[Any, Any], tuple[Any, Any]],
        mass: float | Callable[[Any], Any] = 1.0,
        **rest: Any,
    ) -> System:
        """A system with given equations: accelerations, guards, resets and energies.

        The package states its own walkers in this way; see `models.equations.straight.SYSTEM`.

        Args:
            equations: The hybrid system, a `gym_passive_walker.modeling.HybridSystem`. Its phases
                have accelerations, guards and resets; the last phase ends with a heelstrike. A
                `push` that a phase lacks follows from the mass matrix.
            body: Its parameters, of the type `equations.Body`.
            centre: Function of body and state: x and y of the centre of mass from the stance foot.
            mass: Its total mass; a function of body where fields of the body change it.
            **rest: `name`, `start`, `limits`, `pose`, `exchange`, as in the class.

        Raises:
            StatementError: if the functions contradict each other: a mass matrix that is not
                positive, a power balance that does not close, a guard that never falls, a reset
                that gains energy or moves the walker. The message names the function.
        """
        if not isinstance(equations, hybrid.System):
            raise StatementError(f"equations must be a HybridSystem, not {equations!r}")
        if not equations.phases:
            raise StatementError(f"phases of {equations.name!r} must have one phase or more")
        if unknown := rest.keys() - {"name", "start", "limits", "pose", "exchange"}:
            raise TypeError(f"System.of has no argument {', '.join(sorted(unknown))}")
        absent: Any = None  # functions from which equations would be derived
        given: dict[str, Any] = {
            "name": equations.name, "State": equations.State, "Control": equations.Control,
            "travel": equations.travel, "falls": _falls_of(equations),
        }  # fmt: skip
        return cls(
            body=body, given=equations, centre=centre, mass=mass, links=absent,
            landing=absent, relabel=absent, **(given | rest),
        )  # fmt: skip

    def vary(self, **parameters: float) -> System:
        """This system with other values of some fields of its body."""
        unknown = [name for name in parameters if name not in self.parameters]
        if unknown:
            raise StatementError(
                f"body of system {self.name!r} has no {', '.join(unknown)}: it has "
                f"{', '.join(self.parameters)}"
            )
        made = self.with_body(parameters)
        check(made)
        return made

    def __getstate__(self) -> dict[str, Any]:
        return self._own | {"_made": {}}  # what is compiled stays in its process

    @property
    def _own(self) -> dict[str, Any]:
        """Its attributes, without the system with the legs exchanged."""
        return {name: value for name, value in self.__dict__.items() if name != "swapped"}

    @property
    def legs_alike(self) -> bool:
        """Whether each stride has the same parameters."""
        return not self.exchange

    @property
    def exchanged_places(self) -> tuple[int, ...]:
        """Places of constants that the legs exchange, pair after pair."""
        return tuple(
            self.body._fields.index(name) for pair in self.exchange.items() for name in pair
        )

    @cached_property
    def swapped(self) -> System:
        """The system of the next stride, with the legs exchanged; itself if they are alike."""
        if self.legs_alike:
            return self
        other = self.with_body(self._next_body(self.body)._asdict())
        other.__dict__["swapped"] = self
        return other

    @property
    def _counterparts(self) -> dict[str, str]:
        """Fields that the legs exchange, both ways."""
        return {**self.exchange, **{b: a for a, b in self.exchange.items()}}

    def counterpart(self, parameter: str) -> str:
        """Field of the next stride's body with the value of a field."""
        return self._counterparts.get(parameter, parameter)

    def _next_body(self, body: Any) -> Any:
        """Return the body of the next stride, from that of a stride."""
        return body._replace(**{a: getattr(body, b) for a, b in self._counterparts.items()})

    def swap(self, constants: NDArray) -> NDArray:
        """Return constants (..., constants) of the next stride, from those of a stride."""
        if self.legs_alike:
            return constants
        return constants[..., self._next_body(self.body._make(range(len(self.body))))]

    @property
    def supports(self) -> frozenset[str]:
        """The features that it has; the force of the ground is derived, or must be given."""
        known = self.given is None or None not in (self.given.ground_force, self.given.momentum)
        features = {"feedback", "optimal gaits", "pages", "robustness"}
        if self.given is None or all(phase.push for phase in self.given.phases):
            features.add("pushes")
        if known:
            features |= {"constraints", "ground force", "reality check"}
        if known and self.hybrid.mass_matrix is not None:
            features.add("collision matrix")
        return frozenset(features if self.legs_alike else features - ALIKE)

    @property
    def title(self) -> str:
        """Its name."""
        return self.name

    @property
    def size(self) -> int:
        """Numbers of a state."""
        return 2 * self.coordinates

    @property
    def state_names(self) -> tuple[str, ...]:
        """Names of the numbers of a state."""
        return self.State._fields  # type: ignore[attr-defined]

    @property
    def parts(self) -> tuple[str, ...]:
        """Names of its coordinates in pictures."""
        return tuple(name.replace("_", " ") for name in self.state_names[: self.coordinates])

    @property
    def kind(self) -> str:
        """Name of its equations."""
        return self.hybrid.name

    @property
    def chart(self) -> Whole:
        """Coordinates of its states just after heelstrike."""
        return Whole(self.size)

    @property
    def weight(self) -> float:
        """Weight; gravity is 1."""
        return self.total_mass

    @property
    def controls(self) -> tuple[str, ...]:
        """Names of its controls."""
        return self.Control._fields  # type: ignore[attr-defined]

    @property
    def absent(self) -> tuple[str, ...]:
        """Names of controls and parameters that are absent from given equations."""
        return () if self.given is None else self.given.absent

    @property
    def control_units(self) -> NDArray[np.float64]:
        """Units of the controls: 1."""
        return np.ones(len(self.controls))

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of what actuators hold, as derivatives by them are named."""
        return tuple(f"control {name}" for name in self.controls)

    @property
    def actuators(self) -> tuple[Actuator, ...]:
        """What actions of environments may move."""
        return tuple(
            Actuator(
                name, self.limits.get(name, "max_hip_torque"), f"control {name!r}",
                usual=name not in self.absent,
            )
            for name in self.controls
        )  # fmt: skip

    @property
    def observed(self) -> tuple[tuple[str, str], ...]:
        """Name and unit of each number of the environments' own observation."""
        return (*((name, "") for name in self.state_names), ("slope, positive downhill", "rad"))

    @property
    def endings(self) -> dict[str, str]:
        """Outcomes by which an episode ends in a fall, and when."""
        return dict.fromkeys(self.falls, "a rule of the system's falls")

    @property
    def toe_stubs(self) -> bool:
        """Whether given equations have a guard that a stubbed toe passes."""
        phases = () if self.given is None else self.given.phases
        return any(guard.watch == Watch.SCUFF for phase in phases for guard in phase.guards)

    @property
    def parameters(self) -> dict[str, float]:
        """Fields of `body` by name, but for those that are absent from its equations."""
        fields = self.body._asdict().items()
        return {name: value for name, value in fields if name not in self.absent}

    def with_parameters(self, **values: float) -> System:
        """Return a system with other values of some fields of `body`, as `vary` does."""
        return self.vary(**values)

    def check_values(self, names: Sequence[str], values: NDArray) -> None:
        """Check that systems may have each row of values (n, k) of fields of `body`.

        A check is slow, so it is that of rows with an extreme value.

        Raises:
            StatementError: if one may not.
        """
        rows = values[np.unique([values.argmin(axis=0), values.argmax(axis=0)])]
        for row in set(map(tuple, rows.tolist())):
            check_row(self, tuple(names), row)

    def units_with(self, **values: ArrayLike) -> Units:
        """Return the units, on which the body has no effect."""
        return self.units

    def equations(self, using: Collection[str] = ()) -> hybrid.System:
        """Return the equations of motion, for uneven ground if a change of it is in use."""
        return self.hybrid if set(UNEVEN).isdisjoint(using) else self.uneven

    def constants(self, **values: ArrayLike) -> NDArray[Any]:
        """Return the constants of systems that differ in some, (1 or n, constants)."""
        return constants_from(self.body._replace(**values))

    def drawn(self, state: Any) -> list[NDArray[np.float64]]:
        """Lines of points (x, y) that show a state (2 m,), each of shape (points, 2)."""
        return [np.array(line, dtype=float) for line in self.lines(self.body, self.State(*state))]

    def lines(self, body: Any, state: Any) -> Sequence[Sequence[tuple[Any, Any]]]:
        """Lines of points (x, y) that show a state of a body, of the kind of numbers given."""
        if self.pose is not None:
            return self.pose(body, state)
        if self.given is not None:
            return [[(0.0, 0.0), self.centre(body, state)]]
        links = (Link(*link) for link in self.links(body, state))
        return [[(0.0, 0.0), (link.x, link.y)] for link in links]

    def centre_of_mass(self, state: ArrayLike) -> NDArray[Any]:
        """Position (x, y) of the centre of mass from the stance foot, (..., 2).

        Args:
            state: States (..., 2 m), real or complex.
        """
        given = np.asarray(state)
        mass, x, y = self._centre(self.body, self.State(*np.moveaxis(given, -1, 0)))
        places = (np.broadcast_to(part / mass, given.shape[:-1]) for part in (x, y))
        return np.stack([*places], axis=-1)

    def with_both_feet_down(self, coordinates: NDArray[np.float64]) -> NDArray[np.float64]:
        """Coordinates (n, m) nearby at which the swing foot touches the ground.

        The first coordinate stays as it is; the others change as little as Newton's method allows.
        They are not a number where it does not converge.
        """
        rates = np.zeros_like(coordinates)

        def foot(body: Any, state: Any) -> tuple:
            height = self._clearance(body, state)
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
        strike = self.hybrid.phases[-1].resets[Outcome.HEELSTRIKE].strike
        after = Derived(lambda body, state: tuple(strike(body, state, 0.0, SMOOTH).after))(
            self.body, self.State(*states.T)
        )
        return np.stack([np.broadcast_to(part, len(states)) for part in after], axis=-1)

    def exchanged(self, coordinates: NDArray[np.float64]) -> NDArray[np.float64]:
        """Coordinates (n, m) after the legs have exchanged their roles."""
        return self.struck(np.hstack([coordinates, np.zeros_like(coordinates)]))[
            :, : self.coordinates
        ]

    def standing(self, state: Sequence[float]) -> bool:
        """Whether no rule of `falls` says that a state (2 m,) has fallen."""
        given = self.State(*state)
        bounds = (g for g in self.hybrid.phases[0].guards if g.watch == Watch.BOUND)
        return all(float(guard.falls(self.body, given, SMOOTH)) > 0.0 for guard in bounds)

    def checked_state(
        self, state: Sequence[float], name: str = "options['state']"
    ) -> tuple[float, ...]:
        """Return a user's state (2 m,) after a check that it has not fallen.

        Raises:
            ValueError: if it has fallen, or is no state.
        """
        given = np.asarray(state, dtype=float)
        if given.shape != (self.size,) or not np.all(np.isfinite(given)):
            raise ValueError(
                f"{name} must be {self.size} finite numbers, coordinates and their rates, not "
                f"{state!r}"
            )
        if not self.standing(given.tolist()):
            raise ValueError(f"{name} is of a walker that has fallen: {given.tolist()}")
        return tuple(given.tolist())

    @property
    def coordinates(self) -> int:
        """Number m of its coordinates."""
        return len(self.State._fields) // 2  # type: ignore[attr-defined]

    @property
    def total_mass(self) -> float:
        """Its mass, which is also its weight."""
        return float(self.mass_with())

    def mass_with(self, **values: Any) -> Any:
        """Return the mass of systems that differ in some fields of `body`."""
        return self._centre(self.body._replace(**values), self.State(*[0.0] * self.size))[0]

    @property
    def hybrid(self) -> hybrid.System:
        """The hybrid system that the engine compiles."""
        if "hybrid" not in self._made:
            self._made["hybrid"] = _registered(self._measured() if self.given else self._stated())
        return self._made["hybrid"]

    @property
    def uneven(self) -> hybrid.System:
        """The same on footholds of different heights."""
        if self.given is not None and "height_change" in self.given.absent:
            raise StatementError(
                f"equations of system {self.name!r} are for even ground: `height_change` is absent"
            )
        if "uneven" not in self._made:
            absent = tuple(name for name in self.hybrid.absent if name != "height_change")
            self._made["uneven"] = _registered(self.hybrid._replace(absent=absent))
        return self._made["uneven"]

    def with_body(self, values: Mapping[str, float]) -> System:
        """This system with other values of some fields of its body, without checks."""
        made = object.__new__(System)  # with the same equations, which are compiled once
        made.__dict__.update(self._own | {"body": self.body._replace(**values)})
        return made

    def _clearance(self, body: Any, state: Any) -> Any:
        """Height of the swing foot."""
        if self.given is not None:
            return self.given.foot_clearance(body, state)
        return self.landing(body, state)[1]

    def _stated(self) -> hybrid.System:
        strike = Guard(
            lambda body, state, ground: self.landing(body, state)[1] - ground.height_change,
            Outcome.HEELSTRIKE,
            Watch.STRIKE,
            tuple(_on_ground(counts) for counts in self.counts),
            bends=True,
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
            foot_clearance=self._clearance,
            mass_matrix=Derived(self._mass_matrix),
            travel=self.travel,
            works=self.Control(*[1.0] * len(self.Control._fields)),  # type: ignore[attr-defined]
            spring_gain=None if self.potential is None else self._spring_gain,
            friction_power=Derived(self._taken) if takes else None,
            ground_force=Derived(self._ground_force),
            momentum=Derived(lambda body, state: self._motion(body, state).momentum()),
            absent=("height_change", "slope_change", "push_off"),
            State=self.State,
            Control=self.Control,
        )

    def _measured(self) -> hybrid.System:
        """The given equations, with a default measure that knows the body of the next stride."""
        given: Any = self.given
        if self.legs_alike or as_written(given.measure) is not hybrid.measured:
            return given

        def measure(system: Any, body: Any, *rest: Any) -> hybrid.Step:
            return hybrid.measured(system, body, *rest, then=self._next_body(body))

        return given._replace(measure=measure)

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
        return tuple(solve_positive(motion.matrix(), forces))

    def _ground_force(self, body: Any, state: Any, accelerations: Any, ground: Ground) -> tuple:
        gravity = ground.sine, -ground.cosine
        return self._motion(body, state).contact_force(accelerations, gravity)

    def _push(self, body: Any, state: Any, back: Any, up: Any) -> tuple:
        """Jumps of the rates by an impulse at the centre of mass, per unit of mass."""
        _, x, y = self._centre(body, state)
        ways = (rates_by(part, state[: self.coordinates]) for part in (x, y))
        impulses = [up * b - back * a for a, b in zip(*ways, strict=True)]
        return tuple(solve_positive(self._motion(body, state).matrix(), impulses))

    def _strike(self, body: Any, before: Any, push_off: Any, ground: Ground) -> hybrid.Strike:
        rates, lost = self._motion(body, before).landing(self.landing(body, before))
        return hybrid.Strike(relabelled(self.relabel, body, before, rates), lost)

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
        if self.given is not None:
            x, y = self.centre(body, state)
            mass = self.mass(body) if callable(self.mass) else self.mass
            return mass, mass * x, mass * y
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


def _pushed(equations: hybrid.System) -> hybrid.System:
    """A hybrid system in which all phases have a `push`, if it has a mass matrix."""
    matrix, gain = equations.mass_matrix, equations.potential_gain
    if matrix is None:
        return equations
    phases = (
        phase if phase.push else phase._replace(push=push_of(matrix, gain, phase.links))
        for phase in equations.phases
    )
    return equations._replace(phases=tuple(phases))


def _registered(stated: hybrid.System) -> hybrid.System:
    """Name a system by the text of its functions, and make it known by this name."""
    module = compiled.written(stated)
    outcomes = [[guard.outcome.name for guard in phase.guards] for phase in stated.phases]
    text = f"{module}{compiled.written_readings(stated)}{outcomes}"
    name = f"own-{hashlib.sha256(text.encode()).hexdigest()[:16]}"
    if module.group == group():  # else it is written again for this CPU
        compiled.WRITTEN[name] = module
    return register_system(stated._replace(name=name))


def _on_ground(function: Callable[[Any, Any], Any]) -> Callable[[Any, Any, Ground], Any]:
    """A function of body and state as one of body, state and ground."""
    return lambda body, state, ground: function(body, state)
