"""Numbers from their bits, and the reverse, in compiled code."""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic


@intrinsic
def _bits_of(typing_context, x):  # type: ignore[no-untyped-def]
    """Return the bits of a number."""

    def code(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        return builder.bitcast(arguments[0], ir.IntType(64))

    return types.uint64(types.float64), code


@intrinsic
def _number_of(typing_context, bits):  # type: ignore[no-untyped-def]
    """Return the number of some bits."""

    def code(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        return builder.bitcast(arguments[0], ir.DoubleType())

    return types.float64(types.uint64), code


# In compiled code: bits_of(number), number_of(bits).
bits_of: Any = _bits_of
number_of: Any = _number_of
