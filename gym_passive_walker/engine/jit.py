"""How bookkeeping is compiled: by numba, cached in this package's own folder."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cached_property
from typing import Any

import numba
from llvmlite import ir
from numba import types
from numba.extending import intrinsic, typeof_impl

from gym_passive_walker.engine.announced import announce
from gym_passive_walker.engine.cache import cache_directory

# "numpy": a division never raises.
_OPTIONS: dict[str, Any] = {"error_model": "numpy", "no_cfunc_wrapper": True}


@contextmanager
def _kernels_cached_here() -> Iterator[None]:
    """Numba reads its cache folder when a function is decorated; set it only for ours."""
    before = numba.config.CACHE_DIR  # type: ignore[attr-defined]
    numba.config.CACHE_DIR = str(cache_directory())  # type: ignore[attr-defined]
    try:
        yield
    finally:
        numba.config.CACHE_DIR = before  # type: ignore[attr-defined]


def jitted(function: Callable[..., Any]) -> Any:
    """Compile a piece of bookkeeping that kernels call."""
    return numba.njit(**_OPTIONS)(function)


def inlined(function: Callable[..., Any]) -> Any:
    """Compile a few operations that melt into whoever calls them."""
    return numba.njit(forceinline=True, **_OPTIONS)(function)


class Kernel:
    """An entry point: compiled when first called, cached on disk, free of Python's lock.

    Other kernels may call it: they find it in the cache, where `jitted` functions are compiled
    anew for each kernel.

    Args:
        function: What to compile.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        self.function = function

    @cached_property
    def compiled(self) -> Any:
        """What numba makes of it."""
        with _kernels_cached_here():
            compiled = numba.njit(cache=True, nogil=True, **_OPTIONS)(self.function)
        announce(compiled, f"the kernel {self.function.__name__.strip('_')}")
        return compiled

    def __call__(self, *arguments: Any) -> Any:
        """Run it."""
        return self.compiled(*arguments)


@typeof_impl.register(Kernel)
def _(kernel: Kernel, _: Any) -> types.Dispatcher:
    """What a kernel is to another that calls it."""
    return types.Dispatcher(kernel.compiled)


@intrinsic
def _call(typing_context, function, first, second, lane, planes, x, y):  # type: ignore[no-untyped-def]
    """Call native code by its address; see `native.Function` for what it takes."""

    def code(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        address, *rest = arguments
        kind = ir.FunctionType(ir.VoidType(), [value.type for value in rest])
        pointer = builder.inttoptr(address, kind.as_pointer())
        builder.call(pointer, rest)
        return context.get_dummy_value()

    word, number = types.int64, types.float64
    return types.void(word, word, word, word, word, number, number), code


@intrinsic
def _fma(typing_context, a, b, c):  # type: ignore[no-untyped-def]
    """The sum a * b + c, rounded once."""

    def code(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        return builder.fma(*arguments)

    number = types.float64
    return number(number, number, number), code


@intrinsic
def _address(typing_context, array):  # type: ignore[no-untyped-def]
    """Where an array's entries begin (in a tenth of the time that `array.ctypes` compiles in)."""

    def code(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        data = context.make_array(signature.args[0])(context, builder, arguments[0]).data
        return builder.ptrtoint(data, ir.IntType(64))

    return types.int64(array), code


# In compiled code: address(array), fma(a, b, c), call(function, first, second, lane, planes, x, y).
call: Any = _call
fma: Any = _fma
address: Any = _address
