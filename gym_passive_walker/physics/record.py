"""A walker's record: all that the engine knows of it, one row of numbers in an array.

Everything is dimensionless: angles in rad, times in sqrt(l/g), energies and torques in m g l.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

ANGLES, RATES = 0, 3  # stance, thigh, shank
TIME, END, STEP = 6, 7, 8  # elapsed, when to stop, proposed length of the next integration step
PHASE, OUTCOME = 9, 10
SIN_SLOPE, COS_SLOPE, TORQUE = 11, 12, 13
# Change of the angle between the legs, net and absolute: the work of a unit torque.
HIP_NET, HIP_TURN = 14, 15
KNEE_TIME, KNEE_LOSS, HEEL_LOSS = 16, 17, 18
STEPS = 19  # integration steps tried
FIELDS = 20

LONGEST_STRIDE = 100.0
"""Time in sqrt(l/g) after which a stride without heelstrike has stalled; a usual one takes 3."""


def new_records(
    states: NDArray,
    slopes: NDArray,
    torques: NDArray | float = 0.0,
    *,
    end: float = LONGEST_STRIDE,
) -> NDArray:
    """Records of walkers at dimensionless states, shape (n, FIELDS)."""
    records = np.zeros((len(states), FIELDS), np.result_type(states, slopes, torques, float))
    records[:, :6] = states
    records[:, END] = end
    records[:, SIN_SLOPE] = np.sin(slopes)
    records[:, COS_SLOPE] = np.cos(slopes)
    records[:, TORQUE] = torques
    return records
