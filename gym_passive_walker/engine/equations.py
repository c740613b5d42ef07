"""Functions of a phase as expressions over a tile; base of the code for all lanes or for one."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

from gym_passive_walker.engine.layout import PAIR
from gym_passive_walker.engine.native import Memory
from gym_passive_walker.engine.runge_kutta import Pair
from gym_passive_walker.models.equations.hybrid import Ground, Guard, Phase, State, System
from gym_passive_walker.models.expressions import Expression, Tangents


class Equations:
    """Functions of a phase as expressions over a tile.

    Args:
        system: The system.
        phase: A phase of the system.
        body: Names of the constants that the phase uses, in the order of the tile's rows.
        pair: The Runge-Kutta pair.
    """

    def __init__(
        self, system: System, phase: Phase, body: tuple[str, ...], pair: Pair = PAIR
    ) -> None:
        self.system, self.phase, self.names, self.pair = system, phase, body, pair

    @property
    def links(self) -> range:
        """Indices of the independent angles."""
        return range(self.phase.links)

    @property
    def rates(self) -> slice:
        """Indices of the angular velocities in a state."""
        return slice(self.system.coordinates, None)

    def bends(self, tile: Memory, stage: int) -> list[Expression]:
        """Accelerations in a stage of the step, one for each coordinate."""
        return [tile["stage", stage, link] for link in range(self.system.coordinates)]

    def body(self, tile: Memory) -> Any:
        """Return the walker's constants; those that the phase does not use are NaN."""
        rows = {name: tile["body", i] for i, name in enumerate(self.names)}
        unused = dict.fromkeys(self.system.Body._fields, float("nan"))  # type: ignore[attr-defined]
        return without_absent(self.system, self.system.Body(**unused | rows))

    @property
    def controls(self) -> list[int]:
        """Indices of the controls that there may be."""
        names = enumerate(self.system.Control._fields)  # type: ignore[attr-defined]
        return [i for i, name in names if name not in self.system.absent]

    @property
    def grounds(self) -> list[int]:
        """Indices of the parts of the ground that are not absent from the system."""
        names = enumerate(Ground._fields)
        return [i for i, name in names if name not in self.system.absent]

    def ground(self, tile: Memory) -> Ground:
        """Return the walker's ground data."""
        found = {Ground._fields[i]: tile["ground", i] for i in self.grounds}
        return Ground(**dict.fromkeys(Ground._fields, 0.0) | found)

    def guard(self, index: int, tile: Memory) -> Callable[[State], Expression]:
        """Return a guard as a function of the state."""
        falls, body, ground = self.phase.guards[index].falls, self.body(tile), self.ground(tile)
        return lambda state: falls(body, state, ground)

    def wheres(self, guard: Guard, tile: Memory) -> list[Callable[[State], Expression]]:
        """Return the functions of the state that are positive where a guard's crossing counts."""
        body, ground = self.body(tile), self.ground(tile)
        return [lambda state, where=where: where(body, state, ground) for where in guard.where]

    @property
    def dissipates(self) -> bool:
        """Whether the system has friction."""
        return self.system.friction_power is not None

    def friction(self, tile: Memory, state: State) -> Expression:
        """Return the power dissipated by friction in a state."""
        assert self.system.friction_power is not None
        return self.system.friction_power(self.body(tile), state)

    def state(self, tile: Memory, prefix: str = "") -> State:
        """Return the state at the start of a step, or at its end with the prefix "new_"."""
        return self.as_state(tile.entries(prefix + "angle"), tile.entries(prefix + "rate"))

    def as_state(self, angles: list, rates: list) -> State:
        """Return a state from the independent angles and their angular velocities."""
        last = self.phase.links - 1
        each = range(self.system.coordinates)
        return self.system.State(*(v[min(i, last)] for v in (angles, rates) for i in each))

    def accelerations(self, tile: Memory, state: State) -> tuple[Expression, ...]:
        """Accelerations of the links."""
        names: tuple[str, ...] = self.system.Control._fields  # type: ignore[attr-defined]
        held = {names[i]: tile["control", i] for i in self.controls}
        control = self.system.Control(**dict.fromkeys(names, 0.0) | held)
        return self.phase.accelerations(self.body(tile), state, control, self.ground(tile))

    def along(
        self, function: Callable[[State], Expression], state: State, bends: list[Any]
    ) -> tuple[Expression, Expression, Expression]:
        """Return a function of the state, and its first and second time derivatives.

        Args:
            function: The function.
            state: Angles and angular velocities.
            bends: Angular accelerations; None where the second derivative is not needed.
        """
        flow = self.as_state(list(state[self.rates]), bends)
        moves = {x: change for x, change in zip(state, flow, strict=True) if change is not None}

        def derivative(of: Expression) -> Expression:
            change = Tangents(moves)(of)
            return of.number(0.0) if change is None else change

        value = function(state)
        rate = derivative(value)
        return value, rate, derivative(rate)

    def _moved(self, control: int, state: State) -> Expression:
        """Return the coordinate on which a control does work."""
        return self.system.travel(state)[control]


def places_of(system: System, record: Memory) -> list[int]:
    """Return the index of each number of a state in the field "state" of a record."""
    count, room = system.coordinates, record.layout["start"].shape[0]
    return [*range(count), *range(room, room + count)]


def state_of(system: System, record: Memory) -> State:
    """A walker's state."""
    return system.State(*(record["state", i] for i in places_of(system, record)))


def without_absent(system: System, body: Any) -> Any:
    """Replace the constants that are absent from the system by zero."""
    return body._replace(**{name: 0.0 for name in system.absent if name in body._fields})


def weighted(weights: Iterable[Any], terms: Iterable[Expression]) -> Any:
    """Return the weighted sum of terms; 0 if all weights are zero."""
    return sum_of([float(w) * x for w, x in zip(weights, terms, strict=True) if w != 0.0])


def sum_of(terms: list[Expression]) -> Any:
    """Return the sum of terms, in order; 0 for no terms."""
    if not terms:
        return 0.0
    total = terms[0]
    for term in terms[1:]:
        total = total + term
    return total
