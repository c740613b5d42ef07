"""A user's function of a `Transition`: compiled, called with arrays, or called for each walker.

A function is traced with symbolic numbers, and the expression that it returns is compiled. One that
cannot be traced is called after each step with arrays of all walkers, or for each walker. A way of
calling it counts only if it gives the numbers of plain Python for each walker alone.
"""

from __future__ import annotations

import ctypes
import hashlib
import warnings
from collections.abc import Callable, Sequence
from types import FunctionType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gym_passive_walker._tools.arguments import shown
from gym_passive_walker._tools.loading import cause_of
from gym_passive_walker.engine import machine
from gym_passive_walker.engine.native import Memory, Module, uses
from gym_passive_walker.envs import task, views
from gym_passive_walker.envs.transitions import OF_LEDGER, PARTS, note_for
from gym_passive_walker.envs.views import Shape
from gym_passive_walker.gaits.scenes.checks import SceneError
from gym_passive_walker.gaits.scenes.transition import Transition
from gym_passive_walker.models.equations.hybrid import Outcome
from gym_passive_walker.models.expressions import Expression

_ALL = (1 << len(PARTS)) - 1
_FEW = 3  # walkers in a comparison of results, together and alone
_ROUNDING = 1e-9  # relative; formulas may cancel digits
_SIGNATURE = ctypes.CFUNCTYPE(None, *[ctypes.c_int64] * 4, *[ctypes.c_double] * 2)


class Rule:
    """A user's function, compiled where possible.

    Args:
        name: "reward", "observation" or "terminated".
        function: The function of a `Transition`.
        shape: Shape of its transitions.
        text: Digest of the code of the rule that this one is a copy of.

    Attributes:
        size: Number of values that the function returns.
        noted: Groups of `transitions.PARTS` that the function reads, as bits.
        native: Address of the compiled code; 0 if the function cannot be traced.
        text: Digest of the compiled code; None if there is none.
        untraced: Why the function is not compiled; empty if it is.

    Raises:
        SceneError: if the function raises an error, or does not return numbers.
    """

    def __init__(
        self,
        name: str,
        function: Callable[[Transition], Any],
        shape: Shape,
        text: str | None = None,
    ) -> None:
        self.name, self.function, self.shape = name, function, shape
        self._trace: tuple[Any, ...] = ()  # the step and the results that were traced
        self.native, self.noted, self.text, self.untraced = 0, _ALL, None, ""
        self._together = self._as_numbers = True
        self._trusted = False
        notes = views.samples(shape, begun=name == "observation")
        alone = self._tried(notes)
        self.size = alone.shape[1]
        if self.size == 0 or (name != "observation" and self.size != 1):
            raise SceneError(f"{name} fails: it gives {self.size} numbers")
        try:
            self._compile(notes, alone)
        except Exception as error:  # a user's function may raise anything
            self.untraced = cause_of(error)
            self._together = self._is_together(notes[:_FEW], alone[:_FEW])
            self._warn(
                f"cannot be compiled ({self.untraced}): after each step it is called "
                f"{'with arrays' if self._together else 'walker by walker'}, which takes longer; "
                "use gpw.math, and its where() instead of if"
            )
        if text and text != self.text:
            self._warn(_FROZEN.format(name))

    def __reduce__(self) -> tuple[Any, ...]:
        return Rule, (self.name, self.function, self.shape, self.text)

    def _warn(self, said: str) -> None:
        """Warn once of the function, with the line that defines it."""
        said = f"{self.name} {said}"
        plain = getattr(self.function, "__func__", self.function)  # of a method
        if not isinstance(plain, FunctionType):
            warnings.warn(said, stacklevel=4)
            return
        code, known = plain.__code__, plain.__globals__.setdefault("__warningregistry__", {})
        where = code.co_filename, code.co_firstlineno
        warnings.warn_explicit(said, UserWarning, *where, registry=known)

    def _tried(self, notes: NDArray) -> NDArray[np.float64]:
        """Return the results for each walker alone: with plain numbers, else as arrays of one.

        Raises:
            SceneError: if there are none, or one is not a number.
        """
        try:
            found = self._alone(notes)
        except _NoNumber as error:
            raise SceneError(str(error)) from None
        except Exception as error:
            self._as_numbers = False
            try:
                found = self._alone(notes)
            except _NoNumber as no_number:
                raise SceneError(str(no_number)) from None
            except Exception:
                raise SceneError(f"{self.name} fails: {cause_of(error)}") from error
        if np.isnan(found).any():
            k = int(np.flatnonzero(np.isnan(found).any(axis=1))[0])
            raise SceneError(f"{self._wanted(np.nan)} {_SAMPLED[k]}; return a number there too")
        return found

    def _wanted(self, found: Any) -> str:
        """Return the beginning of an error for a result that is no number."""
        plain = getattr(self.function, "__func__", self.function)
        name = getattr(plain, "__qualname__", type(plain).__qualname__)
        return f"{self.name} must return numbers, and {name} returns {shown(found)}"

    def _compile(self, notes: NDArray, alone: NDArray[np.float64]) -> None:
        """Compile the function, and determine the fields that it reads.

        Raises:
            TypeError: if it cannot be traced, or the code gives other results for the walkers of
                `notes` than `alone`.
        """
        module = Module(fuses=False)
        noted = self.write(module)
        text = str(module)
        try:
            native = machine.loaded(machine.object_code(module)).get_function_address("rule")
        except RuntimeError as error:
            raise TypeError("the compiler does not accept its code") from error
        found = self._of_code(native, notes)
        if not _agree(found, alone):
            k, i = np.argwhere(~_close(found, alone))[0]
            raise TypeError(
                f"compiled it would return {found[k, i]:.6g} where Python returns {alone[k, i]:.6g}"
            )
        self.native, self.noted = native, noted
        self.text = hashlib.sha256(text.encode()).hexdigest()

    def _of_code(self, native: int, notes: NDArray) -> NDArray[np.float64]:
        """Return results (n, size) of compiled code."""
        first: NDArray[Any]
        second: NDArray[Any]
        if self.name == "observation":
            first, second = notes, np.zeros((len(notes), self.size))
        else:
            first, second = np.zeros(len(notes), task.ledger_for(self.shape.layout)), notes.copy()
            for field in {*OF_LEDGER} - {"heelstrike", "fell"}:
                first[field] = notes[field]
            first["outcome"] = np.where(notes["heelstrike"] > 0.5, Outcome.HEELSTRIKE, 0)
            first["ending"] = notes["fell"]
        places = first.ctypes.data, second.ctypes.data
        _SIGNATURE(native)(*places, len(notes), 0, 0.0, 0.0)
        if self.name == "observation":
            return second
        return second[_RESULTS[self.name]][:, None]

    def _traced(self, step: Transition) -> list[Any]:
        """Return the expressions from the function; raises TypeError for other results."""
        found, again = (listed(self.function(step)) for _ in range(2))
        for result in found:
            if not isinstance(result, Expression | int | float | np.number | np.bool_):
                raise TypeError(f"it gives {shown(result)}")
        if not _same(found, again):
            raise TypeError("it gives another result each time")
        return found

    def write(self, module: Module) -> int:
        """Add the function under the name "rule" to a module that rounds each operation.

        Returns:
            Groups of `transitions.PARTS` that it reads, as bits.
        """
        noting, noted = self.name == "observation", 0
        note_type = note_for(self.shape.layout)
        seen = np.dtype([("seen", "f8", (self.size,))])
        layouts = (note_type, seen) if noting else (task.ledger_for(self.shape.layout), note_type)

        def code(first: Memory, second: Memory) -> None:
            nonlocal noted
            step = views.traced(*((first, None) if noting else (second, first)), self.shape)
            results = self._traced(step)
            self._trace = step, results
            zero = Expression(first.known, "constant", 0.0)
            for i, result in enumerate(results):
                second[("seen", i) if noting else _RESULTS[self.name]] = zero.number(result)
            read = {x.args[1] for x in uses(second.writes.values()) if x.op == "read"}
            parts = [*PARTS] if noting else [(), *PARTS[1:]]  # the ledger itself is read
            noted = sum(1 << i for i, part in enumerate(parts) if read & {*part})

        function = module.function("rule", layouts)
        function.over_rows(code)
        function.end()
        return noted

    def look_again(self) -> None:
        """Compare the function at the beginning of episodes with what it was before.

        One that is compiled is traced again, and a warning says if it has other constants now. One
        that is called with arrays is compared at its next call with each walker alone.
        """
        self._trusted = False
        if self.native:
            step, results = self._trace
            try:
                same = _same(listed(self.function(step)), results)
            except Exception:
                same = False
            if not same:
                self._warn(_FROZEN.format(self.name))

    def __call__(self, notes: NDArray) -> NDArray[np.float64]:
        """Return results (n, size) for transitions (n,), from arrays or one walker at a time.

        Raises:
            SceneError: if the function returns no numbers.
        """
        try:
            if self._together and not self._trusted and len(notes) > 1:
                self._trusted, few = True, notes[:_FEW]
                self._together = self._is_together(few, self._alone(few))
                if not self._together:
                    self._warn("mixes walkers: it is called walker by walker, which takes longer")
            found = self._of_arrays(notes) if self._together else self._alone(notes)
        except _NoNumber as error:
            raise SceneError(str(error)) from None
        if found.shape[1] != self.size:
            raise SceneError(f"{self.name} gives {found.shape[1]} numbers, and gave {self.size}")
        return found

    def _is_together(self, notes: NDArray, alone: NDArray[np.float64]) -> bool:
        """Return whether arrays of all walkers give the results of each alone."""
        try:
            return _agree(self._of_arrays(notes), alone)
        except Exception:
            return False

    def _of_arrays(self, notes: NDArray) -> NDArray[np.float64]:
        """Return results (n, size) from arrays of all walkers."""
        with np.errstate(all="ignore"):
            found = self.function(views.of_notes(notes, self.shape))
        columns = [self._floats(column) for column in listed(found, arrays=True)]
        return np.stack([np.broadcast_to(column, len(notes)) for column in columns], axis=1)

    def _alone(self, notes: NDArray) -> NDArray[np.float64]:
        """Return results (n, size), from one walker at a time."""
        each = [notes[i : i + 1] for i in range(len(notes))]
        if not self._as_numbers:
            return np.concatenate([self._of_arrays(note) for note in each])
        with np.errstate(all="ignore"):
            rows = [listed(self.function(views.of_one(note, self.shape))) for note in each]
        found = [[self._floats(number) for number in row] for row in rows]
        for shape in {number.shape for row in found for number in row} - {()}:
            raise TypeError(f"it gives arrays of shape {shape}, not numbers")
        return np.array(found, float).reshape(len(notes), -1)

    def _floats(self, found: Any) -> NDArray[np.float64]:
        """Return a result as an array of floats.

        Raises:
            _NoNumber: for None, text, complex numbers and other objects.
        """
        array = np.asarray(found)
        if array.dtype.kind not in "biuf":
            hint = "; its `return` is missing" if found is None else ""
            raise _NoNumber(f"{self._wanted(found)}{hint}")
        return array.astype(float)


class _NoNumber(TypeError):
    """A function returns something else than numbers."""


_RESULTS = {"reward": "paid", "terminated": "ends"}
"""Fields of a recorded transition for the results of functions."""

_SAMPLED = (
    "in a step within a stride", "in a step with a heelstrike", "in a step with a fall",
    "in a step late in an episode", "when an episode begins",
)  # fmt: skip
"""Descriptions of `views.samples`."""

_FROZEN = (
    "has other constants than when it was compiled: values that a function holds are read when an "
    "environment is made or copied; set_scene({}=...) reads them again"
)


def listed(found: Any, *, arrays: bool = False) -> list[Any]:
    """Return the result of a function as a list of its numbers, or of `arrays` of them."""
    several = isinstance(found, np.ndarray) and found.ndim > arrays
    return [*found] if several or isinstance(found, tuple | list) else [found]


def _same(found: Sequence[Any], other: Sequence[Any]) -> bool:
    """Return whether two traces are the same expressions and constants."""
    return len(found) == len(other) and all(
        a is b if isinstance(a, Expression) or isinstance(b, Expression) else a == b
        for a, b in zip(found, other, strict=True)
    )


def _close(found: NDArray[np.float64], other: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return where results are equal to rounding."""
    return np.isclose(found, other, rtol=_ROUNDING, atol=1e-12, equal_nan=True)


def _agree(found: NDArray[np.float64], other: NDArray[np.float64]) -> bool:
    """Return whether results have one shape, and are equal to rounding."""
    return found.shape == other.shape and bool(_close(found, other).all())
