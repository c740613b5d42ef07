"""Arguments that make sense, or a sentence on what would."""

from __future__ import annotations

import math
from typing import Any

from gym_passive_walker.physics.arguments import check_slope


def _single(value: Any, name: str) -> float:
    try:
        if isinstance(value, str | bytes):
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
        whole_number = found == value and found >= least
    except (TypeError, ValueError, OverflowError):
        whole_number = False
    if not whole_number:
        raise ValueError(f"{name} must be a whole number from {least} on, not {value!r}")
    return found


def gait_kind(kind: Any) -> Any:
    """A kind of gait, "long" or "short".

    Raises:
        ValueError: if it is neither.
    """
    if kind not in ("long", "short"):
        raise ValueError(f'kind must be "long" or "short", not {kind!r}')
    return kind
