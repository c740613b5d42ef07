"""Units and axis labels of the columns of a sweep."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import fields

import numpy as np
from numpy.typing import NDArray

from gym_passive_walker.apps.sweeps.description import Given
from gym_passive_walker.apps.sweeps.tasks import task
from gym_passive_walker.gaits.actuation import Actuation
from gym_passive_walker.gaits.control.maps import stride_map
from gym_passive_walker.models.units import KINDS, UNITS, Units
from gym_passive_walker.models.walkers import Walker
from gym_passive_walker.pictures.axes import ANGLE, SLOPE, SPEED

_NAMES = {"slope": SLOPE, "stance_angle": ANGLE, "froude_speed": SPEED, "speed": SPEED}
_NAMES |= {"multiplier": "modulus of the largest multiplier", "seconds": "run time (s)"}
_RESULTS = {
    "angle": ("period_doubling", "stable_from", "stable_to", "first_end", "last_end",
              "least_angle", "greatest_angle"),
    "count": ("first_passage", "recovery"),
    "length": ("step_length", "roughness", "step_up", "step_down", "distance"),
    "time": ("step_period",),
    "speed": ("fastest",),
    "impulse": ("push_forward", "push_backward"),
}  # fmt: skip
_KINDS = KINDS | {name: kind for kind, names in _RESULTS.items() for name in names}
_KINDS.pop("gravity")  # over itself it would be 1
_SYMBOLS = {"count": "strides"} | {kind: symbol for kind, (symbol, _) in UNITS.items()}
_OWN = {f.name for f in fields(Walker)}
_OWN_OF = {"gait": {*Actuation._fields, "step_length", "step_period"}}
"""Columns in a walker's own units: walker parameters, and actuation and results of gaits."""


def label(name: str) -> str:
    """Return the axis label of a column, with its unit if it has one."""
    plain, unit = name.replace("_", " "), _SYMBOLS.get(_KINDS.get(name, ""))
    said = f" ({unit})" if unit in ("rad", "strides") else f" / {unit}" if unit else ""
    return _NAMES.get(name, plain + said)


def sizes(name: str, analysis: str, tasks: Sequence[Given]) -> NDArray[np.float64]:
    """Return the divisors that convert the values of a column to the unit of its label.

    Args:
        name: The column.
        analysis: Name of the sweep's analysis.
        tasks: Arguments of each row's task.

    Returns:
        Shape (tasks,): 1 where values are dimensionless, NaN where the walker is invalid.
    """
    if name not in _OWN | _OWN_OF.get(analysis, set()) or name not in _KINDS:
        return np.ones(len(tasks))
    _, unit = UNITS[_KINDS[name]]
    return np.array([_size(unit, analysis, given) for given in tasks])


def _size(unit: Callable[[Walker, Units], float], analysis: str, given: Given) -> float:
    try:
        taken = task(analysis, given).keywords  # type: ignore[attr-defined]
        walker = taken.get("walker") or taken.get("changes", {}).get("walker")
        if walker is None and {"controller", "scene"} & taken.keys():
            names = ("slope", "controller", "scene")
            walker = stride_map(**{name: taken[name] for name in names if name in taken}).walker
    except ValueError:
        return np.nan
    return 1.0 if walker is None else unit(walker, walker.units)
