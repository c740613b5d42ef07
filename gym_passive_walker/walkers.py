"""What a walker is: McGeer's parameters, the walkers of the source document, and their tuning.

Lengths, masses and gravity are in any consistent set of units. A leg is a thigh and a shank with
a circular foot; both legs are alike. Figure 4.1 of Garcia, Chatterjee and Ruina names the
parameters; here they are in words. Offsets across a leg (`thigh_offset`, `shank_offset`) are
positive backwards, uphill of the line that they are measured from.

References:
    M. Garcia, A. Chatterjee, A. Ruina, "Efficiency, speed, and scaling of two-dimensional
    passive-dynamic walking", Dynamics and Stability of Systems 15 (2000) 75-99.
    T. McGeer, "Passive walking with knees", IEEE ICRA (1990) 1640-1645.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, fields, replace
from typing import NamedTuple


class WalkerError(ValueError):
    """The parameters describe no walker; the message says which, and what is allowed."""


@dataclass(frozen=True, kw_only=True)
class Walker:
    """A planar walker with two equal legs; masses are per leg.

    A walker whose legs have no mass (``thigh_mass = shank_mass = 0`` and ``hip_mass > 0``) is the
    simplest walker: the limit of a vanishing point mass at each foot.

    Attributes:
        thigh_length: l_t, hip to knee.
        thigh_offset: w_t, centre of mass of the thigh, backwards from the hip-knee line.
        thigh_mass: m_t.
        thigh_gyration: r_t, radius of gyration of the thigh about its centre of mass.
        thigh_com: c_t, centre of mass of the thigh, down from the hip.
        shank_length: l_s, knee to the bottom of the foot, through the foot's centre.
        shank_offset: w_s, centre of mass of the shank, backwards from the line knee-foot centre.
        shank_mass: m_s.
        shank_gyration: r_s, radius of gyration of the shank about its centre of mass.
        shank_com: c_s, centre of mass of the shank, down from the knee.
        foot_radius: R, from 0 (a point foot) to below the shank's length.
        foot_angle: epsilon_T in rad, from the thigh forward to the line hip-foot centre.
        hip_mass: one extra point mass at the hip.
        knees: whether the swing knee is free until it strikes its stop; False locks both knees.
        gravity: g.

    Raises:
        WalkerError: if a parameter is not finite, out of its range, or leaves a joint with nothing
            to turn.
    """

    thigh_length: float
    thigh_offset: float = 0.0
    thigh_mass: float
    thigh_gyration: float = 0.0
    thigh_com: float = 0.0
    shank_length: float
    shank_offset: float = 0.0
    shank_mass: float
    shank_gyration: float = 0.0
    shank_com: float = 0.0
    foot_radius: float = 0.0
    foot_angle: float = 0.0
    hip_mass: float = 0.0
    knees: bool = True
    gravity: float = 9.81

    def __post_init__(self) -> None:
        """Refuse what is no walker."""
        for field in fields(self):
            value = getattr(self, field.name)
            if field.name == "knees":
                if not isinstance(value, bool):
                    raise WalkerError(f"knees must be True or False, not {value!r}")
                continue
            try:
                value = float(value)
            except (TypeError, ValueError):
                raise WalkerError(f"{field.name} must be a number, not {value!r}") from None
            if not math.isfinite(value):
                raise WalkerError(f"{field.name} must be finite, not {value}")
            object.__setattr__(self, field.name, value)
        for name in ("thigh_length", "shank_length", "gravity"):
            if getattr(self, name) <= 0.0:
                raise WalkerError(f"{name} must be positive, not {getattr(self, name)}")
        for name in ("thigh_mass", "shank_mass", "hip_mass", "thigh_gyration", "shank_gyration"):
            if getattr(self, name) < 0.0:
                raise WalkerError(f"{name} must not be negative, but is {getattr(self, name)}")
        if not 0.0 <= self.foot_radius < self.shank_length:
            raise WalkerError(
                f"foot_radius must lie from 0 to below the shank's length {self.shank_length}, "
                f"so that the foot's centre is below the knee; it is {self.foot_radius}"
            )
        reach = (self.shank_length - self.foot_radius) / self.thigh_length
        if not (abs(self.foot_angle) < 0.5 * math.pi and abs(math.sin(self.foot_angle)) < reach):
            limit = math.asin(min(1.0, reach))
            raise WalkerError(
                f"foot_angle {self.foot_angle} rad cannot be reached by this shank: its size must "
                f"be below {limit:.6g} rad (sin of it below (l_s - R)/l_t)"
            )
        self._check_masses()

    def _check_masses(self) -> None:
        """Every joint must have something to turn."""
        if self.thigh_mass == 0.0 and self.shank_mass == 0.0:
            if self.hip_mass == 0.0:
                raise WalkerError("a walker needs mass: thigh_mass, shank_mass and hip_mass are 0")
            if self.knees or self.foot_radius != 0.0:
                raise WalkerError(
                    "legs without mass are the simplest walker, which has point feet and no "
                    "knees: set foot_radius=0 and knees=False, or give the legs some mass"
                )
            return
        thigh_spread = math.hypot(self.thigh_gyration, self.thigh_com, self.thigh_offset)
        shank_spread = math.hypot(self.shank_gyration, self.shank_com, self.shank_offset)
        if self.knees and self.shank_mass * shank_spread == 0.0:
            raise WalkerError(
                "a free shank needs a moment of inertia about the knee: give it shank_mass and "
                "one of shank_com, shank_offset, shank_gyration, or set knees=False"
            )
        if self.shank_mass == 0.0 and self.thigh_mass * thigh_spread == 0.0:
            raise WalkerError(
                "a swing leg needs a moment of inertia about the hip: move some of its mass away "
                "from the hip, or set both leg masses to 0 for the simplest walker"
            )

    @property
    def leg_length(self) -> float:
        """Leg length l = l_t + l_s, the unit of length of all dimensionless numbers."""
        return self.thigh_length + self.shank_length

    @property
    def total_mass(self) -> float:
        """Mass of both legs and the hip."""
        return 2.0 * (self.thigh_mass + self.shank_mass) + self.hip_mass

    @property
    def massless_legs(self) -> bool:
        """Whether this is the simplest walker, the limit of vanishing foot mass."""
        return self.thigh_mass == 0.0 and self.shank_mass == 0.0

    @property
    def time_unit(self) -> float:
        """The pendulum time sqrt(l/g), the unit of time of all dimensionless numbers."""
        return math.sqrt(self.leg_length / self.gravity)

    @property
    def shank_angle(self) -> float:
        """Angle in rad from the line foot centre-hip to the shank's line, forward (epsilon_F)."""
        reach = (self.shank_length - self.foot_radius) / self.thigh_length
        return math.asin(math.sin(self.foot_angle) / reach)


PARAMETERS = tuple(field.name for field in fields(Walker) if field.name != "knees")
"""Names of the numbers that make a walker."""


class TuningErrors(NamedTuple):
    """How far a walker is from the conditions for walking at vanishing slope (Fig. 4.7).

    Each is zero for a tuned walker. Lengths are in units of the leg length, positive forward.

    Attributes:
        static_equilibrium: whole-body centre of mass ahead of the contact point, legs parallel,
            hip above the contact (condition 1: the foot normal points at the centre of mass).
        hip_over_contact: hip ahead of the foot normal at that contact (condition 2; true by the
            way angles are measured, for every walker with circular feet).
        collinearity: distance of the whole body's centre of mass from the line hip-foot centre
            (condition 3).
        shank_under_knee: shank's centre of mass ahead of the knee, leg straight (condition 4;
            0 for a walker without knees, where it is not required).
    """

    static_equilibrium: float
    hip_over_contact: float
    collinearity: float
    shank_under_knee: float


def _lateral(walker: Walker) -> tuple[float, float]:
    """How far forward lie a leg's centre of mass, and the shank's from the knee, leg straight."""
    epsilon, shank = walker.foot_angle, walker.shank_angle
    shank_ahead = walker.shank_com * math.sin(shank) - walker.shank_offset * math.cos(shank)
    thigh_ahead = -walker.thigh_com * math.sin(epsilon) - walker.thigh_offset * math.cos(epsilon)
    knee_ahead = -walker.thigh_length * math.sin(epsilon)
    leg_mass = walker.thigh_mass + walker.shank_mass
    if leg_mass == 0.0:
        return 0.0, shank_ahead
    moment = walker.thigh_mass * thigh_ahead + walker.shank_mass * (knee_ahead + shank_ahead)
    return moment / leg_mass, shank_ahead


def tuning_errors(walker: Walker | str) -> TuningErrors:
    """Say which of Fig. 4.7's conditions for zero-slope walking a walker fails, and by how much."""
    walker = as_walker(walker)
    leg_ahead, shank_ahead = _lateral(walker)
    length = walker.leg_length
    share = 2.0 * (walker.thigh_mass + walker.shank_mass) / walker.total_mass
    return TuningErrors(
        static_equilibrium=share * leg_ahead / length,
        hip_over_contact=0.0,
        collinearity=share * leg_ahead / length,
        shank_under_knee=shank_ahead / length if walker.knees else 0.0,
    )


def tune(walker: Walker | str) -> Walker:
    """The nearest walker that can stand at zero slope, and so may walk there (Fig. 4.7).

    Moves the two offsets `thigh_offset` and `shank_offset` and nothing else: the shank's centre of
    mass goes under the knee, then the thigh's goes where it brings the whole body's onto the line
    from hip to foot centre. A straight-legged walker is given the same offsets as its kneed twin.

    Raises:
        WalkerError: if the thigh has no mass to balance an angled foot with.
    """
    walker = as_walker(walker)
    if walker.massless_legs:
        return walker
    if walker.thigh_mass == 0.0 and walker.foot_angle != 0.0:
        raise WalkerError(
            "tuning moves the thigh's mass, and this walker has none while its foot is at an "
            "angle: give it thigh_mass, or set foot_angle=0"
        )
    knee_share = (
        walker.shank_mass * walker.thigh_length / walker.thigh_mass if walker.thigh_mass else 0.0
    )
    return replace(
        walker,
        thigh_offset=-math.tan(walker.foot_angle) * (walker.thigh_com + knee_share),
        shank_offset=math.tan(walker.shank_angle) * walker.shank_com,
    )


def blend(a: Walker | str, b: Walker | str, fraction: float) -> Walker:
    """A walker between two: every parameter at `fraction` of the way from a to b (Fig. 4.8).

    Args:
        a: The walker at fraction 0, or a preset's name.
        b: The walker at fraction 1, likewise.
        fraction: Usually between 0 and 1; beyond them is allowed while it is still a walker.

    Raises:
        WalkerError: if one has knees and the other has not, or the result is no walker.
    """
    a, b = as_walker(a), as_walker(b)
    if a.knees != b.knees:
        raise WalkerError("cannot blend a walker with knees and one without")
    values = {
        name: (1.0 - fraction) * getattr(a, name) + fraction * getattr(b, name)
        for name in PARAMETERS
    }
    return Walker(knees=a.knees, **values)


class Part(NamedTuple):
    """A rigid piece of a leg segment.

    Attributes:
        mass: its mass.
        com: its centre of mass, down the segment from the upper joint.
        offset: its centre of mass, backwards across the segment.
        inertia: its moment of inertia about its own centre of mass.
    """

    mass: float
    com: float
    offset: float = 0.0
    inertia: float = 0.0


def combine(parts: Iterable[Part]) -> Part:
    """The rigid body made of several parts (parallel-axis theorem)."""
    parts = list(parts)
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
    knees: bool = True,
    gravity: float = 9.81,
) -> Walker:
    """Build a walker from the measured pieces of its legs (appendix 4.10.1).

    Args:
        thigh: Parts of one thigh, measured from the hip along the thigh.
        shank: Parts of one shank, measured from the knee along the *straight* leg, that is along
            the thigh's direction: `com` down it, `offset` **forward** of it, as on a workbench.
        thigh_length: l_t.
        shank_length: l_s, knee to the bottom of the foot through the foot's centre.
        foot_radius: R.
        knee_angle: Angle in rad between the thigh's line and the line knee-foot centre, straight.
        hip_mass: Point mass at the hip, for both legs together.
        knees: Whether the knees bend.
        gravity: g.
    """
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


def _point_foot(foot_mass: float, hip_mass: float, foot_radius: float = 0.0) -> Walker:
    """A straight-legged walker of point masses: at the hip, and at the bottom of each foot."""
    return Walker(
        thigh_length=0.5,
        thigh_mass=0.5 * hip_mass,
        shank_length=0.5,
        shank_mass=foot_mass,
        shank_com=0.5,
        foot_radius=foot_radius,
        knees=False,
    )


_LAB = Walker(
    thigh_length=0.35,
    thigh_offset=0.0,
    thigh_mass=2.345,
    thigh_gyration=0.099,
    thigh_com=0.091,
    shank_length=0.46,
    shank_offset=0.025,
    shank_mass=1.013,
    shank_gyration=0.197,
    shank_com=0.17,
    foot_radius=0.2,
    foot_angle=0.097,
)

_TUNED = replace(
    _LAB,
    thigh_offset=-0.023,
    thigh_gyration=0.1882,
    thigh_com=0.084,
    shank_offset=0.022,
    shank_gyration=0.1226,
)

WALKERS: dict[str, Walker] = {
    "A": replace(_TUNED, knees=False),
    "B": _point_foot(foot_mass=0.1, hip_mass=0.8, foot_radius=0.2),
    "C": _TUNED,
    "D": Walker(
        thigh_length=0.5,
        thigh_mass=0.0,
        shank_length=0.5,
        shank_mass=0.0,
        hip_mass=1.0,
        knees=False,
    ),
    "E": _point_foot(foot_mass=0.1, hip_mass=0.8),
    "F": _point_foot(foot_mass=0.05, hip_mass=0.9),
    "lab": _LAB,
    "lab-straight": replace(_LAB, knees=False),
}
"""The walkers of the source document: A to E of Table 4.1, F of Fig. 4.5, and the laboratory's
walker of Fig. 4.3 with its knees free and locked."""


def as_walker(walker: Walker | str) -> Walker:
    """A walker as given, or the preset of that name.

    Raises:
        WalkerError: if there is no preset of that name.
    """
    if isinstance(walker, Walker):
        return walker
    if isinstance(walker, str) and walker in WALKERS:
        return WALKERS[walker]
    raise WalkerError(
        f"no walker {walker!r}: give a Walker, or one of the names {', '.join(WALKERS)}"
    )


def describe(walker: Walker) -> str:
    """A walker's preset name, or its parameters."""
    for name, preset in WALKERS.items():
        if preset == walker:
            return f"walker {name!r}"
    return str(walker)
