"""Where a search for gaits begins: points of the section that a gait may be near to.

Just before a heelstrike a walker's motion is set by three numbers: the step's size and the ratios
of the two legs' rates to it. A small grid of ratios, each with the step size at which the collision
loses what the slope supplies, is a set of starts that suits every slope and every walker of human
proportions. Gaits that take several strides to repeat are looked for where walks return to.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from gym_passive_walker.gaits.section import Section
from gym_passive_walker.gaits.walk import walk_on
from gym_passive_walker.physics import constants as K
from gym_passive_walker.physics import record as R
from gym_passive_walker.physics.engine import strike_heels
from gym_passive_walker.physics.record import new_records

# Ratios to the step angle, just before heelstrike: of the stance leg's rate, and of the swing
# leg's rate in excess of it (zero where the foot meets the ground without sliding). Excesses far
# from zero belong to the slow walks of untuned walkers and to short steps on steep slopes. The
# simplest walker forgets its swing leg's rate at heelstrike.
_EXCESSES = (-6.0, -4.0, -2.8, -2.0, -1.5, -1.0, -0.7, -0.45, -0.25, -0.1)
_EXCESSES += (0.0, 0.1, 0.3, 0.6, 1.0, 1.6, 2.2, 2.8)
_STANCE_RATIOS = {
    K.Kind.KNEED: -np.geomspace(1.005, 2.0, 16),
    K.Kind.COMPASS: -np.geomspace(1.005, 2.0, 16),
    K.Kind.SIMPLEST: -np.geomspace(1.005, 2.0, 200),
}
_EXCESS_RATIOS = {
    K.Kind.KNEED: np.array(_EXCESSES),
    K.Kind.COMPASS: np.array(_EXCESSES),
    K.Kind.SIMPLEST: np.zeros(1),
}
_LOSS_SHARES = {K.Kind.KNEED: (1.0, 0.6, 0.3), K.Kind.COMPASS: (1.0,), K.Kind.SIMPLEST: (1.0,)}
_ANGLES = np.geomspace(1e-10, 0.7, 80)

_WALKERS, _SETTLING, _KEPT = 48, 100, 12  # walks looked at for returns


def starts(section: Section, slope: float) -> NDArray:
    """Points of the section that a gait of one stride at this slope may be near to.

    Args:
        section: The section, of one walker.
        slope: Slope in rad, positive.

    Returns:
        Points (n, dimension).
    """
    stance, excess = (
        x.ravel() for x in np.meshgrid(_STANCE_RATIOS[section.kind], _EXCESS_RATIOS[section.kind])
    )
    angle = np.tile(_ANGLES, len(stance))
    stance_rate = np.repeat(stance, len(_ANGLES)) * angle
    swing_rate = np.repeat(stance + excess, len(_ANGLES)) * angle
    state = np.column_stack([-angle, angle, angle, stance_rate, swing_rate, swing_rate])
    records = new_records(state, np.zeros(len(state)))
    strike_heels(records, section.constants, int(section.kind))
    c = section.constants[0]
    length = 2.0 * (c[K.LEG] * np.sin(angle) + c[K.FOOT_RADIUS] * angle)
    loss = (records[:, R.HEEL_LOSS] / length).reshape(len(stance), -1)
    loss = np.log(np.maximum(loss, 1e-300))
    points = section.point(records[:, :6]).reshape(len(stance), len(_ANGLES), -1)
    found = []
    for share in _LOSS_SHARES[section.kind]:
        goal = math.log(share * math.sin(slope))
        rows = np.flatnonzero((loss[:, 0] < goal) & (goal < loss[:, -1]))
        above = np.argmax(loss[rows] > goal, axis=1)
        low, high = loss[rows, above - 1], loss[rows, above]
        part = ((goal - low) / (high - low))[:, None]
        found.append((1.0 - part) * points[rows, above - 1] + part * points[rows, above])
    return np.concatenate(found)


def returns(section: Section, slope: float, gaits: NDArray) -> NDArray:
    """Points that walks begun beside some gaits come back to.

    Where a gait has doubled its period, or walks are chaotic, they pass near every gait there is.

    Args:
        section: The section.
        slope: Slope in rad.
        gaits: Fixed points, (n, dimension).

    Returns:
        Points (m, dimension) of walks that last.
    """
    beside = np.random.default_rng(0).standard_normal((_WALKERS, section.dimension))
    size = np.geomspace(1e-4, 0.03, _WALKERS)[:, None]
    u = np.concatenate([gait + size * beside for gait in gaits])
    slopes = np.full(len(u), slope)
    states = walk_on(section, section.state(u), slopes, _SETTLING, tolerance=1e-7)
    states = states[np.all(np.isfinite(states), axis=1)]
    kept = []
    for _ in range(_KEPT):
        states = walk_on(section, states, slopes[: len(states)], 1, tolerance=1e-7)
        kept.append(states)
    states = np.concatenate(kept)
    return section.point(states[np.all(np.isfinite(states), axis=1)])
