"""Access to the GPU: availability, arrays and kernels."""

from __future__ import annotations

import warnings
from contextlib import nullcontext
from typing import Any

import numba.cuda
import numpy as np
from numpy.typing import NDArray

from gym_passive_walker._tools.progress import compiling

cuda: Any = numba.cuda
"""Numba's module for GPUs."""

SIMULATED = bool(cuda.config.ENABLE_CUDASIM)
"""Whether numba simulates a GPU: ``NUMBA_ENABLE_CUDASIM=1``."""

BLOCK = 128
"""Largest number of threads of a block; a thread uses nearly all registers."""

THREADS_IN_BLOCK = 1 if SIMULATED else BLOCK
"""Threads of a block; the simulator runs one after the other."""

_MISSING = (
    "this needs a CUDA GPU, and there is none here: simulate on the CPU (gpw.stride, "
    "gym.make_vec), or set NUMBA_ENABLE_CUDASIM=1 before Python starts to simulate a GPU"
)


class NoDevice(RuntimeError):
    """There is no CUDA GPU."""


def need_device() -> None:
    """Require a GPU.

    Raises:
        NoDevice: if there is no GPU, and none is simulated.
    """
    if not cuda.is_available():
        raise NoDevice(_MISSING)


class _Row(np.void):
    """A record with its fields as attributes, as in code for a GPU."""

    def __getattribute__(self, name: str) -> Any:
        get = super().__getattribute__
        return self[name] if name in (get("dtype").names or ()) else get(name)

    def __setattr__(self, name: str, value: Any) -> None:
        self[name] = value


def kind(layout: np.dtype) -> np.dtype:
    """Return the type of records on a GPU: aligned, with fields as attributes."""
    return np.dtype((_Row, np.dtype(layout.descr, align=True)))


def upload(array: NDArray) -> Any:
    """Return a copy of an array on the GPU."""
    array = typed(np.array(array, order="C"))
    return array if SIMULATED else cuda.to_device(array)


def typed(array: NDArray) -> NDArray:
    """Return an array with the type that it has on the GPU."""
    return array.view(kind(array.dtype)) if array.dtype.fields else array


def write(array: Any, values: NDArray) -> None:
    """Write values into an array on the GPU, after all that the GPU has been given to do."""
    if SIMULATED:
        array[:] = values
        return
    cuda.synchronize()
    array.copy_to_device(values)


def to_host(array: Any) -> NDArray:
    """Return a copy of an array of the GPU in the CPU's memory."""
    found = array.copy() if SIMULATED else array.copy_to_host()
    return found.view(np.ndarray)


def placed(words: Any) -> tuple[Any, Any]:
    """Return a kernel's argument for words from `primitives.words_of`, and what holds its memory.

    numba-cuda needs 0.2 ms to pass 36 arrays to a kernel, and 5 us to pass an address.
    """
    if SIMULATED:
        return words, None
    there = cuda.to_device(words)
    return there.__cuda_array_interface__["data"][0], there


def launch(kernel: Any, count: int, *arguments: Any, stream: Any = 0) -> None:
    """Run a kernel on a stream, with one thread for each of `count` walkers."""
    if count == 0:  # a GPU refuses a launch without threads
        return
    blocks = (count + THREADS_IN_BLOCK - 1) // THREADS_IN_BLOCK
    if not SIMULATED:
        known = kernel.overloads
        with nullcontext() if known else compiling(f"{kernel.py_func.__name__} for the GPU"):
            kernel[blocks, THREADS_IN_BLOCK, stream](*arguments)
        return
    with warnings.catch_warnings():  # a GPU does not warn
        warnings.simplefilter("ignore", RuntimeWarning)
        kernel[blocks, THREADS_IN_BLOCK](*arguments)
