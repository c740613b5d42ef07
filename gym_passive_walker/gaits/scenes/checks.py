"""Validation of the arguments of a scene; errors name the allowed values."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from gym_passive_walker._tools.arguments import number, shown, unknown


class SceneError(ValueError):
    """The arguments describe no scene; the message says which, and what is allowed."""


class UnknownArgumentError(SceneError, TypeError):
    """A scene has no argument of that name.

    It is a `TypeError` with Python's own words, by which libraries find arguments to leave out.
    """


def checked(check: Callable[..., Any], *given: Any, **limits: Any) -> Any:
    """Return the result of a check; its errors become a `SceneError`."""
    try:
        return check(*given, **limits)
    except (TypeError, ValueError) as error:
        raise SceneError(str(error)) from None


def check_point_feet(actions: Sequence[str], *walkers: Any) -> None:
    """Check that walkers with an ankle torque have point feet.

    Raises:
        ValueError: if the foot of one is round.
    """
    if "ankle" in actions and any(walker.foot_radius != 0.0 for walker in walkers):
        raise ValueError(
            "the action 'ankle' needs point feet: a round foot rolls, and the ground under it "
            "bears no torque; choose a walker with foot_radius=0"
        )


CHECKS = ("contact", "friction", "knee lock", "scuffing")
"""Feasibility constraints: items of `RealityCheck.passed`, the most severe first."""

ANSWERS = ("ignore", "report", "end")
"""Results of a constraint: none, entries in `info`, or entries and the end of the episode."""


def _several(value: Any) -> bool:
    """Return whether a value is iterable and neither a string nor a mapping."""
    return np.iterable(value) and not isinstance(value, str | Mapping)


def bounded(name: str, value: Any, low: float, high: float) -> float:
    """Return the value as a finite number from `low` to `high`.

    Raises:
        SceneError: if it is none.
    """
    try:
        found = number(value, name)
    except ValueError:
        found = math.nan
    if not low <= found <= high:
        raise SceneError(f"{name} must be a number from {low:g} to {high:g}, not {shown(value)}")
    return found


def spread(name: str, value: Any, low: float, high: float) -> tuple[float, float]:
    """Return a range (low, high) within bounds; a single number gives both ends.

    Raises:
        SceneError: if it is none.
    """
    try:
        found = [number(end, name) for end in (list(value) if _several(value) else [value])]
    except ValueError:
        found = []
    if len(found) not in (1, 2) or not low <= found[0] <= found[-1] <= high:
        raise SceneError(
            f"{name} must be a number from {low:g} to {high:g}, or a range of them as (low, high), "
            f"not {shown(value)}"
        )
    return found[0], found[-1]


def several(name: str, given: Any, allowed: Sequence[str], least: int = 0) -> tuple[str, ...]:
    """Return a name, or a row of at least some names, as a tuple of allowed names.

    Raises:
        SceneError: if a name is not allowed or occurs twice, or there are too few.
    """
    row = (given,) if isinstance(given, str) else given
    names = tuple(row) if np.iterable(row) else ("",)
    strange = [each for each in names if each not in allowed]
    if strange or len(set(names)) < len(names) or len(names) < least:
        some = f"some of {', '.join(map(repr, allowed))}, each once" if allowed else "()"
        raise SceneError(f"{name} must be {some}, not {shown(given)}")
    return names


def checked_pushes(pushes: Any) -> dict[str, Any]:
    """Return rate and range of impulses of pushes on the hip; empty without pushes.

    Raises:
        SceneError: if they are invalid.
    """
    if pushes is None or pushes == {}:
        return {}
    if not isinstance(pushes, Mapping) or set(pushes) != {"rate", "impulse"}:
        raise SceneError(
            "pushes must have a rate, how many there are in sqrt(l/g), and an impulse as a range "
            f'in m sqrt(g l): {{"rate": 0.05, "impulse": (-0.05, 0.05)}}, not {shown(pushes)}'
        )
    return {
        "rate": bounded("pushes['rate']", pushes["rate"], 0.0, 100.0),
        "impulse": spread("pushes['impulse']", pushes["impulse"], -10.0, 10.0),
    }


def checked_noise(noise: Any, size: int) -> float | tuple[float, ...]:
    """Return standard deviations of the observation noise, as one number or one for each entry.

    A single number applies to angles and angular velocities.

    Raises:
        SceneError: if they are invalid.
    """
    if not _several(noise):
        return bounded("observation_noise", noise, 0.0, 10.0)
    if len(noise) != size:
        raise SceneError(
            f"observation_noise must be a number, of angles and rates, or {size} of them, one for "
            "each "
            f"entry of the observation, not {shown(noise)}"
        )
    return tuple(
        bounded(f"observation_noise[{i}]", each, 0.0, 10.0) for i, each in enumerate(noise)
    )


def checked_constraints(constraints: Any, *, knees: bool) -> dict[str, str]:
    """Return the result of each constraint by name, without those that are ignored.

    Raises:
        SceneError: if a name or a result is invalid, or the walker has no knees to lock.
    """
    if not isinstance(constraints, Mapping):
        raise SceneError(
            f"constraints must map checks to what comes of them, not {shown(constraints)}"
        )
    if said := unknown(constraints, CHECKS, "constraints"):
        raise SceneError(said)
    for name, answer in constraints.items():
        if answer not in ANSWERS:
            allowed = ", ".join(map(repr, ANSWERS))
            raise SceneError(f"constraints[{name!r}] must be one of {allowed}, not {shown(answer)}")
    found = {
        name: constraints[name] for name in CHECKS if constraints.get(name, "ignore") != "ignore"
    }
    if "knee lock" in found and not knees:
        raise SceneError(
            "'knee lock' is a check of walkers with knees: straight legs have none, and a system's "
            "equations move its own"
        )
    return found
