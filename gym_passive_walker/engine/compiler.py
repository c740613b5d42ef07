"""LLVM's text of kernels, by numba, which nothing else of the package imports.

The text names no CPU and no function of numba, so LLVM compiles it for any CPU.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import cache, reduce
from types import FunctionType
from typing import Any

import numba
from llvmlite import ir
from numba import types
from numba.core import cgutils, config
from numba.core.compiler_lock import global_compiler_lock
from numba.core.imputils import lower_constant
from numba.core.typing.templates import AttributeTemplate
from numba.extending import (
    infer_getattr,
    intrinsic,
    lower_builtin,
    lower_getattr_generic,
    models,
    register_model,
    type_callable,
    typeof_impl,
)
from numba.np import numpy_support
from numba.np.arrayobj import populate_array

from gym_passive_walker.engine import jit
from gym_passive_walker.engine.device_linker import DeviceLinker
from gym_passive_walker.models import math

if config.DISABLE_JIT:  # type: ignore[attr-defined]
    raise ImportError(
        "gym_passive_walker requires compiled code, and NUMBA_DISABLE_JIT does not permit numba to "
        "compile: unset it, or set it to 0"
    )

# "numpy": division by zero gives inf or NaN and does not raise. Without "_nrt", no memory can be
# allocated, and arrays have no reference counts.
NUMBA_OPTIONS: dict[str, Any] = {
    "error_model": "numpy", "no_cfunc_wrapper": True, "no_cpython_wrapper": True, "_nrt": False,
}  # fmt: skip
_WAYS: dict[str, dict[str, Any]] = {
    # Without the option, a function takes it from the caller that happens to be compiled first.
    "jitted": {"forceinline": False},
    "inlined": {"forceinline": True},
    "merged": {"inline": "always"},
}
_WORD, _NUMBER = ir.IntType(64), ir.DoubleType()
_OBJECT = ir.IntType(8).as_pointer()


def _part(function: FunctionType) -> Any:
    """Return numba's dispatcher of a part of a kernel, or of a kernel that another one calls."""
    return numba.njit(**NUMBA_OPTIONS, **_WAYS[jit.WAYS.get(function.__code__, "inlined")])(
        function
    )


@type_callable(math.where)
def _(context: Any) -> Any:
    def signature(condition: Any, yes: Any, no: Any) -> Any:
        kind = context.unify_types(yes, no)
        return kind(types.boolean, kind, kind)

    return signature


@lower_builtin(math.where, types.boolean, types.Any, types.Any)
def _(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    return builder.select(*arguments)


@intrinsic
def _call(typing_context, function, first, second, lane, tangents, x, y):  # type: ignore[no-untyped-def]
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
    def code(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        return builder.fma(*arguments)

    number = types.float64
    return number(number, number, number), code


@intrinsic
def _address(typing_context, array):  # type: ignore[no-untyped-def]
    def code(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        data = context.make_array(signature.args[0])(context, builder, arguments[0]).data
        return builder.ptrtoint(data, _WORD)

    return types.int64(array), code


@intrinsic
def _copy(typing_context, target, source, size):  # type: ignore[no-untyped-def]
    def code(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        *places, count = arguments
        target, source = (builder.inttoptr(place, _OBJECT) for place in places)
        cgutils.raw_memcpy(builder, target, source, count, ir.Constant(_WORD, 1))
        return context.get_dummy_value()

    return types.void(types.int64, types.int64, types.int64), code


@intrinsic
def _view(typing_context, address, shape, dtype):  # type: ignore[no-untyped-def]
    kind = types.Array(dtype.dtype, len(shape), "C")

    def code(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        lengths = cgutils.unpack_tuple(builder, arguments[1])
        return _array(context, builder, kind, arguments[0], lengths)

    return kind(types.int64, types.UniTuple(types.intp, len(shape)), dtype), code


def _array(context: Any, builder: Any, kind: Any, address: Any, lengths: list[Any]) -> Any:
    """Return the contiguous array at an address."""
    array = context.make_array(kind)(context, builder)
    size = context.get_constant(types.intp, context.get_abi_sizeof(array.data.type.pointee))
    strides = [size]
    for length in lengths[:0:-1]:
        strides.insert(0, builder.mul(strides[0], length))
    data = builder.inttoptr(address, array.data.type)
    populate_array(array, data, lengths, strides, size, None)
    return array._getvalue()


class _Here(types.Type):
    """Type of arrays in a block of memory, and of what has them as attributes: an address."""

    def __init__(self, arrays: jit.Arrays) -> None:
        super().__init__(f"Here_{arrays.name}")
        self.found = arrays.found
        self.kinds = {
            name: types.Array(numpy_support.from_dtype(kind), len(axes), "C")
            for name, (kind, _, _, axes) in arrays.found.items()
        }


typeof_impl.register(jit.Arrays)(cache(lambda arrays, _: _Here(arrays)))
lower_constant(_Here)(lambda *_: ir.Constant(_WORD, 0))


@register_model(_Here)
class _(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: _Here) -> None:
        super().__init__(manager, kind, _WORD)


@infer_getattr
class _(AttributeTemplate):
    key = _Here

    def generic_resolve(self, here: _Here, name: str) -> Any:
        return here.kinds.get(name)


@lower_getattr_generic(_Here)
def _(context: Any, builder: Any, here: _Here, address: Any, name: str) -> Any:
    """Read an array's address and lengths; LLVM merges these loads, as they are invariant."""
    _, first, apart, axes = here.found[name]

    def at(place: int) -> Any:
        return builder.add(address, ir.Constant(_WORD, place))

    def word(place: int) -> Any:
        loaded = builder.load(builder.inttoptr(at(place), _WORD.as_pointer()))
        loaded.set_metadata("invariant.load", builder.module.add_metadata([]))
        return loaded

    lengths = [reduce(builder.mul, map(word, of), ir.Constant(_WORD, by)) for by, of in axes]
    data = word(first) if apart else at(first)
    return _array(context, builder, here.kinds[name], data, lengths)


@intrinsic
def _arrays_at(typing_context, address, arrays):  # type: ignore[no-untyped-def]
    def code(context, builder, signature, given):  # type: ignore[no-untyped-def]
        # LLVM moves no invariant load before this, to where the words may have been written.
        kind = ir.FunctionType(_WORD, [_WORD])
        return builder.asm(kind, "", "=r,0,~{memory}", given[:1], side_effect=True)

    return arrays(types.int64, arrays), code


@intrinsic(prefer_literal=True)
def _stack(typing_context, count):  # type: ignore[no-untyped-def]
    def code(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        words = cgutils.alloca_once(builder, _WORD, ir.Constant(_WORD, count.literal_value))
        return builder.ptrtoint(words, _WORD)

    return types.int64(count), code


def _drawing(kind: Any, result: Any, place: int) -> Any:
    """Return the primitive that calls a function of a generator, by its place in `bitgen_t`."""

    def draw(typing_context, generator):  # type: ignore[no-untyped-def]
        def code(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
            members = builder.inttoptr(arguments[0], _WORD.as_pointer())  # state, then functions

            def member(i: int) -> Any:
                return builder.load(builder.gep(members, [ir.Constant(_WORD, i)]))

            draws = builder.inttoptr(member(place), ir.FunctionType(result, [_WORD]).as_pointer())
            return builder.call(draws, [member(0)])

        return kind(types.int64), code

    return intrinsic(draw)


@intrinsic
def _bits_of(typing_context, x):  # type: ignore[no-untyped-def]
    def code(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        return builder.bitcast(arguments[0], _WORD)

    return types.uint64(types.float64), code


@intrinsic
def _number_of(typing_context, bits):  # type: ignore[no-untyped-def]
    def code(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        return builder.bitcast(arguments[0], _NUMBER)

    return types.float64(types.uint64), code


@intrinsic
def _word_at(typing_context, address):  # type: ignore[no-untyped-def]
    def code(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        place = builder.inttoptr(arguments[0], _WORD.as_pointer())
        return builder.load_atomic(place, "seq_cst", 8)

    return types.int64(types.int64), code


def _changing(operation: str) -> Any:
    """Return the primitive that changes a word at once for all threads."""

    def change(typing_context, address, amount):  # type: ignore[no-untyped-def]
        def code(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
            place = builder.inttoptr(arguments[0], _WORD.as_pointer())
            return builder.atomic_rmw(operation, place, arguments[1], "seq_cst")

        return types.int64(types.int64, types.int64), code

    return intrinsic(change)


PRIMITIVES: dict[Any, Any] = {
    jit.call: _call, jit.fma: _fma, jit.address: _address, jit.view: _view, jit.stack: _stack,
    jit.arrays_at: _arrays_at, jit.copy: _copy,
    jit.draw_uniform: _drawing(types.float64, _NUMBER, 3),
    jit.draw_word: _drawing(types.uint64, _WORD, 1), jit.bits_of: _bits_of,
    jit.number_of: _number_of, jit.word_at: _word_at, jit.add_at: _changing("add"),
    jit.put_at: _changing("xchg"),
}  # fmt: skip
"""The primitives of `jit` on a CPU."""


@cache
def linker() -> DeviceLinker:
    """Return what binds kernels to these primitives."""
    return DeviceLinker(PRIMITIVES, _part)


_SCALARS = {int: types.int64, bool: types.boolean, float: types.float64}
_KINDS = {"word": _WORD, "number": _NUMBER, "object": _OBJECT, "nothing": ir.VoidType()}


@global_compiler_lock
def text_of(function: Callable[..., Any], kinds: tuple[Any, ...]) -> str:
    """Return the LLVM text of a kernel: a function that Python calls by METH_FASTCALL.

    Args:
        function: The kernel's function.
        kinds: Types of its arguments, from `jit`.
    """
    given = [
        types.Array(numpy_support.from_dtype(kind[0]), kind[1], "C")
        if isinstance(kind, tuple)
        else _SCALARS[kind]
        for kind in kinds
    ]
    dispatcher: Any = numba.njit(**NUMBA_OPTIONS)(linker().rebound(function))
    dispatcher.compile(tuple(given))
    (found,) = dispatcher.overloads.values()
    context, result = found.target_context, found.signature.return_type
    library = context.codegen().create_library("kernel")
    module = library.create_ir_module("kernel")
    takes = [_OBJECT, _OBJECT.as_pointer(), _WORD]  # self, the arguments and their number
    outer = ir.Function(module, ir.FunctionType(_OBJECT, takes), "kernel")
    inner = ir.Function(
        module, context.call_conv.get_function_type(result, given), found.fndesc.llvm_func_name
    )
    builder = ir.IRBuilder(outer.append_basic_block())

    def python(name: str, *arguments: Any) -> Any:
        returns, *takes = (_KINDS[kind] for kind in jit.OF_PYTHON[name])
        of = ir.FunctionType(returns, takes)
        return builder.call(cgutils.get_or_insert_function(module, of, name), arguments)

    values = []
    for i, kind in enumerate(given):
        value = builder.load(builder.gep(outer.args[1], [ir.Constant(_WORD, i)]))
        if isinstance(kind, types.Array):
            values.append(_of_object(context, builder, kind, builder.ptrtoint(value, _WORD)))
        elif kind == types.float64:
            values.append(python("PyFloat_AsDouble", value))
        else:
            word = python("PyLong_AsUnsignedLongLongMask", value)
            truth = kind == types.boolean
            values.append(cgutils.is_not_null(builder, word) if truth else word)
    thread = python("PyEval_SaveThread")
    _, answer = context.call_conv.call_function(builder, inner, result, given, values)
    python("PyEval_RestoreThread", thread)
    if result == types.float64:
        builder.ret(python("PyFloat_FromDouble", answer))
    else:
        kind = types.uint64 if result == types.uint64 else types.int64
        none = result == types.none
        word = ir.Constant(_WORD, 0) if none else context.cast(builder, answer, result, kind)
        builder.ret(python(f"PyLong_From{'Unsigned' * (kind == types.uint64)}LongLong", word))
    library.add_ir_module(module)
    library.add_linking_library(found.library)
    library.finalize()
    return untargeted(library.get_llvm_str())


def _of_object(context: Any, builder: Any, kind: types.Array, value: Any) -> Any:
    """Return the array of a NumPy object at an address."""

    def word(address: Any, place: int) -> Any:
        there = builder.add(address, ir.Constant(_WORD, place))
        return builder.load(builder.inttoptr(there, _WORD.as_pointer()))

    shape = word(value, jit.SHAPE)
    lengths = [word(shape, 8 * axis) for axis in range(kind.ndim)]
    return _array(context, builder, kind, word(value, jit.DATA), lengths)


def untargeted(text: str) -> str:
    """Return numba's text without its target."""
    text = re.sub(r'target (datalayout|triple) = "[^"]*"\n', "", text)
    text = re.sub(r'"(target-cpu|target-features|tune-cpu|probe-stack)"="[^"]*"', "", text)
    text = re.sub(r"= common (local_unnamed_addr )?global", "= internal global", text)
    return re.sub(
        r"^define (linkonce_odr |internal )?(?![^\n]*@kernel\()",
        "define internal ",
        text,
        flags=re.M,
    )
