"""How the engine computes: many walkers side by side, in the lanes of the processor's vectors.

A *tile* holds up to `WIDTH` walkers in one flat array: quantity `row` of the walker in `lane`
stands at ``tile[row * WIDTH + lane]``. Loops run over lanes; what they compute for one lane is
written as small functions of scalars. One flat array with constant strides is what lets the
compiler see that rows do not overlap and turn each loop into vector instructions.

Lanes are filled in whole groups of `GROUP`, so every walker passes through the same instructions
wherever it stands: its trajectory is bitwise the same alone and in any crowd.

The same source compiles for complex numbers. An infinitesimal imaginary part then carries an
exact derivative through the whole computation (a dual number), while the real part stays bitwise
what it was; whoever compares or rounds takes the real part first.
"""

from __future__ import annotations

import hashlib
import os
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

import numba
import numpy as np
from llvmlite import binding as llvm
from llvmlite import ir
from numba import types
from numba.extending import intrinsic, overload

GROUP = 8
"""Lanes are filled in multiples of this: one 512-bit vector, or two of 256 bits."""

WIDTH = 16
"""Walkers in a tile: enough to hide the latency of one vector behind another, few enough that a
tile stays in the first-level cache."""


def _use_full_vectors() -> None:
    """Let the compiler use 512-bit vectors where the processor has them.

    LLVM prefers 256 bits even there, by a tuning flag that numba offers no finer way to lift. The
    setting holds for the process; whoever sets NUMBA_CPU_FEATURES decides instead.
    """
    features = llvm.get_host_cpu_features()
    if features.get("avx512f") and not numba.config.CPU_FEATURES and not numba.config.CPU_NAME:  # type: ignore[attr-defined]
        numba.config.CPU_NAME = llvm.get_host_cpu_name()  # type: ignore[attr-defined]
        numba.config.CPU_FEATURES = features.flatten() + ",-prefer-256-bit"  # type: ignore[attr-defined]


def cache_directory() -> Path:
    """Where compiled kernels are kept: a folder named after this package's sources.

    Numba notices when a function's own file changes but not when a function that it calls does;
    a folder keyed by all of `physics/` makes a stale kernel impossible.
    """
    digest = hashlib.sha256()
    for source in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(source.name.encode() + source.read_bytes())
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    cache_home = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    for base in (chosen, cache_home, Path(tempfile.gettempdir())):
        if base is None:
            continue
        directory = Path(base) / "gym_passive_walker" / digest.hexdigest()[:16]
        try:
            directory.mkdir(parents=True, exist_ok=True)
        except OSError:
            continue
        if os.access(directory, os.W_OK):
            return directory
    raise OSError("no writable folder for compiled kernels: set NUMBA_CACHE_DIR to one")


Function = TypeVar("Function", bound=Callable[..., Any])

_CACHE = cache_directory()
_use_full_vectors()


@contextmanager
def _kernels_cached_here() -> Iterator[None]:
    """Numba reads its cache folder when a function is decorated; set it only for ours."""
    before = numba.config.CACHE_DIR  # type: ignore[attr-defined]
    numba.config.CACHE_DIR = str(_CACHE)  # type: ignore[attr-defined]
    try:
        yield
    finally:
        numba.config.CACHE_DIR = before  # type: ignore[attr-defined]


# "numpy": a division never raises, so it does not stop the vectoriser. "contract": a*b + c is one
# rounding. Nothing else of fast-math: sums keep their order and NaN stays visible.
_OPTIONS: dict[str, Any] = {
    "error_model": "numpy",
    "fastmath": {"contract"},
    "no_cfunc_wrapper": True,
}


def inlined(function: Callable[..., Any]) -> Any:
    """Compile a piece of physics that always melts into the kernel that calls it."""
    return numba.njit(forceinline=True, **_OPTIONS)(function)


def made_for(*what: object) -> Callable[[Function], Function]:
    """Name a function that a factory makes after what it was made for.

    Kernels cached by different processes are linked by name, and closures of one factory share
    theirs: without a name of its own one would silently be called in place of another.
    """

    def rename(function: Function) -> Function:
        suffix = "_".join(str(part) for part in what)
        function.__name__ = f"{function.__name__}_{suffix}"
        function.__qualname__ = f"{function.__qualname__}_{suffix}"
        return function

    return rename


def jitted(function: Callable[..., Any]) -> Any:
    """Compile a piece of bookkeeping that kernels call now and then."""
    return numba.njit(**_OPTIONS)(function)


def kernel(function: Callable[..., Any]) -> Any:
    """Compile an entry point: cached on disk, free of Python's lock while it runs."""
    with _kernels_cached_here():
        return numba.njit(cache=True, nogil=True, **_OPTIONS)(function)


def _entry(context, builder, array_type, array, row, lane):  # type: ignore[no-untyped-def]
    """Address of a tile's entry: no check for negative indices, which stops the vectoriser."""
    data = context.make_array(array_type)(context, builder, array).data
    word = ir.IntType(64)
    index = builder.add(builder.mul(row, ir.Constant(word, WIDTH)), lane)
    return builder.gep(data, [index], inbounds=True)


@intrinsic
def _get(typing_context, tile, row, lane):  # type: ignore[no-untyped-def]
    """The tile's quantity `row` of the walker in `lane`."""

    def code(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        address = _entry(context, builder, signature.args[0], *arguments)
        return builder.load(address)

    return tile.dtype(tile, types.int64, types.int64), code


@intrinsic
def _put(typing_context, tile, row, lane, value):  # type: ignore[no-untyped-def]
    """Set the tile's quantity `row` of the walker in `lane`."""

    def code(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        address = _entry(context, builder, signature.args[0], *arguments[:3])
        builder.store(arguments[3], address)
        return context.get_dummy_value()

    return types.void(tile, types.int64, types.int64, tile.dtype), code


@intrinsic
def _align_stack(typing_context):  # type: ignore[no-untyped-def]
    """Have the compiled function that calls this put each vector into one line of the cache.

    What finds no room in registers waits on the stack, which is aligned to 16 bytes unless asked:
    most vectors would lie across two lines, and take up to half as long again to reach.
    """

    def code(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        attributes = builder.function.attributes
        attributes.add("nounwind")  # llvmlite prints no attributes if this set is empty
        attributes.alignstack = 8 * GROUP
        return context.get_dummy_value()

    return types.void(), code


# Called as get(tile, row, lane), put(tile, row, lane, value) and align_stack() in compiled code.
get: Any = _get
put: Any = _put
align_stack: Any = _align_stack


def reciprocal(x: Any) -> Any:
    """1 / x, also for dual numbers (numba's complex division raises, and cannot be a vector)."""
    return 1.0 / x


@overload(reciprocal, inline="always")
def _reciprocal(x):  # type: ignore[no-untyped-def]
    if isinstance(x, types.Complex):

        def dual(x):  # type: ignore[no-untyped-def]
            inverse = 1.0 / x.real
            return complex(inverse, -x.imag * inverse * inverse)

        return dual
    return lambda x: 1.0 / x


@jitted
def new_tile(rows, like):
    """An empty tile of numbers like those of an array; each vector in one line of the cache."""
    buffer = np.zeros(rows * WIDTH + GROUP, like.dtype)
    start = -buffer.ctypes.data % (8 * GROUP) // buffer.itemsize
    return buffer[start : start + rows * WIDTH]


_INVERSE_PI = 0.3183098861837907
_PI = 3.141592653589793
_PI_REST = 1.2246467991473532e-16  # pi = _PI + _PI_REST to 32 digits


@inlined
def sine_cosine(x):
    """Sine and cosine to the last bit or so, in plain arithmetic that vectorises.

    The angle is reduced to a quarter turn either side of a multiple of pi; the polynomials in its
    square are Chebyshev fits there, in Estrin's order to keep the chains of dependent operations
    short. Absolute error below 2e-16 for angles up to a thousand turns.
    """
    half_turns = np.floor(x.real * _INVERSE_PI + 0.5)
    sign = 1.0 - 2.0 * (half_turns - 2.0 * np.floor(0.5 * half_turns))
    r = (x - half_turns * _PI) - half_turns * _PI_REST
    z = r * r
    z2 = z * z
    z4 = z2 * z2
    sine = r + r * z * (
        (
            (-1.6666666666666666e-1 + 8.333333333333316e-3 * z)
            + z2 * (-1.9841269841254966e-4 + 2.7557319219160833e-6 * z)
        )
        + z4
        * (
            (-2.505210761669045e-8 + 1.6058977292642743e-10 * z)
            + z2 * (-7.643969663988074e-13 + 2.7314368769379893e-15 * z)
        )
    )
    cosine = (
        1.0
        - 0.5 * z
        + z2
        * (
            (
                (4.1666666666666664e-2 - 1.388888888888888e-3 * z)
                + z2 * (2.4801587301579848e-5 - 2.755731922156836e-7 * z)
            )
            + z4
            * (
                (2.0876756602722215e-9 - 1.1470712262813793e-11 * z)
                + z2 * (4.77787760803859e-14 - 1.5218598818596388e-16 * z)
            )
        )
    )
    return sign * sine, sign * cosine
