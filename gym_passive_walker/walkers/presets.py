"""The walkers of the source document, and their names."""

from __future__ import annotations

from dataclasses import replace

from gym_passive_walker.arguments import shown
from gym_passive_walker.walkers.walker import Walker, WalkerError


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

ABOUT: dict[str, str] = {
    "A": "straight legs with round feet, masses as the laboratory's walker; tuned",
    "B": "straight legs with round feet, point masses at hip and feet; tuned",
    "C": "knees, round feet, masses near those of the laboratory's walker; tuned",
    "D": "the simplest walker: straight legs without mass, point feet, all mass at the hip",
    "E": "straight legs, point feet, point masses: 0.1 at each foot, 0.8 at the hip",
    "F": "as E with lighter feet: 0.05 at each foot, 0.9 at the hip",
    "lab": "the laboratory's machine as it was built: knees, round feet, not tuned",
    "lab-straight": "the laboratory's machine with its knees locked",
}
"""What each of `WALKERS` is, in words. Tuned walkers may walk at vanishing slope (`tune`)."""


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
        f"no walker {shown(walker)}: give a Walker, or one of the names {', '.join(WALKERS)}"
    )
