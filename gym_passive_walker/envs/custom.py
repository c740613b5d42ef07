"""Users' own rewards, observations and terminations: plain functions of a `Transition`.

A function is traced with symbolic numbers, and the expression that it returns is compiled. A
function that cannot be traced is called after each step, with arrays of all walkers. If it does not
accept arrays, it is called for each walker.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from types import FunctionType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gym_passive_walker.arguments import number, shown, unknown
from gym_passive_walker.engine import compiled
from gym_passive_walker.engine.expressions import Expression, choose
from gym_passive_walker.engine.layout import NARROW, Layout, layout_of
from gym_passive_walker.engine.native import Memory, Module, uses
from gym_passive_walker.envs import task, transitions
from gym_passive_walker.envs.checks import SceneError, checked
from gym_passive_walker.envs.rules import command_error
from gym_passive_walker.envs.transitions import (
    BOOLEANS,
    OF_LEDGER,
    PARTS,
    SEVERAL,
    Transition,
    note_for,
)
from gym_passive_walker.math import where
from gym_passive_walker.physics.hybrid import Outcome, State

_STRUCK = float(Outcome.HEELSTRIKE)


def everything(step: Transition) -> tuple[Any, ...]:
    """Return the default observation of a `System`: its state, and the slope in rad."""
    return *step.state, step.slope


def everything_and_command(step: Transition) -> tuple[Any, ...]:
    """Return the default observation of a `System` and the commanded speed."""
    return *everything(step), step.command


TERMS: dict[str, Callable[[Transition], Any]] = {
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


_ALL = (1 << len(PARTS)) - 1


class Weighted:
    """A reward that is a weighted sum of `TERMS`.

    Args:
        weights: Weight of each term, by the term's name.
    """

    def __init__(self, weights: Mapping[str, float]) -> None:
        self.weights = dict(weights)

    def __call__(self, step: Transition) -> Any:
        """Return the weighted sum."""
        return sum(part for part in self.terms(step).values())

    def terms(self, step: Transition) -> dict[str, Any]:
        """Return the weighted terms by name."""
        return {name: weight * TERMS[name](step) for name, weight in self.weights.items()}


def rule_of(given: Any) -> Callable[[Transition], Any]:
    """Return the function, or the weighted sum of a mapping from terms to weights."""
    return Weighted(given) if isinstance(given, Mapping) else given


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
        raise SceneError(f"{name} must be a function of a step{weights}, not {shown(given)}")
    return given


class Shape(NamedTuple):
    """Sizes and types of the fields of a scene's transitions.

    Attributes:
        actions: Number of actions.
        State: Named tuple of a state.
        layout: Layout of the records.
    """

    actions: int
    State: type = State
    layout: Layout = NARROW

    def transition(self, parts: Mapping[str, Any]) -> Transition:
        """Return a `Transition` from recorded fields: numbers for booleans, lists for vectors."""
        given: dict[str, Any] = dict(parts)
        count, room = len(self.State._fields) // 2, self.layout.links  # type: ignore[attr-defined]
        for name in ("before", "state"):
            each = given[name]
            given[name] = self.State(*each[:count], *each[room : room + count])
        for name in ("action", "last_action"):
            given[name] = tuple(given[name][: self.actions])
        for name in BOOLEANS:
            if not isinstance(given[name], bool | np.bool_):
                given[name] = given[name] > 0.5
        return Transition(**given)


def shape_of(scene: Any) -> Shape:
    """Return the shape of a scene's transitions."""
    own = scene.own_system
    if own is None:
        return Shape(len(scene.actions))
    return Shape(len(scene.actions), own.State, layout_of(own.hybrid))


class Rule:
    """A user's function, compiled where possible.

    Args:
        name: "reward", "observation" or "terminated".
        function: The function of a `Transition`.
        shape: Shape of its transitions.

    Attributes:
        size: Number of values that the function returns.
        noted: Groups of `transitions.PARTS` that the function reads, as bits.
        native: Address of the compiled code; 0 if the function cannot be traced.

    Raises:
        SceneError: if the function raises an error, or does not return numbers.
    """

    def __init__(self, name: str, function: Callable[[Transition], Any], shape: Shape) -> None:
        self.name, self.function, self.shape = name, function, shape
        self.native, self.noted, self._each = 0, _ALL, False
        sample = np.zeros(3, note_for(shape.layout))
        sample["duration"], sample["steps"] = 0.1, 1.0
        try:
            self._compile()
            return
        except Exception as error:
            untraced = error  # a user's function may raise anything
        for self._each in (False, True):
            try:
                self.size, other = (self(sample[:n]).shape[1] for n in (2, 3))
                if other != self.size:
                    raise TypeError(f"it gives {self.size} numbers for 2 walkers, {other} for 3")
                self._check_size(self.size)
                break
            except Exception as error:
                failed = error
        else:
            raise SceneError(f"{name} fails: {failed}") from failed
        _warn_of(
            function,
            f"{name} cannot be compiled ({untraced}): after each step it is called "
            f"{'walker by walker' if self._each else 'with arrays'}, which takes longer; use "
            "gpw.math, and its where() instead of if",
        )

    def __reduce__(self) -> tuple[Any, ...]:
        return Rule, (self.name, self.function, self.shape)

    def _check_size(self, size: int) -> None:
        if size == 0 or (self.name != "observation" and size != 1):
            raise TypeError(f"it gives {size} numbers")

    def _traced(self, step: Transition) -> list[Any]:
        """Return the expressions from the function; raises TypeError for other results."""
        found, again = (_numbers(self.function(step)) for _ in range(2))
        for result, other in zip(found, again, strict=True):
            if not isinstance(result, Expression | int | float):
                raise TypeError(f"it gives {shown(result)}")
            if result is not other and result != other:
                raise TypeError("it gives another result each time")
        return found

    def _compile(self) -> None:
        """Compile the function, and determine the fields that it reads."""
        module = Module(fuses=False)
        self.write(module)
        engine = compiled.loaded(compiled.object_code(module))
        self.native = engine.get_function_address("rule")

    def write(self, module: Module) -> None:
        """Add the function under the name "rule" to a module that rounds each operation."""
        known: dict = {}
        note_type = note_for(self.shape.layout)
        ledger_type = task.ledger_for(self.shape.layout)
        self.size = len(self._traced(_read(Memory(note_type, 1, known), None, self.shape)))
        self._check_size(self.size)
        seen = np.dtype([("seen", "f8", (self.size,))])
        noting = self.name == "observation"
        layouts = (note_type, seen) if noting else (ledger_type, note_type)

        def code(first: Memory, second: Memory) -> None:
            note = first if noting else second
            step = _read(note, None if noting else first, self.shape)
            for i, result in enumerate(self._traced(step)):
                value = Expression(note.known, "constant", 0.0).number(result)
                if isinstance(result, Expression) and result.op in _CONDITIONS:
                    value = choose(result, 1.0, 0.0)
                if noting:
                    second["seen", i] = value
                else:
                    note["paid" if self.name == "reward" else "ends"] = value
            results = [*first.writes.values(), *second.writes.values()]
            read = {x.args[1] for x in uses(results) if x.op == "read"}
            parts = [*PARTS] if noting else [(), *PARTS[1:]]  # the ledger itself is read
            self.noted = sum(1 << i for i, part in enumerate(parts) if read & {*part})

        function = module.function("rule", layouts)
        function.over_rows(code)
        function.end()

    def __call__(self, notes: NDArray) -> NDArray[np.float64]:
        """Return results (n, size) for transitions (n,), from arrays or one walker at a time."""
        if self._each:
            each = np.array([self._of_one(notes[i : i + 1]) for i in range(len(notes))], float)
            if each.ndim != 2:
                raise TypeError(f"it gives arrays of shape {each.shape[2:]}, not numbers")
            return each
        found = self.function(of_notes(notes, self.shape))
        columns = _numbers(found, arrays=True)
        return np.stack(
            [np.broadcast_to(np.asarray(column, float), len(notes)) for column in columns], axis=1
        )

    def _of_one(self, note: NDArray) -> list[Any]:
        """Return results for the transition (1,) of one walker."""
        parts = {
            name: note[name][0].tolist() if name in SEVERAL else note[name].item()
            for name in Transition._fields
        }
        return _numbers(self.function(self.shape.transition(parts)))


def _warn_of(function: Callable[..., Any], said: str) -> None:
    """Warn once of a user's function, with the line that defines it."""
    plain = getattr(function, "__func__", function)  # of a method
    if not isinstance(plain, FunctionType):
        warnings.warn(said, stacklevel=3)
        return
    code, known = plain.__code__, plain.__globals__.setdefault("__warningregistry__", {})
    warnings.warn_explicit(said, UserWarning, code.co_filename, code.co_firstlineno, registry=known)


def _numbers(found: Any, *, arrays: bool = False) -> list[Any]:
    """Return the result of a function as a list of its numbers, or of `arrays` of them."""
    several = isinstance(found, np.ndarray) and found.ndim > arrays
    return [*found] if several or isinstance(found, tuple | list) else [found]


_CONDITIONS = ("<", "<=", ">", ">=", "and", "or", "not")


def _read(note: Memory, row: Memory | None, shape: Shape) -> Transition:
    """Return a transition of expressions that read the ledger's row or else a note."""
    parts: dict[str, Any] = {
        name: note.entries(name) if name in SEVERAL else note[name] for name in Transition._fields
    }
    if row is not None:
        struck = abs(row["outcome"] - _STRUCK) < 0.5
        parts |= {name: row[name] for name in OF_LEDGER if name not in BOOLEANS}
        parts["heelstrike"] = choose(struck, 1.0, 0.0)
        parts["fell"] = choose(row["ending"] > 0.5, 1.0, 0.0)
    return shape.transition(parts)


def of_notes(notes: NDArray, shape: Shape) -> Transition:
    """Return recorded transitions (n,) as one `Transition` of arrays."""
    parts: dict[str, Any] = {
        name: list(notes[name].T) if name in SEVERAL else notes[name] for name in Transition._fields
    }
    return shape.transition(parts)


class Custom:
    """The user's own functions of a scene, for a batch of walkers.

    Args:
        scene: A scene with at least one such function, or with a `System`.
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
        given = {name: getattr(scene, name) for name in RULES}
        if scene.own_system is not None and given["observation"] is None:
            commanded = scene.command is not None
            given["observation"] = everything_and_command if commanded else everything
        for name, function in given.items():
            if function is not None:
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

    def address(self, name: str) -> int:
        """Return the address of a compiled function; 0 if there is none."""
        return self.rules[name].native if name in self.rules else 0

    def begin(self, batch: Any, lanes: NDArray[np.int64]) -> None:
        """Clear the transitions of walkers at the beginning of their episodes."""
        transitions.begin(batch.records, batch.ledger, batch.machinery[0], lanes, self.notes)
        if batch.disturbances:
            self.notes["command"][lanes] = batch.disturbances.states["command"][lanes]

    def evaluate(
        self, batch: Any, rewards: NDArray[np.float64], terminated: NDArray[np.bool_]
    ) -> int:
        """Evaluate functions that are not compiled; returns the number of episodes that end."""
        for name in self._slow:
            self.notes["paid" if name == "reward" else "ends"] = self.rules[name](self.notes)[:, 0]
        pays, stops = (name in self._given for name in ("reward", "terminated"))
        return transitions.enter(
            batch.records, batch.ledger, self.notes, pays, stops, rewards, terminated
        )

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


RULES = ("reward", "observation", "terminated")
"""Arguments of a scene that are functions."""
