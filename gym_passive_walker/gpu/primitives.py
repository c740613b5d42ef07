"""What the kernels' source is made of: memory by its address, and a few operations on numbers.

On a device these are single instructions; in numba's simulator of one they are functions of Python.
An address there is an array of the numbers that begin at it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numba
import numpy as np
from llvmlite import ir
from numba import cuda, types

from gym_passive_walker.engine.jit import fma as _fma

SIMULATED = bool(cuda.config.ENABLE_CUDASIM)
"""Whether there is a simulator instead of a device: ``NUMBA_ENABLE_CUDASIM=1``."""



def jitted(function: Callable[..., Any]) -> Any:
    """Compile a function that kernels call."""
    return cuda.jit(device=True)(function)


def inlined(function: Callable[..., Any]) -> Any:
    """Compile one that melts into whoever calls it."""
    return jitted(function) if SIMULATED else cuda.jit(device=True, forceinline=True)(function)


if SIMULATED:
    _fused = numba.njit(lambda a, b, c: _fma(a, b, c))
    sqrt: Any = np.sqrt
    sin, cos = np.sin, np.cos

    def fma(a, b, c):
        """The sum a * b + c, rounded once; of singles, as good as once."""
        whole = _fused(a, b, c)
        return np.float32(whole) if isinstance(c, np.float32) else whole

    def address(array):
        """The numbers of an array."""
        while not isinstance(array, np.ndarray):  # the simulator's wrappers
            array = array._item if hasattr(array, "_item") else array._ary
        return array.reshape(-1).view(np.ndarray).view(np.float64)

    def get(first, word):
        """A number."""
        return first[word]

    def put(first, word, value):
        """Write a number."""
        first[word] = value

    def get_whole(first, word):
        """A whole number, as a float."""
        return np.float64(first.view(np.int64)[word])

    def put_whole(first, word, value):
        """Write a whole number, given as a float."""
        first.view(np.int64)[word] = int(value)

    def apart():
        """Nothing: Python copies no function into another."""

    def select(condition, yes, no):
        """One of two numbers."""
        return yes if condition else no

    def flip(x, last_bit):
        """A number, its sign changed if another's last bit is set."""
        return -x if np.float64(last_bit).view(np.int64) & 1 else x

else:
    from numba.cuda.extending import intrinsic

    _NUMBER, _WORD = ir.DoubleType(), ir.IntType(64)
    sqrt, sin, cos = math.sqrt, math.sin, math.cos

    def _entry(builder, first, word, kind):
        """A pointer to one of the words that begin at an address."""
        return builder.gep(builder.inttoptr(first, kind.as_pointer()), [word])

    @intrinsic
    def address(typing_context, array):
        """Where an array's entries begin."""

        def code(context, builder, signature, arguments):
            data = context.make_array(signature.args[0])(context, builder, arguments[0]).data
            return builder.ptrtoint(data, _WORD)

        return types.int64(array), code

    @intrinsic
    def get(typing_context, first, word):
        """A number."""

        def code(context, builder, signature, arguments):
            return builder.load(_entry(builder, *arguments, _NUMBER))

        return types.float64(types.int64, types.int64), code

    @intrinsic
    def get_whole(typing_context, first, word):
        """A whole number, as a float."""

        def code(context, builder, signature, arguments):
            return builder.sitofp(builder.load(_entry(builder, *arguments, _WORD)), _NUMBER)

        return types.float64(types.int64, types.int64), code

    @intrinsic
    def put(typing_context, first, word, value):
        """Write a number."""

        def code(context, builder, signature, arguments):
            *place, value = arguments
            builder.store(value, _entry(builder, *place, _NUMBER))
            return context.get_dummy_value()

        return types.void(types.int64, types.int64, types.float64), code

    @intrinsic
    def put_whole(typing_context, first, word, value):
        """Write a whole number, given as a float."""

        def code(context, builder, signature, arguments):
            *place, value = arguments
            builder.store(builder.fptosi(value, _WORD), _entry(builder, *place, _WORD))
            return context.get_dummy_value()

        return types.void(types.int64, types.int64, types.float64), code

    @intrinsic
    def apart(typing_context):
        """Keep the function that says so from being copied to wherever it is called."""

        def code(context, builder, signature, arguments):
            builder.function.attributes.add("noinline")
            return context.get_dummy_value()

        return types.void(), code

    @intrinsic
    def select(typing_context, condition, yes, no):
        """One of two numbers."""

        def code(context, builder, signature, arguments):
            return builder.select(*arguments)

        return yes(types.boolean, yes, yes), code

    @intrinsic
    def flip(typing_context, x, last_bit):
        """A number, its sign changed if another's last bit is set."""

        def code(context, builder, signature, arguments):
            x, other = (builder.bitcast(value, _WORD) for value in arguments)
            sign = builder.shl(other, _WORD(63))
            return builder.bitcast(builder.xor(x, sign), _NUMBER)

        return types.float64(types.float64, types.float64), code

    @intrinsic
    def fma(typing_context, a, b, c):
        """The sum a * b + c, rounded once."""

        def code(context, builder, signature, arguments):
            return builder.fma(*arguments)

        return c(c, c, c), code
