"""The surface of uneven ground in pictures: footholds that were passed, and those ahead."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from gym_passive_walker.gaits.look.trajectory import Trajectory
from gym_passive_walker.gaits.terrain import Terrain, contacts
from gym_passive_walker.models.equations.hybrid import Outcome
from gym_passive_walker.models.walkers import Walker
from gym_passive_walker.pictures.pose import SOLE_SPAN

_EDGE = 0.05  # leg lengths from the end of a sole to the end of its foothold
_SHORTEST = 0.05  # leg lengths: the smallest guess of an unknown step length


def profile(
    walker: Walker,
    terrain: Terrain,
    key: int,
    first: int,
    known: NDArray[np.float64],
    reach: tuple[float, float],
    length: float,
) -> NDArray[np.float64]:
    """The surface of the ground: a patch for each foothold along its own slope, steps between.

    Footholds ahead, and those too long ago to be recorded, are placed at equal step lengths. All
    lengths are in the walker's units.

    Args:
        walker: The walker.
        terrain: Terrain of the footholds.
        key: Key of the walk's random numbers.
        first: Index of the first foothold of `known`.
        known: Contact points (x, y) at the beginning of consecutive strides, shape (n, 2).
        reach: Smallest and largest x along the slope to show.
        length: Length of unknown steps; ignored if `known` has several rows, which give their mean.

    Returns:
        Points (x, y) along and off the slope, shape (m, 2), with x increasing.
    """
    if len(known) > 1:
        length = float(np.diff(known[:, 0]).mean())
    length = max(length, _SHORTEST * walker.leg_length)
    behind = min(first, _steps(known[0, 0] - reach[0], length))
    ahead = _steps(reach[1] - known[-1, 0], length)
    places = np.arange(first - behind, first + len(known) + ahead)
    ground = terrain.ground(key, places)
    guessed = contacts(walker, ground, np.full(len(places), length))
    touched, last = known @ [1.0, 1j], behind + len(known) - 1
    laid = np.concatenate(
        [
            guessed[:behind] - guessed[behind] + touched[0],
            touched,
            guessed[last + 1 :] - guessed[last] + touched[-1],
        ]
    )
    # A foothold ends beyond the point to which its foot can roll, so that a shorter step than usual
    # still reaches the next one. A large foot rolls for most of a step: then the rest is halved.
    share = walker.foot_radius / walker.leg_length
    steps = np.diff(laid.real)
    rolls = walker.foot_radius * (SOLE_SPAN + 0.5 * steps / walker.leg_length)
    ends = np.minimum(rolls + _EDGE * walker.leg_length, 0.5 * (1.0 + share) * steps)
    edges = laid.real[:-1] + ends
    low, high = min(reach[0], laid[0].real), max(reach[1], laid[-1].real)
    x = np.concatenate([[low], np.repeat(edges, 2), [high]])
    here, steep = (np.repeat(values, 2) for values in (laid, np.tan(ground[:, 0])))
    return np.column_stack([x, here.imag - steep * (x - here.real)])


def ground_under(walk: Trajectory, margin: float) -> NDArray[np.float64] | None:
    """The surface under a walk as points (x, y), shape (m, 2); None on smooth ground.

    Args:
        walk: The walk.
        margin: Distance shown before the walk and beyond it, in the walker's units of length.
    """
    if walk.terrain is None:
        return None
    landed = walk.outcomes[-1] == Outcome.HEELSTRIKE  # then the last foothold is touched as well
    lengths = np.append(walk.taken.step_length, 0.0)[: len(walk.outcomes) + landed]
    ground = walk.terrain.ground(walk.terrain_seed, np.arange(len(lengths)))
    places = contacts(walk.walker, ground, lengths) + complex(walk.contact_x[0], walk.contact_y[0])
    known = np.column_stack([places.real, places.imag])
    reach = known[0, 0] - margin, known[-1, 0] + margin
    length = 2.0 * walk.walker.leg_length * abs(float(walk.states[0, 0]))
    return profile(walk.walker, walk.terrain, walk.terrain_seed, 0, known, reach, length)


def height(surface: NDArray[np.float64], x: NDArray[np.float64] | float) -> NDArray[np.float64]:
    """Height of a surface, points of shape (m, 2), at some x; of the shape of `x`."""
    return np.asarray(np.interp(x, surface[:, 0], surface[:, 1]))


def part_between(surface: NDArray[np.float64], low: float, high: float) -> NDArray[np.float64]:
    """The part of a surface between two x, shape (k, 2); the surface is level beyond its ends."""
    inner = surface[(surface[:, 0] > low) & (surface[:, 0] < high)]
    first, last = ([[x, float(height(surface, x))]] for x in (low, high))
    return np.concatenate([first, inner, last])


def _steps(distance: float, length: float) -> int:
    """Number of footholds in a distance, and one more for safety."""
    return max(0, math.ceil(distance / length)) + 1
