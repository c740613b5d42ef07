"""Equations and impacts from a mass matrix, for systems that are stated phase by phase.

A mass matrix is a function of body and state that returns its upper triangle, row by row, for the
coordinates that move by themselves in any phase. In a phase with fewer `links` than coordinates,
the last coordinates move with the last of the links.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

from gym_passive_walker.engine.own.mechanics import Derived, rates_by, relabelled, solve_positive
from gym_passive_walker.models.equations.hybrid import Ground, Strike

_UPHILL, _UPWARDS = Ground(1.0, 0.0), Ground(0.0, 1.0)  # directions in which a weight resists

Matrix = Callable[[Any, Any], Sequence[Any]]
Forces = Callable[[Any, Any, Any, Ground], Sequence[Any]]


def tied(state: Any, links: int) -> Any:
    """A state in which the last coordinates and their rates are those of the last link."""
    half = len(state) // 2
    places = [min(i, links - 1) for i in range(half)]
    return state._make([*(state[i] for i in places), *(state[half + i] for i in places)])


def gathered(values: Sequence[Any], links: int) -> list[Any]:
    """Generalized forces on the links: those on coordinates that move with one are added up."""
    totals = list(values[:links])
    for value in values[links:]:
        totals[-1] = totals[-1] + value
    return totals


def _size_of(values: Sequence[Any]) -> int:
    """The rows of the matrix that has these numbers in its upper triangle."""
    return math.isqrt(2 * len(values))


def triangle(values: Sequence[Any], links: int | None = None) -> dict[tuple[int, int], Any]:
    """The upper triangle of a mass matrix by row and column, with the last coordinates tied."""
    size, entries, found = _size_of(values), iter(values), {}
    links = size if links is None else links
    for i in range(size):
        for j in range(i, size):
            value, at = next(entries), (min(i, links - 1), min(j, links - 1))
            value = 2.0 * value if at[0] == at[1] and i != j else value
            found[at] = found[at] + value if at in found else value
    return found


def accelerations_of(mass_matrix: Matrix, forces: Forces, links: int | None = None) -> Derived:
    """The accelerations that a mass matrix and forces give.

    Args:
        mass_matrix: Function of body and state: the upper triangle, row by row.
        forces: Function of body, state, control and ground: what the mass matrix times the
            accelerations is, one number for each coordinate. Gravity, controls and the terms of
            the rates are among them.
        links: Coordinates that move by themselves; all if None.

    Returns:
        Function of body, state, control and ground, for `Phase.accelerations`.
    """

    def accelerations(body: Any, state: Any, control: Any, ground: Ground) -> tuple:
        matrix, given = mass_matrix(body, state), forces(body, state, control, ground)
        moving = len(given) if links is None else links
        return tuple(solve_positive(triangle(matrix, moving), gathered(given, moving)))

    return Derived(accelerations)


def kinetic_energy_of(mass_matrix: Matrix) -> Callable[[Any, Any], Any]:
    """The kinetic energy, a function of body and state, that a mass matrix gives."""

    def kinetic_energy(body: Any, state: Any) -> Any:
        half = len(state) // 2
        energy: Any = 0.0
        for (i, j), value in triangle(mass_matrix(body, state)).items():
            share = 0.5 if i == j else 1.0
            energy = energy + share * (value * (state[half + i] * state[half + j]))
        return energy

    return kinetic_energy


def stop_of(mass_matrix: Matrix, gap: Callable[[Any, Any], Any]) -> Derived:
    """A plastic impact that ends the motion of a gap, as a knee ends that of its shank.

    Args:
        mass_matrix: Function of body and state: the upper triangle, row by row.
        gap: Function of body and state, of coordinates alone; its rate is zero after the impact.

    Returns:
        Function of body, state, push-off and ground, for `Reset.strike`. It keeps the coordinates
        and every momentum that the stop does not act on.
    """

    def strike(body: Any, before: Any, push_off: Any, ground: Ground) -> Strike:
        half = len(before) // 2
        given = mass_matrix(body, before)
        matrix, links = triangle(given), _size_of(given)
        ways = rates_by(gap(body, before), before[:links])
        jumps = solve_positive(matrix, ways)
        closing: Any = 0.0
        yields: Any = 0.0
        for way, rate, jump in zip(ways, before[half : half + links], jumps, strict=True):
            closing, yields = closing + way * rate, yields + way * jump
        impulse = closing / yields
        rates = [a - impulse * b for a, b in zip(before[half:], jumps, strict=False)]
        after = [*before[:half], *rates, *rates[-1:] * (half - links)]
        return Strike(before._make(after), 0.5 * closing * impulse)

    return Derived(strike)


def _moved_by(potential_gain: Any, body: Any, state: Any, links: int) -> list[list[Any]]:
    """Mass times the derivative of its centre, along the ground and up, by each coordinate.

    Gravity acts at the centre of mass: its potential says how a coordinate moves it.
    """
    still = state._make([0.0] * len(state))
    gains = (potential_gain(body, still, state, ground) for ground in (_UPHILL, _UPWARDS))
    return [rates_by(gain, state[:links]) for gain in gains]


def heelstrike_of(
    mass_matrix: Matrix,
    potential_gain: Any,
    contact: Callable[[Any, Any], tuple[Any, Any]],
    relabel: Callable[[Any, Any], Sequence[Any]],
    *,
    links: int | None = None,
    mass: Any = 1.0,
) -> Derived:
    """A plastic impact of the swing foot, which stays where it lands as the old foot lets go.

    Args:
        mass_matrix: Function of body and state: the upper triangle, row by row, for a stance foot
            that does not move.
        potential_gain: Function of body, two states and ground, as in `HybridSystem`. It says how
            the coordinates move the centre of mass.
        contact: Function of body and state: x and y of the swing foot from the stance foot, as
            `System.landing`. Of a foot that rolls, x is where its centre is less how far it has
            rolled.
        relabel: Function of body and state: the coordinates after the heelstrike, when the legs
            have exchanged their roles, by those before it.
        links: Coordinates that move by themselves before it; all if None.
        mass: The total mass, or a function of the body.

    Returns:
        Function of body, state, push-off and ground, for `Reset.strike`. It keeps the momentum of
        every motion that the new contact allows. A joint that is locked before the heelstrike
        stays locked in it.
    """

    def strike(body: Any, before: Any, push_off: Any, ground: Ground) -> Strike:
        half, given = len(before) // 2, mass_matrix(body, before)
        moving = _size_of(given) if links is None else links
        total: Any = mass(body) if callable(mass) else mass
        state, matrix = tied(before, moving), triangle(given, moving)
        rates = state[half : half + moving]
        # The old foot moves by as much as the new one would, with the opposite sign.
        feet = [rates_by(place, state[:moving]) for place in contact(body, state)]
        back, up = _moved_by(potential_gain, body, state, moving)
        moments = [[-value for value in back], up]

        def row(i: int, values: Sequence[Any]) -> Any:
            entries = (matrix[min(i, j), max(i, j)] * value for j, value in enumerate(values))
            return sum(entries, start=0.0)

        def by(ways: Sequence[Any], values: Sequence[Any]) -> Any:
            return sum((a * b for a, b in zip(ways, values, strict=True)), start=0.0)

        free = dict(matrix)
        for (i, j), value in matrix.items():
            for foot, moment in zip(feet, moments, strict=True):
                both = foot[i] * moment[j] + moment[i] * foot[j]
                value = value - both + total * (foot[i] * foot[j])
            free[i, j] = value
        momenta = [by(moment, rates) for moment in moments]
        right = [
            row(i, rates) - sum(foot[i] * along for foot, along in zip(feet, momenta, strict=True))
            for i in range(moving)
        ]
        after = solve_positive(free, right)
        jumps = [old - new for old, new in zip(rates, after, strict=True)]
        lost = 0.5 * by([row(i, jumps) for i in range(moving)], jumps)
        for foot, moment in zip(feet, moments, strict=True):
            jump = by(foot, after)
            lost = lost + jump * by(moment, jumps) + 0.5 * total * (jump * jump)
        return Strike(relabelled(relabel, body, state, after), lost)

    return Derived(strike)


def push_of(mass_matrix: Matrix, potential_gain: Any, links: int) -> Derived:
    """The jumps of the rates by an impulse at the centre of mass, per unit of mass."""

    def push(body: Any, state: Any, back: Any, up: Any) -> tuple:
        state, impulses = tied(state, links), [0.0] * links
        moments = _moved_by(potential_gain, body, state, links)
        for amount, ways in zip((back, up), moments, strict=True):
            impulses = [a + amount * b for a, b in zip(impulses, ways, strict=True)]
        return tuple(solve_positive(triangle(mass_matrix(body, state), links), impulses))

    return Derived(push)
