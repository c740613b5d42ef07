"""Users' own rewards, observations and terminations: plain functions of a `Transition`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gym_passive_walker.envs import transitions
from gym_passive_walker.envs.rule import Rule, listed
from gym_passive_walker.envs.transitions import note_for
from gym_passive_walker.envs.views import of_notes, shape_of
from gym_passive_walker.gaits.scenes.rewards import (
    DRAWN,
    FUNCTIONS,
    OWN,
    Weighted,
    observation_parts,
    rule_of,
)


def is_custom(scene: Any) -> bool:
    """Return whether a scene calls functions of a `Transition`."""
    return any(getattr(scene, n) for n in FUNCTIONS)


class Joined:
    """Several observations of a user's, one after another.

    Args:
        functions: The functions.

    Attributes:
        sizes: Number of numbers that each returned at the last call.
    """

    def __init__(self, functions: list[Callable[[Any], Any]]) -> None:
        self._functions, self.sizes = functions, [0] * len(functions)
        names = (getattr(each, "__qualname__", type(each).__qualname__) for each in functions)
        self.__qualname__ = " or ".join(names)

    def __call__(self, step: Any) -> list[Any]:
        """Return the numbers of all functions."""
        arrays = np.ndim(step.distance) > 0
        found = [listed(function(step), arrays=arrays) for function in self._functions]
        self.sizes = [len(each) for each in found]
        return [number for each in found for number in each]


class Custom:
    """The user's own functions of a scene, for a batch of walkers.

    Args:
        scene: A scene with at least one such function.
        count: Number of walkers.

    Attributes:
        notes: Transitions of the last step, (count,) of `note_for` the walkers' layout.
        rules: Functions by name: "reward", "observation", "terminated".
        noted: Groups of `transitions.PARTS` to record, as bits.
        native: Whether reward and termination are compiled.
        observation_size: Size of the observation; None with the environment's own.
        groups: Place of each group in the observation; None if there are none.
        parts: Group, part, and place in the observation of each part.
    """

    def __init__(self, scene: Any, count: int) -> None:
        self._shape = shape_of(scene)
        self.notes = np.zeros(count, note_for(self._shape.layout))
        self.rules: dict[str, Rule] = {}
        self.parts: list[tuple[str, Any, slice]] = []
        self.groups: dict[str, slice] | None = None
        for name in FUNCTIONS:
            function = getattr(scene, name)
            if name == "observation" and scene.groups:
                parts = [part for _, part in observation_parts(scene.groups) if callable(part)]
                function = Joined(parts) if parts else None
            if function is not None:
                self.rules[name] = Rule(name, rule_of(function), self._shape)
        self._given = [name for name in ("reward", "terminated") if name in self.rules]
        self._slow = [name for name in self._given if not self.rules[name].native]
        self.native = not self._slow
        self.observation_size = (
            self.rules["observation"].size if "observation" in self.rules else None
        )
        if scene.groups:
            self._place(scene)
        self.noted = 0
        for rule in self.rules.values():
            weighted = isinstance(rule.function, Weighted)  # `terms` reads the ledger's fields
            self.noted |= rule.noted | int(weighted)

    def arrays(self, functions: Mapping[str, int] | None = None) -> dict[str, NDArray]:
        """Return the arrays with content, by their names in `memory`.

        Args:
            functions: Addresses of compiled functions by name; those on this CPU when None.
        """
        if functions is None:
            functions = {name: rule.native for name, rule in self.rules.items()}
        addresses = [functions.get(name, 0) for name in ("reward", "terminated", "observation")]
        own = np.array([(self.noted, *addresses, self.native)], transitions.USER_RULES)
        return {"notes": self.notes, "own": own}

    def look_again(self) -> None:
        """Compare the functions with what they were, as all walkers begin; see `Rule`."""
        for rule in self.rules.values():
            rule.look_again()

    def evaluate(
        self, batch: Any, rewards: NDArray[np.float64], terminated: NDArray[np.bool_]
    ) -> int:
        """Evaluate functions that are not compiled; returns the number of episodes that end."""
        for name in self._slow:
            self.notes["paid" if name == "reward" else "ends"] = self.rules[name](self.notes)[:, 0]
        pays, stops = (name in self._given for name in ("reward", "terminated"))
        entry_point = batch.entry_point
        return entry_point.kernels.enter(entry_point.address, pays, stops, rewards, terminated)

    def _place(self, scene: Any) -> None:
        """Set the places of groups and of their parts in the observation."""
        functions = self.rules["observation"].function if "observation" in self.rules else None
        sizes = iter(functions.sizes if isinstance(functions, Joined) else ())
        own = len(scene.walker.observed) + (scene.command is not None)
        own += 2 * scene.terrain_lookahead + len(scene.observe_body)
        known, first, self.groups = {OWN: own, DRAWN: len(scene.randomized)}, 0, {}
        for group, part in observation_parts(scene.groups):
            last = first + (next(sizes) if callable(part) else known[part])
            self.parts.append((group, part, slice(first, last)))
            begun = self.groups[group].start if group in self.groups else first
            self.groups[group], first = slice(begun, last), last
        self.observation_size = first

    def observe(
        self,
        observations: NDArray[np.float32],
        lanes: Any,
        known: Mapping[str, NDArray],
    ) -> None:
        """Write the observations of some walkers into the flat array of all.

        Args:
            observations: Filled, flat: (count * observation_size,).
            lanes: The walkers.
            known: Parts of groups that are no functions, by name, each (count, size).
        """
        rule, notes = self.rules.get("observation"), self.notes[lanes]
        rows = observations.reshape(len(self.notes), -1)
        if rule is None:
            numbers = np.empty((len(notes), 0))
        elif rule.native:
            numbers = np.empty((len(notes), rule.size))
            transitions.look(notes, rule.native, numbers)
        else:
            numbers = rule(notes)
        if self.groups is None:
            rows[lanes] = numbers
            return
        used = 0
        for _, part, place in self.parts:
            if callable(part):
                size = place.stop - place.start
                rows[lanes, place], used = numbers[:, used : used + size], used + size
            else:
                rows[lanes, place] = known[part][lanes]

    def terms(self, notes: NDArray) -> dict[str, NDArray[np.float64]]:
        """Return terms (n,) of the rewards in transitions (n,); a function has one, "function"."""
        function = self.rules["reward"].function
        if not isinstance(function, Weighted):
            return {"function": notes["paid"]}
        terms = function.terms(of_notes(notes, self._shape))
        return {name: np.broadcast_to(x, len(notes)) for name, x in terms.items()}
