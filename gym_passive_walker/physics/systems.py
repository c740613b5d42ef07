"""Every kind of walker, and which of them a walker is."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker.physics import kneed, legs, simplest, straight
from gym_passive_walker.physics.bodies import body_from
from gym_passive_walker.physics.hybrid import State, System
from gym_passive_walker.walkers import Mechanism, Walker, varied

FITTINGS = ("hip_stiffness", "hip_friction", "knee_stiffness")
"""Constants of what may be fitted to a walker's joints."""

EXTRAS = (*FITTINGS, "ankle", "push_off")
"""What walkers may have; others run code without it."""

UNEVEN = ("height_change", "slope_change")
"""What the ground may do from foothold to foothold; smooth ground runs code without it."""

_KINDS = (kneed.SYSTEM, straight.SYSTEM, simplest.SYSTEM)


def _on_smooth_ground(kind: System) -> System:
    """A system on ground of one slope."""
    phases = tuple(map(legs.on_smooth_ground, kind.phases))
    return kind._replace(name=f"{kind.name}-fitted", phases=phases, absent=UNEVEN)


def _bare(kind: System) -> System:
    """A system on ground of one slope, of walkers that have nothing more than legs and a hip."""
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
    """A system with all there may be."""
    return kind._replace(name=f"{kind.name}-uneven")


SYSTEMS: dict[str, System] = {}
"""By name: users' systems, and of each kind of the package a bare one, one with all `EXTRAS`, and
one for `UNEVEN` ground too."""


def register(system: System) -> System:
    """Make a system known by its name; the package registers its own in this way too."""
    SYSTEMS[system.name] = system
    return system


for _made in (_bare, _on_smooth_ground, _anywhere):
    for _kind in _KINDS:
        register(_made(_kind))


def kind_of(walker: Walker) -> str:
    """What kind of legs a walker has: "kneed", "straight", "simplest", or a user's own."""
    if isinstance(walker, Mechanism):
        return walker.hybrid.name
    if walker.massless_legs:
        return simplest.SYSTEM.name
    return kneed.SYSTEM.name if walker.knees else straight.SYSTEM.name


def system_of(*walkers: Walker, using: Collection[str] = ()) -> System:
    """Which equations walkers of one kind obey.

    Args:
        walkers: The walkers.
        using: What else there is of `EXTRAS` and `UNEVEN`, or may be: controls in use, parameters
            that vary, ground that does.
    """
    if isinstance(walkers[0], Mechanism):
        smooth = set(UNEVEN).isdisjoint(using)
        return walkers[0].hybrid if smooth else walkers[0].uneven
    if not set(UNEVEN).isdisjoint(using):
        return SYSTEMS[f"{kind_of(walkers[0])}-uneven"]
    fitted = any(getattr(walker, name) for walker in walkers for name in FITTINGS)
    fitted = fitted or not set(EXTRAS).isdisjoint(using)
    return SYSTEMS[f"{kind_of(walkers[0])}-fitted" if fitted else kind_of(walkers[0])]


def body_of(walker: Walker) -> Any:
    """The constants of a walker."""
    return body_from(walker, SYSTEMS[kind_of(walker)].Body)


@lru_cache(maxsize=4096)
def _row(walker: Walker) -> NDArray[np.float64]:
    if isinstance(walker, Mechanism):
        return np.array(walker.body, dtype=float)[None, None]
    return np.array(body_of(walker), dtype=float)[None, None]


def bodies(*walkers: Walker) -> NDArray[np.float64]:
    """Constants of walkers of one kind as the engine reads them, (walkers, 1, constants)."""
    return np.concatenate([_row(walker) for walker in walkers])


_INFINITESIMAL = 1e-100  # imaginary part that carries a derivative: its square is nothing


def varied_bodies(walker: Walker, parameters: Mapping[str, ArrayLike]) -> NDArray[np.float64]:
    """Constants of walkers that differ from one in some parameters.

    Args:
        walker: The one.
        parameters: Values of parameters, a number for all or (n,).

    Returns:
        Shape (1 or n, constants).
    """
    if isinstance(walker, Mechanism):
        body = walker.body._replace(**parameters)
    else:
        body = body_from(varied(walker, parameters), system_of(walker).Body)
    constants = np.broadcast_arrays(*body)
    return np.stack(constants, axis=-1).reshape(-1, len(constants))


def bodies_by(
    walker: Walker, parameters: Mapping[str, ArrayLike], name: str
) -> NDArray[np.float64]:
    """How the constants of `varied_bodies` change with a parameter, of the same shape."""
    own = walker.body if isinstance(walker, Mechanism) else walker
    value = parameters.get(name, getattr(own, name))
    moved = {**parameters, name: np.asarray(value) + 1j * _INFINITESIMAL}
    return np.imag(varied_bodies(walker, moved)) / _INFINITESIMAL
