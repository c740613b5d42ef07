"""Output of commands: tables for people, JSON for programs."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import fields, is_dataclass
from enum import Enum
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from gym_passive_walker._tools.console import in_columns
from gym_passive_walker.gaits.measures import SI, SYMBOLS, UNIT_OF

_WORDS = {
    "state": "section state",
    "froude_speed": "speed / √(g l)",
    "kneestrike_time": "kneestrike",
    "multiplier": "|multiplier|",
    "leg_length": "leg",
    "total_mass": "mass",
    "outcome": "ends with",
    "about": "what it is",
}
"""Labels of quantities with a name that is not their label."""

_KINDS = UNIT_OF | {
    "stance_angles": "angle", "leg_length": "length", "total_mass": "mass", "seconds": "time",
}  # fmt: skip
PLAIN = SYMBOLS | {"state": "rad, √(g/l)"}
"""Units of dimensionless quantities."""


class Report(NamedTuple):
    """The result of a command.

    Attributes:
        text: Output for people.
        data: Output for programs: anything that `plain` converts to JSON.
        files: Functions that write further files, by path. They are called after the text is
            printed, so that a full disk does not lose the result.
        then: A function that is called at last, such as a server.
    """

    text: str
    data: Any
    files: Mapping[Path, Callable[[Path], object]] = MappingProxyType({})
    then: Callable[[], object] = lambda: None


def record(source: Any, names: Iterable[str]) -> dict[str, Any]:
    """Some of an object's attributes, as a dict by name."""
    return {name: getattr(source, name) for name in names}


def table_rows(columns: Mapping[str, Iterable[Any]]) -> list[dict[str, Any]]:
    """The rows of a table from its columns."""
    return [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]


def listing(title: str, values: Mapping[str, Any], units: Mapping[str, str] = SI) -> str:
    """A title, and below it one line for each quantity."""
    labels = [_label(name, units) for name in values]
    width = max(map(len, labels))
    lines = [
        f"  {label:<{width}}  {_written(value, digits=8)}"
        for label, value in zip(labels, values.values(), strict=True)
    ]
    return "\n".join([title, *lines])


def table(rows: Sequence[Mapping[str, Any]], units: Mapping[str, str] = SI) -> str:
    """A table with a column for each quantity; text aligned left, numbers right."""
    cells = [[_label(name, units) for name in rows[0]]]
    cells += [[_written(value) for value in row.values()] for row in rows]
    words = [i for i, value in enumerate(rows[0].values()) if isinstance(value, str)]
    return "\n".join(in_columns(cells, left=words))


def plain(value: Any) -> Any:
    """Convert a value for JSON: NaN to null, a complex number to its parts, an enum to its name."""
    match value:
        case Enum():
            return value.name
        case None | bool() | int() | str():
            return value
        case float():
            return value if math.isfinite(value) else None
        case complex():
            return [plain(value.real), plain(value.imag)]
        case np.ndarray() | np.generic():
            return plain(value.tolist())
        case Mapping():
            return {str(name): plain(part) for name, part in value.items()}
    if "McGeer's parameters" not in getattr(value, "supports", ("McGeer's parameters",)):
        return {"name": value.title} | plain(value.parameters)  # its functions are no numbers
    if is_dataclass(value):
        return plain({field.name: getattr(value, field.name) for field in fields(value)})
    if hasattr(value, "_asdict"):
        return plain(value._asdict())
    if isinstance(value, Iterable):
        return [plain(part) for part in value]
    return str(value)


def _label(name: str, units: Mapping[str, str]) -> str:
    words, unit = _WORDS.get(name, name.replace("_", " ")), units.get(_KINDS.get(name, ""), "")
    return f"{words} ({unit})" if unit else words


def _written(value: Any, digits: int = 6) -> str:
    """A quantity as text, with `digits` significant digits."""
    match value:
        case Enum():
            return value.name.lower().replace("_", " ")
        case bool() | np.bool_():
            return ("no", "yes")[int(value)]
        case str():
            return value
        case complex() if value.imag:
            return f"{value.real:.{digits}g}{value.imag:+.{digits}g}i"
        case complex():
            return _written(value.real, digits)
        case np.ndarray() | tuple() | list():
            return ", ".join(_written(part, digits) for part in value) or "none"
    return "-" if math.isnan(value) else f"{value:.{digits}g}"
