"""Validation of arguments, with messages that say what is allowed."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterable, Sequence
from difflib import get_close_matches
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker._tools.console import cut

FINEST_TOLERANCE, COARSEST_TOLERANCE = 1e-15, 0.1
KEPT = 10_000_000
"""Largest number of items, such as walkers, that are held in memory together."""

_MOST = 1_000_000_000  # largest number of items that are only counted
_T = TypeVar("_T")


def shown(value: Any) -> str:
    """Return the text of a value for a message; long text is shortened."""
    try:
        text = repr(value)
    except Exception:  # `repr` of foreign objects may raise anything
        text = f"a {type(value).__name__}"
    return cut(text)


def real_array(value: ArrayLike, name: str, allowed: str) -> NDArray[np.float64]:
    """Return a value as an array of finite real numbers.

    Raises:
        ValueError: if it is not one; the message names the argument and what is allowed.
    """
    try:
        given = np.asarray(value)
        if given.dtype.kind in "bcSUmM":  # numpy converts some of these to floats
            raise TypeError
        numbers = np.asarray(given, dtype=float)
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"{name} must be {allowed}, not {shown(value)}") from None
    if not np.all(np.isfinite(numbers)):
        raise ValueError(f"{name} must be {allowed}, all finite, not {shown(value)}")
    return numbers


def check_slope(
    slope: ArrayLike, name: str = "slope", also: str = ", or an array of them"
) -> NDArray[np.float64]:
    """Return slopes in rad as an array, if all are between -pi/2 and pi/2.

    Args:
        slope: Slopes in rad, a number or an array.
        name: The argument's name.
        also: End of the message: what is allowed besides one angle.

    Raises:
        ValueError: if a slope is not such an angle.
    """
    allowed = f"an angle in rad between -pi/2 and pi/2{also}"
    slopes = real_array(slope, name, allowed)
    if not np.all(np.abs(slopes) < 0.5 * np.pi):
        raise ValueError(f"{name} must be {allowed}, not {shown(slope)}")
    return slopes


_OF_LEGS = "[stance, thigh, shank angle, then their rates]: shape (6,) or (n, 6)"


def check_state(state: ArrayLike, name: str = "state", of: Any = None) -> NDArray[np.float64]:
    """States of a model as an array of shape (..., size), if finite.

    Args:
        state: The states.
        name: Name of the argument.
        of: The model; a walker with McGeer's parameters when None.
    """
    size, allowed = 6, _OF_LEGS
    if of is not None and "McGeer's parameters" not in of.supports:
        size = of.size
        allowed = f"[{', '.join(of.state_names)}]: shape ({size},) or (n, {size})"
    states = real_array(state, name, allowed)
    if states.ndim == 0 or states.shape[-1] != size:
        raise ValueError(f"{name} must be {allowed}, not {states.shape}")
    return states


def _single(value: Any, name: str) -> float:
    if type(value) is float:  # the common case
        return value
    try:
        if isinstance(value, str | bytes | bool | np.bool_ | np.complexfloating) or np.ndim(value):
            raise TypeError
        return float(value)
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"{name} must be one number, not {shown(value)}") from None


def one_slope(slope: Any, name: str = "slope") -> float:
    """Return a single slope in rad.

    Raises:
        ValueError: if it is not one angle between -pi/2 and pi/2.
    """
    return float(check_slope(_single(slope, name), name, ""))


def several_slopes(slopes: ArrayLike, name: str, *, downhill: bool = True) -> NDArray[np.float64]:
    """Return slopes in rad, (n,).

    Args:
        slopes: Slopes in rad, a number or (n,).
        name: Name of the argument.
        downhill: Whether slopes must be above 0, as passive walkers require.

    Raises:
        ValueError: if the slopes are not one or more angles, above 0 if `downhill`.
    """
    values = np.atleast_1d(check_slope(slopes, name))
    if values.ndim != 1 or len(values) == 0 or (downhill and np.any(values <= 0.0)):
        above = " above 0" * downhill
        raise ValueError(
            f"{name} must be one or more angles in rad{above}, in one row, not {shown(slopes)}"
        )
    return values


def number(
    value: Any,
    name: str,
    *,
    least: float = -sys.float_info.max,
    above: float = -math.inf,
    most: float = sys.float_info.max,
) -> float:
    """Return a number from `least` to `most` that is above `above`.

    Infinity is allowed only if `most` is infinite.

    Raises:
        ValueError: if the value is not such a number.
    """
    found = _single(value, name)
    if not least <= found <= most or found <= above:
        bounded = most < sys.float_info.max
        if least > -sys.float_info.max:
            limit = f" from {least:g} to {most:g}" if bounded else f" from {least:g} on"
        else:
            limit = f" above {above:g}" * (above > -math.inf) + f" up to {most:g}" * bounded
        finite = "" if math.isfinite(found) or most == math.inf else "finite "
        raise ValueError(f"{name} must be a {finite}number{limit}, not {shown(value)}")
    return found


def check_tolerance(tolerance: Any) -> float:
    """Return the tolerance, if it is from FINEST_TOLERANCE to COARSEST_TOLERANCE.

    Raises:
        ValueError: if it is not.
    """
    return number(tolerance, "tolerance", least=FINEST_TOLERANCE, most=COARSEST_TOLERANCE)


def whole(value: Any, name: str, least: int = 1, most: int = _MOST) -> int:
    """Return an integer from `least` to `most`.

    Raises:
        ValueError: if the value is not such an integer.
    """
    try:
        found = int(value)
        said = isinstance(value, bool | np.bool_)
        whole_number = bool(found == value) and found >= least and not said
    except (TypeError, ValueError, OverflowError):
        found, whole_number = least, False
    if not whole_number or found > most:
        limit = f"from {least} to {most}" if found > most else f"from {least} on"
        raise ValueError(f"{name} must be a whole number {limit}, not {shown(value)}")
    return found


def seed_number(value: Any, name: str = "seed") -> int:
    """Return a seed of random numbers, an integer from 0 to 2^128 - 1.

    Raises:
        ValueError: if the value is not such an integer.
    """
    return whole(value, name, 0, 2**128 - 1)


def boolean(value: Any, name: str) -> bool:
    """Return a boolean.

    Raises:
        ValueError: if the value is neither True nor False.
    """
    if not isinstance(value, bool | np.bool_):
        raise ValueError(f"{name} must be True or False, not {shown(value)}")
    return bool(value)


def instance(value: Any, kind: type[_T], name: str, source: str) -> _T:
    """Return an object, if it is an instance of a class.

    Args:
        value: The object.
        kind: The class.
        name: The argument's name.
        source: Part of the message: an example of such an object.

    Raises:
        ValueError: if it is not an instance.
    """
    if not isinstance(value, kind):
        raise ValueError(f"{name} must be a {kind.__name__}, such as {source}, not {shown(value)}")
    return value


def unknown(names: Iterable[Any], known: Sequence[str], owner: str) -> str | None:
    """Return a message on unknown names, with similar known ones; None if all are known.

    Args:
        names: The names to check.
        known: All known names.
        owner: Subject of the message, such as "a walker".
    """
    strange = [str(name) for name in names if name not in known]
    if not strange:
        return None
    said = [cut(name) + near(name, known) for name in dict.fromkeys(strange)]
    return f"{owner} has no {', '.join(said)}; it has {', '.join(known)}"


def near(name: Any, known: Iterable[str]) -> str:
    """Return the known name that is most like a name, as " (level?)"; empty if none is."""
    close = get_close_matches(str(name)[:100], [*known], 1)
    return f" ({close[0]}?)" if close else ""


def gait_kind(kind: Any) -> Any:
    """Return a kind of gait, "long" or "short".

    Raises:
        ValueError: if the value is neither.
    """
    if not isinstance(kind, str) or kind not in ("long", "short"):
        raise ValueError(f'kind must be "long" or "short", not {shown(kind)}')
    return kind
