"""Units and axis labels of the columns of a sweep."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import fields

import numpy as np
from numpy.typing import NDArray

from gym_passive_walker.gaits.actuation import Actuation
from gym_passive_walker.render.axes import ANGLE, SLOPE, SPEED
from gym_passive_walker.sweeps.description import Given
from gym_passive_walker.sweeps.tasks import task
from gym_passive_walker.units import units_of
from gym_passive_walker.walkers import Walker

_NAMES = {"slope": SLOPE, "stance_angle": ANGLE, "froude_speed": SPEED, "speed": SPEED}
_NAMES |= {"multiplier": "modulus of the largest multiplier", "seconds": "run time (s)"}
_LENGTHS = ("thigh_length", "thigh_offset", "thigh_gyration", "thigh_com", "foot_radius")
_LENGTHS += ("shank_length", "shank_offset", "shank_gyration", "shank_com")
_UNITS = {
    "rad": ("foot_angle", "period_doubling", "stable_from", "stable_to", "first_end", "last_end",
            "least_angle", "greatest_angle"),
    "strides": ("first_passage", "recovery"),
    "l": (*_LENGTHS, "step_length", "roughness", "step_up", "step_down", "distance"),
    "m": ("thigh_mass", "shank_mass", "hip_mass"),
    "√(l/g)": ("step_period",),
    "√(g l)": ("fastest",),
    "(m g l)": ("hip_stiffness", "knee_stiffness", "hip_torque", "ankle_torque"),
    "(m l √(g l))": ("hip_friction",),
    "(m √(g l))": ("push_off", "push_forward", "push_backward"),
}  # fmt: skip
_SIZES: dict[str, Callable[[Walker], float]] = {
    "l": lambda walker: walker.leg_length,
    "m": lambda walker: walker.total_mass,
    "√(l/g)": lambda walker: units_of(walker).time,
    "(m g l)": lambda walker: units_of(walker).torque,
    "(m √(g l))": lambda walker: units_of(walker).impulse,
    "(m l √(g l))": lambda walker: units_of(walker).torque * units_of(walker).time,
}
_OWN = {*(f.name for f in fields(Walker)), *Actuation._fields}
_OWN_OF = {"gait": {"step_length", "step_period"}}
"""Columns in a walker's own units: walker parameters and actuation, and these results."""


def label(name: str) -> str:
    """Return the axis label of a column, with its unit if it has one."""
    plain = name.replace("_", " ")
    unit = next((unit for unit, names in _UNITS.items() if name in names), "")
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
    measure = next((_SIZES.get(unit) for unit, names in _UNITS.items() if name in names), None)
    if measure is None or name not in _OWN | _OWN_OF.get(analysis, set()):
        return np.ones(len(tasks))
    return np.array([_size(measure, analysis, given) for given in tasks])


def _size(measure: Callable[[Walker], float], analysis: str, given: Given) -> float:
    try:
        taken = task(analysis, given).keywords  # type: ignore[attr-defined]
    except ValueError:
        return np.nan
    walker = taken.get("walker") or taken.get("changes", {}).get("walker")
    return 1.0 if walker is None else measure(walker)
