"""Many walkers stride after stride, as lanes: what bifurcation diagrams and basins are made of."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker.gaits.section import Section
from gym_passive_walker.physics import record as R
from gym_passive_walker.physics.engine import advance
from gym_passive_walker.physics.events import Outcome
from gym_passive_walker.physics.record import new_records

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
    outcome = np.real(records[:, R.OUTCOME]).astype(np.int8)
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


def period_of(values: ArrayLike, longest: int, tolerance: float = 1e-6) -> NDArray[np.int64]:
    """The smallest period with which sequences repeat; 0 where none does.

    Args:
        values: Sequences, shape (..., count), longer than `longest`.
        longest: Longest period looked for.
        tolerance: How nearly they repeat, relative to their size.
    """
    values = np.asarray(values, dtype=float)
    if not 1 <= longest < values.shape[-1]:
        raise ValueError(f"a period from 1 to below {values.shape[-1]}, not {longest}")
    with np.errstate(invalid="ignore"):
        size = tolerance * np.abs(values).max(axis=-1)
        period = np.zeros(values.shape[:-1], dtype=np.int64)
        for p in range(longest, 0, -1):
            gap = np.abs(values[..., p:] - values[..., :-p]).max(axis=-1)
            period[gap <= size] = p
    return period
