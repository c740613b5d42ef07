"""What walks settle on: the stable gaits at a slope, and when a walk is about to reach one."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker.gaits.fixed_point import find_gaits
from gym_passive_walker.gaits.gait import Gait
from gym_passive_walker.gaits.section import logarithms
from gym_passive_walker.gaits.stride_map import StrideMap
from gym_passive_walker.physics.hybrid import Outcome
from gym_passive_walker.progress import progress

FELL, UNSETTLED = -1, -2
"""Instead of a gait's index: the walker fell, or still walks on none of the gaits."""

_LONGEST_PERIOD = 12
_SETTLING = 500  # strides taken before a walk is looked at
_ROUGHLY, _FINELY = 1e-9, 1e-12  # tolerances of walks, and along gaits


class Attractors:
    """Points of the stable gaits at a slope, to tell which one a walk is about to settle on.

    Args:
        stride_map: Whose gaits.
        gaits: The gaits, of any period.
        near: Distance in logarithmic coordinates that counts as close.
    """

    def __init__(self, stride_map: StrideMap, gaits: list[Gait], near: float) -> None:
        self.near = near
        self.points: list[NDArray] = []
        self.owner: list[int] = []
        finely = stride_map.with_tolerance(_FINELY)
        for index, gait in enumerate(gaits):
            point = finely.points_at(gait.state)
            for _ in range(gait.period):
                self.points.append(logarithms(point)[0])
                self.owner.append(index)
                point = finely.apply(point, gait.slope).ends

    def of(self, points: NDArray) -> NDArray[np.int8]:
        """Index of the gait that each point (n, m) is close to; UNSETTLED if to none."""
        index = np.full(len(points), UNSETTLED, np.int8)
        u = logarithms(points)
        for point, owner in zip(self.points, self.owner, strict=True):
            index[np.abs(u - point).max(axis=1) < self.near] = owner
        return index


class Settled(NamedTuple):
    """What has become of n walks.

    Attributes:
        index: The gait that a walk has come close to, FELL or UNSETTLED, (n,).
        outcome: How its last stride ended, an `Outcome`, (n,).
        strides: Strides completed, (n,).
        points: The last point of the section that it came to, (n, m).
    """

    index: NDArray[np.int8]
    outcome: NDArray[np.int8]
    strides: NDArray[np.int32]
    points: NDArray[np.float64]


def walk_until_settled(
    stride_map: StrideMap, points: NDArray, slope: float, gaits: Attractors, most: int
) -> Settled:
    """Let walkers walk until each has fallen, or has come close to a stable gait.

    Args:
        stride_map: Who walks.
        points: Where they start, (n, m).
        slope: Slope in rad.
        gaits: The gaits to come close to.
        most: Strides after which a walk counts as unsettled.
    """
    count = len(points)
    settled = Settled(
        np.full(count, UNSETTLED, np.int8),
        np.full(count, Outcome.HEELSTRIKE, np.int8),
        np.zeros(count, np.int32),
        points.copy(),
    )
    walking = np.arange(count)
    with progress("strides until all have settled", most) as taken:
        for _ in range(most):
            passage = stride_map.apply(settled.points[walking], slope)
            on = passage.alive
            settled.outcome[walking] = passage.outcomes
            settled.index[walking[~on]] = FELL
            walking, ends = walking[on], passage.ends[on]
            settled.points[walking] = ends
            settled.strides[walking] += 1
            settled.index[walking] = index = gaits.of(ends)
            walking = walking[index == UNSETTLED]
            if len(walking) == 0:
                break
            taken()
    return settled


def stable_gaits(stride_map: StrideMap, slope: float, points: NDArray) -> list[Gait]:
    """The stable gaits of any period that walks settle on.

    Args:
        stride_map: Who walks.
        slope: Slope in rad.
        points: Where they start, (n, m).

    Returns:
        Gaits, those of short period first; none for a walk that is still unsettled or chaotic.
    """
    roughly = stride_map.with_tolerance(_ROUGHLY)
    points = roughly.apply(points, slope, strides=_SETTLING).ends
    points = points[np.isfinite(points[:, 0])]
    angles, here = [], points
    for _ in range(2 * _LONGEST_PERIOD):
        here = roughly.apply(here, slope).ends
        angles.append(here[:, 0])
    periods = period_of(np.array(angles).T, _LONGEST_PERIOD, 1e-4)
    found: list[Gait] = []
    for period in sorted(set(periods[periods > 0].tolist())):
        left = points[periods == period]
        while len(left):
            guess = stride_map.states_at(left[:1])
            gaits = find_gaits(stride_map, slope, period=period, guess=guess)[:1]
            if not gaits:
                break
            found += [gait for gait in gaits if gait.stable]
            left = left[Attractors(stride_map, gaits, 1e-2).of(left) == UNSETTLED]
    return found


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
