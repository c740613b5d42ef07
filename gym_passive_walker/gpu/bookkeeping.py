"""The engine's bookkeeping, bound to a device: the same functions with other primitives.

What the engine calls by address, a device calls by number; where the engine carries lanes of a
tile, a thread of a device carries its one walker. All else is compiled from the functions that
processors run.
"""

from __future__ import annotations

from types import FunctionType
from typing import Any

from gym_passive_walker.engine import device_linker
from gym_passive_walker.gpu.primitives import jitted


def _compiled(function: FunctionType) -> Any:
    """A function for kernels to call."""
    return jitted(function)


class DeviceLinker(device_linker.DeviceLinker):
    """Functions bound to a device, each made once.

    Args:
        given: Functions of a device, by what they stand for.
    """

    def __init__(self, given: dict[Any, Any]) -> None:
        super().__init__(given, _compiled)
