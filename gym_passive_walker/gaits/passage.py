"""What strides make of points of the section: the terms in which a stride map answers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

_DROWNED = 1e6
"""Push-off over the step length squared, of about 1 on most gaits; beyond, rounding is no less than
the accuracy of gaits."""


class NoStride(ValueError):
    """The stride did not end with a heelstrike, so the map has no value there."""


@dataclass(frozen=True)
class Change:
    """What strides make of n points; NaN where a walker fell. All of it dimensionless.

    As derivatives, each array has one axis more: the last, with a column for each direction.

    Attributes:
        ends: Points after the strides, (n, m).
        durations: Of all strides, (n,).
        lengths: Of all steps along the slope, (n,).
        lost: Energy lost at collisions and to friction, (n,).
        supplied: Energy supplied by gravity and torque, as if each stride ended at the height where
            it began, (n,).
        knee_times: When the knee locks in the last stride, (n,); NaN without knees.
        imbalance: Energy lost less energy supplied, over their mean, (n,). Zero on a gait, and
            precise where the small difference of two states would not be. With a push-off P, times
            1 + P over the square of the length; NaN where that exceeds 1e6.
    """

    ends: NDArray[np.float64]
    durations: NDArray[np.float64]
    lengths: NDArray[np.float64]
    lost: NDArray[np.float64]
    supplied: NDArray[np.float64]
    knee_times: NDArray[np.float64]
    imbalance: NDArray[np.float64]


@dataclass(frozen=True)
class Passage(Change):
    """Points taken through some strides.

    Attributes:
        outcomes: How each walker's last stride ended, an `Outcome`, (n,): STALLED if it was given
            up, DIVERGED if its point was not finite.
    """

    outcomes: NDArray[np.int8]

    @property
    def alive(self) -> NDArray[np.bool_]:
        """Whether every stride ended with a heelstrike, (n,)."""
        return ~np.isnan(self.ends[:, 0])


def product(a: NDArray, b: NDArray) -> NDArray:
    """The product of two quantities (n, 1 + k, ...), each with k derivatives behind its value."""
    product = a[:, :1] * b + a * b[:, :1]
    product[:, 0] *= 0.5
    return product


def imbalance(lost: NDArray, supplied: NDArray, push_off: NDArray, lengths: NDArray) -> NDArray:
    """The difference of energy lost and supplied over their mean, (n, 1 + k).

    With legs nearly together, a strike takes back all that the push-off has just given. Compared
    with that alone, every walker that hardly steps would be in balance. So the difference is
    enlarged where steps are short for their push-off, which leaves those of gaits much as they are.
    """
    l0, s0 = lost[:, :1], supplied[:, :1]
    relative = 4.0 * (s0 * lost - l0 * supplied) / (l0 + s0) ** 2
    relative[:, 0] = 2.0 * (lost[:, 0] - supplied[:, 0]) / (lost[:, 0] + supplied[:, 0])
    if not np.any(push_off):
        return relative
    square = product(lengths, lengths)
    enlarged = (push_off - push_off[:, :1] * square / square[:, :1]) / square[:, :1]
    enlarged[:, 0] = push_off[:, 0] / square[:, 0]
    drowned = enlarged[:, 0] > _DROWNED
    enlarged[:, 0] += 1.0
    enlarged[drowned] = np.nan
    return product(relative, enlarged)
