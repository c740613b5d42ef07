"""The engine's bookkeeping, bound to a device: the same functions with other primitives.

What the engine calls by address, a device calls by number; where the engine carries lanes of a
tile, a thread of a device carries its one walker. All else is compiled from the functions that
processors run.
"""

from __future__ import annotations

import dis
from collections.abc import Callable
from types import FunctionType, ModuleType
from typing import Any

from numba.core.dispatcher import Dispatcher

from gym_passive_walker.engine.jit import Kernel


def plain(value: Any) -> FunctionType | None:
    """The function that a processor's kernel is made of; None of anything else."""
    if isinstance(value, Kernel):
        return value.function  # type: ignore[return-value]
    return getattr(value, "py_func", None) if isinstance(value, Dispatcher) else None


class Bound:
    """Functions bound to a device, each made once.

    Args:
        compile: What makes a device's function of a plain one.
        given: By what to replace functions that are called, by those themselves.
    """

    def __init__(self, compile: Callable[[FunctionType], Any], given: dict[Any, Any]) -> None:
        self._compile, self._made = compile, dict(given)

    def __call__(self, function: Any) -> Any:
        """A kernel or function of the engine, and all that it calls, for the device."""
        if function not in self._made:
            found = plain(function)
            assert found is not None
            self._made[function] = self._compile(self.rebound(found))
        return self._made[function]

    def rebound(self, function: FunctionType) -> FunctionType:
        """A plain function that calls what is bound to the device."""
        names = dict(function.__globals__)
        read = [(step.opname, step.argval) for step in dis.get_instructions(function)]
        attributes = {name for kind, name in read if kind in ("LOAD_ATTR", "LOAD_METHOD")}
        for name in {name for kind, name in read if kind == "LOAD_GLOBAL"} & names.keys():
            names[name] = self._other(names[name], attributes)
        return FunctionType(function.__code__, names, function.__name__, function.__defaults__)

    def _other(self, value: Any, attributes: set[str]) -> Any:
        """What stands on a device for what a function names."""
        if isinstance(value, ModuleType) and value.__name__.startswith("gym_passive_walker"):
            module = ModuleType(value.__name__)
            for name in attributes & vars(value).keys():
                setattr(module, name, self._other(vars(value)[name], set()))
            return module
        try:
            known = value in self._made
        except TypeError:  # an array
            return value
        return self(value) if known or plain(value) else value
