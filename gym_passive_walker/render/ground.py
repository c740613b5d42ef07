"""Uneven ground as pictures show it: footholds that were passed, and those ahead."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from gym_passive_walker.gaits.terrain import Terrain, contacts
from gym_passive_walker.gaits.trajectory import Trajectory
from gym_passive_walker.physics.hybrid import Outcome
from gym_passive_walker.render.pose import SOLE_SPAN, pose
from gym_passive_walker.walkers import Walker

_EDGE = 0.05  # leg lengths from where a sole ends to where its foothold does
_SHORTEST = 0.05  # leg lengths: the least guess of a step whose length is not known


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

    Where the walker has not been yet, or is no longer remembered, steps are taken for equally long.

    Args:
        walker: Who walks, in whose units lengths are.
        terrain: How footholds lie.
        key: Of the walk.
        first: Number of the first foothold whose place is known.
        known: Where strides began to touch it and those that follow, (n, 2).
        reach: Between which x along the slope the ground is shown.
        length: Of steps that are not known; those that are tell their own, if there are any.

    Returns:
        Points (x, y) along the slope that is walked and off it, (m, 2), x rising.
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
    # A foothold ends beyond where its foot can roll, and lets a shorter step than usual reach the
    # next one; a foot that rolls on for most of a step leaves half of the rest to the other.
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
    """The surface under a walk, and some way before it and beyond; None where it is smooth.

    Args:
        walk: The walk.
        margin: How far, in the walker's units.
    """
    if walk.terrain is None:
        return None
    begun = np.flatnonzero(np.diff(walk.strides, prepend=-1))
    known = np.column_stack([walk.contact_x, walk.contact_y])[begun]
    if walk.outcomes[-1] == Outcome.HEELSTRIKE:  # the last foothold has been touched as well
        landed = pose(
            walk.walker, walk.states[-1], walk.contact_x[-1], walk.contact_y[-1], walk.tilts[-1]
        ).swing.foot
        tilt = float(walk.terrain.ground(walk.terrain_seed, len(begun))[0])
        normal = np.array([math.sin(tilt), math.cos(tilt)])
        known = np.vstack([known, landed - walk.walker.foot_radius * normal])
    reach = known[0, 0] - margin, known[-1, 0] + margin
    length = 2.0 * walk.walker.leg_length * abs(float(walk.states[0, 0]))
    return profile(walk.walker, walk.terrain, walk.terrain_seed, 0, known, reach, length)


def height(surface: NDArray[np.float64], x: NDArray[np.float64] | float) -> NDArray[np.float64]:
    """How high a surface is at some places."""
    return np.asarray(np.interp(x, surface[:, 0], surface[:, 1]))


def between(surface: NDArray[np.float64], low: float, high: float) -> NDArray[np.float64]:
    """The part of a surface from one x to another, (k, 2); level beyond both its ends."""
    inner = surface[(surface[:, 0] > low) & (surface[:, 0] < high)]
    first, last = ([[x, float(height(surface, x))]] for x in (low, high))
    return np.concatenate([first, inner, last])


def _steps(distance: float, length: float) -> int:
    """Footholds in a distance, one more than may be seen."""
    return max(0, math.ceil(distance / length)) + 1
