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

FEATURES = {
    "actuation": "an Actuation",
    "contact margins": "distances of gaits from a halt, a late knee and a grazing foot",
    "gauntlet": "the gauntlet",
    "gpu episodes": "a batch on a GPU",
    "McGeer's parameters": "this function",
    "optimal gait": "an optimal gait",
    "ratios": "the argument `ratios` of a basin",
    "reality check": "reality_check",
    "step kinds": "long and short steps",
    "stride plans": "an environment under a plan of several control steps",
    "step derivatives": "a step with derivatives",
    "tilted footholds": "footholds of different slopes",
    "tuning": "optimize_walker",
    "units": "units of its own",
}
"""What a model may support, and how a refusal calls it."""


def check_supports(model: Any, feature: str) -> None:
    """Check that a model supports one of FEATURES.

    Raises:
        ValueError: if it does not.
    """
    if feature not in model.supports:
        raise ValueError(
            f"{FEATURES[feature]} needs a walker with two legs and McGeer's parameters, not the "
            f"system {model.title!r}"
        )


class Model(Protocol):
    """A walker of the package, or a system that a user has stated.

    Attributes:
        title: Name in pictures and messages.
        coordinates: Number m of coordinates.
        size: Numbers of a state: coordinates, then their rates.
        state_names: Names of the numbers of a state.
        kind: Name of its equations; models of one kind may be in one batch.
        units: Units in which it is dimensionless.
        weight: Its weight, in its own units.
        parameters: Numbers that may vary, by name.
        body: Constants in its equations of motion.
        chart: Coordinates of its states just after heelstrike, and of searches for gaits.
        supports: The FEATURES that it has.
        start: A state just after heelstrike near a gait; None where searches need none.
        controls: Names of what actuators hold during a stride.
        control_units: Units of the controls.
        inputs: Names of what actuators hold, as derivatives by them are named.
    """

    title: str
    coordinates: Any
    size: Any
    state_names: Any
    kind: Any
    units: Any
    weight: Any
    parameters: Any
    body: Any
    chart: Any
    supports: Any
    start: Any
    controls: Any
    control_units: Any
    inputs: Any

    def with_parameters(self, **values: float) -> Any:
        """Return a model with other values of some parameters."""
        ...

    def with_body(self, values: Mapping[str, float]) -> Any:
        """Return a model with other parameters, without checks that take long."""
        ...

    def units_with(self, **values: ArrayLike) -> Any:
        """Return the units of models that differ in some parameters: numbers, or arrays (n,)."""
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
