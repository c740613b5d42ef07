"""The primitives on a device: single instructions.

An address is a number. Each function says what it takes and gives, and writes it.
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
    """A pointer to one of the words that begin at an address."""
    first, word = place
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
        return builder.load(_entry(builder, arguments, _NUMBER))

    return types.float64(types.int64, types.int64), code


@intrinsic
def get_whole(typing_context, first, word):
    """A whole number, as a float."""

    def code(context, builder, signature, arguments):
        return builder.sitofp(builder.load(_entry(builder, arguments, _WORD)), _NUMBER)

    return types.float64(types.int64, types.int64), code


@intrinsic
def put(typing_context, first, word, value):
    """Write a number."""

    def code(context, builder, signature, arguments):
        *place, value = arguments
        builder.store(value, _entry(builder, place, _NUMBER))
        return context.get_dummy_value()

    return types.void(types.int64, types.int64, types.float64), code


@intrinsic
def put_whole(typing_context, first, word, value):
    """Write a whole number, given as a float."""

    def code(context, builder, signature, arguments):
        *place, value = arguments
        builder.store(builder.fptosi(value, _WORD), _entry(builder, place, _WORD))
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

    kind = typing_context.unify_types(yes, no)
    return kind(types.boolean, kind, kind), code


@intrinsic
def bits(typing_context, x):
    """A number's bits, as a whole number."""

    def code(context, builder, signature, arguments):
        return builder.bitcast(arguments[0], _WORD)

    return types.int64(types.float64), code


@intrinsic
def of_bits(typing_context, whole):
    """The number that has some bits."""

    def code(context, builder, signature, arguments):
        return builder.bitcast(arguments[0], _NUMBER)

    return types.float64(types.int64), code


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
