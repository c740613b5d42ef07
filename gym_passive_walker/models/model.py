"""The contract of walkers: what engine, analyses and environments ask of one.

`Walker` has McGeer's parameters, and `System` equations that a user has stated. Both are models.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker.models.equations.numbers import complex_step, step_derivative

FEATURES = {
    "actuation": "an Actuation",
    "collision matrix": "collision_matrix",
    "constraints": "the argument `constraints`",
    "contact margins": "distances of gaits from a halt, a late knee and a grazing foot",
    "feedback": "LinearFeedback",
    "gauntlet": "the gauntlet",
    "ground force": "the force on the stance foot",
    "knee lock observed": "an observation with the lock of a knee",
    "legs": "a picture of legs",
    "McGeer's parameters": "this function",
    "optimal gaits": "optimal_gait",
    "pages": "a web page",
    "pushes": "a push",
    "ratios": "the argument `ratios` of a basin",
    "reality check": "reality_check",
    "robustness": "robustness",
    "step kinds": "long and short steps",
    "stride plans": "an environment under a plan of several control steps",
    "step derivatives": "a step with derivatives",
    "tilted footholds": "footholds of different slopes",
    "units": "units of its own",
}
"""What a model may support, and how a refusal calls it."""

_NEEDED, _FORCE = "the force of the ground", "`ground_force` and `momentum`"
_STATED = {
    "collision matrix": (_NEEDED, f"`mass_matrix`, {_FORCE}"),
    "constraints": (_NEEDED, _FORCE),
    "ground force": (_NEEDED, _FORCE),
    "pushes": ("the inertia of the walker", "`mass_matrix`, or `push` in each phase"),
    "reality check": (_NEEDED, _FORCE),
}
"""What a feature needs, and what equations of a system must have for it; it is derived where they
are."""
ALIKE = frozenset({"constraints", "feedback", "optimal gaits", "pages", "robustness"})
"""Features of models with legs that are alike."""

Checked = TypeVar("Checked", bound=Any)


def check_supports(model: Checked, feature: str) -> Checked:
    """Return a model after a check that it supports one of FEATURES.

    Raises:
        ValueError: if it does not.
    """
    if feature not in model.supports:
        if feature in ALIKE and not model.legs_alike:
            raise ValueError(
                f"{FEATURES[feature]} needs legs that are alike: those of the system "
                f"{model.title!r} exchange {', '.join(model.exchange)}"
            )
        if feature in _STATED:
            needed, functions = _STATED[feature]
            raise ValueError(
                f"{FEATURES[feature]} needs {needed}: the equations of the system "
                f"{model.title!r} must have {functions}"
            )
        raise ValueError(
            f"{FEATURES[feature]} needs a walker with two legs and McGeer's parameters, not the "
            f"system {model.title!r}"
        )
    return model


def check_heights_only(model: Any, slopes: Any) -> None:
    """Check that a model that does not support tilted footholds has none.

    A system's coordinates may be lengths, or angles to another link: they do not rotate with the
    ground.

    Raises:
        ValueError: if a slope is not 0.
    """
    if "tilted footholds" not in model.supports and np.any(slopes):
        raise ValueError(
            f"footholds of the system {model.title!r} may differ in height, not in slope"
        )


class Actuator(NamedTuple):
    """What an action of an environment moves.

    Attributes:
        name: Its name in a scene's `actions`.
        limit: The largest control: a number in the model's units; or, over its weight, the name of
            the scene's argument.
        about: What it is, with its sign.
        unit: Unit of the control.
        least: The smallest action; the largest is 1.
        usual: Whether scenes that name no actions have it.
    """

    name: str
    limit: str | float
    about: str
    unit: str = ""
    least: float = -1.0
    usual: bool = True


class Model:
    """A walker of the package, or a system that a user has stated.

    Attributes:
        legs_alike: Whether each stride has the same parameters; else the legs exchange some of them
            at each heelstrike.
        exchanged_places: Places of constants that the legs exchange, pair after pair.
        swapped: The model of the next stride, with the legs exchanged; itself if they are alike.
        title: Name in pictures and messages.
        coordinates: Number m of coordinates.
        parts: Names of the coordinates in pictures.
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
        absent: Names of controls that its equations leave out: nothing may set them.
        control_units: Units of the controls.
        inputs: Names of what actuators hold, as derivatives by them are named.
        actuators: What actions of environments may move.
        observed: Name and unit of each number of the environments' own observation: the state
            first, then others, the slope last.
        endings: Outcomes by which an episode ends in a fall, and when.
        toe_stubs: Whether its equations have a guard that a stubbed toe passes.

    Methods:
        with_parameters: Return a model with other values of some parameters.
        with_body: The same without checks that take long.
        check_values: Check that models may have each row of values (n, k) of parameters.
        checked_state: Return a user's state in dimensionless units, after a check.
        mass_with: Return the mass of models that differ in some parameters; complex values carry
            derivatives.
        units_with: Return the units of models that differ in some parameters.
        equations: Return the equations of motion, with further features in use.
        constants: Return constants of models that differ in some parameters, (1 or n, constants).
        counterpart: Return what the model of the next stride calls a parameter.
        in_stride: Return the model of a stride, by its number from 0.
        swap: Return constants (..., constants) of the next stride, from those of a stride.
    """

    legs_alike = True
    exchanged_places: tuple[int, ...] = ()
    absent: tuple[str, ...] = ()

    @property
    def swapped(self) -> Any:
        """The model of the next stride."""
        return self

    def counterpart(self, parameter: str) -> str:
        """What the model of the next stride calls a parameter."""
        return parameter

    def in_stride(self, number: int) -> Any:
        """The model of a stride, by its number from 0."""
        return self.swapped if number % 2 else self

    def swap(self, constants: NDArray) -> NDArray:
        """Return the constants of the next stride."""
        return constants


@lru_cache(maxsize=4096)
def check_row(model: Checked, names: tuple[str, ...], row: tuple[float, ...]) -> Checked:
    """Return a model with these values of parameters, after a check, which is made once.

    Raises:
        ValueError: if it may not have them, or other equations are those of such a model.
    """
    made = model.with_parameters(**dict(zip(names, row, strict=True)))
    if made.massless_legs != model.massless_legs:
        masses = "has mass" if model.massless_legs else "has no mass"
        raise ValueError(
            f"a leg {masses} with {', '.join(names)} = {', '.join(f'{x:g}' for x in row)}, so that "
            "its equations are not those of this walker: give a walker that has"
            f"{'' if model.massless_legs else ' no'} such mass"
        )
    return made


def constants_from(body: Any) -> NDArray[Any]:
    """Return constants (1 or n, constants) from a body of numbers or arrays (n,)."""
    constants = np.broadcast_arrays(*body)
    return np.stack(constants, axis=-1).reshape(-1, len(constants))


@lru_cache(maxsize=4096)
def _row(model: Any) -> NDArray[np.float64]:
    return np.array(model.body, dtype=float)[None, None]


def bodies(*models: Any) -> NDArray[np.float64]:
    """Constants of models of one kind in the form of the engine, (models, 1, constants)."""
    return np.concatenate([_row(model) for model in models])


def constants_by(model: Any, parameters: Mapping[str, ArrayLike], name: str) -> NDArray[np.float64]:
    """Return derivatives of `Model.constants` by a parameter, of the same shape."""
    value = complex_step(parameters.get(name, model.parameters[name]))
    return step_derivative(model.constants(**{**parameters, name: value}))
