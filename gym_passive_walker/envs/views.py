"""A transition as users' functions see it: traced, as arrays of all walkers, or of one walker.

In each of them a condition counts as 1.0 or 0.0 in arithmetic, `~` negates it, and arithmetic gives
inf or NaN where it has no result.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin
from numpy.typing import NDArray

from gym_passive_walker.engine.layout import NARROW, Layout, layout_of
from gym_passive_walker.engine.native import Memory
from gym_passive_walker.envs.transitions import BOOLEANS, OF_LEDGER, SEVERAL, note_for
from gym_passive_walker.gaits.scenes.transition import Transition
from gym_passive_walker.models.equations.hybrid import Outcome, State
from gym_passive_walker.models.expressions import choose

_STRUCK = float(Outcome.HEELSTRIKE)


class Shape(NamedTuple):
    """Sizes and types of the fields of a scene's transitions.

    Attributes:
        actions: Number of actions.
        State: Named tuple of a state.
        layout: Layout of the records.
        start: A state to try functions with; empty for the package's walkers.
    """

    actions: int
    State: type = State
    layout: Layout = NARROW
    start: tuple[float, ...] = ()

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
            given[name] = given[name] > 0.5
        return Transition(**given)


def shape_of(scene: Any) -> Shape:
    """Return the shape of a scene's transitions."""
    walker = scene.walker
    system, start = walker.equations(), () if walker.start is None else walker.start
    return Shape(len(scene.actions), system.State, layout_of(system), tuple(map(float, start)))


def traced(note: Memory, row: Memory | None, shape: Shape) -> Transition:
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
    """Return a copy of recorded transitions (n,) as one `Transition` of arrays."""
    notes = notes.copy()
    parts: dict[str, Any] = {
        name: [*notes[name].T.view(Array)] if name in SEVERAL else notes[name].view(Array)
        for name in Transition._fields
    }
    return shape.transition(parts)


def of_one(note: NDArray, shape: Shape) -> Transition:
    """Return the recorded transition of one walker, (1,), as a `Transition` of numbers."""
    parts: dict[str, Any] = {
        name: [*map(Number, note[name][0].tolist())] if name in SEVERAL else Number(note[name][0])
        for name in Transition._fields
    }
    return shape.transition(parts)


def samples(shape: Shape, *, begun: bool) -> NDArray:
    """Return transitions to try functions with.

    Args:
        shape: Their shape.
        begun: Whether to add a walker at the beginning of its episode.

    Returns:
        Transitions (n,) of `note_for`: a step within a stride, one with a heelstrike, a fall, and a
        step late in a long episode.
    """
    count = len(_STEPS["time"])
    notes = np.zeros(count + begun, note_for(shape.layout))
    random, half = np.random.default_rng(0), len(shape.State._fields) // 2  # type: ignore[attr-defined]
    for name, values in _STEPS.items():
        notes[name][:count] = values
    for name in ("action", "last_action"):
        notes[name][:count, : shape.actions] = random.uniform(0.1, 1.0, (count, shape.actions))
    for name in ("before", "state"):
        drawn = random.uniform(-0.3, 0.3, (len(notes), 2 * half)) + (shape.start or 0.0)
        notes[name][:, :half] = drawn[:, :half]
        notes[name][:, shape.layout.links :][:, :half] = drawn[:, half:]
    if begun:
        notes["before"][count], notes["slope"][count] = notes["state"][count], 0.01
    return notes


_STEPS = {
    "knee_locked": (0.0, 1.0, 0.0, 1.0), "distance": (0.021, 0.016, -0.31, 0.034),
    "duration": (0.1, 0.057, 0.1, 0.1), "time": (7.3, 14.6, 2.9, 331.0),
    "energy": (1.1e-3, 4e-4, 2.3e-3, 7e-4), "hip_work": (9e-4, -4e-4, 2.1e-3, 3e-4),
    "hip_work_absolute": (1.1e-3, 4e-4, 2.3e-3, 7e-4), "ankle_work": (2e-4, -3e-4, 1e-4, 5e-4),
    "ankle_work_absolute": (2e-4, 3e-4, 2e-4, 6e-4), "push_off_work": (0.0, 1.3e-3, 0.0, 0.0),
    "collision_loss": (0.0, 5.2e-3, 0.0, 8e-4), "heelstrike": (0.0, 1.0, 0.0, 0.0),
    "step_length": (0.0, 0.44, 0.0, 0.0), "step_period": (0.0, 2.57, 0.0, 0.0),
    "fell": (0.0, 0.0, 1.0, 0.0), "strides": (2.0, 6.0, 1.0, 128.0),
    "steps": (75.0, 152.0, 29.0, 3391.0), "slope": (0.011, 0.013, 0.017, 0.009),
    "height_change": (2e-3, -3e-3, 1e-3, 4e-3), "slope_change": (-1e-3, 2e-3, 3e-3, -4e-3),
    "push": (3e-3, -5e-3, 0.0, 2e-3), "command": (0.12, 0.15, 0.17, 0.19),
    "reward": (0.01, 0.012, -0.333, 0.027),
}  # fmt: skip
"""Fields of steps that a walker can make."""


_LOGICAL = (
    np.bitwise_and, np.bitwise_or, np.bitwise_xor, np.invert,
    np.logical_and, np.logical_or, np.logical_xor, np.logical_not,
)  # fmt: skip
"""Functions in which a condition is one; in all others it is a number."""


IN_PLACE = ("add", "sub", "mul", "truediv", "floordiv", "mod", "pow", "and", "or", "xor")
"""Operators with a form such as `+=`."""


class _Counting(NDArrayOperatorsMixin):
    """Numbers and conditions on which all operators act as on the compiler's expressions."""

    def __array_ufunc__(self, function: Any, method: str, *given: Any, **options: Any) -> Any:
        """Apply a function of NumPy, with conditions as numbers unless it is logical."""
        plain = [_plain(x, counted=function not in _LOGICAL) for x in given]
        out = options.pop("out", ())
        if any(isinstance(x, np.ndarray) for x in out):  # `x += 1` of a number gives a new one
            options["out"] = tuple(x.view(np.ndarray) for x in out)
            getattr(function, method)(*plain, **options)
            return out[0] if len(out) == 1 else out
        return _wrapped(getattr(function, method)(*plain, **options))


def _plain(x: Any, *, counted: bool) -> Any:
    """Return a number as one of Python or NumPy; conditions as numbers if they are counted."""
    if isinstance(x, np.ndarray):
        x = x.view(np.ndarray)
        return x.astype(float) if counted and x.dtype == bool else x
    if isinstance(x, Number):
        return float(x)
    if isinstance(x, bool | np.bool_ | Truth):
        return float(x) if counted else bool(x)
    return x


def _wrapped(found: Any) -> Any:
    """Return a result of NumPy as a number or a condition that counts."""
    if isinstance(found, tuple):
        return tuple(map(_wrapped, found))
    if isinstance(found, np.ndarray):
        return found.view(Array)
    if isinstance(found, bool | np.bool_):
        return Truth(found)
    return Number(found) if isinstance(found, float) else found


class Array(_Counting, np.ndarray):
    """An array of one entry for each walker."""

    __slots__ = ()

    def __array_function__(self, *given: Any) -> Any:
        """Apply a function of NumPy; its result counts too."""
        return _wrapped(super().__array_function__(*given))


for _name in IN_PLACE:  # as for numbers: `x += 1` changes no field of the step
    setattr(Array, f"__i{_name}__", getattr(np.ndarray, f"__{_name}__"))


class Truth(_Counting, int):
    """A condition of one walker, 1 or 0."""

    __slots__ = ()
    __hash__ = int.__hash__  # type: ignore[assignment]


class Number(_Counting, float):
    """A number of one walker."""

    __slots__ = ()
    __hash__ = float.__hash__  # type: ignore[assignment]


def _quick(operator: Callable[..., Any], usual: Callable[..., Any]) -> Callable[..., Any]:
    """Return an operator of `Number`s that takes that of floats where it has a result."""

    def method(self: Number, *others: Any) -> Any:
        try:
            found = operator(self, *others)
        except ZeroDivisionError:
            found = NotImplemented
        return usual(self, *others) if found is NotImplemented else _wrapped(found)

    return method


for _name in ("add", "sub", "mul", "truediv", "lt", "le", "gt", "ge", "eq", "ne", "neg", "abs"):
    for _method in (f"__{_name}__", f"__r{_name}__"):
        if hasattr(float, _method):
            setattr(Number, _method, _quick(getattr(float, _method), getattr(Number, _method)))
