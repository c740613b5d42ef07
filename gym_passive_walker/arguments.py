"""Arguments that make sense, or a sentence on what would."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from difflib import get_close_matches
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


def _single(value: Any, name: str) -> float:
    try:
        if isinstance(value, str | bytes | bool | np.bool_):
            raise TypeError
        return float(value)
    except (TypeError, ValueError):
        raise ValueError(f"{name} must be one number, not {value!r}") from None


def one_slope(slope: Any, name: str = "slope") -> float:
    """A single slope in rad.

    Raises:
        ValueError: if it is not one finite angle between upright slopes.
    """
    return float(check_slope(_single(slope, name)))


def several_slopes(slopes: ArrayLike) -> NDArray[np.float64]:
    """Slopes of walks downhill in rad, (n,).

    Raises:
        ValueError: if they are not one or more angles above 0.
    """
    try:
        values = np.atleast_1d(np.asarray(slopes, dtype=float))
    except (TypeError, ValueError):
        raise ValueError(f"slopes must be angles in rad, not {slopes!r}") from None
    check_slope(values)
    if values.ndim != 1 or len(values) == 0 or np.any(values <= 0.0):
        raise ValueError("slopes must be one or more angles in rad above 0, in one row")
    return values


def number(value: Any, name: str, *, least: float = -math.inf, above: float = -math.inf) -> float:
    """A single number from `least` on that is greater than `above`.

    Raises:
        ValueError: if it is not.
    """
    found = _single(value, name)
    if math.isnan(found) or found < least or (found <= above and above > -math.inf):
        limit = f" above {above:g}" if above > -math.inf else ""
        limit = f" from {least:g} on" if least > -math.inf else limit
        raise ValueError(f"{name} must be a number{limit}, not {value!r}")
    return found


def whole(value: Any, name: str, least: int = 1) -> int:
    """A whole number from `least` on.

    Raises:
        ValueError: if it is not.
    """
    try:
        found = int(value)
        truth = isinstance(value, bool | np.bool_)
        whole_number = found == value and found >= least and not truth
    except (TypeError, ValueError, OverflowError):
        whole_number = False
    if not whole_number:
        raise ValueError(f"{name} must be a whole number from {least} on, not {value!r}")
    return found


def unknown(names: Iterable[Any], known: Sequence[str], who: str) -> str | None:
    """A sentence on names that are not known, and the nearest that are; None if all are known.

    Args:
        names: What was asked for.
        known: All that there is.
        who: Whose names they are: "a walker".
    """
    strange = [name for name in names if name not in known]
    if not strange:
        return None
    near = {name: get_close_matches(str(name), known, 1) for name in strange}
    said = [f"{name} ({close[0]}?)" if close else str(name) for name, close in near.items()]
    return f"{who} has no {', '.join(said)}; it has {', '.join(known)}"


def gait_kind(kind: Any) -> Any:
    """A kind of gait, "long" or "short".

    Raises:
        ValueError: if it is neither.
    """
    if kind not in ("long", "short"):
        raise ValueError(f'kind must be "long" or "short", not {kind!r}')
    return kind
