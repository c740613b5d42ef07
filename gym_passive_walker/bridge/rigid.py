"""A walker as a tree of rigid bodies in SI units, which files of other simulators describe.

The plane has x in the walking direction and z up. A body's frame stands upright where its angle is
zero; its origin is the joint to its parent. Angles are positive where the upper end leans back.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gym_passive_walker.models.equations.bodies import KneedBody, StraightBody, body_from
from gym_passive_walker.models.walkers import Walker, describe

Place = tuple[float, float]
TreePose = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Coordinates of a tree and their velocities, in the order of `Tree.joints`."""


class Foot(NamedTuple):
    """A circular foot.

    Attributes:
        centre: Position (x, z) of the circle's centre in the frame of its body, in m.
        radius: Radius in m; 0 is a point.
    """

    centre: Place
    radius: float


class Body(NamedTuple):
    """A rigid body of a tree.

    Attributes:
        name: Its name.
        parent: Name of the body on which it hangs; None of the first one.
        joint: Name of the hinge to its parent.
        place: Position (x, z) of the hinge in the parent's frame, in m.
        mass: Mass in kg.
        com: Position (x, z) of the centre of mass in its own frame, in m.
        inertia: Moment of inertia in kg m^2 about the centre of mass, in the plane.
        stop: Whether the hinge turns to negative angles alone, as a knee does.
        feet: Its feet.
        end: Position (x, z) of its far end, for pictures, in m.
    """

    name: str
    parent: str | None
    joint: str
    place: Place
    mass: float
    com: Place
    inertia: float
    stop: bool = False
    feet: tuple[Foot, ...] = ()
    end: Place = (0.0, 0.0)


class Motor(NamedTuple):
    """An actuator.

    Attributes:
        name: Its name.
        joint: Name of the hinge on which its torque acts.
        gear: Torque on the hinge per unit of its control, in N m.
    """

    name: str
    joint: str
    gear: float = 1.0


class Tree(NamedTuple):
    """A walker as a tree of bodies; the first one moves freely in the plane.

    Attributes:
        name: Name of the walker.
        bodies: The bodies, parents first.
        gravity: Acceleration of gravity in m/s^2.
        knees: Whether it has knees.
        motors: Its actuators.
        stiffness: Of a torsional spring at each joint, by its name, in N m/rad.
        friction: Viscous friction of each joint, by its name, in N m s/rad.
    """

    name: str
    bodies: tuple[Body, ...]
    gravity: float
    knees: bool
    motors: tuple[Motor, ...] = ()
    stiffness: dict[str, float] = {}  # noqa: RUF012
    friction: dict[str, float] = {}  # noqa: RUF012

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the coordinates: x and z of the first body, and the angles of all hinges."""
        return ("x", "z", *(body.joint for body in self.bodies))

    @property
    def feet(self) -> list[str]:
        """Names of all feet."""
        return [name for body in self.bodies for name, _ in foot_names(body)]


def foot_names(body: Body) -> list[tuple[str, Foot]]:
    """The feet of a body, with their names."""
    if len(body.feet) == 1:
        return [(f"{body.name}_foot", body.feet[0])]
    return [(f"{body.name}_foot_{i}", foot) for i, foot in enumerate(body.feet, 1)]


SIDES = "left", "right"
"""The legs; the left one is the stance leg at first."""


def tree_of_walker(walker: Walker, name: str = "") -> Tree:
    """Return a walker as a tree: two thighs and two shanks, or two straight legs.

    Raises:
        ValueError: if its legs have no mass, or a body has no moment of inertia.
    """
    if walker.massless_legs:
        raise ValueError(
            f"{describe(walker)} has legs without mass, which no rigid-body simulator can move: "
            "give them a little mass, as walker F has, or stay with this package"
        )
    legs = _thigh_and_shank if walker.knees else _straight_leg
    bodies = tuple(body for side in SIDES for body in legs(walker, side))
    for body in bodies:
        if not (body.mass > 0.0 and body.inertia > 0.0):
            raise ValueError(
                f"{body.name} of {describe(walker)} has no moment of inertia about its centre of "
                "mass, which rigid-body simulators need: give it a mass and a radius of gyration"
            )
    hip, knees = "right_hip", [f"{side}_knee" for side in SIDES]
    stiffness = {hip: walker.hip_stiffness, **dict.fromkeys(knees, walker.knee_stiffness)}
    joints = {body.joint for body in bodies}
    return Tree(
        name=name or "walker",
        bodies=bodies,
        gravity=walker.gravity,
        knees=bool(walker.knees),
        motors=(Motor("hip", hip),),
        stiffness={joint: k for joint, k in stiffness.items() if k and joint in joints},
        friction={hip: walker.hip_friction} if walker.hip_friction else {},
    )


def _at_hip(
    walker: Walker, side: str, link: str, mass: float, com: Place, inertia: float, **more: Any
) -> Body:
    """A link that hangs at the hip: the right one from the left one, which has the hip's mass."""
    first = side == SIDES[0]
    if first and (point := walker.hip_mass):
        total = mass + point
        inertia += mass * point / total * (com[0] ** 2 + com[1] ** 2)
        mass, com = total, (com[0] * mass / total, com[1] * mass / total)
    return Body(
        name=f"{side}_{link}",
        parent=None if first else f"{SIDES[0]}_{link}",
        joint="pitch" if first else f"{side}_hip",
        place=(0.0, 0.0),
        mass=mass,
        com=com,
        inertia=inertia,
        **more,
    )


def _straight_leg(walker: Walker, side: str) -> list[Body]:
    body, length = body_from(walker, StraightBody), walker.leg_length
    mass = walker.thigh_mass + walker.shank_mass
    com = -body.leg_com_across * length, (body.leg_com_along - body.leg) * length
    spin = body.leg_spin * walker.total_mass * length**2
    centre = 0.0, -body.leg * length
    feet = (Foot(centre, walker.foot_radius),)
    return [_at_hip(walker, side, "leg", mass, com, spin, feet=feet, end=centre)]


def _thigh_and_shank(walker: Walker, side: str) -> list[Body]:
    body, length = body_from(walker, KneedBody), walker.leg_length
    moment = walker.total_mass * length
    knee = -body.knee_across * length, body.knee_along * length
    thigh_mass, shank_mass = walker.thigh_mass, walker.shank_mass
    # The thigh's first moment has the shank's mass at the knee.
    sums = -body.thigh_across * moment, body.thigh_along * moment
    thigh = (0.0, 0.0)
    if thigh_mass:
        thigh = tuple((sums[i] - shank_mass * knee[i]) / thigh_mass for i in (0, 1))
    shank = -body.shank_across * moment / shank_mass, body.shank_along * moment / shank_mass
    centre = -knee[0], -body.leg * length - knee[1]
    spin = thigh_mass * walker.thigh_gyration**2
    return [
        _at_hip(walker, side, "thigh", thigh_mass, thigh, spin, end=knee),
        Body(
            name=f"{side}_shank",
            parent=f"{side}_thigh",
            joint=f"{side}_knee",
            place=knee,
            mass=shank_mass,
            com=shank,
            inertia=shank_mass * walker.shank_gyration**2,
            stop=True,
            feet=(Foot(centre, walker.foot_radius),),
            end=centre,
        ),
    ]


def coordinates(
    walker: Walker, slope: float, state: Sequence[float], *, stance: int = 0, place: float = 0.0
) -> TreePose:
    """Return coordinates and velocities of a tree with its stance foot on the ground.

    Args:
        walker: The walker.
        slope: Slope in rad, positive downhill.
        state: [stance, thigh, shank] angles in rad from the ground's normal, then their angular
            velocities in rad/s, (6,).
        stance: Number of the stance leg: 0 left, 1 right.
        place: Contact point along the ground, in m.

    Returns:
        Positions and velocities, in the order of `Tree.joints`.
    """
    angles, rates = np.array(state[:3], float), np.array(state[3:], float)
    if not walker.knees:
        angles[2], rates[2] = angles[1], rates[1]
    leg = body_from(walker, StraightBody).leg * walker.leg_length
    radius, theta, rate = walker.foot_radius, angles[0], rates[0]
    along = place - leg * math.sin(theta)
    up = radius + leg * math.cos(theta)
    along_rate = -(radius + leg * math.cos(theta)) * rate
    up_rate = -leg * math.sin(theta) * rate
    turn = np.array([[math.cos(slope), math.sin(slope)], [-math.sin(slope), math.cos(slope)]])

    def joined(angle: NDArray, offset: float) -> NDArray:
        """Angles of the legs as those of hinges: pitch, knee, hip, knee."""
        stance_leg, swing = (angle[0], 0.0), (angle[1], angle[2] - angle[1])
        left, right = (swing, stance_leg) if stance else (stance_leg, swing)
        hinges = [left[0] - offset, left[1], right[0] - left[0], right[1]]
        return np.array(hinges if walker.knees else hinges[::2])

    positions = np.concatenate([turn @ [along, up], joined(angles, slope)])
    velocities = np.concatenate([turn @ [along_rate, up_rate], joined(rates, 0.0)])
    return positions, velocities
