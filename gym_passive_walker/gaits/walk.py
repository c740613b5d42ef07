"""Many walkers stride after stride, as lanes: what bifurcation diagrams and basins are made of."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gym_passive_walker.gaits.section import Section
from gym_passive_walker.physics import integrator as I
from gym_passive_walker.physics.events import Outcome
from gym_passive_walker.physics.stride import advance, new_records

LONGEST_WALKED = 20.0
"""Time in sqrt(l/g) after which a stride without heelstrike is given up; a usual one takes 3."""


def take_stride(
    section: Section,
    states: NDArray,
    slopes: NDArray,
    *,
    tolerance: float,
    longest: float = LONGEST_WALKED,
) -> tuple[NDArray, NDArray[np.int8]]:
    """Take every walker through one stride.

    Args:
        section: The section, of one walker for all.
        states: Dimensionless section states, (n, 6), real or complex.
        slopes: rad, (n,).
        tolerance: Of the integration.
        longest: Dimensionless time after which a stride is given up as STALLED.

    Returns:
        The next states, of use where the outcome is HEELSTRIKE; and the outcomes.
    """
    records = new_records(states, slopes, end=longest)
    with np.errstate(all="ignore"):
        advance(section.kind, section.constants.astype(records.dtype), records, tolerance=tolerance)
    outcome = records[:, I.OUTCOME].real.astype(np.int8)
    outcome[outcome == Outcome.RUNNING] = Outcome.STALLED
    return records[:, :6], outcome


def walk_on(
    section: Section, states: NDArray, slopes: NDArray, count: int, *, tolerance: float
) -> NDArray:
    """Take every walker through a number of strides.

    Args:
        section: The section.
        states: Dimensionless section states, (n, 6).
        slopes: rad, (n,).
        count: Strides to take.
        tolerance: Of the integration.

    Returns:
        Where they stand, (n, 6); NaN for those that no longer walk.
    """
    states = states.copy()
    walking = np.flatnonzero(np.all(np.isfinite(states), axis=1))
    for _ in range(count):
        if len(walking) == 0:
            break
        ends, outcome = take_stride(section, states[walking], slopes[walking], tolerance=tolerance)
        ends[outcome != Outcome.HEELSTRIKE] = np.nan
        states[walking] = ends
        walking = walking[outcome == Outcome.HEELSTRIKE]
    return states
