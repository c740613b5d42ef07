"""Compilation of Python functions by numba, cached in this package's own folder."""

from __future__ import annotations

import hashlib
import inspect
import pickle
import sys
from collections.abc import Callable
from functools import cached_property
from pathlib import Path
from typing import Any

import numba
from llvmlite import ir
from numba import types
from numba.core import cgutils, config
from numba.core.caching import NullCache
from numba.core.compiler import CompileResult
from numba.core.serialize import dumps
from numba.extending import (
    intrinsic,
    lower_builtin,
    register_jitable,
    type_callable,
    typeof_impl,
)
from numba.np.arrayobj import populate_array

from gym_passive_walker.engine import cache
from gym_passive_walker.engine.compile_notice import announce
from gym_passive_walker.models import math

if config.DISABLE_JIT:  # type: ignore[attr-defined]
    raise ImportError(
        "gym_passive_walker requires compiled code, and NUMBA_DISABLE_JIT does not permit numba to "
        "compile: unset it, or set it to 0"
    )

# "numpy": division by zero gives inf or NaN and does not raise.
_OPTIONS: dict[str, Any] = {"error_model": "numpy", "no_cfunc_wrapper": True}
# Functions that only kernels call need no Python wrapper, a quarter of their compilation time.
_WITHIN: dict[str, Any] = _OPTIONS | {"no_cpython_wrapper": True}


def jitted(function: Callable[..., Any]) -> Any:
    """Compile a function that only kernels call; LLVM decides whether to inline it."""
    # Without the option, a function takes it from the caller that happens to be compiled first.
    return numba.njit(forceinline=False, **_WITHIN)(function)


def inlined(function: Callable[..., Any]) -> Any:
    """Compile a short function that is inlined into its callers."""
    return numba.njit(forceinline=True, **_WITHIN)(function)


def merged(function: Callable[..., Any]) -> Any:
    """Compile a function as a part of its callers: a further level of calls takes seconds."""
    return numba.njit(inline="always", **_WITHIN)(function)


def shared(function: Callable[..., Any]) -> Any:
    """Let kernels inline a plain function, which Python code calls with arrays or tensors."""
    return register_jitable(forceinline=True, **_WITHIN)(function)


LOWERED: set[Any] = set()
"""Plain functions for which compiled code has an instruction."""


def selecting(function: Callable[..., Any]) -> Any:
    """Let kernels compile calls `function(condition, yes, no)` to the instruction `select`."""

    @type_callable(function)
    def _(context: Any) -> Any:
        def signature(condition: Any, yes: Any, no: Any) -> Any:
            kind = context.unify_types(yes, no)
            return kind(types.boolean, kind, kind)

        return signature

    @lower_builtin(function, types.boolean, types.Any, types.Any)
    def _(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.select(*arguments)

    LOWERED.add(function)
    return function


selecting(math.where)
for _function in (math.minimum, math.maximum):
    shared(_function)


def named(function: Callable[..., Any], variant: str) -> Callable[..., Any]:
    """A function of a factory, named apart from the factory's others.

    The linker knows cached functions by their names: of two with one name it calls either.
    """
    function.__qualname__ += f"_{variant}" * bool(variant)
    return function


class _Kept(NullCache):
    """Numba's interface to this package's cache, for one function.

    Numba's own cache does not check what it loads, and fails where it cannot write.

    Args:
        function: The function to compile. The cache key includes its source file, which
            `cache.fingerprint` may not cover.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        source = Path(inspect.getfile(function))
        self._function = f"{source.stem}.{function.__qualname__}"
        self._made_by = sys.implementation.cache_tag, numba.__version__, source.read_bytes()

    def _name(self, signature: Any, codegen: Any) -> str:
        key = repr((self._made_by, signature, codegen.magic_tuple()))
        return f"{self._function}-{hashlib.sha256(key.encode()).hexdigest()[:16]}.nb"

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Load the compiled function for arguments of these types, if it is cached."""
        target_context.refresh()
        data = cache.found(self._name(sig, target_context.codegen()))
        return data and CompileResult._rebuild(target_context, *pickle.loads(data))

    def save_overload(self, sig: Any, cres: Any) -> None:
        """Write a compiled function to the cache."""
        cache.keep(self._name(sig, cres.codegen), dumps(cres._reduce()))


class Kernel:
    """An entry point: compiled when first called, cached on disk, releases Python's lock.

    Other kernels may call it and load it from the cache. `jitted` functions are compiled again for
    each kernel.

    Args:
        function: The function to compile.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        self.function = function

    @cached_property
    def compiled(self) -> Any:
        """Numba's dispatcher of the function."""
        dispatcher: Any = numba.njit(nogil=True, **_OPTIONS)(self.function)
        dispatcher._cache = _Kept(self.function)
        announce(dispatcher, f"the kernel {self.function.__name__.strip('_')}")
        return dispatcher

    def __call__(self, *arguments: Any) -> Any:
        """Run the kernel."""
        return self.compiled(*arguments)


@typeof_impl.register(Kernel)
def _(kernel: Kernel, _: Any) -> types.Dispatcher:
    """Return the numba type of a kernel, for kernels that call it."""
    return types.Dispatcher(kernel.compiled)


@intrinsic
def _call(typing_context, function, first, second, lane, tangents, x, y):  # type: ignore[no-untyped-def]
    """Call native code by its address; see `native.Function` for its arguments."""

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
    """Return the sum a * b + c, rounded once."""

    def code(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        return builder.fma(*arguments)

    number = types.float64
    return number(number, number, number), code


@intrinsic
def _address(typing_context, array):  # type: ignore[no-untyped-def]
    """Return the address of an array's data; compiles ten times faster than `array.ctypes`."""

    def code(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        data = context.make_array(signature.args[0])(context, builder, arguments[0]).data
        return builder.ptrtoint(data, ir.IntType(64))

    return types.int64(array), code


@intrinsic
def _view(typing_context, address, shape, dtype):  # type: ignore[no-untyped-def]
    """Return the contiguous array at an address; compiles no further functions."""
    kind = types.Array(dtype.dtype, len(shape), "C")

    def code(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        array = context.make_array(kind)(context, builder)
        size = context.get_constant(types.intp, context.get_abi_sizeof(array.data.type.pointee))
        lengths, strides = cgutils.unpack_tuple(builder, arguments[1]), [size]
        for length in lengths[:0:-1]:
            strides.insert(0, builder.mul(strides[0], length))
        data = builder.inttoptr(arguments[0], array.data.type)
        populate_array(array, data, lengths, strides, size, None)
        return array._getvalue()

    return kind(types.int64, types.UniTuple(types.intp, len(shape)), dtype), code


@intrinsic(prefer_literal=True)
def _stack(typing_context, count):  # type: ignore[no-untyped-def]
    """Return the address of words on the caller's stack; their number is a constant."""

    def code(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        word = ir.IntType(64)
        words = cgutils.alloca_once(builder, word, ir.Constant(word, count.literal_value))
        return builder.ptrtoint(words, word)

    return types.int64(count), code


@intrinsic
def _uniform(typing_context, generator):  # type: ignore[no-untyped-def]
    """Draw a number in [0, 1) from the NumPy generator with its `bitgen_t` at an address."""

    def code(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        word, number = ir.IntType(64), ir.DoubleType()
        members = builder.inttoptr(arguments[0], word.as_pointer())  # state, then functions

        def member(i: int) -> Any:
            return builder.load(builder.gep(members, [ir.Constant(word, i)]))

        draws = builder.inttoptr(member(3), ir.FunctionType(number, [word]).as_pointer())
        return builder.call(draws, [member(0)])

    return types.float64(types.int64), code


# In compiled code: address(array), view(address, shape, dtype), stack(count), fma(a, b, c),
# uniform(generator), call(function, first, second, lane, tangents, x, y).
call: Any = _call
fma: Any = _fma
address: Any = _address
view: Any = _view
stack: Any = _stack


@inlined
def entry(array, i):  # type: ignore[no-untyped-def]
    """Return the address of an array's entry; a slice would add a reference to the array."""
    return address(array) + i * array.itemsize


draw_uniform: Any = _uniform
