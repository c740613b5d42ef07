"""Tuning of walkers for gaits at vanishing slope, and interpolation between two walkers (4.6.1)."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

from gym_passive_walker._tools.arguments import number
from gym_passive_walker.models.model import check_supports
from gym_passive_walker.models.walkers.presets import WalkerLike, as_walker
from gym_passive_walker.models.walkers.walker import PARAMETERS, Walker, WalkerError


class TuningErrors(NamedTuple):
    """Errors of a walker in the conditions for walking at vanishing slope (Fig. 4.7).

    Each is zero for a tuned walker. Lengths are in units of the leg length, positive forward.
    Condition 2, the hip over the contact, holds of every walker with circular feet, by the way
    angles are measured.

    Attributes:
        static_equilibrium: whole-body centre of mass ahead of the contact point, legs parallel,
            hip above the contact (condition 1: the foot normal points at the centre of mass).
        collinearity: distance of the whole body's centre of mass from the line hip-foot centre
            (condition 3).
        shank_under_knee: shank's centre of mass ahead of the knee, leg straight (condition 4;
            0 for a walker without knees, where it is not required).
    """

    static_equilibrium: float
    collinearity: float
    shank_under_knee: float


def _lateral(walker: Walker) -> tuple[float, float]:
    """Forward distances of a leg's centre of mass, and of the shank's from the knee."""
    epsilon, shank = walker.foot_angle, walker.shank_angle
    shank_ahead = walker.shank_com * math.sin(shank) - walker.shank_offset * math.cos(shank)
    thigh_ahead = -walker.thigh_com * math.sin(epsilon) - walker.thigh_offset * math.cos(epsilon)
    knee_ahead = -walker.thigh_length * math.sin(epsilon)
    leg_mass = walker.thigh_mass + walker.shank_mass
    if leg_mass == 0.0:
        return 0.0, shank_ahead
    moment = walker.thigh_mass * thigh_ahead + walker.shank_mass * (knee_ahead + shank_ahead)
    return moment / leg_mass, shank_ahead


def tuning_errors(walker: WalkerLike) -> TuningErrors:
    """Return the errors of a walker in the conditions for walking at zero slope (Fig. 4.7)."""
    walker = check_supports(as_walker(walker), "McGeer's parameters")
    leg_ahead, shank_ahead = _lateral(walker)
    length = walker.leg_length
    share = 2.0 * (walker.thigh_mass + walker.shank_mass) / walker.total_mass
    return TuningErrors(
        static_equilibrium=share * leg_ahead / length,
        collinearity=share * leg_ahead / length,
        shank_under_knee=shank_ahead / length if walker.knees else 0.0,
    )


def tune(walker: WalkerLike) -> Walker:
    """The nearest walker that can stand at zero slope, and so may have gaits there (Fig. 4.7).

    Only the two offsets `thigh_offset` and `shank_offset` change. First the shank's centre of mass
    is placed under the knee. Then the thigh's is placed so that the centre of mass of the whole
    body lies on the line from hip to foot centre. A straight-legged walker gets the same offsets as
    its kneed twin.

    The conditions are necessary for gaits at vanishing slopes, but not sufficient for a gait at any
    slope. Tuning can remove a walker's gaits. The laboratory's walker is an example: its gyrations
    would have to change as well. `tune_to_walk` returns the nearest tuned walker with a gait.

    Raises:
        WalkerError: if the thigh has no mass to balance an angled foot with.
    """
    walker = check_supports(as_walker(walker), "McGeer's parameters")
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
    tuned = replace(
        walker,
        thigh_offset=-math.tan(walker.foot_angle) * (walker.thigh_com + knee_share),
        shank_offset=math.tan(walker.shank_angle) * walker.shank_com,
    )
    return tuned.titled(f"{walker.title} (tuned)") if walker.title else tuned


def interpolate(a: WalkerLike, b: WalkerLike, fraction: float) -> Walker:
    """A walker between two walkers, parameter by parameter (Fig. 4.8).

    Args:
        a: The walker at fraction 0, in a form that `as_walker` takes.
        b: The walker at fraction 1, in the same forms.
        fraction: Usually between 0 and 1. Other fractions are allowed if the result is a valid
            walker.

    Raises:
        ValueError: if the fraction is not a number.
        WalkerError: if only one of them has knees, or the result is invalid.
    """
    a, b = (check_supports(as_walker(walker), "McGeer's parameters") for walker in (a, b))
    fraction = number(fraction, "fraction")
    if a.knees != b.knees:
        raise WalkerError("cannot interpolate between walkers of which `knees` differs")
    values = {
        name: (1.0 - fraction) * getattr(a, name) + fraction * getattr(b, name)
        for name in PARAMETERS
    }
    return Walker(knees=a.knees, **values)
