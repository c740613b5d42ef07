"""Equations and impacts from a mass matrix, for systems that are stated phase by phase.

A mass matrix is a function of body and state that returns its upper triangle, row by row, for the
coordinates that move by themselves in any phase. In a phase with fewer `links` than coordinates,
the last coordinates move with the last of the links.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

from gym_passive_walker.modeling.mechanics import Derived, rates_by, solve
from gym_passive_walker.physics.hybrid import Ground, Strike

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


def size_of(values: Sequence[Any]) -> int:
    """The rows of the matrix that has these numbers in its upper triangle."""
    return math.isqrt(2 * len(values))


def triangle(values: Sequence[Any], links: int | None = None) -> dict[tuple[int, int], Any]:
    """The upper triangle of a mass matrix by row and column, with the last coordinates tied."""
    size, entries, found = size_of(values), iter(values), {}
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
        return tuple(solve(triangle(matrix, moving), gathered(given, moving)))

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
        matrix, links = triangle(given), size_of(given)
        ways = rates_by(gap(body, before), before[:links])
        jumps = solve(matrix, ways)
        closing: Any = 0.0
        yields: Any = 0.0
        for way, rate, jump in zip(ways, before[half : half + links], jumps, strict=True):
            closing, yields = closing + way * rate, yields + way * jump
        impulse = closing / yields
        rates = [a - impulse * b for a, b in zip(before[half:], jumps, strict=False)]
        after = [*before[:half], *rates, *rates[-1:] * (half - links)]
        return Strike(before._make(after), 0.5 * closing * impulse)

    return Derived(strike)


def push_of(mass_matrix: Matrix, potential_gain: Any, links: int) -> Derived:
    """The jumps of the rates by an impulse at the centre of mass, per unit of mass.

    Gravity acts at the centre of mass: its potential says how a coordinate moves it.
    """

    def push(body: Any, state: Any, back: Any, up: Any) -> tuple:
        state = tied(state, links)
        still = state._make([0.0] * len(state))
        impulses: list[Any] = [0.0] * links
        for amount, ground in ((back, Ground(1.0, 0.0)), (up, Ground(0.0, 1.0))):
            ways = rates_by(potential_gain(body, still, state, ground), state[:links])
            impulses = [a + amount * b for a, b in zip(impulses, ways, strict=True)]
        return tuple(solve(triangle(mass_matrix(body, state), links), impulses))

    return Derived(push)
