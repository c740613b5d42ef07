"""Scaling of gaits at small slopes: local exponents, and transitions between power laws.

A collision dissipates the fourth power of the step length if the foot velocity is normal to the
ground. It dissipates the square if that velocity has a tangential part. Gravity supplies step
length times slope. So the step grows with the cube root of the slope, or in proportion to it
(section 4.6.3). The exponent along a branch of gaits is the tangent of the branch in logarithmic
coordinates, from the exact derivatives of the stride map.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

import gym_passive_walker as gpw
from gym_passive_walker import GaitFamily, Walker

CUBE_ROOT = 0.943976
"""Stance angle over slope^(1/3) of the simplest walker's short-step gait as the slope vanishes."""

_SMALL_SLOPE, _TOLERANCE = 1e-8, 1e-13


class Exponents(NamedTuple):
    """Local exponents of n gaits of a branch.

    Attributes:
        slope: Slope in rad, (n,).
        stance_angle: d ln(stance angle) / d ln(slope), (n,).
        speed: d ln(speed) / d ln(slope), (n,).
    """

    slope: NDArray[np.float64]
    stance_angle: NDArray[np.float64]
    speed: NDArray[np.float64]


def local_exponents(family: GaitFamily) -> Exponents:
    """Local exponents of stance angle and speed with slope, along a branch of gaits.

    They are infinite at a fold. Between gaits, interpolate in ln(slope).

    Args:
        family: A branch of period-one gaits over slopes.

    Raises:
        ValueError: if another parameter varies along the branch, or its gaits have another period.
    """
    if family.parameter != "slope" or family.period != 1:
        raise ValueError("exponents are those of a family of period-one gaits over slopes")
    strides, slope = family.stride_map.with_tolerance(_TOLERANCE), family.slope
    points, m = strides.points_at(family.state), strides.dimension
    angle = points[:, :1, None]
    # Relative to the stance angle, so that the equations are well scaled for steps of every size.
    passage, change = strides.linearize(
        points, slope, by=("state", "slope"), along=angle * np.eye(m)
    )
    residual = change.ends / angle
    residual[:, :, :m] -= np.eye(m)
    # The stride map is nearly the identity in one direction at small slopes. The energy balance is
    # an equivalent equation there, without cancellation.
    residual[:, 1] = change.imbalance
    residual[:, :, m] *= slope[:, None]
    tangent = np.linalg.svd(residual)[2][:, -1]
    with np.errstate(divide="ignore"):
        tangent = tangent / tangent[:, m:]
    speed = (
        change.lengths / passage.lengths[:, None] - change.durations / passage.durations[:, None]
    )
    speed[:, m] *= slope
    return Exponents(slope, tangent[:, 0], np.sum(speed * tangent, axis=1))


def exponent_crossings(family: GaitFamily, exponent: float = 2.0 / 3.0) -> NDArray[np.float64]:
    """Slopes at which the local exponent of the stance angle crosses a value.

    Args:
        family: A branch of period-one gaits over slopes.
        exponent: The value; midway between 1/3 and 1 by default.

    Returns:
        Slopes in rad, in order along the branch, interpolated between its gaits.
    """
    local = local_exponents(family)
    excess, log_slope = local.stance_angle - exponent, np.log(local.slope)
    crossed = np.flatnonzero(excess[:-1] * excess[1:] < 0.0)
    share = excess[crossed] / (excess[crossed] - excess[crossed + 1])
    return np.exp(log_slope[crossed] + share * (log_slope[crossed + 1] - log_slope[crossed]))


def transition_slope(walker: Walker | str, *, cube_root: float = CUBE_ROOT) -> float:
    """The slope at which the short-step gait's linear law meets a cube-root law (Fig. 4.5).

    The laws angle = a slope and angle = b slope^(1/3) meet at (b / a)^(3/2). Garcia (1999) argues
    that this is proportional to rho^(3/2) for point feet that weigh rho times the hip. The
    cube-root law is arbitrary there, since it cancels in the ratio of two walkers' slopes.

    Args:
        walker: A walker with a short step proportional to the slope as the slope vanishes.
        cube_root: The coefficient b; by default the simplest walker's, to which point feet tend.

    Returns:
        The slope in rad.
    """
    gait = gpw.find_gait(walker, _SMALL_SLOPE, "short")
    return float((cube_root * _SMALL_SLOPE / gait.stance_angle) ** 1.5)
