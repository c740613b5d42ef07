"""How gaits scale at small slopes: powers of the slope, and where one power gives way to another.

A collision whose foot velocity is normal to the ground costs the fourth power of the step, one
with a tangential part the square; gravity supplies step times slope. So a step grows with the cube
root of the slope, or in proportion to it (section 4.6.3). Along a family the exponent is the
tangent of the curve of gaits in logarithmic coordinates, exact like every derivative here.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gym_passive_walker.arguments import instance, number
from gym_passive_walker.gaits.family import GaitFamily
from gym_passive_walker.gaits.fixed_point import find_gait
from gym_passive_walker.gaits.gait import gait_equations
from gym_passive_walker.gaits.section import logarithms
from gym_passive_walker.walkers import WalkerLike, as_walker

CUBE_ROOT = 0.943976
"""Stance angle over slope^(1/3) of the simplest walker's short-step gait as the slope vanishes."""

_SMALL_SLOPE, _EXACT = 1e-8, 1e-13  # the second a tolerance
_LARGEST_ANGLE = 1e3  # over slope^(1/3), of a law that may be compared with


class Exponents(NamedTuple):
    """Local exponents along a family, one per gait.

    Attributes:
        slope: Slope in rad.
        stance_angle: d ln(stance angle) / d ln(slope).
        speed: d ln(speed) / d ln(slope).
    """

    slope: NDArray[np.float64]
    stance_angle: NDArray[np.float64]
    speed: NDArray[np.float64]


def local_exponents(family: GaitFamily) -> Exponents:
    """The power of the slope with which a family's gaits grow, gait by gait.

    Infinite where the family folds; between gaits interpolate in ln(slope).

    Args:
        family: A family of period-one gaits over slopes.

    Raises:
        ValueError: if the family varies something else than the slope, or its gaits take several
            strides to repeat.
    """
    instance(family, GaitFamily, "family", "gpw.gait_family returns")
    if family.parameter != "slope":
        raise ValueError(f"exponents are by the slope, and this family varies {family.parameter}")
    if family.period != 1:
        raise ValueError(f"these gaits repeat after {family.period} strides: give one of period 1")
    stride_map, slope = family.stride_map.with_tolerance(_EXACT), family.slope
    u = logarithms(stride_map.points_at(family.state))
    gaits = gait_equations(stride_map, u, slope, by=("slope",))
    by_log_slope = np.ones(u.shape[1] + 1) * np.ones((len(u), 1))
    by_log_slope[:, -1] = slope
    tangent = np.linalg.svd(gaits.derivatives * by_log_slope[:, None])[2][:, -1]
    with np.errstate(divide="ignore"):
        tangent = tangent / tangent[:, -1:]
    passage, change = gaits.passage, gaits.change
    growth = change.lengths / passage.lengths[:, None]
    growth = growth - change.durations / passage.durations[:, None]
    return Exponents(slope, tangent[:, 0], np.sum(growth * by_log_slope * tangent, axis=1))


def exponent_crossings(family: GaitFamily, exponent: float = 2.0 / 3.0) -> NDArray[np.float64]:
    """Slopes at which a family's stance angle passes from one power of the slope to another.

    Args:
        family: A family of period-one gaits over slopes.
        exponent: The local exponent looked for; midway between 1/3 and 1 if not given.

    Returns:
        Slopes in rad in order along the family, by interpolation between its gaits.
    """
    local = local_exponents(family)
    excess, log_slope = local.stance_angle - number(exponent, "exponent"), np.log(local.slope)
    crossed = np.flatnonzero(excess[:-1] * excess[1:] < 0.0)
    share = excess[crossed] / (excess[crossed] - excess[crossed + 1])
    return np.exp(log_slope[crossed] + share * (log_slope[crossed + 1] - log_slope[crossed]))


def transition_slope(walker: WalkerLike, *, cube_root: float = CUBE_ROOT) -> float:
    """Where the short-step gait's linear law at small slopes meets a cube-root law (Fig. 4.5).

    The two laws, angle = a slope and angle = b slope^(1/3), meet at (b / a)^(3/2). For point feet
    that weigh rho times the hip the document argues that this is proportional to rho^(3/2). The
    cube-root line is arbitrary there, since it drops out of the ratio of two walkers' slopes.

    Args:
        walker: A walker that walks at vanishing slopes in proportion to them; see `as_walker`.
        cube_root: b. The default is that of the simplest walker, to which point feet tend.

    Returns:
        The slope in rad; for the simplest walker itself, whose law is never linear, it is as small
        as the slope at which the laws are read off.

    Raises:
        GaitNotFound: if the walker has no short-step gait at vanishing slopes.
    """
    cube_root = number(cube_root, "cube_root", above=0.0, most=_LARGEST_ANGLE)
    gait = find_gait(as_walker(walker), _SMALL_SLOPE, "short")
    return float((cube_root * _SMALL_SLOPE / gait.stance_angle) ** 1.5)
