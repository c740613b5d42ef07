"""Primitives of the kernels' source: memory access by address, and operations on numbers.

`instructions` implements them for a GPU, `simulated` for numba's simulator of a GPU.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from gym_passive_walker.devices.gpu.device import SIMULATED, cuda

if SIMULATED:
    from gym_passive_walker.devices.gpu import simulated as _own
else:
    from gym_passive_walker.devices.gpu import instructions as _own

NAMES = (
    "address", "apart", "bits", "exp", "flip", "fma", "get", "get_whole", "of_bits", "put",
    "put_whole", "select", "sqrt", "tanh",
)  # fmt: skip
"""Names of the primitives."""

BY_NAME: dict[str, Any] = {name: getattr(_own, name) for name in NAMES}
"""The primitives, by name."""


type_of_arrays, unpacker, words_of = _own.type_of_arrays, _own.unpacker, _own.words_of
"""How a kernel finds arrays by one argument; see `instructions`."""


def jitted(function: Callable[..., Any]) -> Any:
    """Compile a function for calls from kernels."""
    return cuda.jit(device=True)(function)


def inlined(function: Callable[..., Any]) -> Any:
    """Compile a function that is inlined into its callers."""
    return jitted(function) if SIMULATED else cuda.jit(device=True, forceinline=True)(function)


def copy(target, source, size):
    """Copy bytes from one address to another, in words."""
    for word in range(size // 8):
        _own.put(target, word, _own.get(source, word))


BY_NAME["copy"] = inlined(copy)
