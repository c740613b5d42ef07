"""Users' own rewards, observations and terminations: plain functions of a `Transition`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gym_passive_walker.envs import transitions
from gym_passive_walker.envs.rule import Rule
from gym_passive_walker.envs.transitions import note_for
from gym_passive_walker.envs.views import of_notes, shape_of
from gym_passive_walker.gaits.scenes.rewards import FUNCTIONS, Weighted, rule_of


def is_custom(scene: Any) -> bool:
    """Return whether a scene calls functions of a `Transition`."""
    return any(getattr(scene, n) for n in FUNCTIONS)


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
    """

    def __init__(self, scene: Any, count: int) -> None:
        self._shape = shape_of(scene)
        self.notes = np.zeros(count, note_for(self._shape.layout))
        self.rules: dict[str, Rule] = {}
        for name in FUNCTIONS:
            if (function := getattr(scene, name)) is not None:
                self.rules[name] = Rule(name, rule_of(function), self._shape)
        self._given = [name for name in ("reward", "terminated") if name in self.rules]
        self._slow = [name for name in self._given if not self.rules[name].native]
        self.native = not self._slow
        self.observation_size = (
            self.rules["observation"].size if "observation" in self.rules else None
        )
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

    def observe(self, observations: NDArray[np.float32], lanes: Any = slice(None)) -> None:
        """Write the observations of some walkers into the flat array of all."""
        rule, notes = self.rules["observation"], self.notes[lanes]
        rows = observations.reshape(len(self.notes), rule.size)
        if rule.native:
            numbers = np.empty((len(notes), rule.size))
            transitions.look(notes, rule.native, numbers)
            rows[lanes] = numbers
        else:
            rows[lanes] = rule(notes)

    def terms(self) -> dict[str, NDArray[np.float64]]:
        """Return terms (count,) of the last rewards by name; a function has one, "function"."""
        function = self.rules["reward"].function
        if not isinstance(function, Weighted):
            return {"function": self.notes["paid"].copy()}
        terms = function.terms(of_notes(self.notes, self._shape))
        return {name: np.array(np.broadcast_to(x, len(self.notes))) for name, x in terms.items()}
