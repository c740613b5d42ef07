"""Names of walkers in messages and pictures."""

from __future__ import annotations

from typing import Any

from gym_passive_walker.models.walkers.presets import WALKERS
from gym_passive_walker.models.walkers.tuning import tune
from gym_passive_walker.models.walkers.walker import Walker


def name_of(walker: Any) -> str:
    """A walker's title, or name as a preset, tuned or not; else its kind, leg length and mass."""
    if walker.title:
        return walker.title
    for name, preset in WALKERS.items():
        if preset == walker:
            return name
    for name, preset in WALKERS.items():
        if tune(preset) == walker:
            return f"{name} (tuned)"
    kind = "kneed" if walker.knees else "simplest" if walker.massless_legs else "straight-legged"
    return f"{kind}, leg length {walker.leg_length:.4g}, mass {walker.total_mass:.4g}"


def describe(walker: Any) -> str:
    """Name of a walker within a sentence: its title, the preset's name, or its parameters."""
    name = name_of(walker)
    if not isinstance(walker, Walker):
        return f"system {name!r}"
    return f"walker {name!r}" if walker.title or name in WALKERS else str(walker)
