"""Checks of a system's functions at random states, before anything is compiled."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gym_passive_walker._tools.arguments import shown
from gym_passive_walker.engine.compiled import constants_used
from gym_passive_walker.engine.layout import MOST_CONSTANTS, MOST_GUARDS, WIDE
from gym_passive_walker.engine.own.mechanics import Derived, Link, rates_by
from gym_passive_walker.engine.own.stated import StatementError, as_written, same
from gym_passive_walker.engine.own.statement import tied
from gym_passive_walker.models.equations import hybrid
from gym_passive_walker.models.equations.hybrid import SMOOTH, Ground, Outcome, Phase, Watch
from gym_passive_walker.models.walkers import WALKERS

_TRIALS, _CLOSE = 3, 1e-9  # random states of a check, and the largest relative error
_ITERATIONS = 50  # of Newton's method
_IMPACTS = (Outcome.HEELSTRIKE, Outcome.KNEESTRIKE)  # after which walkers go on
_SLOPING = Ground(0.1, 0.995)  # any slope on which powers are compared
_TAKEN = frozenset({
    # what analyses and compiled code find by its name
    "slope", "height_change", "slope_change", "hip_torque", "ankle_torque", "push_off",
    # other columns of tables
    "time", "stride", "phase", "contact_x", "contact_y", "tilt", "step_length", "step_period",
    "speed", "froude_speed", "largest_multiplier", "stable",
})  # fmt: skip
_FALLS = tuple(
    outcome.name.lower()
    for outcome in Outcome
    if Outcome.FELL_FORWARD <= outcome <= Outcome.SWING_OVERROTATION
)


def _is_named_tuple(of: Any) -> bool:
    """Whether a value is the class of a named tuple."""
    return isinstance(of, type) and issubclass(of, tuple) and hasattr(of, "_fields")


def _fields_of(of: Any) -> tuple[str, ...]:
    """The names of a named tuple's fields; none of anything else."""
    return of._fields if _is_named_tuple(of) else ()


def _real(x: Any) -> float:
    if isinstance(x, str | bytes | bool | np.bool_) or np.iscomplexobj(x) or np.ndim(x):
        raise TypeError
    return float(x)


class Checks:
    """Trials of a `System`'s functions at random states, before anything is compiled."""

    def __init__(self, system: Any) -> None:
        self.system, rng = system, np.random.default_rng(0)
        if not isinstance(system.name, str) or not system.name.strip():
            raise self.error("name", f"must be text, not {system.name!r}")
        if system.name in WALKERS:
            raise self.error("name", "is the name of a walker of the package: choose another")
        fields = _fields_of(system.State)
        if not fields or len(fields) % 2 or len(fields) // 2 > WIDE.links:
            raise self.error(
                "State", "must be a named tuple of 1 to 8 coordinates and, behind them, their rates"
            )
        if not _is_named_tuple(system.Control):
            raise self.error("Control", "must be a named tuple of the controls")
        if not _fields_of(type(system.body)):
            raise self.error("body", "must be an instance of a named tuple of parameters")
        for name in ("State", "Control", "body"):
            kind = type(system.body) if name == "body" else getattr(system, name)
            if taken := [each for each in _fields_of(kind) if each in _TAKEN]:
                raise self.error(
                    name, f"must not have a field {taken[0]}, which the package gives another "
                    "meaning: rename it"
                )  # fmt: skip
        if both := [each for each in fields if each in _fields_of(system.Control)]:
            raise self.error("Control", f"has the field {both[0]} of State: rename one of them")
        self.body, count = system.body, len(fields) // 2
        self.numbers("body", self.body)
        start = [0.0] * (2 * count) if system.start is None else system.start
        if np.iterable(start) and len(list(start)) != 2 * count:
            raise self.error("start", f"must have {2 * count} numbers, not {start!r}")
        centre = self.numbers("start", start)
        self.start = system.State(*centre.tolist())
        states = centre + rng.uniform(-0.3, 0.3, (_TRIALS, 2 * count))
        self.states = [system.State(*state) for state in states.tolist()]
        self.count = count

    def error(self, function: str, said: str) -> StatementError:
        """Return the error with which a function of the system is refused."""
        return StatementError(f"{function} of system {self.system.name!r} {said}")

    def tried(self, name: str, function: Callable[..., Any], *arguments: Any) -> Any:
        """Return the result of a function; an exception becomes an error that names it."""
        try:
            return function(*arguments)
        except StatementError:
            raise
        except Exception as error:
            raise self.error(name, f"fails: {type(error).__name__}: {error}") from error

    def agree(self, name: str, function: Any, size: int | None, *arguments: Any) -> None:
        """Refuse a function that gives other results when it is traced.

        Args:
            name: Its name.
            function: The function.
            size: How many numbers it returns; None for a single one.
            *arguments: Its arguments, of numbers.
        """

        def row(*given: Any) -> tuple[Any, ...]:
            found = function(*given)
            if found is None:
                raise self.error(name, "returns None: add its return")
            return tuple(found) if size is not None and np.iterable(found) else (found,)

        plain, traced = (
            self.numbers(name, self.tried(name, each, *arguments), 1 if size is None else size)
            for each in (row, Derived(row))
        )
        if not np.allclose(plain, traced, _CLOSE, _CLOSE):
            raise self.error(
                name, f"gives {traced.tolist()} for symbols and {plain.tolist()} for the same "
                "numbers: it must not depend on their type"
            )  # fmt: skip

    def numbers(self, name: str, values: Any, count: int | None = None) -> NDArray[np.float64]:
        """Return results as an array of finite numbers, (count,); refuse all others."""
        try:
            found = np.array([_real(x) for x in values])
        except (TypeError, ValueError, OverflowError) as error:
            raise self.error(name, f"must give numbers, not {shown(values)}") from error
        if count is not None and len(found) != count:
            raise self.error(name, f"must give {count} numbers, not {len(found)}")
        if not np.all(np.isfinite(found)):
            raise self.error(name, f"must give finite numbers, not {found.tolist()}")
        return found


_FUNCTIONS = ("potential", "dissipation", "forces", "travel", "pose", "centre")
_DERIVED = ("links", "landing", "relabel", "counts", "potential", "dissipation", "forces")


def check_given(system: Any, equations: hybrid.System) -> None:
    """Refuse functions beside given equations from which these would be derived.

    Raises:
        StatementError: with the function's name.
    """
    for name in _DERIVED:
        if getattr(system, name):
            raise StatementError(
                f"{name} of system {system.name!r} must be left out: its equations are given; "
                "change `equations`"
            )
    for name in ("State", "Control", "travel"):
        if as_written(getattr(system, name)) is not as_written(getattr(equations, name)):
            raise StatementError(
                f"{name} of system {system.name!r} must be that of its equations: give changed "
                "equations to gpw.System.of"
            )


@np.errstate(all="ignore")  # of values that `where` does not choose
def check(system: Any) -> None:
    """Refuse functions that do not fit each other.

    Raises:
        StatementError: with the function's name.
    """
    checks = Checks(system)
    for name in ("falls", "limits", "exchange"):
        if not isinstance(getattr(system, name), Mapping):
            raise checks.error(name, f"must be a mapping, not {shown(getattr(system, name))}")
    for name, function in (
        *((name, getattr(system, name)) for name in _FUNCTIONS),
        *((f"falls[{name!r}]", function) for name, function in system.falls.items()),
    ):
        if function is not None and not callable(function):
            raise checks.error(name, f"must be a function, not {shown(function)}")
    if system.travel is None:
        raise checks.error("travel", "must be a function of the state")
    if not system.falls:
        raise checks.error("falls", f"must say when it has fallen: {', '.join(_FALLS)}")
    for name in system.falls:
        if name not in _FALLS:
            raise checks.error("falls", f"has no outcome {name!r}: choose from {', '.join(_FALLS)}")
    for name, limit in system.limits.items():
        held = [each for each in system.controls if each not in system.absent]
        if name not in held:
            known = ", ".join(held) or "none"
            raise checks.error("limits", f"has no control {name!r}: choose from {known}")
        if checks.numbers("limits", [limit])[0] <= 0.0:
            raise checks.error("limits", f"must be positive, not {limit!r} of {name!r}")
    _check_exchange(checks)
    if system.given is not None:
        if system.centre is None:
            raise checks.error("centre", "is missing: give x and y of the centre of mass")
        mass = system.mass
        if callable(mass):
            checks.agree("mass", mass, None, checks.body)
            mass = mass(checks.body)
        if not checks.numbers("mass", [mass])[0] > 0.0:
            raise checks.error("mass", f"must be positive, not {mass!r}")
        _check_statement(checks, system.given)
        return
    if system.centre is not None or system.mass != 1.0:
        raise checks.error("centre and mass", "follow from its links: leave them out")
    for name in ("counts", "links", "landing", "relabel"):
        value = getattr(system, name)
        if not (isinstance(value, (tuple, list)) if name == "counts" else callable(value)):
            kind = "a list of functions" if name == "counts" else "a function of body and state"
            raise checks.error(name, f"must be {kind}, not {value!r}")
    if not all(map(callable, system.counts)):
        raise checks.error("counts", f"must be a list of functions, not {shown(system.counts)}")
    controls = len(system.controls)
    rows = 1 + len(system.falls) + len(system.counts) + controls
    if rows > MOST_GUARDS or controls > WIDE.controls or len(system.body) > MOST_CONSTANTS:
        raise checks.error(
            "statement", f"is too large: at most {WIDE.controls} controls, {MOST_CONSTANTS} "
            f"parameters, and {MOST_GUARDS} controls, falls and counts together"
        )  # fmt: skip
    if system.start is not None and not all(
        checks.numbers("falls", [checks.tried("falls", function, checks.body, checks.start)])[0] > 0
        for function in system.falls.values()
    ):
        raise checks.error("falls", "is not positive at its start: the walker has fallen there")
    for state in checks.states:
        _check_links(checks, state)
        _check_functions(checks, state)
        _check_equations(checks, state)
    coordinates = np.array([state[: checks.count] for state in checks.states])
    if checks.count > 1 and np.all(np.isnan(system.with_both_feet_down(coordinates))):
        raise checks.error("landing", "never falls: its y is zero near none of the states tried")
    for state in checks.states:
        _check_heelstrike(checks, state)


def _check_exchange(checks: Checks) -> None:
    """Refuse an exchange that is not of pairs of the body's fields."""
    fields = checks.system.parameters
    names = [name for pair in checks.system.exchange.items() for name in pair]
    for name in names:
        if name not in fields:
            raise checks.error(
                "exchange", f"has no field {shown(name)} of body: choose from {', '.join(fields)}"
            )
        if names.count(name) > 1:
            raise checks.error("exchange", f"has the field {name} twice: give each pair once")


def _check_links(checks: Checks, state: Any) -> None:
    links = checks.tried("links", checks.system.links, checks.body, state)
    if not isinstance(links, (tuple, list)):
        raise checks.error("links", f"must give a list of gpw.Link, not {links!r}")
    for link in links:
        each = checks.tried("links", lambda link: Link(*link), link)
        plain = Link(*checks.numbers("links", each, 5).tolist())
        if plain.mass < 0.0 or plain.inertia < 0.0:
            raise checks.error("links", f"must have no negative mass or inertia, as {plain} has")

    def changes(body: Any, state: Any) -> tuple:
        links = checks.system.links(body, state)
        return tuple(tuple(rates_by(x, state)) for link in links for x in Link(*link))

    by_state = np.array(checks.tried("links", Derived(changes), checks.body, state), dtype=float)
    by_state = by_state.reshape(-1, len(Link._fields), len(state))
    if np.any(by_state[:, [0, 3]]):
        raise checks.error(
            "links", "must have masses and moments of inertia that do not depend on the state"
        )
    if np.any(by_state[:, :, checks.count :]):
        raise checks.error("links", "must have places and angles that do not depend on the rates")


def _check_functions(checks: Checks, state: Any) -> None:
    system, body = checks.system, checks.body
    for name, function, size in (
        ("landing", system.landing, 2),
        ("relabel", system.relabel, checks.count),
        ("forces", system.forces, checks.count),
        *(("falls", each, None) for each in system.falls.values()),
        *(("counts", each, None) for each in system.counts),
        ("potential", system.potential, None),
        ("dissipation", system.dissipation, None),
    ):
        if function is not None:
            checks.agree(name, function, size, body, state)
    for number in (0, 1):

        def place(body: Any, state: Any, number: int = number) -> Any:
            return system.landing(body, state)[number]

        if np.any(_slopes(checks, "landing", place, state, checks.count)):
            raise checks.error("landing", "must not depend on the rates of the coordinates")
    for function in system.falls.values():
        if not np.any(_slopes(checks, "falls", function, state, 0)):
            raise checks.error("falls", "never falls: it does not depend on the coordinates")
    for function in system.counts:
        moves = _slopes(checks, "counts", function, state, 0)
        if function(body, state) <= 0.0 and not np.any(moves):
            raise checks.error("counts", "is never positive: no heelstrike would count")
    if system.potential is not None and np.any(
        _slopes(checks, "potential", system.potential, state, checks.count)
    ):
        raise checks.error("potential", "must not depend on the rates of the coordinates")
    if (
        system.dissipation is not None
        and system.dissipation(body, state) != 0.0  # it is without dampers
        and not np.any(_slopes(checks, "dissipation", system.dissipation, state, checks.count))
    ):
        raise checks.error("dissipation", "takes nothing: it does not depend on the rates")
    _check_travel(checks, system.travel, state)
    _check_pose(checks, state)


def _check_travel(checks: Checks, travel: Any, state: Any) -> None:
    """Refuse a travel that is not one of the coordinates, for each control."""
    names = checks.system.controls
    checks.agree("travel", travel, len(names), state)
    for number, name in enumerate(names):

        def moved(body: Any, state: Any, number: int = number) -> Any:
            return travel(state)[number]

        if np.any(_slopes(checks, "travel", moved, state, checks.count)):
            raise checks.error("travel", f"of the control {name!r} must not depend on the rates")
        if not np.any(_slopes(checks, "travel", moved, state, 0)):
            raise checks.error(
                "travel", f"of the control {name!r} does not depend on the coordinates: it would "
                "move nothing"
            )  # fmt: skip


def _slopes(
    checks: Checks, name: str, function: Any, state: Any, first: int
) -> NDArray[np.float64]:
    """Derivatives of a function by the coordinates of a state, or by its rates, (m,)."""

    def slopes(body: Any, state: Any) -> tuple:
        return tuple(rates_by(function(body, state), state[first : first + checks.count]))

    return checks.numbers(name, checks.tried(name, Derived(slopes), checks.body, state))


def _check_pose(checks: Checks, state: Any) -> None:
    lines, again = (checks.tried("pose", checks.system.drawn, state) for _ in range(2))
    if not same([line.tolist() for line in lines], [line.tolist() for line in again]):
        raise checks.error(
            "pose", "gives another result each time: its arguments must determine it"
        )
    for line in lines:
        if line.ndim != 2 or line.shape[1] != 2 or not np.all(np.isfinite(line)):
            raise checks.error("pose", "must give lines of finite points (x, y)")


def _check_equations(checks: Checks, state: Any) -> None:
    system, body = checks.system, checks.body
    _positive_matrix(
        checks, system._mass_matrix, checks.count, state, "links",
        "leave a coordinate without inertia: the mass matrix must be positive",
    )  # fmt: skip
    if system.dissipation is not None:
        half = checks.count
        back = type(state)(*state[:half], *(-rate for rate in state[half:]))
        for moving in (state, back):
            if system.dissipation(body, moving) < 0.0:
                raise checks.error("dissipation", f"must not be negative, as at {moving}")


def _positive_matrix(
    checks: Checks, function: Any, count: int, state: Any, name: str, said: str
) -> NDArray[np.float64]:
    """The mass matrix of some coordinates, (count, count); refused if it is not positive.

    The function returns its upper triangle, row by row; an error names the user's function `name`.
    """
    above = np.triu_indices(count)
    found = checks.tried(name, Derived(function), checks.body, state)
    matrix = np.zeros((count, count))
    matrix[above] = checks.numbers(name, found, len(above[0]))
    matrix = matrix + np.triu(matrix, 1).T
    if np.linalg.eigvalsh(matrix)[0] <= 1e-12 * np.abs(matrix).max():
        raise checks.error(name, f"{said}, as it is not at {state}")
    return matrix


def _check_heelstrike(checks: Checks, state: Any) -> None:
    system, body = checks.system, checks.body
    if not np.any(_slopes(checks, "landing", system._clearance, state, 0)):
        raise checks.error("landing", "never falls: its y does not depend on the coordinates")

    def struck(body: Any, state: Any) -> tuple:
        after, lost, _ = system._strike(body, state, 0.0, Ground(0.0, 1.0))
        energy = system._kinetic_energy(system._next_body(body), after)
        return system._kinetic_energy(body, state), energy, lost

    before, after, lost = checks.tried("relabel", Derived(struck), body, state)
    if abs(before - after - lost) > _CLOSE * before:
        raise checks.error(
            "relabel", "does not name the same motion: just after a heelstrike the kinetic energy "
            f"is {after:.6g} in the new coordinates and {before - lost:.6g} in the old ones"
        )  # fmt: skip
    new = system.State(*system.relabel(body, state), *state[checks.count :])
    then = system._next_body(body)
    mass, _, moment = system._centre(body, state)
    height = moment - mass * system.landing(body, state)[1]
    if abs(system._centre(then, new)[2] - height) > _CLOSE * (1.0 + abs(height)):
        raise checks.error(
            "relabel", "does not name the same posture: the centre of mass is at another height "
            "over the new foot"
        )  # fmt: skip
    if system.potential is not None:
        energies = [system.potential(body, state), system.potential(then, new)]
        if abs(energies[1] - energies[0]) > _CLOSE * (1.0 + abs(energies[0])):
            raise checks.error(
                "potential", f"is {energies[0]:.6g} before a heelstrike and {energies[1]:.6g} "
                "after it, in the same posture: springs must act alike on both legs"
            )  # fmt: skip


def _check_statement(checks: Checks, equations: hybrid.System) -> None:
    """Refuse given equations that contradict each other."""
    system, body = checks.system, checks.body
    if not isinstance(body, equations.Body):
        raise checks.error("body", f"must be of the type {equations.Body.__name__}, not {body!r}")
    for name in equations.absent:
        if getattr(body, name, 0.0) != 0.0:
            raise checks.error(
                "body", f"has {name} = {getattr(body, name)!r}, which is absent from its "
                "equations: leave it 0"
            )  # fmt: skip
    if Outcome.HEELSTRIKE not in equations.phases[-1].resets:
        raise checks.error("phases", "must end with a heelstrike: the last one has no reset for it")
    for number, phase in enumerate(equations.phases):
        _check_form(checks, equations, number, phase)
    for state in checks.states:
        checks.numbers("centre", checks.tried("centre", system.centre, body, state), 2)
        _check_pose(checks, state)
        _check_energies(checks, equations, state)
        for phase in equations.phases:
            here = tied(state, phase.links)
            _check_phase(checks, equations, phase, here)
            _check_resets(checks, equations, phase, here)
    for phase in equations.phases:
        if len(constants_used(equations, phase)) > MOST_CONSTANTS:
            raise checks.error(
                f"phase {phase.stage.name}", f"is too large: it may use at most {MOST_CONSTANTS} "
                "parameters"
            )  # fmt: skip


def _check_form(checks: Checks, equations: hybrid.System, number: int, phase: Phase) -> None:
    """Refuse a phase of more parts than there is room for, or with impacts that lead nowhere."""
    name, count = f"phase {phase.stage.name}", len(equations.phases)
    if not 1 <= phase.links <= checks.count:
        raise checks.error(name, f"must have 1 to {checks.count} links, not {phase.links!r}")
    controls = len(checks.system.controls)
    rows = len(phase.guards) + controls + sum(len(guard.where) for guard in phase.guards)
    if rows > MOST_GUARDS or controls > WIDE.controls:
        raise checks.error(
            name, f"is too large: at most {WIDE.controls} controls, and {MOST_GUARDS} controls, "
            "guards and conditions of guards together"
        )  # fmt: skip
    for outcome, reset in phase.resets.items():
        which = f"reset {Outcome(outcome).name} of {name}"
        if outcome not in _IMPACTS:
            raise checks.error(which, "cannot act: a reset is of a kneestrike or a heelstrike")
        if outcome == Outcome.HEELSTRIKE and reset.into is not None:
            raise checks.error(which, f"goes into phase {reset.into}: a heelstrike ends the stride")
        if outcome == Outcome.KNEESTRIKE and reset.into not in range(number + 1, count):
            raise checks.error(
                which, f"goes into phase {reset.into!r}: a kneestrike leads to a later one"
            )
    for guard in phase.guards:
        if guard.outcome in _IMPACTS and guard.outcome not in phase.resets:
            raise checks.error(
                f"guard {guard.outcome.name} of {name}", "has no reset: state what the impact does"
            )  # fmt: skip
        if guard.outcome == Outcome.RUNNING:
            raise checks.error(f"guards of {name}", "must end it: RUNNING is no outcome of one")


def _check_energies(checks: Checks, equations: hybrid.System, state: Any) -> None:
    """Refuse energies, places and measures that are not finite numbers."""
    body, start = checks.body, equations.State(*np.zeros(2 * checks.count).tolist())
    for name, arguments in (
        ("kinetic_energy", (body, state)),
        ("potential_gain", (body, start, state, _SLOPING)),
        ("spring_gain", (body, start, state)),
        ("friction_power", (body, state)),
        ("place", (body, state)),
        ("foot_clearance", (body, state)),
    ):
        function = getattr(equations, name)
        if function is not None:
            checks.numbers(name, [checks.tried(name, Derived(function), *arguments)])
    if (equations.ground_force is None) != (equations.momentum is None):
        lacking = "momentum" if equations.momentum is None else "ground_force"
        raise checks.error(lacking, "is missing: ground_force and momentum are used together")
    _check_travel(checks, equations.travel, state)
    given = equations, body, state[: checks.count], state, state, _SLOPING
    checks.numbers("measure", checks.tried("measure", equations.measure, *given), 4)


def _rate(value: Any, state: Any, bends: Sequence[Any]) -> Any:
    """Return the rate of a value, given the accelerations of all coordinates."""
    moves = (*state[len(bends) :], *bends)
    return sum(d * v for d, v in zip(rates_by(value, state), moves, strict=True))


def _check_phase(checks: Checks, equations: hybrid.System, phase: Phase, state: Any) -> None:
    """Compare a phase's accelerations with the power of gravity, springs, friction and controls."""
    body, count, name = checks.body, checks.count, f"accelerations of phase {phase.stage.name}"
    control = equations.Control(
        *(0.0 if each in equations.absent else 0.1 + 0.1 * i
          for i, each in enumerate(equations.Control._fields))  # type: ignore[attr-defined]
    )  # fmt: skip
    start = equations.State(*np.zeros(2 * count))
    found = checks.tried(name, Derived(phase.accelerations), body, state, control, _SLOPING)
    checks.numbers(name, found, phase.links)

    def bends_of(body: Any, state: Any) -> list[Any]:
        turns = phase.accelerations(body, state, control, _SLOPING)
        return [turns[min(i, phase.links - 1)] for i in range(count)]

    def powers(body: Any, state: Any) -> tuple:
        rate = partial(_rate, state=state, bends=bends_of(body, state))
        gained = [rate(equations.kinetic_energy(body, state))]
        gained.append(rate(equations.potential_gain(body, start, state, _SLOPING)))
        if equations.spring_gain is not None:
            gained.append(rate(equations.spring_gain(body, start, state)))
        if equations.friction_power is not None:
            gained.append(equations.friction_power(body, state))
        for torque, works, moved in zip(
            control, equations.works, equations.travel(state), strict=True
        ):
            gained.append(0.0 if torque == 0.0 else -torque * works * rate(moved))
        return tuple(gained)

    def forces(body: Any, state: Any) -> tuple:
        bends = bends_of(body, state)
        momenta = equations.momentum(body, state)  # type: ignore[misc]
        changes = [_rate(momentum, state, bends) for momentum in momenta]
        back, up = equations.ground_force(body, state, bends, _SLOPING)  # type: ignore[misc]
        weight = checks.system.total_mass
        return (*changes, back + weight * _SLOPING.sine, up - weight * _SLOPING.cosine)

    if equations.momentum is not None:
        each = checks.numbers("momentum", checks.tried("momentum", Derived(forces), body, state), 4)
        if np.abs(each[:2] - each[2:]).max() > _CLOSE * np.abs(each).max():
            raise checks.error(
                "ground_force", f"and weight change the momentum by {each[2:].tolist()} in "
                f"{name}, and `momentum` itself changes by {each[:2].tolist()}; its mass is "
                f"{checks.system.total_mass:.6g}"
            )  # fmt: skip
    each = checks.numbers(name, checks.tried(name, Derived(powers), body, state))
    if abs(each.sum()) > _CLOSE * np.abs(each).sum():
        raise checks.error(
            name, f"do not balance power: kinetic energy changes by {each[0]:.6g}, where gravity, "
            f"springs, friction and controls supply {-each[1:].sum():.6g}"
        )  # fmt: skip
    if equations.mass_matrix is not None and phase.links == max(p.links for p in equations.phases):
        _check_mass_matrix(checks, equations, phase.links, state)


def _check_mass_matrix(checks: Checks, equations: hybrid.System, count: int, state: Any) -> None:
    """Compare the mass matrix of the links that move by themselves with the kinetic energy."""
    name = "mass_matrix"
    matrix = _positive_matrix(checks, equations.mass_matrix, count, state, name, "must be positive")
    rates = np.array(state[checks.count :][:count])
    kinetic = Derived(equations.kinetic_energy)(checks.body, state)
    if abs(0.5 * rates @ matrix @ rates - kinetic) > _CLOSE * kinetic:
        raise checks.error(name, "does not give the kinetic energy")


def _check_resets(checks: Checks, equations: hybrid.System, phase: Phase, state: Any) -> None:
    """Refuse strikes that never come, gain energy, or move the walker."""
    body, system = checks.body, checks.system
    for guard in phase.guards:
        name, falls = f"guard {guard.outcome.name} of phase {phase.stage.name}", guard.falls

        def value(body: Any, state: Any, falls: Any = falls) -> tuple:
            height = falls(body, state, SMOOTH)
            return height, *rates_by(height, state[: checks.count])

        found = checks.numbers(name, checks.tried(name, Derived(value), body, state))
        if not np.any(found[1:]):
            raise checks.error(name, "never falls: it does not depend on the coordinates")
        if guard.watch != Watch.STRIKE or guard.outcome not in phase.resets:
            continue
        struck = _on_guard(checks, phase, value, state)
        reset = phase.resets[guard.outcome]
        if struck is None:
            continue
        name = f"reset {guard.outcome.name} of phase {phase.stage.name}"
        strike = Derived(lambda body, state, s=reset.strike: s(body, state, 0.0, SMOOTH)[:2])
        after, lost = checks.tried(name, strike, body, struck)
        after = equations.State(*checks.numbers(name, after, 2 * checks.count))
        then = system._next_body(body) if reset.into is None else body
        energies = [
            float(Derived(equations.kinetic_energy)(of, state))
            for of, state in ((body, struck), (then, after))
        ]
        if energies[1] > energies[0] * (1.0 + _CLOSE):
            raise checks.error(
                name, f"gains energy: {energies[0]:.6g} before, {energies[1]:.6g} after"
            )
        if abs(energies[0] - energies[1] - lost) > _CLOSE * energies[0]:
            raise checks.error(
                name, f"states an energy loss of {float(lost):.6g}, and takes "
                f"{energies[0] - energies[1]:.6g}"
            )  # fmt: skip
        if reset.into is None:
            moved = system.centre(then, after)[1] - system.centre(body, struck)[1]
        else:
            moved = np.abs(np.subtract(after, struck)[: checks.count]).max()
        if abs(moved) > 1e-6:
            raise checks.error(name, f"moves the walker by {abs(moved):.3g}: its posture must stay")
        links = equations.phases[reset.into or 0].links
        if not np.allclose(after, tied(after, links), atol=1e-9):
            raise checks.error(
                name, f"leaves coordinates moving apart that its next phase, of {links} links, "
                "moves together"
            )  # fmt: skip


def _on_guard(checks: Checks, phase: Phase, value: Any, state: Any) -> Any:
    """Return a state nearby at which a guard is zero, by Newton's method; None if it fails."""
    count, links, here = checks.count, phase.links, np.array(state, dtype=float)
    for _ in range(_ITERATIONS):
        height, *slopes = np.array(Derived(value)(checks.body, type(state)(*here)), dtype=float)
        if abs(height) < 1e-13:
            return type(state)(*here.tolist())
        ways = np.array(slopes[:links])
        ways[-1] += sum(slopes[links:])
        step = -height * ways / (ways @ ways)
        here[:count] += [step[min(i, links - 1)] for i in range(count)]
    return None
