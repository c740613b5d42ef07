"""Results of a stride map: points of the section after some strides, and measures of these."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

_DROWNED = 1e6
"""Limit of the push-off over the step length squared, which is about 1 on most gaits. Above it,
rounding exceeds the accuracy of gaits."""


class NoStride(ValueError):
    """The stride did not end with a heelstrike, so the map has no value there."""


@dataclass(frozen=True)
class Change:
    """Measures of strides from n points, dimensionless; NaN where a walker fell.

    Arrays of derivatives have one more axis, the last, with a column for each direction.

    Attributes:
        ends: Points after the strides, (n, m).
        durations: Total duration of the strides, (n,).
        lengths: Total length of the steps along the slope, (n,).
        lost: Energy lost at impacts and to friction, (n,).
        supplied: Energy supplied by gravity and actuators, as if each stride ended at the height
            where it began, (n,).
        braked: Absolute less net work of torques, (n,): energy spent beyond that supplied.
        knee_times: Time of kneestrike in the last stride, (n,); NaN without knees.
        imbalance: Energy lost less energy supplied, over their mean, (n,). It is zero on a gait,
            and precise where the small difference of two states would not be. With a push-off P it
            is multiplied by 1 + P / lengths^2; NaN where P / lengths^2 exceeds 1e6.
    """

    ends: NDArray[np.float64]
    durations: NDArray[np.float64]
    lengths: NDArray[np.float64]
    lost: NDArray[np.float64]
    supplied: NDArray[np.float64]
    braked: NDArray[np.float64]
    knee_times: NDArray[np.float64]
    imbalance: NDArray[np.float64]


@dataclass(frozen=True)
class Passage(Change):
    """Results of applying a stride map to n points.

    Attributes:
        outcomes: `Outcome` of each walker's last stride, (n,): STALLED if it was given up,
            DIVERGED if the walker's point was not finite.
    """

    outcomes: NDArray[np.int8]

    @property
    def alive(self) -> NDArray[np.bool_]:
        """Whether every stride ended with a heelstrike, (n,)."""
        return ~np.isnan(self.ends[:, 0])


def product(a: NDArray, b: NDArray) -> NDArray:
    """Multiply two quantities (n, 1 + k, ...), each a value followed by its k derivatives."""
    product = a[:, :1] * b + a * b[:, :1]
    product[:, 0] *= 0.5
    return product


def imbalance(lost: NDArray, supplied: NDArray, push_off: NDArray, lengths: NDArray) -> NDArray:
    """Return the difference of energy lost and supplied over their mean, (n, 1 + k).

    With legs nearly together, an impact absorbs all the energy that the push-off has just supplied.
    Every point with tiny steps would then seem to be in balance. So the difference is enlarged
    where steps are short for their push-off. Values near gaits hardly change.
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
