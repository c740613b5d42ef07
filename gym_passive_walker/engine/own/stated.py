"""The functions of a user's system: an error of one names it, and its results do not change."""

from __future__ import annotations

import traceback
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from gym_passive_walker.models.equations import hybrid
from gym_passive_walker.models.expressions import Expression


class StatementError(ValueError):
    """The definition of a system is wrong; the message names the function."""


class Stated:
    """A function of a system, called with numbers or traced with expressions.

    Its first trace is made twice and compared.

    Args:
        name: Its name in messages.
        function: The function as the user wrote it.
        system: Name of the system.
    """

    def __init__(self, name: str, function: Callable[..., Any], system: str) -> None:
        self.name, self.system, self._traced = name, system, False
        self.function = as_written(function)

    def __repr__(self) -> str:
        return repr(self.function)

    def __call__(self, *arguments: Any) -> Any:
        """Return the function's result.

        Raises:
            StatementError: if the function raises an error, or two traces of it differ.
        """
        twice = False
        if not self._traced:
            parts = (x for each in arguments for x in (each if isinstance(each, tuple) else [each]))
            twice = self._traced = any(isinstance(x, Expression) for x in parts)
        try:
            found, *again = (_listed(self.function(*arguments)) for _ in range(1 + twice))
        except StatementError:
            raise
        except Exception as error:  # a user's function may raise anything
            raise self.error(f"fails{self._line(error)}: {_said(error)}") from error
        if again and not same(found, again[0]):
            raise self.error("gives another result each time: its arguments must determine it")
        return found

    def error(self, said: str) -> StatementError:
        """Return the error with which the function is refused."""
        return StatementError(f"{self.name} of system {self.system!r} {said}")

    def _line(self, error: Exception) -> str:
        """Return where the function failed: the last line of its file that was running."""
        file = getattr(getattr(self.function, "__code__", None), "co_filename", None)
        lines = [x.lineno for x in traceback.extract_tb(error.__traceback__) if x.filename == file]
        return f" in line {lines[-1]} of {Path(file).name}" if lines and file else ""


def as_written(function: Any) -> Any:
    """Return a function as the user wrote it; other values as they are."""
    return function.function if isinstance(function, Stated) else function


def _said(error: Exception) -> str:
    said = " ".join(f"{type(error).__name__}: {error}".split())
    if "xpression" in said:  # numbers of other libraries, or `if`, where a function is traced
        said += "; use gym_passive_walker.math, and its where() instead of if"
    return said


def _listed(found: Any) -> Any:
    return [*found] if isinstance(found, Iterator) else found


def same(found: Any, again: Any) -> bool:
    """Return whether two results are equal: numbers, expressions, or nested rows of them."""
    if isinstance(found, tuple | list) and isinstance(again, tuple | list):
        return len(found) == len(again) and all(map(same, found, again))
    if isinstance(found, Expression) or isinstance(again, Expression):
        return found is again
    return bool(np.all((found == again) | (found != found)))  # NaN is refused elsewhere


def stated(equations: hybrid.System, name: str) -> hybrid.System:
    """Return a hybrid system with functions that are `Stated`.

    Args:
        equations: The hybrid system.
        name: Name of the user's system.
    """

    def of(function: Any, title: str) -> Any:
        return Stated(title, function, name) if callable(function) else function

    def of_guard(guard: hybrid.Guard, stage: str) -> hybrid.Guard:
        title = f"guard {guard.outcome.name} of {stage}"
        where = tuple(of(each, f"where of {title}") for each in guard.where)
        return guard._replace(falls=of(guard.falls, title), where=where)

    def of_reset(reset: hybrid.Reset, outcome: hybrid.Outcome, stage: str) -> hybrid.Reset:
        title = f"reset {outcome.name} of {stage}"
        refuses = tuple(x._replace(if_=of(x.if_, f"refuses of {title}")) for x in reset.refuses)
        return reset._replace(strike=of(reset.strike, title), refuses=refuses)

    def of_phase(phase: hybrid.Phase) -> hybrid.Phase:
        stage = f"phase {phase.stage.name}"
        return phase._replace(
            accelerations=of(phase.accelerations, f"accelerations of {stage}"),
            guards=tuple(of_guard(guard, stage) for guard in phase.guards),
            resets={key: of_reset(reset, key, stage) for key, reset in phase.resets.items()},
            push=of(phase.push, f"push of {stage}"),
        )

    parts = {each: of(getattr(equations, each), each) for each in _FUNCTIONS}
    return equations._replace(phases=tuple(map(of_phase, equations.phases)), **parts)


_FUNCTIONS = (
    "place", "kinetic_energy", "potential_gain", "foot_clearance", "measure", "mass_matrix",
    "travel", "spring_gain", "friction_power", "ground_force", "momentum",
)  # fmt: skip
