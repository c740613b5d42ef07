"""Where a search for gaits begins: points of the section that a gait may be near to.

Just before a heelstrike a walker's motion is set by three numbers: the step's size and the ratios
of the two legs' rates to it. A small grid of ratios, each with the step size at which the collision
loses what the slope supplies, is a set of starts that suits every slope and every walker of human
proportions. Gaits that take several strides to repeat are looked for where walks return to.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from gym_passive_walker.gaits.log_chart import from_logarithms, logarithms
from gym_passive_walker.gaits.posture import heelstrike, step_lengths
from gym_passive_walker.gaits.stride_map import StrideMap
from gym_passive_walker.physics.systems import kind_of
from gym_passive_walker.walkers import Walker

# Ratios to the step angle, just before heelstrike: of the stance leg's rate, and of the swing
# leg's rate in excess of it (zero where the foot meets the ground without sliding). Excesses far
# from zero belong to the slow walks of untuned walkers and to short steps on steep slopes. The
# simplest walker forgets its swing leg's rate at heelstrike.
_EXCESSES = (-6.0, -4.0, -2.8, -2.0, -1.5, -1.0, -0.7, -0.45, -0.25, -0.1)
_EXCESSES += (0.0, 0.1, 0.3, 0.6, 1.0, 1.6, 2.2, 2.8)
_RATIOS = -np.geomspace(1.005, 2.0, 16), np.array(_EXCESSES)
_RATIOS_OF = {
    "kneed": _RATIOS,
    "straight": _RATIOS,
    "simplest": (-np.geomspace(1.005, 2.0, 200), np.zeros(1)),
}
_LOSS_SHARES = {"kneed": (1.0, 0.6, 0.3), "straight": (1.0,), "simplest": (1.0,)}
_ANGLES = np.geomspace(1e-10, 0.7, 80)
_PUSHED_ANGLES = np.geomspace(1e-4, 0.7, 120)  # a push-off makes no tiny steps
_LEAST = 1e-300  # energy: its logarithm is finite

_WALKERS, _SETTLING, _KEPT = 48, 100, 12  # walks looked at for returns
_ROUGHLY = 1e-7  # tolerance of these


def starts(stride_map: StrideMap, slope: float) -> NDArray:
    """Where a gait of one stride at this slope may be near to.

    Args:
        stride_map: Of one walker.
        slope: Slope in rad; positive, unless motors drive the walker.

    Returns:
        Logarithmic coordinates (n, m).
    """
    held = stride_map.actuation
    u, loss, pushed = _grid(stride_map.walker, held.push_off)
    # Over a step, the hip opens by four stance angles and the stance leg turns by two: by about two
    # and one for each unit of length.
    works = stride_map.system.works
    given = 2.0 * works.hip * held.hip_torque + works.ankle * held.ankle_torque
    supply = math.sin(slope) + given + pushed
    if stride_map.terrain is not None:
        rise = float(stride_map.ground[:, 1].mean())
        supply = supply - rise * math.cos(slope) / step_lengths(
            stride_map.walker, np.exp(u[0, :, 0])
        )
    if not np.any(supply > 0.0):
        return np.empty((0, stride_map.dimension))
    found = []
    for share in _LOSS_SHARES[kind_of(stride_map.walker)]:
        excess = loss - np.log(np.maximum(share * supply, _LEAST))
        short = excess < 0.0
        # Under a push-off uphill, steps of two sizes are in balance: it hardly helps tiny ones.
        rows, above = np.nonzero(short[:, :-1] != short[:, 1:])
        low, high = excess[rows, above], excess[rows, above + 1]
        part = (low / (low - high))[:, None]
        found.append((1.0 - part) * u[rows, above] + part * u[rows, above + 1])
    return np.concatenate(found)


@lru_cache(maxsize=64)
def _grid(walker: Walker, push_off: float) -> tuple[NDArray, NDArray, NDArray | float]:
    """Points just after heelstrike, by ratios of rates and step angle, and what each step loses.

    Returns:
        Logarithmic coordinates (ratios, angles, m); over the weight and the step's length, the
        logarithm of what the heelstrike loses, (ratios, angles), and what the push-off before it
        gives, of the same shape or 0.
    """
    stride_map = StrideMap.of(walker)
    stance, excess = (x.ravel() for x in np.meshgrid(*_RATIOS_OF[kind_of(walker)]))
    angles = _PUSHED_ANGLES if push_off else _ANGLES
    angle = np.tile(angles, len(stance))
    stance_rate = np.repeat(stance, len(angles)) * angle
    swing_rate = np.repeat(stance + excess, len(angles)) * angle
    points, *energies = heelstrike(stride_map, angle, stance_rate, swing_rate, push_off)
    shape = len(stance), len(angles)
    lost, pushed = ((energy / step_lengths(walker, angle)).reshape(shape) for energy in energies)
    u, loss = logarithms(points).reshape(*shape, -1), np.log(np.maximum(lost, _LEAST))
    return u, loss, pushed if push_off else 0.0


def returns(stride_map: StrideMap, slope: float, gaits: NDArray) -> NDArray:
    """Where walks begun beside some gaits come back to.

    Where a gait has doubled its period, or walks are chaotic, they pass near every gait there is.

    Args:
        stride_map: Of one walker.
        slope: Slope in rad.
        gaits: Fixed points in logarithmic coordinates, (n, m).

    Returns:
        Logarithmic coordinates (k, m) along walks that last.
    """
    roughly = stride_map.with_tolerance(_ROUGHLY)
    beside = np.random.default_rng(0).standard_normal((_WALKERS, stride_map.dimension))
    size = np.geomspace(1e-4, 0.03, _WALKERS)[:, None]
    points = from_logarithms(np.concatenate([gait + size * beside for gait in gaits]))
    points = roughly.apply(points, slope, strides=_SETTLING).ends
    points = points[np.isfinite(points[:, 0])]
    kept = []
    for _ in range(_KEPT):
        points = roughly.apply(points, slope).ends
        kept.append(points)
    points = np.concatenate(kept)
    return logarithms(points[np.isfinite(points[:, 0])])
