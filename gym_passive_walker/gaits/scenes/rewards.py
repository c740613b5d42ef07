"""Weighted rewards, and checks of functions of one's own: of a `Transition`, written in `envs`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from gym_passive_walker._tools.arguments import number, shown, unknown
from gym_passive_walker.gaits.scenes.checks import SceneError, checked
from gym_passive_walker.gaits.scenes.rules import command_error
from gym_passive_walker.models.math import where

FUNCTIONS = ("reward", "observation", "terminated")
"""Arguments of a scene that are functions."""

TERMS: dict[str, Callable[[Any], Any]] = {
    "distance": lambda step: step.distance,
    "energy": lambda step: step.energy,
    "alive": lambda step: where(step.fell, 0.0, 1.0),
    "fell": lambda step: where(step.fell, 1.0, 0.0),
    "command": lambda step: command_error(step.step_length, step.step_period, step.command),
    "action": lambda step: sum(each**2 for each in step.action),
    "action_change": lambda step: sum(
        (now - last) ** 2 for now, last in zip(step.action, step.last_action, strict=True)
    ),
    "collision_loss": lambda step: step.collision_loss,
    "push_off_work": lambda step: step.push_off_work,
}
"""Terms of a weighted reward; `ABOUT_TERMS` describes them."""

ABOUT_TERMS = {
    "distance": "distance of the hip along the slope / l",
    "energy": "energy that the actuators are charged for / (m g l)",
    "alive": "1 for each step without a fall",
    "fell": "1 for a fall",
    "command": "| step length - command * step period | / l of each stride",
    "action": "sum of the squares of the actions",
    "action_change": "sum of the squares of the changes of the actions",
    "collision_loss": "energy lost at impacts / (m g l)",
    "push_off_work": "work of the push-off / (m g l)",
}
"""Descriptions of the terms of a weighted reward, with units."""


class Weighted:
    """A reward that is a weighted sum of `TERMS`.

    Args:
        weights: Weight of each term, by the term's name.
    """

    def __init__(self, weights: Mapping[str, float]) -> None:
        self.weights = dict(weights)

    def __call__(self, step: Any) -> Any:
        """Return the weighted sum."""
        return sum(self.terms(step).values())

    def terms(self, step: Any) -> dict[str, Any]:
        """Return the weighted terms by name."""
        return {name: weight * TERMS[name](step) for name, weight in self.weights.items()}


def rule_of(given: Any) -> Callable[[Any], Any]:
    """Return the function, or the weighted sum of a mapping from terms to weights."""
    return Weighted(given) if isinstance(given, Mapping) else given


OBSERVERS = ("policy", "critic")
"""Groups of an observation: what the actor sees, and what the critic sees in training."""

OWN, DRAWN = "default", "randomized"
"""Parts of an observation by name: the environment's own, and the draws of domain randomization."""


def observation_parts(observation: Any) -> list[tuple[str, Any]]:
    """Return group and part of each part of a checked observation with groups, in order."""
    return [(name, part) for name, parts in observation.items() for part in as_row(parts)]


def as_row(parts: Any) -> tuple[Any, ...]:
    """Return the parts of a group of an observation as a row: one part, or several of them."""
    return tuple(parts) if isinstance(parts, list | tuple) else (parts,)


def checked_groups(given: Mapping[str, Any], *, draws: bool) -> dict[str, Any]:
    """Return an observation with groups after a check.

    Args:
        given: A function or OWN for "policy"; for "critic" these or DRAWN, or a row of them.
        draws: Whether the scene has domain randomization.

    Raises:
        SceneError: if a group is missing or unknown, or a part cannot be observed.
    """
    if {*given} != {*OBSERVERS}:
        raise SceneError(
            'observation must be a function of a step, or have "policy" and "critic", what the '
            f"actor and the critic see, not {shown(dict(given))}"
        )
    found = {}
    for name in OBSERVERS:
        part = given[name]
        row = as_row(part)
        if name == "critic" and DRAWN in row and not draws:
            raise SceneError(
                f"observation['critic'] has {DRAWN!r}, and this scene draws nothing: give it a "
                "domain_randomization"
            )
        allowed = (OWN, DRAWN) if name == "critic" else (OWN,)
        strange = [each for each in row if not callable(each) and each not in allowed]
        names = [each for each in row if isinstance(each, str)]
        single = name == "policy" and len(row) != 1
        if strange or single or not row or len({*names}) < len(names):
            rows = ", or a row of these, each once" if name == "critic" else ""
            raise SceneError(
                f"observation[{name!r}] must be a function of a step or "
                f"{' or '.join(map(repr, allowed))}{rows}, not {shown(part)}"
            )
        found[name] = row[0] if len(row) == 1 else row
    return found


def checked_rule(name: str, given: Any) -> Any:
    """Return a function, or weights of a reward, after a check.

    Raises:
        SceneError: if the value is neither a function nor weights of `TERMS`.
    """
    if name == "reward" and isinstance(given, Mapping):
        if not given:
            raise SceneError(f"reward must have weights of some of {', '.join(TERMS)}")
        if said := unknown(given, tuple(TERMS), "a reward"):
            raise SceneError(said)
        return {each: checked(number, w, f"reward[{each!r}]") for each, w in given.items()}
    if given is not None and not callable(given):
        weights = ", or weights by name" * (name == "reward")
        weights += ', or of "policy" and "critic" by name' * (name == "observation")
        raise SceneError(f"{name} must be a function of a step{weights}, not {shown(given)}")
    return given
