"""The contract of walkers: what engine, analyses and environments ask of one.

`Walker` has McGeer's parameters, and `System` equations that a user has stated. Both are models.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from functools import lru_cache
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker.models.equations.hybrid import System
from gym_passive_walker.models.equations.numbers import complex_step, step_derivative


class Model(Protocol):
    """A walker of the package, or a system that a user has stated.

    Attributes:
        title: Name in pictures and messages.
        coordinates: Number m of coordinates.
        size: Numbers of a state: coordinates, then their rates.
        kind: Name of its equations; models of one kind may be in one batch.
        units: Units in which it is dimensionless.
        weight: Its weight, in its own units.
        parameters: Numbers that may vary, by name.
        body: Constants in its equations of motion.
        inputs: Names of what actuators hold, as derivatives by them are named.
    """

    title: str
    coordinates: Any
    size: Any
    kind: Any
    units: Any
    weight: Any
    parameters: Any
    body: Any
    inputs: Any

    def with_parameters(self, **values: float) -> Any:
        """Return a model with other values of some parameters."""
        ...

    def equations(self, using: Collection[str] = ()) -> System:
        """Return the equations of motion, with further features in use."""
        ...

    def constants(self, **values: ArrayLike) -> NDArray[Any]:
        """Return the constants of models that differ in some parameters, (1 or n, constants)."""
        ...


def constants_from(body: Any) -> NDArray[Any]:
    """Return constants (1 or n, constants) from a body of numbers or arrays (n,)."""
    constants = np.broadcast_arrays(*body)
    return np.stack(constants, axis=-1).reshape(-1, len(constants))


@lru_cache(maxsize=4096)
def _row(model: Model) -> NDArray[np.float64]:
    return np.array(model.body, dtype=float)[None, None]


def bodies(*models: Model) -> NDArray[np.float64]:
    """Constants of models of one kind in the form of the engine, (models, 1, constants)."""
    return np.concatenate([_row(model) for model in models])


def constants_by(
    model: Model, parameters: Mapping[str, ArrayLike], name: str
) -> NDArray[np.float64]:
    """Return derivatives of `Model.constants` by a parameter, of the same shape."""
    value = complex_step(parameters.get(name, model.parameters[name]))
    return step_derivative(model.constants(**{**parameters, name: value}))
