"""Positions of the parts of a walker: the geometry of Fig. 4.1.

Points are (x, y): x along the slope, positive downhill; y away from the ground. Lengths are in the
walker's own units, and all functions accept arrays of states.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker._tools.arguments import check_state
from gym_passive_walker.models.equations.legs import turned
from gym_passive_walker.models.equations.numbers import sine_cosine
from gym_passive_walker.models.model import check_supports
from gym_passive_walker.models.walkers import Walker, WalkerLike, as_walker

SOLE_SPAN = 0.5
"""Half the angle in rad that a foot's arc spans; gaits roll over about half of the arc."""

SOLE_POINTS = 21
"""Points along a foot's arc; the middle one lies on the line from the hip through its centre."""


class Leg(NamedTuple):
    """A leg below the hip; each point has shape (..., 2).

    Attributes:
        knee: The knee.
        foot: Centre of the foot's arc.
        tip: Where the shank's line meets the sole: a shank's length from the knee.
        sole: Points along the foot's arc from heel to toe, shape (..., SOLE_POINTS, 2).
    """

    knee: NDArray[np.float64]
    foot: NDArray[np.float64]
    tip: NDArray[np.float64]
    sole: NDArray[np.float64]


class Pose(NamedTuple):
    """Positions of the parts of a walker.

    Attributes:
        contact: Contact point of the stance foot, shape (..., 2).
        hip: The hip, shape (..., 2).
        stance: The stance leg.
        swing: The swing leg.
    """

    contact: NDArray[np.float64]
    hip: NDArray[np.float64]
    stance: Leg
    swing: Leg


def _turned(along: float | NDArray, across: float | NDArray, angle: NDArray) -> NDArray:
    """A vector (x, y) fixed to a leg: `along` from foot to hip, `across` backwards."""
    back, up = turned(along, across, *sine_cosine(angle))
    return np.stack([-back, up], axis=-1)


def joints(
    walker: Walker, hip: NDArray, thigh: NDArray, shank: NDArray
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Knee, foot and tip of a leg below a hip, as in `Leg`, from its angles in rad."""
    radius, bend = walker.foot_radius, walker.shank_angle
    reach = walker.shank_length - radius
    knee = hip + _turned(
        -walker.thigh_length * math.cos(walker.foot_angle),
        walker.thigh_length * math.sin(walker.foot_angle),
        thigh,
    )
    down = _turned(-math.cos(bend), -math.sin(bend), shank)
    foot = knee + down * reach
    return knee, foot, foot + down * radius


def hip_over(walker: Walker, contact: NDArray, stance: NDArray, tilt: NDArray) -> NDArray:
    """Position of the hip, from the contact point and the stance angle to the slope's normal."""
    sine, cosine = sine_cosine(tilt)
    foot = contact + np.stack([sine, cosine], axis=-1) * walker.foot_radius
    return foot + _turned(leg_line(walker), 0.0, stance)


def _leg(walker: Walker, hip: NDArray, thigh: NDArray, shank: NDArray) -> Leg:
    """Positions of a leg below a hip, from its angles in rad."""
    radius, (knee, foot, tip) = walker.foot_radius, joints(walker, hip, thigh, shank)
    spread = np.linspace(-SOLE_SPAN, SOLE_SPAN, SOLE_POINTS)
    arc = _turned(-radius * np.cos(spread), -radius * np.sin(spread), shank[..., None])
    return Leg(knee, foot, tip, foot[..., None, :] + arc)


def pose(
    walker: WalkerLike,
    state: ArrayLike,
    contact_x: ArrayLike = 0.0,
    contact_y: ArrayLike = 0.0,
    tilt: ArrayLike = 0.0,
) -> Pose:
    """Positions of the parts of a walker.

    Args:
        walker: The walker, in a form that `as_walker` takes.
        state: [stance, thigh, shank] angles in rad, then their angular velocities (ignored), shape
            (6,) or (..., 6). A straight-legged walker's shank is ignored.
        contact_x: Contact point of the stance foot along the slope, in the walker's units of
            length; a number or shape (...).
        contact_y: Height of the contact point over the slope, in the walker's units of length; a
            number or shape (...).
        tilt: Slope of the ground at the contact beyond the slope that is walked, in rad; a number
            or shape (...). Angles in `state` are measured from the normal of that ground.

    Returns:
        The `Pose`.

    Raises:
        ValueError: if the state has another shape or is not finite.
    """
    walker = check_supports(as_walker(walker), "legs")
    state = check_state(state)
    shape = state.shape[:-1]
    x, y, tilt = (
        np.broadcast_to(np.asarray(part, dtype=float), shape)
        for part in (contact_x, contact_y, tilt)
    )
    stance, thigh = state[..., 0] - tilt, state[..., 1] - tilt
    shank = state[..., 2] - tilt if walker.knees else thigh
    contact = np.stack([x, y], axis=-1)
    hip = hip_over(walker, contact, stance, tilt)
    return Pose(
        contact=contact,
        hip=hip,
        stance=_leg(walker, hip, stance, stance),
        swing=_leg(walker, hip, thigh, shank),
    )


def leg_line(walker: Walker) -> float:
    """Distance from the foot's centre to the hip of a straight leg, in the walker's units."""
    return float(walker.body.leg * walker.leg_length)


def level(points: ArrayLike, slope: float) -> NDArray[np.float64]:
    """Rotate points so that gravity points down: (right, up), shape (..., 2).

    Args:
        points: (x, y) along and off the slope, shape (..., 2).
        slope: Slope in rad; it descends to the right.
    """
    points = np.asarray(points, dtype=float)
    sine, cosine = math.sin(slope), math.cos(slope)
    return points @ np.array([[cosine, -sine], [sine, cosine]])


def legs_by_identity(pose: Pose, strides: int) -> tuple[Leg, Leg]:
    """The two legs in an order that heelstrikes do not change: first the stance leg of stride 0."""
    return (pose.swing, pose.stance) if strides % 2 else (pose.stance, pose.swing)
