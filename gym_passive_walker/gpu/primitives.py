"""What the kernels' source is made of: memory by its address, and a few operations on numbers.

`instructions` has them for a device, `simulated` for numba's simulator of one.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from gym_passive_walker.gpu.device import SIMULATED, cuda

if SIMULATED:
    from gym_passive_walker.gpu import simulated as _own
else:
    from gym_passive_walker.gpu import instructions as _own

NAMES = (
    "address", "apart", "bits", "exp", "flip", "fma", "get", "get_whole", "of_bits", "put",
    "put_whole", "select", "sqrt", "tanh",
)  # fmt: skip
"""Of the primitives."""

BY_NAME: dict[str, Any] = {name: getattr(_own, name) for name in NAMES}
"""The primitives."""


def jitted(function: Callable[..., Any]) -> Any:
    """Compile a function that kernels call."""
    return cuda.jit(device=True)(function)


def inlined(function: Callable[..., Any]) -> Any:
    """Compile one that melts into its callers."""
    return jitted(function) if SIMULATED else cuda.jit(device=True, forceinline=True)(function)
