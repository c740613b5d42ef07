"""Tools to test that options have an effect: calls with one option changed, and comparison.

A table holds, for each function, arguments to call it with and another value for each of its
parameters. A function that is called in several ways has the entries "name, way". `missing` reports
a parameter that the table lacks, so a new option needs an entry. Values that are slow to compute,
or that need compiled code, are entered as `Later`.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, fields, is_dataclass
from enum import Enum
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gym_passive_walker.gaits.gait import GaitNotFound


class Later:
    """A value that is computed once, when a test first needs it."""

    def __init__(self, make: Callable[[], Any]) -> None:
        self.value = cache(make)


def _all(result: Any) -> Any:
    return result


def _anything(before: Any, after: Any) -> bool:
    return True


@dataclass(frozen=True)
class To:
    """Another value of an option.

    Attributes:
        value: The value.
        among: Other arguments of both calls, which the option needs to matter.
        same: Whether the result has to stay the same.
        look: The part of a result that is compared.
        expect: What has to hold of the two results, besides that they differ.
        refused: What the error says that the second call ends in instead, a pattern.
    """

    value: Any
    among: Mapping[str, Any] = field(default_factory=dict)
    same: bool = False
    look: Callable[[Any], Any] = _all
    expect: Callable[[Any, Any], Any] = _anything
    refused: str | None = None


@dataclass(frozen=True)
class Call:
    """A function, arguments to call it with, and another value for each of its parameters.

    Attributes:
        function: The function; by default its own signature has the parameters.
        base: Arguments of the first call.
        other: What each parameter is changed to, a plain value or `To`.
        besides: Parameters that are no option of this function, each with the reason.
        of: The function with the signature, if `function` only wraps it.
    """

    function: Callable[..., Any]
    base: Mapping[str, Any]
    other: Mapping[str, Any]
    besides: Mapping[str, str] = field(default_factory=dict)
    of: Callable[..., Any] | None = None

    @property
    def parameters(self) -> list[str]:
        """Names of the function's parameters."""
        of = self.function if self.of is None else self.of
        kinds = inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD
        found = inspect.signature(of).parameters.items()
        return [name for name, parameter in found if parameter.kind not in kinds]


def cases(table: Mapping[str, Call]) -> list[tuple[str, str]]:
    """Every option of a table, as (function, option)."""
    return [(name, option) for name, call in table.items() for option in call.other]


def missing(table: Mapping[str, Call], public: Iterable[str]) -> list[str]:
    """Sentences on parameters that a table lacks, and on entries of removed functions."""
    public, tested = set(public), {name.split(",")[0] for name in table}
    said = [f"{name} has no test that its options are heard" for name in public - tested]
    said += [f"{name} is tested, and is not there" for name in tested - public]
    for name, call in table.items():
        known = {*call.other, *call.besides} - {"self"}
        there = {*call.parameters} - {"self"}
        said += [f"option {x} of {name} has no test that it is heard" for x in there - known]
        said += [f"option {x} of {name} is tested, and is not there" for x in known - there]
    return sorted(said)


def check(call: Call, option: str) -> None:
    """Call a function with and without the changed option, and require a difference."""
    to = call.other[option]
    to = to if isinstance(to, To) else To(to)
    base = {**call.base, **to.among}
    before = to.look(_known(call.function, _now(base)))
    changed = _now({**base, option: to.value})
    if to.refused is not None:
        with pytest.raises((ValueError, GaitNotFound, TimeoutError), match=to.refused):
            call.function(**changed)
        return
    after = to.look(call.function(**changed))
    if to.same:
        assert plain(before) == plain(after), f"{option} changes the result"
    else:
        assert plain(before) != plain(after), f"{option} is not heard"
        assert to.expect(before, after), f"{option} does something else"


_KNOWN: dict[tuple, tuple[Mapping[str, Any], Any]] = {}


def _known(function: Callable[..., Any], arguments: Mapping[str, Any]) -> Any:
    """The result of a call before a change, which the tests of many options share."""
    key = function, *((name, id(value)) for name, value in arguments.items())
    if key not in _KNOWN:
        _KNOWN[key] = arguments, function(**arguments)  # kept, so no other value has its id
    return _KNOWN[key][1]


def _now(arguments: Mapping[str, Any]) -> dict[str, Any]:
    return {
        name: value.value() if isinstance(value, Later) else value
        for name, value in arguments.items()
    }


def plain(value: Any) -> Any:
    """A result in a form that compares bit for bit, NaN equal to NaN."""
    if value is None or isinstance(value, bool | int | str | bytes | type):
        return value
    if isinstance(value, float):
        return value.hex()
    if isinstance(value, complex):
        return value.real.hex(), value.imag.hex()
    if isinstance(value, Enum):
        return value.name
    if isinstance(value, np.ndarray | np.generic):
        array = np.asarray(value)
        if array.dtype == object and array.size and hasattr(array.flat[0], "get_figure"):
            return plain(array.flat[0])  # axes of one figure
        if array.dtype == object:
            return [plain(x) for x in array.ravel().tolist()]
        return array.dtype.str, array.shape, array.tobytes()
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, Mapping):
        return {str(name): plain(part) for name, part in value.items()}
    if hasattr(value, "savefig"):
        return picture(value)
    if hasattr(value, "get_figure"):
        return picture(value.get_figure(root=True))
    if hasattr(value, "detach") and hasattr(value, "cpu"):
        return plain(value.detach().cpu().numpy())
    if isinstance(value, Iterable):
        return [plain(part) for part in value]
    if is_dataclass(value):
        return {part.name: plain(getattr(value, part.name)) for part in fields(value)}
    if hasattr(value, "__dict__"):
        return {name: plain(part) for name, part in vars(value).items()}
    return repr(value)


def picture(figure: Any) -> bytes:
    """The pixels of a figure."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    figure.set_dpi(40)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return bytes(canvas.buffer_rgba())
