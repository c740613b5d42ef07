"""Dimensionless constants of a walker in its equations of motion.

First moments are mass times position, along a leg (from foot to hip) and across it (backwards).
Everything is dimensionless; see `hybrid`.
"""

from __future__ import annotations

from collections import namedtuple
from typing import Any, NamedTuple

import numpy as np

from gym_passive_walker.models.equations.hybrid import Number
from gym_passive_walker.models.equations.numbers import inverse_sine


class SimplestBody(NamedTuple):
    """Constants of legs without mass, which all walkers have.

    Torques are in units of m g l. For the simplest walker they are per unit of foot mass, in g l.

    Attributes:
        foot_radius: Radius of the foot.
        leg: Distance from foot centre to hip.
        hip_stiffness: Of the spring between the legs, torque per angle.
        hip_friction: Of the hip, torque per angular velocity, over sqrt(l/g).
    """

    foot_radius: Number
    leg: Number
    hip_stiffness: Number
    hip_friction: Number


class _Legs(NamedTuple):
    """Further constants of legs with mass; first moments are mass times position.

    Attributes:
        foot_diameter: Twice the foot's radius.
        stance_along: First moment of the stance leg about the foot centre, along the leg, with all
            other mass at the hip.
        stance_across: The same moment across the leg.
        stance_inertia: Second moment of the stance leg, plus that of the foot's rolling.
        swing_along: First moment of the straight swing leg about the hip, along the leg.
        swing_across: The same moment across the leg.
        swing_inertia: Second moment of the straight swing leg about the hip.
        swing_mobility: 1 / swing_inertia.
        leg_mass: Mass of one leg.
        leg_com_along: Centre of mass of a leg from the foot centre, along the leg.
        leg_com_across: The same across the leg.
        leg_spin: Moment of inertia of a leg about its centre of mass.
    """

    foot_diameter: Number
    stance_along: Number
    stance_across: Number
    stance_inertia: Number
    swing_along: Number
    swing_across: Number
    swing_inertia: Number
    swing_mobility: Number
    leg_mass: Number
    leg_com_along: Number
    leg_com_across: Number
    leg_spin: Number


class _Knee(NamedTuple):
    """Further constants of a leg with a free knee.

    Attributes:
        thigh_along: First moment about the hip of the thigh with the shank's mass at the knee.
        thigh_across: The same moment across the leg.
        thigh_inertia: Second moment of the same masses about the hip.
        shank_along: First moment of the shank about the knee.
        shank_across: The same moment across the leg.
        shank_inertia: Second moment of the shank about the knee.
        shank_mobility: 1 / shank_inertia.
        knee_cosine: Coupling inertia of thigh and shank: factor of the cosine of their angle.
        knee_sine: The same for the sine.
        knee_along: Position of the knee from the hip, along the leg.
        knee_across: The same across the leg.
        knee_stiffness: Of the spring that straightens the knee, over m g l.
    """

    thigh_along: Number
    thigh_across: Number
    thigh_inertia: Number
    shank_along: Number
    shank_across: Number
    shank_inertia: Number
    shank_mobility: Number
    knee_cosine: Number
    knee_sine: Number
    knee_along: Number
    knee_across: Number
    knee_stiffness: Number


StraightBody: Any = namedtuple("StraightBody", (*SimplestBody._fields, *_Legs._fields))
"""A walker with straight legs: what every walker has, and masses of its legs."""

KneedBody: Any = namedtuple("KneedBody", (*StraightBody._fields, *_Knee._fields))
"""A walker with knees: what `StraightBody` has, and the free knee."""


def body_from(p: Any, Body: type) -> Any:
    """Constants of a walker from McGeer's parameters.

    Args:
        p: An object with the attributes of a `Walker`: real or complex numbers, or arrays.
        Body: Class of the constants: `SimplestBody`, `StraightBody` or `KneedBody`.

    Returns:
        An object of that class.
    """
    sin, cos = np.sin, np.cos
    length = p.thigh_length + p.shank_length
    leg_mass = p.thigh_mass + p.shank_mass
    mass = 2.0 * leg_mass + p.hip_mass
    reach = p.shank_length - p.foot_radius
    epsilon_thigh = p.foot_angle
    epsilon_shank = inverse_sine(p.thigh_length * sin(epsilon_thigh) / reach)
    leg = p.thigh_length * cos(epsilon_thigh) + reach * cos(epsilon_shank)
    m, ml, ml2 = mass, mass * length, mass * length**2
    torque = p.gravity * (length if Body is SimplestBody else ml)
    values = {
        "foot_radius": p.foot_radius / length,
        "leg": leg / length,
        "hip_stiffness": p.hip_stiffness / torque,
        "hip_friction": p.hip_friction / (torque * (length / p.gravity) ** 0.5),
    }
    if Body is SimplestBody:
        return Body(**values)

    # Positions along and across the leg: of the thigh's centre of mass and the knee from the hip,
    # of the shank's centre of mass from the knee.
    thigh = (
        -p.thigh_com * cos(epsilon_thigh) + p.thigh_offset * sin(epsilon_thigh),
        p.thigh_com * sin(epsilon_thigh) + p.thigh_offset * cos(epsilon_thigh),
    )
    knee = (-p.thigh_length * cos(epsilon_thigh), p.thigh_length * sin(epsilon_thigh))
    shank = (
        -p.shank_com * cos(epsilon_shank) - p.shank_offset * sin(epsilon_shank),
        -p.shank_com * sin(epsilon_shank) + p.shank_offset * cos(epsilon_shank),
    )
    thigh_spin = p.thigh_mass * p.thigh_gyration**2
    shank_spin = p.shank_mass * p.shank_gyration**2

    thigh_moment = [p.thigh_mass * thigh[i] + p.shank_mass * knee[i] for i in (0, 1)]
    shank_moment = [p.shank_mass * shank[i] for i in (0, 1)]
    thigh_inertia = (
        thigh_spin
        + p.thigh_mass * (thigh[0] ** 2 + thigh[1] ** 2)
        + p.shank_mass * p.thigh_length**2
    )
    shank_inertia = shank_spin + p.shank_mass * (shank[0] ** 2 + shank[1] ** 2)
    knee_cosine = knee[0] * shank_moment[0] + knee[1] * shank_moment[1]
    knee_sine = knee[1] * shank_moment[0] - knee[0] * shank_moment[1]

    swing_moment = [thigh_moment[i] + shank_moment[i] for i in (0, 1)]
    com = [swing_moment[0] / leg_mass + leg, swing_moment[1] / leg_mass]
    hip_load = mass - leg_mass
    # About the leg's own centre of mass, summed from the parts: no difference of large numbers.
    from_com_thigh = (thigh[0] + leg - com[0], thigh[1] - com[1])
    from_com_shank = (knee[0] + shank[0] + leg - com[0], knee[1] + shank[1] - com[1])
    leg_spin = (
        thigh_spin
        + shank_spin
        + p.thigh_mass * (from_com_thigh[0] ** 2 + from_com_thigh[1] ** 2)
        + p.shank_mass * (from_com_shank[0] ** 2 + from_com_shank[1] ** 2)
    )
    swing_inertia = thigh_inertia + shank_inertia + 2.0 * knee_cosine
    values |= {
        "foot_diameter": 2.0 * p.foot_radius / length,
        "stance_along": (leg_mass * com[0] + hip_load * leg) / ml,
        "stance_across": leg_mass * com[1] / ml,
        "stance_inertia": (
            leg_spin
            + leg_mass * (com[0] ** 2 + com[1] ** 2)
            + hip_load * leg**2
            + mass * p.foot_radius**2
        )
        / ml2,
        "swing_along": swing_moment[0] / ml,
        "swing_across": swing_moment[1] / ml,
        "swing_inertia": swing_inertia / ml2,
        "swing_mobility": ml2 / swing_inertia,
        "leg_mass": leg_mass / m,
        "leg_com_along": com[0] / length,
        "leg_com_across": com[1] / length,
        "leg_spin": leg_spin / ml2,
    }
    if Body is KneedBody:
        values |= {
            "thigh_along": thigh_moment[0] / ml,
            "thigh_across": thigh_moment[1] / ml,
            "thigh_inertia": thigh_inertia / ml2,
            "shank_along": shank_moment[0] / ml,
            "shank_across": shank_moment[1] / ml,
            "shank_inertia": shank_inertia / ml2,
            "shank_mobility": ml2 / shank_inertia,
            "knee_cosine": knee_cosine / ml2,
            "knee_sine": knee_sine / ml2,
            "knee_along": knee[0] / length,
            "knee_across": knee[1] / length,
            "knee_stiffness": p.knee_stiffness / torque,
        }
    return Body(**values)
