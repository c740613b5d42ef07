"""The engine's bookkeeping, bound to a device: the same functions with other primitives.

What the engine calls by address, a device calls by number; where the engine carries lanes of a
tile, a thread of a device carries its one walker. All else is compiled from the functions that
processors run.
"""

from __future__ import annotations

import dis
from types import FunctionType, ModuleType
from typing import Any

from numba.core.dispatcher import Dispatcher

from gym_passive_walker.engine.jit import Kernel
from gym_passive_walker.gpu.primitives import jitted

_OURS = "gym_passive_walker"


def plain(value: Any) -> FunctionType | None:
    """The function that kernels are made of, or are to be; None of anything else."""
    if isinstance(value, Kernel):
        return value.function  # type: ignore[return-value]
    if isinstance(value, Dispatcher):
        return value.py_func
    ours = isinstance(value, FunctionType) and value.__module__.startswith(_OURS)
    return value if ours else None


class Bound:
    """Functions bound to a device, each made once.

    Args:
        given: Functions of a device, by what they stand for.
    """

    def __init__(self, given: dict[Any, Any]) -> None:
        self._made = dict(given)

    def instead(self, of: dict[Any, Any], *, anew: tuple[Any, ...] = ()) -> Bound:
        """The same with other functions instead.

        Args:
            of: Functions of the package, by those that they stand for; or made ones.
            anew: Which to make again, since they call those.
        """
        kept = {key: made for key, made in self._made.items() if key not in anew}
        bound = Bound(kept)
        for function, other in of.items():
            bound._made[function] = bound(other) if plain(other) else other
        return bound

    def __call__(self, function: Any) -> Any:
        """A function of the package, and all that it calls, for kernels to call."""
        if function not in self._made:
            self._made[function] = jitted(self.rebound(function))
        return self._made[function]

    def rebound(self, function: Any) -> FunctionType:
        """A plain function whose names stand for what is bound to the device."""
        found = plain(function)
        assert found is not None
        names = dict(found.__globals__)
        read = [(step.opname, step.argval) for step in dis.get_instructions(found)]
        attributes = {name for kind, name in read if kind in ("LOAD_ATTR", "LOAD_METHOD")}
        for name in {name for kind, name in read if kind == "LOAD_GLOBAL"} & names.keys():
            names[name] = self._other(names[name], attributes)
        return FunctionType(found.__code__, names, found.__name__)

    def _other(self, value: Any, attributes: set[str]) -> Any:
        """What stands on a device for what a function names."""
        if isinstance(value, ModuleType) and value.__name__.startswith(_OURS):
            module = ModuleType(value.__name__)
            for name in attributes & vars(value).keys():
                setattr(module, name, self._other(vars(value)[name], set()))
            return module
        try:
            known = value in self._made
        except TypeError:  # an array
            return value
        return self(value) if known or plain(value) else value
