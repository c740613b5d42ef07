"""Numbers as users give them, checked."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

FINEST_TOLERANCE, COARSEST_TOLERANCE = 1e-15, 0.1


def real_array(value: ArrayLike, name: str, allowed: str) -> NDArray[np.float64]:
    """The value as an array of finite real numbers.

    Raises:
        ValueError: if it is none; the message names the argument and what is allowed.
    """
    try:
        given = np.asarray(value)
        if given.dtype.kind in "bcSUmM":  # some of these numpy would take for numbers
            raise TypeError
        numbers = np.asarray(given, dtype=float)
    except (TypeError, ValueError):
        raise ValueError(f"{name} must be {allowed}, not {value!r}") from None
    if not np.all(np.isfinite(numbers)):
        raise ValueError(f"{name} must be {allowed}, all finite, not {value!r}")
    return numbers


def check_tolerance(tolerance: Any) -> float:
    """The tolerance, if it can be met."""
    allowed = f"a number between {FINEST_TOLERANCE} and {COARSEST_TOLERANCE}"
    number = real_array(tolerance, "tolerance", allowed)
    if number.ndim or not FINEST_TOLERANCE <= number <= COARSEST_TOLERANCE:
        raise ValueError(f"tolerance must be {allowed}, not {tolerance!r}")
    return float(number)


def check_slope(slope: ArrayLike) -> NDArray[np.float64]:
    """Slopes, if they are finite and less than upright."""
    allowed = "an angle in rad between -pi/2 and pi/2, or an array of them"
    slopes = real_array(slope, "slope", allowed)
    if not np.all(np.abs(slopes) < 0.5 * np.pi):
        raise ValueError(f"slope must be {allowed}, not {slope!r}")
    return slopes


def check_state(state: ArrayLike) -> NDArray[np.float64]:
    """States as an array of shape (..., 6), if finite."""
    allowed = "[stance, thigh, shank angle, then their rates]: shape (6,) or (n, 6)"
    states = real_array(state, "state", allowed)
    if states.ndim == 0 or states.shape[-1] != 6:
        raise ValueError(f"state must be {allowed}, not {states.shape}")
    return states
