"""The systems of all kinds of walkers, and the selection of the system of a walker."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker.models.equations import kneed, legs, simplest, straight
from gym_passive_walker.models.equations.bodies import body_from
from gym_passive_walker.models.equations.hybrid import State, System
from gym_passive_walker.models.equations.numbers import complex_step, step_derivative
from gym_passive_walker.models.walkers import Mechanism, Walker, varied

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


def register_system(system: System) -> System:
    """Add a system under its name; the package adds its own systems in this way too."""
    SYSTEMS[system.name] = system
    return system


for _made in (_bare, _on_smooth_ground, _anywhere):
    for _kind in _KINDS:
        register_system(_made(_kind))


def kind_of(walker: Walker) -> str:
    """Kind of a walker's legs: "kneed", "straight", "simplest", or the name of a user's system."""
    if isinstance(walker, Mechanism):
        return walker.hybrid.name
    if walker.massless_legs:
        return simplest.SYSTEM.name
    return kneed.SYSTEM.name if walker.knees else straight.SYSTEM.name


def system_of(*walkers: Walker, using: Collection[str] = ()) -> System:
    """System of equations of walkers of one kind.

    Args:
        walkers: The walkers.
        using: Further features in use, of `EXTRAS` and `UNEVEN`: controls, parameters that vary,
            and changes of the ground.
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
    """Constants of walkers of one kind in the form of the engine, (walkers, 1, constants)."""
    return np.concatenate([_row(walker) for walker in walkers])


def varied_bodies(walker: Walker, parameters: Mapping[str, ArrayLike]) -> NDArray[np.float64]:
    """Constants of walkers that differ from one walker in some parameters.

    Args:
        walker: The walker.
        parameters: Values of parameters, one for all or (n,).

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
    """Derivatives of the constants of `varied_bodies` by a parameter, of the same shape."""
    own = walker.body if isinstance(walker, Mechanism) else walker
    value = parameters.get(name, getattr(own, name))
    return step_derivative(varied_bodies(walker, {**parameters, name: complex_step(value)}))
