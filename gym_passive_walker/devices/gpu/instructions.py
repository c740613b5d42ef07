"""The primitives on a GPU: single instructions.

An address is an integer. Each function declares its types and emits its LLVM instructions.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import wraps
from itertools import chain, count
from math import prod
from typing import Any

import numba.cuda.extending
import numpy as np
from llvmlite import ir
from numba import types

intrinsic: Any = numba.cuda.extending.intrinsic

_NUMBER, _WORD = ir.DoubleType(), ir.IntType(64)
_GLOBAL = 1  # address space of arrays of the GPU
_FLOAT, _INTEGER = types.float64, types.int64
exp, sqrt, tanh = math.exp, math.sqrt, math.tanh


def _emitting(signature: Any) -> Callable[[Callable[..., Any]], Any]:
    """Decorate a function that emits instructions: kernels call it with this signature."""

    def decorate(emit: Callable[..., Any]) -> Any:
        def code(context, builder, signature, arguments):
            result = emit(builder, *arguments)
            return context.get_dummy_value() if result is None else result

        @wraps(emit)  # the names of its operands are those of the calls
        def typed(typing_context, *operands):
            return signature, code

        return intrinsic(typed)

    return decorate


def _entry(builder, first, word, kind):
    """Return a pointer to one of the words that begin at an address."""
    return builder.gep(builder.inttoptr(first, kind.as_pointer()), [word])


@intrinsic
def address(typing_context, array):
    """Return the address of the first entry of an array."""

    def code(context, builder, signature, arguments):
        data = context.make_array(signature.args[0])(context, builder, arguments[0]).data
        return builder.ptrtoint(data, _WORD)

    return _INTEGER(array), code


def type_of_arrays(arrays):
    """Return the type of a named tuple of arrays."""
    from numba.cuda.typing.typeof import typeof  # type: ignore[import-not-found]

    return typeof(arrays)


def unpacker(kinds, own):
    """Return a function of kernels: the arrays of walker i, from the address of their `words_of`.

    Args:
        kinds: Type of the named tuple of arrays, from `type_of_arrays`.
        own: Arrays in the walker's column, by name; see `columns.WalkerColumns`.
    """
    from numba.cuda.np.arrayobj import populate_array  # type: ignore[import-not-found]

    def code(context, builder, signature, arguments):
        table, i, column = arguments
        table = builder.inttoptr(table, _WORD.as_pointer(_GLOBAL))
        column = context.make_array(signature.args[2])(context, builder, column).data
        places = count()

        def word():
            loaded = builder.load(builder.gep(table, [_WORD(next(places))]))
            loaded.set_metadata("invariant.load", builder.module.add_metadata([]))
            return loaded

        found = []
        for name, kind in zip(kinds.fields, kinds, strict=True):
            array = context.make_array(kind)(context, builder)
            entry = array.data.type.pointee
            size = context.get_abi_sizeof(entry)
            if name in own:
                first, lengths, _ = own[name]
                data = builder.bitcast(builder.gep(column, [_WORD(first)]), array.data.type)
                shape = [_WORD(length) for length in lengths]
                strides = [_WORD(prod(lengths[k + 1 :]) * size) for k in range(kind.ndim)]
            else:
                data = builder.add(word(), builder.mul(word(), i))
                data = builder.inttoptr(data, entry.as_pointer(_GLOBAL))
                data = builder.addrspacecast(data, array.data.type)
                shape, strides = ([word() for _ in range(kind.ndim)] for _ in range(2))
            populate_array(array, data, shape, strides, _WORD(size), None)
            found.append(array._getvalue())
        return context.make_tuple(builder, kinds, found)

    return intrinsic(
        lambda typing_context, table, i, column: (kinds(_INTEGER, _INTEGER, column), code)
    )


def words_of(columns):
    """Return address, step to the next walker, shape and strides of arrays, (words,).

    Args:
        columns: A `columns.WalkerColumns`; arrays in its columns have no words.
    """
    parts = [
        (array.__cuda_array_interface__["data"][0], step, *array.shape, *array.strides)
        for name, array, step in zip(columns.ones._fields, columns.ones, columns.steps, strict=True)
        if name not in columns.own
    ]
    return np.array(list(chain.from_iterable(parts)), np.int64)


@_emitting(_FLOAT(_INTEGER, _INTEGER))
def get(builder, first, word):
    """Return the float at a word after an address."""
    return builder.load(_entry(builder, first, word, _NUMBER))


@_emitting(_FLOAT(_INTEGER, _INTEGER))
def get_whole(builder, first, word):
    """Return the integer at a word after an address, as a float."""
    return builder.sitofp(builder.load(_entry(builder, first, word, _WORD)), _NUMBER)


@_emitting(types.void(_INTEGER, _INTEGER, _FLOAT))
def put(builder, first, word, value):
    """Write a float at a word after an address."""
    builder.store(value, _entry(builder, first, word, _NUMBER))


@_emitting(types.void(_INTEGER, _INTEGER, _FLOAT))
def put_whole(builder, first, word, value):
    """Write a float as an integer at a word after an address."""
    builder.store(builder.fptosi(value, _WORD), _entry(builder, first, word, _WORD))


@_emitting(types.void())
def apart(builder):
    """Prevent inlining of the function that contains this call."""
    builder.function.attributes.add("noinline")


@intrinsic
def select(typing_context, condition, yes, no):
    """Return `yes` if the condition holds, else `no`."""

    def code(context, builder, signature, arguments):
        return builder.select(*arguments)

    kind = typing_context.unify_types(yes, no)
    return kind(types.boolean, kind, kind), code


@_emitting(_INTEGER(_FLOAT))
def bits(builder, x):
    """Return the bits of a float as an integer."""
    return builder.bitcast(x, _WORD)


@_emitting(_FLOAT(_INTEGER))
def of_bits(builder, whole):
    """Return the float with these bits."""
    return builder.bitcast(whole, _NUMBER)


@_emitting(_FLOAT(_FLOAT, _FLOAT))
def flip(builder, x, last_bit):
    """Return x, with the opposite sign if the last bit of `last_bit` is set."""
    x, other = (builder.bitcast(value, _WORD) for value in (x, last_bit))
    return builder.bitcast(builder.xor(x, builder.shl(other, _WORD(63))), _NUMBER)


@_emitting(_FLOAT(_FLOAT, _FLOAT, _FLOAT))
def fma(builder, a, b, c):
    """Return a * b + c, rounded once."""
    return builder.fma(a, b, c)
