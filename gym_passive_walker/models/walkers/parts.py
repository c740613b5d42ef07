"""Walkers from the measured parts of their legs (appendix 4.10.1)."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Literal, NamedTuple

from gym_passive_walker._tools.arguments import number, one_slope
from gym_passive_walker.models.walkers.walker import Walker, WalkerError


class Part(NamedTuple):
    """A rigid piece of a leg segment, in any consistent set of units.

    Attributes:
        mass: Mass.
        com: Distance of the centre of mass from the upper joint, down the segment.
        offset: Distance of the centre of mass from the segment's line. It is positive backwards
            (uphill) in a thigh and positive forwards (downhill) in a shank; see `assemble`.
        inertia: Moment of inertia about the centre of mass.
    """

    mass: float
    com: float
    offset: float = 0.0
    inertia: float = 0.0


def combine(parts: Iterable[Part]) -> Part:
    """The rigid body made of several parts (parallel-axis theorem).

    Raises:
        WalkerError: if a part is invalid, or the parts have no mass.
    """
    try:
        parts = [Part(*(number(value, "each entry") for value in part)) for part in parts]
    except (TypeError, ValueError) as error:
        raise WalkerError(
            f"a segment is a list of Part(mass, com, offset, inertia), all numbers: {error}"
        ) from None
    if any(part.mass < 0.0 or part.inertia < 0.0 for part in parts):
        raise WalkerError("mass and inertia of a part must not be negative")
    mass = sum(part.mass for part in parts)
    if mass <= 0.0:
        raise WalkerError("the parts of a segment need some mass")
    com = sum(part.mass * part.com for part in parts) / mass
    offset = sum(part.mass * part.offset for part in parts) / mass
    inertia = sum(
        part.inertia + part.mass * ((part.com - com) ** 2 + (part.offset - offset) ** 2)
        for part in parts
    )
    return Part(mass, com, offset, inertia)


def assemble(
    thigh: Iterable[Part],
    shank: Iterable[Part],
    *,
    thigh_length: float,
    shank_length: float,
    foot_radius: float,
    knee_angle: float,
    hip_mass: float = 0.0,
    knees: bool | Literal["held"] = True,
    gravity: float = 9.81,
) -> Walker:
    """Build a walker from the measured pieces of its legs (appendix 4.10.1).

    Args:
        thigh: Parts of one thigh, measured from the hip along the thigh: `com` down it, `offset`
            **backwards** across it, as `Walker.thigh_offset`.
        shank: Parts of one shank, measured from the knee along the *straight* leg, that is along
            the thigh's direction: `com` down it, `offset` **forwards** across it, as on a
            workbench. `Walker.shank_offset` is positive backwards.
        thigh_length: l_t, hip to knee.
        shank_length: l_s, knee to the bottom of the foot through the foot's centre.
        foot_radius: R, of the circular foot.
        knee_angle: Angle in rad between the thigh's line and the line knee-foot centre, straight.
        hip_mass: Point mass at the hip, for both legs together.
        knees: Whether the knees bend; "held" as in `Walker`.
        gravity: g.

    Returns:
        The walker; lengths, masses and `gravity` have the units of the arguments.

    Raises:
        WalkerError: if the parts have no mass, or the walker is impossible.
        ValueError: if a length or an angle is not a finite number.
    """
    thigh_length = number(thigh_length, "thigh_length")
    shank_length = number(shank_length, "shank_length")
    foot_radius = number(foot_radius, "foot_radius")
    knee_angle = one_slope(knee_angle, "knee_angle")
    upper, lower = combine(thigh), combine(shank)
    reach = shank_length - foot_radius
    sine, cosine = math.sin(knee_angle), math.cos(knee_angle)
    return Walker(
        thigh_length=thigh_length,
        thigh_offset=upper.offset,
        thigh_mass=upper.mass,
        thigh_gyration=math.sqrt(upper.inertia / upper.mass),
        thigh_com=upper.com,
        shank_length=shank_length,
        shank_offset=lower.com * sine - lower.offset * cosine,
        shank_mass=lower.mass,
        shank_gyration=math.sqrt(lower.inertia / lower.mass),
        shank_com=lower.com * cosine + lower.offset * sine,
        foot_radius=foot_radius,
        foot_angle=math.atan2(reach * sine, reach * cosine + thigh_length),
        hip_mass=hip_mass,
        knees=knees,
        gravity=gravity,
    )


def lab_walker_from_parts() -> Walker:
    """The laboratory's kneed walker from its weighed parts, to full digits (appendix 4.10.1)."""
    return assemble(
        thigh=[
            Part(mass=0.9868 + 0.8, com=0.116, inertia=0.0181),
            Part(mass=0.1718, com=0.029845),
        ],
        shank=[Part(mass=1.013, com=0.171, offset=0.014, inertia=0.03923)],
        thigh_length=0.35,
        shank_length=0.46,
        foot_radius=0.2,
        knee_angle=0.228,
        hip_mass=0.773,
    )
