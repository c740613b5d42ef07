"""What strides make of points of the section: the terms in which a stride map answers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


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
