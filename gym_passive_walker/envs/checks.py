"""What a scene's arguments may be: a number or a sentence on what is allowed."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from gym_passive_walker.arguments import number, shown, unknown


class SceneError(ValueError):
    """The arguments describe no scene; the message says which, and what is allowed."""


def checked(check: Callable[..., Any], *given: Any, **limits: Any) -> Any:
    """Return the result of a check; its errors become a `SceneError`."""
    try:
        return check(*given, **limits)
    except (TypeError, ValueError) as error:
        raise SceneError(str(error)) from None


CHECKS = ("contact", "friction", "knee lock", "scuffing")
"""What may be a rule besides the equations: items of `RealityCheck.passed`, the gravest first."""

ANSWERS = ("ignore", "report", "end")
"""What may come of a check: nothing, a word in `info`, or the episode's end besides."""


def _several(value: Any) -> bool:
    """Whether a value has parts that may be numbers."""
    return np.iterable(value) and not isinstance(value, str | Mapping)


def bounded(name: str, value: Any, low: float, high: float) -> float:
    """The value as a finite number from `low` to `high`."""
    try:
        found = number(value, name)
    except ValueError:
        found = math.nan
    if not low <= found <= high:
        raise SceneError(f"{name} must be a number from {low:g} to {high:g}, not {shown(value)}")
    return found


def spread(name: str, value: Any, low: float, high: float) -> tuple[float, float]:
    """A number twice, or a range (low, high), within bounds."""
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


def checked_pushes(pushes: Any) -> dict[str, Any]:
    """How often and how hard the hip is pushed; empty if it is not."""
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
    """Standard deviations of a sensor's errors: one of angles and rates, or one an entry."""
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
    """What comes of each check; those that are ignored are left out."""
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
        raise SceneError("'knee lock' is a check of walkers with knees: straight legs have none")
    return found
