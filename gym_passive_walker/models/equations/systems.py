"""The systems of all kinds of walkers, by name."""

from __future__ import annotations

import numpy as np

from gym_passive_walker.models.equations import kneed, legs, simplest, straight
from gym_passive_walker.models.equations.hybrid import Outcome, Reset, State, System

FITTINGS = ("hip_stiffness", "hip_friction", "knee_stiffness")
"""Constants of springs and friction at a walker's joints."""

EXTRAS = (*FITTINGS, "ankle", "push_off")
"""Optional features of walkers; the code of a walker without them omits them."""

UNEVEN = ("height_change", "slope_change")
"""Changes of the ground between footholds; the code for smooth ground omits them."""

_KINDS = (kneed.SYSTEM, straight.SYSTEM, simplest.SYSTEM)


def _on_smooth_ground(kind: System) -> System:
    """A system on ground of one slope."""
    phases = tuple(map(legs.on_smooth_ground, kind.phases))
    return kind._replace(name=f"{kind.name}-fitted", phases=phases, absent=UNEVEN)


def _bare(kind: System) -> System:
    """A system on ground of one slope, of walkers with legs and a hip actuator only."""
    bare = _on_smooth_ground(kind)._replace(name=kind.name, absent=(*EXTRAS, *UNEVEN))
    rng, names = np.random.default_rng(0), bare.Body._fields  # type: ignore[attr-defined]
    body = bare.Body(*(0.0 if name in bare.absent else rng.uniform(1.0, 2.0) for name in names))
    start, end = (State(*rng.normal(size=len(State._fields))) for _ in range(2))
    # Energies that are zero at any state need not be followed.
    if bare.spring_gain and bare.spring_gain(body, start, end) == 0.0:
        bare = bare._replace(spring_gain=None)
    if bare.friction_power and bare.friction_power(body, start) == 0.0:
        bare = bare._replace(friction_power=None)
    return bare


def _anywhere(kind: System) -> System:
    """A system with all features."""
    return kind._replace(name=f"{kind.name}-uneven")


SYSTEMS: dict[str, System] = {}
"""Systems by name: those of users, and three of each kind of the package. These are one without
extras, one with all `EXTRAS`, and one for `UNEVEN` ground too."""


def held(kind: System) -> System:
    """A system of walkers with knees of which the trailing one stays locked in the heelstrike."""
    *others, locked = kind.phases
    strikes = {Outcome.HEELSTRIKE: Reset(straight.heelstrike)}
    phases = *others, locked._replace(resets=locked.resets | strikes)
    return kind._replace(name=kind.name.replace("kneed", "held"), phases=phases)


def system_of(name: str) -> System:
    """Return a system by its name; those of held knees are made when they are first used."""
    if name not in SYSTEMS and name.startswith("held"):
        register_system(held(SYSTEMS[name.replace("held", "kneed")]))
    return SYSTEMS[name]


def register_system(system: System) -> System:
    """Add a system under its name; the package adds its own systems in this way too."""
    SYSTEMS[system.name] = system
    return system


for _made in (_bare, _on_smooth_ground, _anywhere):
    for _kind in _KINDS:
        register_system(_made(_kind))
