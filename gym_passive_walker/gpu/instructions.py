"""The primitives on a GPU: single instructions.

An address is an integer. Each function declares its types and emits its LLVM instructions.
"""

from __future__ import annotations

import math
from typing import Any

import numba.cuda.extending
from llvmlite import ir
from numba import types

intrinsic: Any = numba.cuda.extending.intrinsic

_NUMBER, _WORD = ir.DoubleType(), ir.IntType(64)
exp, sqrt, tanh = math.exp, math.sqrt, math.tanh


def _entry(builder, place, kind):
    """Return a pointer to one of the words that begin at an address."""
    first, word = place
    return builder.gep(builder.inttoptr(first, kind.as_pointer()), [word])


@intrinsic
def address(typing_context, array):
    """Return the address of the first entry of an array."""

    def code(context, builder, signature, arguments):
        data = context.make_array(signature.args[0])(context, builder, arguments[0]).data
        return builder.ptrtoint(data, _WORD)

    return types.int64(array), code


@intrinsic
def get(typing_context, first, word):
    """Return the float at a word after an address."""

    def code(context, builder, signature, arguments):
        return builder.load(_entry(builder, arguments, _NUMBER))

    return types.float64(types.int64, types.int64), code


@intrinsic
def get_whole(typing_context, first, word):
    """Return the integer at a word after an address, as a float."""

    def code(context, builder, signature, arguments):
        return builder.sitofp(builder.load(_entry(builder, arguments, _WORD)), _NUMBER)

    return types.float64(types.int64, types.int64), code


@intrinsic
def put(typing_context, first, word, value):
    """Write a float at a word after an address."""

    def code(context, builder, signature, arguments):
        *place, value = arguments
        builder.store(value, _entry(builder, place, _NUMBER))
        return context.get_dummy_value()

    return types.void(types.int64, types.int64, types.float64), code


@intrinsic
def put_whole(typing_context, first, word, value):
    """Write a float as an integer at a word after an address."""

    def code(context, builder, signature, arguments):
        *place, value = arguments
        builder.store(builder.fptosi(value, _WORD), _entry(builder, place, _WORD))
        return context.get_dummy_value()

    return types.void(types.int64, types.int64, types.float64), code


@intrinsic
def apart(typing_context):
    """Prevent inlining of the function that contains this call."""

    def code(context, builder, signature, arguments):
        builder.function.attributes.add("noinline")
        return context.get_dummy_value()

    return types.void(), code


@intrinsic
def select(typing_context, condition, yes, no):
    """Return `yes` if the condition holds, else `no`."""

    def code(context, builder, signature, arguments):
        return builder.select(*arguments)

    kind = typing_context.unify_types(yes, no)
    return kind(types.boolean, kind, kind), code


@intrinsic
def bits(typing_context, x):
    """Return the bits of a float as an integer."""

    def code(context, builder, signature, arguments):
        return builder.bitcast(arguments[0], _WORD)

    return types.int64(types.float64), code


@intrinsic
def of_bits(typing_context, whole):
    """Return the float with these bits."""

    def code(context, builder, signature, arguments):
        return builder.bitcast(arguments[0], _NUMBER)

    return types.float64(types.int64), code


@intrinsic
def flip(typing_context, x, last_bit):
    """Return x, with the opposite sign if the last bit of `last_bit` is set."""

    def code(context, builder, signature, arguments):
        x, other = (builder.bitcast(value, _WORD) for value in arguments)
        sign = builder.shl(other, _WORD(63))
        return builder.bitcast(builder.xor(x, sign), _NUMBER)

    return types.float64(types.float64, types.float64), code


@intrinsic
def fma(typing_context, a, b, c):
    """Return a * b + c, rounded once."""

    def code(context, builder, signature, arguments):
        return builder.fma(*arguments)

    return c(c, c, c), code
