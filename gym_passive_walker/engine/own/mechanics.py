"""Equations of motion and impacts, derived from the positions of masses by exact differentiation.

With the Jacobian J of all positions, the equations are those of d'Alembert: the sum of
J^T m (J q'' + J' q' - g) over all masses equals the generalized forces. A plastic impact keeps the
momentum of every motion that the new contact allows.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np

from gym_passive_walker.models.expressions import Expression, Tangents, operands, read

Number = Any


class Link(NamedTuple):
    """A rigid body, or a point mass.

    Attributes:
        mass: Its mass.
        x: Position of its centre of mass along the ground, in the walking direction.
        y: Height of its centre of mass over the ground.
        inertia: Moment of inertia about its centre of mass.
        angle: Angle in rad by which it has turned, in either sense.
    """

    mass: Number
    x: Number
    y: Number
    inertia: Number = 0.0
    angle: Number = 0.0


class Derived:
    """A function that differentiates what it is given, for expressions and for numbers.

    Args:
        function: Takes expressions, or named tuples of them, to numbers or nested tuples of them.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        self.function = function

    def __call__(self, *arguments: Any) -> Any:
        """The result, of the kind of numbers that the arguments hold."""
        numbers: list[Any] = []
        for argument in arguments:
            numbers += argument if isinstance(argument, tuple) else [argument]
        if any(isinstance(x, Expression) for x in numbers):
            return self.function(*arguments)
        known: dict = {}
        symbols = iter([read(known, i) for i in range(len(numbers))])
        given = [
            getattr(a, "_make", tuple)(next(symbols) for _ in a)
            if isinstance(a, tuple)
            else next(symbols)
            for a in arguments
        ]
        return evaluated(self.function(*given), numbers)


def evaluated(results: Any, numbers: Sequence[Any]) -> Any:
    """Evaluate expressions, nested in tuples, that read entries of a sequence of numbers."""
    done: dict[Expression, Any] = {}

    def value(x: Any) -> Any:
        if not isinstance(x, Expression):
            return x
        if x not in done:
            if x.op == "read":
                done[x] = numbers[x.args[0]]
            elif x.op == "constant":
                done[x] = x.args[0]
            elif x.op in ("sin", "cos"):
                done[x] = getattr(np, x.op)(value(x.args[0]))
            else:
                done[x] = _OPERATIONS[x.op](*map(value, operands(x)))
        return done[x]

    if isinstance(results, tuple):
        parts = [evaluated(part, numbers) for part in results]
        return type(results)(*parts) if hasattr(results, "_fields") else tuple(parts)
    return value(results)


_OPERATIONS: dict[str, Callable[..., Any]] = {
    "add": lambda a, b: a + b,
    "sub": lambda a, b: a - b,
    "mul": lambda a, b: a * b,
    "div": np.divide,  # no exception where `choose` takes another value
    "neg": lambda a: -a,
    "abs": lambda a: np.where(np.real(a) < 0.0, -a, a),
    "sqrt": np.sqrt,
    "exp": np.exp,
    "tanh": np.tanh,
    "<": lambda a, b: np.real(a) < np.real(b),
    "<=": lambda a, b: np.real(a) <= np.real(b),
    ">": lambda a, b: np.real(a) > np.real(b),
    ">=": lambda a, b: np.real(a) >= np.real(b),
    "and": lambda a, b: a & b,
    "or": lambda a, b: a | b,
    "not": np.logical_not,
    "choose": lambda c, a, b: np.where(c, a, b),
}


def rates_by(value: Any, variables: Sequence[Any]) -> list[Any]:
    """Partial derivatives of a value by variables; 0 where it does not depend on one."""
    if not isinstance(value, Expression):
        return [0.0] * len(variables)
    # The other variables are held constant, even where they are made of the same entries.
    held = dict.fromkeys((x for x in variables if isinstance(x, Expression)), None)
    found = []
    for x in variables:
        seeds: dict[Any, Any] = {**held, x: value.number(1.0)}
        change = Tangents(seeds)(value) if x in held else None
        found.append(0.0 if change is None else change)
    return found


def relabelled(
    relabel: Callable[[Any, Any], Sequence[Any]], body: Any, state: Any, rates: Any
) -> Any:
    """The state in other coordinates, given by those of a state with other rates.

    Args:
        relabel: Function of body and state: the new coordinates.
        body: Parameters.
        state: The state.
        rates: Rates of its coordinates, or of the first ones, with which all others move.
    """
    coordinates = relabel(body, state)
    after = []
    for coordinate in coordinates:
        rate: Any = 0.0
        for change, old in zip(rates_by(coordinate, state[: len(rates)]), rates, strict=True):
            rate = rate + change * old
        after.append(rate)
    return state._make([*coordinates, *after])


def along(value: Any, state: Any) -> tuple[Any, Any]:
    """A value's rate along the motion, and its second derivative without accelerations."""
    if not isinstance(value, Expression):
        return 0.0, 0.0
    half = len(state) // 2
    held: dict[Any, Any] = dict.fromkeys((x for x in state if isinstance(x, Expression)), None)
    moves = held | {x: v for x, v in zip(state[:half], state[half:], strict=True) if x in held}
    seeds: dict[Any, Any] = {x: None if v is None else value.number(v) for x, v in moves.items()}
    rate = Tangents(seeds)(value)
    if rate is None:
        return 0.0, 0.0
    bend = Tangents(seeds)(rate)
    return rate, 0.0 if bend is None else bend


def solve_positive(matrix: dict[tuple[int, int], Any], right: Sequence[Any]) -> list[Any]:
    """Solve a symmetric positive system, given the upper triangle of its matrix."""
    size, a, b = len(right), dict(matrix), list(right)
    for k in range(size - 1, -1, -1):  # from the last link, which touches the fewest others
        inverse = 1.0 / a[k, k]
        for i in range(k):
            if is_zero(a[i, k]):
                continue
            factor = a[i, k] * inverse
            for j in range(i, k):
                a[i, j] = a[i, j] - factor * a[j, k]
            b[i] = b[i] - factor * b[k]
    found: list[Any] = []
    for k in range(size):
        rest = b[k]
        for i in range(k):
            rest = rest - a[i, k] * found[i]
        found.append(rest / a[k, k])
    return found


def is_zero(x: Any) -> bool:
    """Whether a number or an expression is zero for certain."""
    return (x.value if isinstance(x, Expression) else x) == 0.0


class _Part(NamedTuple):
    """One of a link's x, y and angle: its weight, its value, its rate and its derivatives."""

    axis: int
    weight: Any
    value: Any
    rate: Any
    bend: Any
    by: list[Any]


class Motion:
    """Links in a state, and how their positions change.

    Args:
        links: The links.
        state: The state: coordinates, then their rates.
    """

    def __init__(self, links: Sequence[Link], state: Any) -> None:
        self.count = len(state) // 2
        self.coordinates = state[: self.count]
        self.parts: list[_Part] = []
        for link in links:
            weights = link.mass, link.mass, link.inertia
            for axis, value in enumerate((link.x, link.y, link.angle)):
                if not is_zero(weights[axis]):
                    by = rates_by(value, self.coordinates)
                    self.parts.append(_Part(axis, weights[axis], value, *along(value, state), by))

    def _sum(self, terms: Iterable[Any]) -> Any:
        total: Any = 0.0
        for term in terms:
            total = total + term
        return total

    def matrix(self, ways: Sequence[Sequence[Any]] | None = None) -> dict[tuple[int, int], Any]:
        """The upper triangle of the mass matrix; `ways` replace the derivatives of the parts."""
        ways = [part.by for part in self.parts] if ways is None else ways
        each = [(part.weight, way) for part, way in zip(self.parts, ways, strict=True)]
        return {
            (i, j): self._sum(
                weight * (way[i] * way[j])
                for weight, way in each
                if not (is_zero(way[i]) or is_zero(way[j]))
            )
            for i in range(self.count)
            for j in range(i, self.count)
        }

    def forces(self, gravity: tuple[Any, Any]) -> list[Any]:
        """Generalized forces of weights, less those that the velocities alone require.

        Args:
            gravity: Along the ground in the walking direction, and up from it.
        """
        pulls = [
            part.weight * ((gravity[part.axis] if part.axis < 2 else 0.0) - part.bend)
            for part in self.parts
        ]
        return self._through([part.by for part in self.parts], pulls)

    def _through(self, ways: Sequence[Sequence[Any]], amounts: Sequence[Any]) -> list[Any]:
        """The sum over parts of amounts times derivatives, one for each coordinate."""
        each = list(zip(ways, amounts, strict=True))
        return [
            self._sum(way[i] * amount for way, amount in each if not is_zero(way[i]))
            for i in range(self.count)
        ]

    def kinetic_energy(self) -> Any:
        """Kinetic energy."""
        return self._sum(0.5 * part.weight * (part.rate * part.rate) for part in self.parts)

    def contact_force(
        self, accelerations: Sequence[Any], gravity: tuple[Any, Any]
    ) -> tuple[Any, Any]:
        """Force of the ground: what the accelerations of all masses need besides their weights.

        Args:
            accelerations: Of the coordinates.
            gravity: Along the ground in the walking direction, and up from it.

        Returns:
            Along the ground in the walking direction, and up from it.
        """

        def needed(part: _Part) -> Any:
            moved = self._sum(a * b for a, b in zip(part.by, accelerations, strict=True))
            return part.weight * (moved + part.bend - gravity[part.axis])

        return self._along(needed)

    def momentum(self) -> tuple[Any, Any]:
        """Momentum along the ground in the walking direction, and up from it."""
        return self._along(lambda part: part.weight * part.rate)

    def _along(self, amount: Callable[[_Part], Any]) -> tuple[Any, Any]:
        """The sums of an amount over what moves along the ground, and up from it."""
        along, up = (
            self._sum(amount(part) for part in self.parts if part.axis == axis) for axis in (0, 1)
        )
        return along, up

    def landing(self, point: tuple[Any, Any]) -> tuple[list[Any], Any]:
        """A plastic impact of a point that stays where it lands, as the old contact lets go.

        Args:
            point: x and y of the point. Of a foot that rolls, x is where its centre is less how
                far it has rolled, so that its rate is the velocity of the point that touches.

        Returns:
            The rates just after it, and the energy that it takes.
        """
        less = [*(rates_by(place, self.coordinates) for place in point), [0.0] * self.count]
        ways = [
            [a - b for a, b in zip(part.by, less[part.axis], strict=True)] for part in self.parts
        ]
        momenta = [part.weight * part.rate for part in self.parts]
        after = solve_positive(self.matrix(ways), self._through(ways, momenta))
        jumps = [
            part.rate - self._sum(a * b for a, b in zip(way, after, strict=True) if not is_zero(a))
            for part, way in zip(self.parts, ways, strict=True)
        ]
        weights = (part.weight for part in self.parts)
        return after, self._sum(0.5 * m * (v * v) for m, v in zip(weights, jumps, strict=True))
