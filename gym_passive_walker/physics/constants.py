"""The dimensionless constants of a walker: what its equations need to know of it.

Everything in `physics` is dimensionless: the leg length l is the unit of length, the walker's
total mass the unit of mass, and the pendulum time sqrt(l/g) the unit of time. So a leg of a
millimetre and one of a kilometre run through the same numbers.

Vectors of a leg are given *along* it (from foot to hip) and *across* it (backwards). First
moments are mass times position: the stance leg's from its foot centre, with the rest of the walker
lumped at the hip; the swing leg's, thigh's from the hip and the shank's from the knee.
"""

from __future__ import annotations

from enum import IntEnum
from typing import Any

import numpy as np

from gym_passive_walker.walkers import Walker


class Kind(IntEnum):
    """Which equations a walker obeys."""

    KNEED = 0
    COMPASS = 1  # straight legs
    SIMPLEST = 2  # legs without mass


# What both kinds of legs with mass need.
FOOT_RADIUS = 0
LEG = 1  # foot centre to hip
STANCE_ALONG = 2  # first moment of the stance leg, the rest at its hip, from the foot centre
STANCE_ACROSS = 3
STANCE_INERTIA = 4  # ... and its second moment, plus that of the foot's rolling
SWING_ALONG = 5  # first moment of the straight swing leg from the hip
SWING_ACROSS = 6
SWING_INERTIA = 7
# The free knee.
THIGH_ALONG = 8  # first moment of the thigh with the shank's mass at the knee, from the hip
THIGH_ACROSS = 9
THIGH_INERTIA = 10
SHANK_ALONG = 11  # first moment of the shank from the knee
SHANK_ACROSS = 12
SHANK_INERTIA = 13
SHANK_MOBILITY = 14  # 1 / SHANK_INERTIA
KNEE_COSINE = 15  # inertia between thigh and shank: cosine and sine parts of their angle
KNEE_SINE = 16
# One leg by itself, for collisions.
LEG_MASS = 17
LEG_COM_ALONG = 18  # centre of mass from the foot centre
LEG_COM_ACROSS = 19
LEG_SPIN = 20  # moment of inertia about that centre of mass
KNEE_ALONG = 21  # knee from the hip, in the thigh
KNEE_ACROSS = 22
COUNT = 23


def kind_of(walker: Walker) -> Kind:
    """Which equations this walker obeys."""
    if walker.massless_legs:
        return Kind.SIMPLEST
    return Kind.KNEED if walker.knees else Kind.COMPASS


def constants_from(p: Any, *, knees: bool) -> np.ndarray:
    """Dimensionless constants from McGeer's parameters, real or complex.

    Args:
        p: Anything with the attributes of a `Walker`. Complex values carry derivatives through.
        knees: Whether the shank is free in swing.

    Returns:
        Array of shape (COUNT,); zeros where a kind has no such constant.
    """
    sin, cos = np.sin, np.cos
    length = p.thigh_length + p.shank_length
    leg_mass = p.thigh_mass + p.shank_mass
    mass = 2.0 * leg_mass + p.hip_mass
    reach = p.shank_length - p.foot_radius
    epsilon_thigh = p.foot_angle
    epsilon_shank = np.arcsin(p.thigh_length * sin(epsilon_thigh) / reach)
    leg = p.thigh_length * cos(epsilon_thigh) + reach * cos(epsilon_shank)

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
    swing_inertia = thigh_inertia + shank_inertia + 2.0 * knee_cosine
    c = np.zeros(
        COUNT, dtype=np.result_type(float, *(np.asarray(v) for v in (leg, mass, swing_inertia)))
    )
    m, ml, ml2 = mass, mass * length, mass * length**2
    c[FOOT_RADIUS] = p.foot_radius / length
    c[LEG] = leg / length
    if leg_mass == 0.0:  # the simplest walker needs no more
        return c
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
    c[STANCE_ALONG] = (leg_mass * com[0] + hip_load * leg) / ml
    c[STANCE_ACROSS] = leg_mass * com[1] / ml
    c[STANCE_INERTIA] = (
        leg_spin
        + leg_mass * (com[0] ** 2 + com[1] ** 2)
        + hip_load * leg**2
        + mass * p.foot_radius**2
    ) / ml2
    c[SWING_ALONG] = swing_moment[0] / ml
    c[SWING_ACROSS] = swing_moment[1] / ml
    c[SWING_INERTIA] = swing_inertia / ml2
    c[LEG_MASS] = leg_mass / m
    c[LEG_COM_ALONG] = com[0] / length
    c[LEG_COM_ACROSS] = com[1] / length
    c[LEG_SPIN] = leg_spin / ml2
    if knees:
        c[THIGH_ALONG] = thigh_moment[0] / ml
        c[THIGH_ACROSS] = thigh_moment[1] / ml
        c[THIGH_INERTIA] = thigh_inertia / ml2
        c[SHANK_ALONG] = shank_moment[0] / ml
        c[SHANK_ACROSS] = shank_moment[1] / ml
        c[SHANK_INERTIA] = shank_inertia / ml2
        c[SHANK_MOBILITY] = ml2 / shank_inertia
        c[KNEE_COSINE] = knee_cosine / ml2
        c[KNEE_SINE] = knee_sine / ml2
        c[KNEE_ALONG] = knee[0] / length
        c[KNEE_ACROSS] = knee[1] / length
    return c


def constants(walker: Walker) -> np.ndarray:
    """Dimensionless constants of a walker, shape (COUNT,)."""
    return constants_from(walker, knees=walker.knees)
