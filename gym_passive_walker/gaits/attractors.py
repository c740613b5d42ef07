"""What walks settle on: the stable gaits at a slope, and when a walk is about to reach one."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker.gaits.fixed_point import find_gaits
from gym_passive_walker.gaits.gait import Gait
from gym_passive_walker.gaits.section import Section, section_of
from gym_passive_walker.gaits.walk import period_of, take_stride, walk_on
from gym_passive_walker.physics.events import Outcome
from gym_passive_walker.walkers import Walker, as_walker

FELL, UNSETTLED = -1, -2
"""Instead of a gait's index: the walker fell, or still walks on none of the gaits."""

_LONGEST_PERIOD = 12


class Attractors:
    """Points of the stable gaits at a slope, to tell which one a walk is about to settle on.

    Args:
        section: The section.
        gaits: The gaits, of any period.
        slope: Slope in rad.
        near: Distance in the section's logarithmic coordinates that counts as close.
    """

    def __init__(self, section: Section, gaits: list[Gait], slope: float, near: float) -> None:
        self.section, self.near = section, near
        self.points: list[NDArray] = []
        self.owner: list[int] = []
        for index, gait in enumerate(gaits):
            state = gait.state[None].copy()
            state[:, 3:] *= section.time
            for _ in range(gait.period):
                self.points.append(section.point(state)[0])
                self.owner.append(index)
                state, _ = take_stride(section, state, np.array([slope]), tolerance=1e-12)

    def of(self, states: NDArray) -> NDArray[np.int8]:
        """Index of the gait that each state is close to; UNSETTLED if to none."""
        index = np.full(len(states), UNSETTLED, np.int8)
        u = self.section.point(states)
        for point, owner in zip(self.points, self.owner, strict=True):
            index[np.abs(u - point).max(axis=1) < self.near] = owner
        return index


def walk_until_settled(
    section: Section, states: NDArray, slope: float, gaits: Attractors, most: int, tolerance: float
) -> tuple[NDArray, NDArray, NDArray, NDArray]:
    """Let walkers walk until each has fallen, or has come close to a stable gait.

    Args:
        section: The section.
        states: Dimensionless section states, (n, 6).
        slope: Slope in rad.
        gaits: The gaits to come close to.
        most: Strides after which a walk counts as unsettled.
        tolerance: Of the integration.

    Returns:
        For each: the gait's index, FELL or UNSETTLED; the last stride's `Outcome`; strides
        completed; and the last section state.
    """
    count = len(states)
    settled = np.full(count, UNSETTLED, np.int8)
    outcome = np.full(count, Outcome.HEELSTRIKE, np.int8)
    strides = np.zeros(count, np.int32)
    states = states.copy()
    walking = np.arange(count)
    for _ in range(most):
        ends, how = take_stride(
            section, states[walking], np.full(len(walking), slope), tolerance=tolerance
        )
        on = how == Outcome.HEELSTRIKE
        outcome[walking] = how
        settled[walking[~on]] = FELL
        walking, ends = walking[on], ends[on]
        states[walking] = ends
        strides[walking] += 1
        settled[walking] = index = gaits.of(ends)
        walking = walking[index == UNSETTLED]
        if len(walking) == 0:
            break
    return settled, outcome, strides, states


def stable_gaits(
    walker: Walker | str, slope: float, states: ArrayLike, *, settle: int = 500
) -> list[Gait]:
    """The stable gaits of any period that walks from some states settle on.

    Args:
        walker: The walker, or a preset's name.
        slope: Slope in rad.
        states: Section states to walk from, (n, 6).
        settle: Strides taken before a walk is looked at.

    Returns:
        Gaits, those of short period first; none for a walk that is still unsettled or chaotic.
    """
    walker = as_walker(walker)
    section = section_of(walker)
    states = np.atleast_2d(np.array(states, dtype=float))
    states[:, 3:] *= section.time
    slopes = np.full(len(states), float(slope))
    states = walk_on(section, states, slopes, settle, tolerance=1e-9)
    states = states[np.all(np.isfinite(states), axis=1)]
    angles, here = [], states
    for _ in range(2 * _LONGEST_PERIOD):
        here = walk_on(section, here, slopes[: len(here)], 1, tolerance=1e-9)
        angles.append(here[:, 0])
    periods = period_of(np.array(angles).T, _LONGEST_PERIOD, 1e-4)
    found: list[Gait] = []
    for period in sorted(set(periods[periods > 0].tolist())):
        left = states[periods == period]
        while len(left):
            guess = left[0].copy()
            guess[3:] /= section.time
            gait = next(iter(find_gaits(walker, slope, period=period, guess=guess)), None)
            if gait is None:
                break
            found += [gait] if gait.stable else []
            left = left[Attractors(section, [gait], float(slope), 1e-2).of(left) == UNSETTLED]
    return found
