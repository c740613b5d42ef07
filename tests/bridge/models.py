"""Walkers and systems that have files, and their mass matrices."""

from __future__ import annotations

from typing import Any

import numpy as np

import gym_passive_walker as gpw
from examples.five_links import FIVE_LINKS
from examples.rimless_wheel import RIMLESS_WHEEL
from examples.torso import TORSO
from examples.unequal_legs import UNEQUAL_LEGS
from gym_passive_walker.bridge.linkage import Linkage
from gym_passive_walker.bridge.rigid import coordinates, tree_of_walker
from gym_passive_walker.models.equations.hybrid import State

WALKERS = {name: walker for name, walker in gpw.WALKERS.items() if not walker.massless_legs}
SYSTEMS = {each.title: each for each in (TORSO, FIVE_LINKS, RIMLESS_WHEEL, UNEQUAL_LEGS)}
MODELS: dict[str, Any] = WALKERS | SYSTEMS
LENGTH, MASS = 0.8, 32.0
"""Units of systems in m and kg."""


def options(model: Any) -> dict[str, Any]:
    """Arguments of `export` that a model needs."""
    return {} if isinstance(model, gpw.Walker) else {"unit_length": LENGTH, "unit_mass": MASS}


def pose_of(model: Any, slope: float, state: Any) -> Any:
    """Coordinates and velocities of the file of a model, with its stance foot on the ground."""
    if isinstance(model, gpw.Walker):
        return coordinates(model, slope, state)
    return Linkage(model).coordinates(slope, state, LENGTH, (9.81 / LENGTH) ** 0.5)


def joints_of(model: Any) -> tuple[str, ...]:
    """Names of the coordinates of the file of a model."""
    if isinstance(model, gpw.Walker):
        return tree_of_walker(model).joints
    return Linkage(model).tree(LENGTH, MASS).joints


def random_state(model: Any, rng: np.random.Generator) -> Any:
    """A random state in the model's own units; straight legs keep their knees locked."""
    state = rng.uniform(-1.0, 1.0, model.size)
    if isinstance(model, gpw.Walker):
        if model.knees:
            state[2] = state[1] - abs(state[2])
        else:
            state[2], state[5] = state[1], state[4]
    return state


def motions(model: Any, slope: float, state: Any) -> Any:
    """Velocities of the file's coordinates per rate of the model, (coordinates, rates)."""
    half = model.size // 2
    if isinstance(model, gpw.Walker) and not model.knees:
        unit = np.eye(2)
        rates = np.column_stack([unit, unit[:, 1]])  # the shank turns with the thigh
    else:
        rates = np.eye(half)
    return np.stack([pose_of(model, slope, [*state[:half], *rate])[1] for rate in rates], axis=1)


def own_mass_matrix(model: Any, state: Any) -> Any:
    """The model's own mass matrix, in SI units and per rate in rad/s."""
    system = model.equations()
    if isinstance(model, gpw.Walker):
        given = State(*model.units.to_dimensionless(state))
        unit = model.units.energy * model.units.time**2
        size = 3 if model.knees else 2
    else:
        given, unit, size = model.State(*state), MASS * LENGTH**2, model.coordinates
        unit /= 1.0
    full, rows = np.zeros((size, size)), np.triu_indices(size)
    full[rows] = system.mass_matrix(model.body, given)
    return unit * (full + np.triu(full, 1).T)


def own_kinetic_energy(model: Any, state: Any) -> float:
    """The model's own kinetic energy in J, of a state in its own units."""
    half = model.size // 2
    rates = np.array(state[half:])
    if isinstance(model, gpw.Walker):
        moving = rates if model.knees else rates[:2]
    else:
        moving = rates * (9.81 / LENGTH) ** 0.5
    return float(0.5 * moving @ own_mass_matrix(model, state) @ moving)
