"""Functions of this package compiled for a machine, each with the primitives of that machine.

What the engine calls by address, another machine may call by number; where the engine integrates
lanes of a tile, it may integrate one walker. All else is compiled from the same functions.
"""

from __future__ import annotations

import dis
from collections.abc import Callable, Hashable
from types import CellType, FunctionType, ModuleType
from typing import Any

from gym_passive_walker.engine.jit import Kernel
from gym_passive_walker.models.math import where

_OURS = "gym_passive_walker"


def python_function(value: Any) -> FunctionType | None:
    """Return the Python function of a kernel or of a function of the package, else None."""
    if isinstance(value, Kernel):
        return value.function  # type: ignore[return-value]
    ours = isinstance(value, FunctionType) and value.__module__.partition(".")[0] == _OURS
    return value if ours and value is not where else None  # compilers have an instruction for it


class DeviceLinker:
    """Functions bound to a machine, each compiled once.

    Args:
        given: Functions of that machine, by those that they replace.
        compiles: Compiles a plain function for that machine.
    """

    def __init__(self, given: dict[Any, Any], compiles: Callable[[FunctionType], Any]) -> None:
        self._made, self._compiles = dict(given), compiles
        self._calls: dict[Any, set[Any]] = {}

    def instead(self, of: dict[Any, Any]) -> DeviceLinker:
        """Return a copy with other functions instead.

        Args:
            of: Functions of the package, by those that they stand for; or made ones.
        """
        stale, found = set(of), 0
        while found < len(stale):  # and their callers
            found = len(stale)
            stale |= {caller for caller, calls in self._calls.items() if calls & stale}
        kept = {key: made for key, made in self._made.items() if key not in stale}
        bound = DeviceLinker(kept, self._compiles)
        bound._calls = {key: calls for key, calls in self._calls.items() if key not in stale}
        for function, other in of.items():
            bound._made[function] = bound(other) if python_function(other) else other
        return bound

    def __call__(self, function: Any) -> Any:
        """Return a function of the package, compiled with all that it calls."""
        if function not in self._made:
            self._made[function] = self._compiles(self.rebound(function))
        return self._made[function]

    def rebound(self, function: Any) -> FunctionType:
        """Return a plain function; its names refer to what is bound to the machine."""
        found = python_function(function) or function
        calls = self._calls.setdefault(function, set())
        names = dict(found.__globals__)
        read = [(step.opname, step.argval) for step in dis.get_instructions(found)]
        attributes = {name for kind, name in read if kind in ("LOAD_ATTR", "LOAD_METHOD")}
        for name in {name for kind, name in read if kind == "LOAD_GLOBAL"} & names.keys():
            value = names[name]
            if isinstance(value, ModuleType) and value.__name__.partition(".")[0] == _OURS:
                names[name] = ModuleType(value.__name__)
                for part in attributes & vars(value).keys():
                    setattr(names[name], part, self._other(vars(value)[part], calls))
            else:
                names[name] = self._other(value, calls)
        cells = [CellType(self._other(x.cell_contents, calls)) for x in found.__closure__ or ()]
        made = FunctionType(found.__code__, names, found.__name__, None, tuple(cells))
        made.__qualname__, made.__module__ = found.__qualname__, found.__module__
        return made

    def _other(self, value: Any, calls: set[Any]) -> Any:
        """Return the replacement of a value that a function names; record it if it is called."""
        given = isinstance(value, Hashable) and value in self._made
        if not given and python_function(value) is None:
            return value
        calls.add(value)
        return self(value)
