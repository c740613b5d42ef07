"""Functions that become machine code: parts of kernels, and kernels, which Python calls.

They are plain functions of Python, which `compiler` compiles by numba. Machine code is kept on
disk and called by its address, so a process in which all is at hand loads no compiler.
"""

from __future__ import annotations

import ctypes
import hashlib
import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import CodeType
from typing import Any, NoReturn, TypeVar

import numpy as np

from gym_passive_walker.engine import machine

Plain = TypeVar("Plain", bound=Callable[..., Any])

WAYS: dict[CodeType, str] = {}
"""How parts of kernels are compiled; other functions are inlined into their callers."""


def jitted(function: Plain) -> Plain:
    """Let kernels call a function; LLVM decides whether to inline it."""
    WAYS[function.__code__] = "jitted"
    return function


def merged(function: Plain) -> Plain:
    """Compile a function as a part of its callers: a further level of calls takes seconds."""
    WAYS[function.__code__] = "merged"
    return function


def named(function: Plain, variant: str) -> Plain:
    """A function of a factory, named apart from the factory's others: code is kept by its name."""
    function.__qualname__ += f"_{variant}" * bool(variant)
    return function


def _compiled_only() -> NoReturn:
    """Raise the error of a primitive, which the compiler of each machine replaces by its own."""
    raise RuntimeError("this function exists in compiled code alone")


def call(
    function: int, first: int, second: int, lane: int, tangents: int, x: float, y: float
) -> None:
    """Call native code by its address; see `native.Function` for its arguments."""
    _compiled_only()


def fma(a: float, b: float, c: float) -> float:
    """Return the sum a * b + c, rounded once."""
    _compiled_only()


def address(array: Any) -> int:
    """Return the address of an array's data; compiles ten times faster than `array.ctypes`."""
    _compiled_only()


def copy(target: int, source: int, size: int) -> None:
    """Copy bytes from one address to another; a record that is assigned compiles for longer."""
    _compiled_only()


def view(address: int, shape: tuple[int, ...], dtype: np.dtype) -> Any:
    """Return the contiguous array at an address; compiles no further functions."""
    _compiled_only()


@dataclass(frozen=True, eq=False)
class Arrays:
    """Arrays in a block of memory; compiled code finds them by the address of the block.

    Attributes:
        name: Name of their type in compiled code, which no other has.
        found: Data type and offset in bytes of each array; whether a word with its address is there
            instead; and of each axis a number and offsets of words: their product is its length.
            A kernel does not change these words.
    """

    name: str
    found: Mapping[str, tuple[np.dtype, int, bool, list[tuple[int, list[int]]]]]


def arrays_at(address: int, arrays: Arrays) -> Any:
    """Return what has the arrays of a block as attributes: in compiled code, its address alone."""
    _compiled_only()


def stack(count: int) -> int:
    """Return the address of words on the caller's stack; their number is a constant."""
    _compiled_only()


def bits_of(x: float) -> np.uint64:
    """Return the bits of a number."""
    _compiled_only()


def number_of(bits: np.uint64) -> float:
    """Return the number of some bits."""
    _compiled_only()


def draw_uniform(generator: int) -> float:
    """Draw a number in [0, 1) from the NumPy generator with its `bitgen_t` at an address."""
    _compiled_only()


def draw_word(generator: int) -> np.uint64:
    """Draw 64 random bits from the NumPy generator with its `bitgen_t` at an address."""
    _compiled_only()


def word_at(address: int) -> int:
    """Return the word at an address, which other threads may change; they are seen in order."""
    _compiled_only()


def add_at(address: int, amount: int) -> int:
    """Add to the word at an address, at once for all threads, and return what it was."""
    _compiled_only()


def put_at(address: int, value: int) -> int:
    """Replace the word at an address, at once for all threads, and return what it was."""
    _compiled_only()


def entry(array: Any, i: int) -> int:
    """Return the address of an array's entry; a slice would be another array."""
    return address(array) + i * array.itemsize


_FASTCALL = 0x80  # of Python's METH flags: an array of the arguments, and their number
OF_PYTHON = {
    "PyLong_AsUnsignedLongLongMask": ("word", "object"),
    "PyFloat_AsDouble": ("number", "object"),
    "PyLong_FromLongLong": ("object", "word"),
    "PyLong_FromUnsignedLongLong": ("object", "word"),
    "PyFloat_FromDouble": ("object", "number"),
    "PyEval_SaveThread": ("object",),
    "PyEval_RestoreThread": ("nothing", "object"),
}
"""Functions of Python's stable binary interface that kernels call: results, and arguments."""


class _Method(ctypes.Structure):
    """Python's `PyMethodDef`."""

    _fields_ = (
        ("name", ctypes.c_char_p), ("code", ctypes.c_void_p), ("flags", ctypes.c_int),
        ("about", ctypes.c_char_p),
    )  # fmt: skip


_METHODS: list[_Method] = []  # Python's functions refer to them
_new_function = ctypes.PYFUNCTYPE(
    ctypes.py_object, ctypes.POINTER(_Method), ctypes.c_void_p, ctypes.c_void_p
)(("PyCFunction_NewEx", ctypes.pythonapi))


# Kernels take arrays as Python's objects, and find their data and shape at these places. Compiled
# extensions read them there too, so the places stay as long as NumPy's binary interface does.
DATA, SHAPE = 16, 32


class Kernel:
    """An entry point: machine code for each choice of argument types, made when first needed.

    Arrays must be contiguous in C's order. Python's lock is released meanwhile.

    Args:
        function: The function; it raises nothing, allocates nothing, and returns a number, or 0 if
            it returns nothing.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        self.function = jitted(function)  # as a part of another kernel
        self._made: dict[Any, Any] = {}

    def __call__(self, *arguments: Any) -> Any:
        """Run the kernel."""
        given = [x.item() if isinstance(x, np.generic) else x for x in arguments]
        return self.native(*given)(*given)

    def native(self, *arguments: Any) -> Any:
        """Return the machine code for arguments of these types, as a function that checks none.

        Raises:
            TypeError: if an array is not contiguous, or an argument is neither array nor number.
        """
        kinds = tuple(map(_kind, arguments))
        if kinds not in self._made:
            self._made[kinds] = self._load(kinds)
        return self._made[kinds]

    def _load(self, kinds: tuple[Any, ...]) -> Any:
        """Load machine code from the disk; make it first if it is not there."""
        _prepare()
        function, source = self.function, Path(inspect.getfile(self.function))
        # `descr`, because dtypes are written in other ways by other versions of NumPy.
        types = [(x[0].descr, x[1]) if isinstance(x, tuple) else x.__name__ for x in kinds]
        key = repr((hashlib.sha256(source.read_bytes()).digest(), types)).encode()
        name = f"{source.stem}.{function.__qualname__.replace('<locals>.', '')}"

        def make() -> str:
            try:
                from gym_passive_walker.engine import compiler  # which imports numba
            except ModuleNotFoundError as error:
                raise ImportError(
                    f"the kernel {name} is to be compiled, and numba is not installed: install it, "
                    "or install gym_passive_walker from a wheel, which has its kernels"
                ) from error
            return compiler.text_of(function, kinds)

        what = f"the kernel {function.__name__.strip('_')}"
        code = machine.kept_code(f"{name}-{hashlib.sha256(key).hexdigest()[:16]}", make, what)
        place = code.get_function_address("kernel")
        _METHODS.append(_Method(function.__name__.encode(), place, _FASTCALL, None))
        return _new_function(ctypes.byref(_METHODS[-1]), None, None)


def _kind(argument: Any) -> Any:
    """Return the type of an argument: of an array, that of its entries and its dimensions."""
    if isinstance(argument, np.ndarray):
        if not argument.flags.c_contiguous:
            raise TypeError("kernels take contiguous arrays only")
        return argument.dtype, argument.ndim
    if type(argument) not in (int, bool, float):
        raise TypeError(f"kernels take arrays and numbers, not {type(argument).__name__}")
    return type(argument)


@cache
def _prepare() -> None:
    """Name Python's functions to LLVM; check that NumPy's array object is as kernels expect it."""
    for name in OF_PYTHON:
        found = ctypes.cast(getattr(ctypes.pythonapi, name), ctypes.c_void_p)
        machine.add_symbol(name, found.value or 0)
    array = np.zeros((2, 3))
    data, shape = (ctypes.c_int64.from_address(id(array) + place).value for place in (DATA, SHAPE))
    if data != array.ctypes.data or (ctypes.c_int64 * 2).from_address(shape)[:] != [2, 3]:
        raise ImportError("this build of Python or NumPy has another array object than CPython's")
