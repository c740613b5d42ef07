"""The device: whether there is one, arrays on it, and how kernels are sent there."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import numba.cuda
import numpy as np
from numpy.typing import NDArray

cuda: Any = numba.cuda
"""What kernels and this room know of devices."""

SIMULATED = bool(cuda.config.ENABLE_CUDASIM)
"""Whether there is a simulator instead of a device: ``NUMBA_ENABLE_CUDASIM=1``."""

BLOCK = 64
"""Threads of a block: a thread takes nearly all registers there may be, so blocks are small."""

_MISSING = (
    "this needs a CUDA GPU, and there is none here: simulate on the CPU (gpw.stride, "
    "gym.make_vec), or set NUMBA_ENABLE_CUDASIM=1 before Python starts to simulate a GPU"
)


class NoDevice(RuntimeError):
    """There is no CUDA device."""


def need_device() -> None:
    """Say that there is no device before it is sent something.

    Raises:
        NoDevice: if there is none, and none is simulated.
    """
    if not cuda.is_available():
        raise NoDevice(_MISSING)


class Row(np.void):
    """A record with its fields as attributes, as in a device's code, whatever they are called."""

    def __getattribute__(self, name: str) -> Any:
        get = super().__getattribute__
        return self[name] if name in (get("dtype").names or ()) else get(name)

    def __setattr__(self, name: str, value: Any) -> None:
        self[name] = value


def kind(layout: np.dtype) -> np.dtype:
    """A layout of records as a device's: read by whole words, its fields as attributes."""
    return np.dtype((Row, np.dtype(layout.descr, align=True)))


def put(array: NDArray) -> Any:
    """A copy of an array on the device."""
    array = np.array(array, order="C")
    if array.dtype.fields:
        array = array.view(kind(array.dtype))
    return array if SIMULATED else cuda.to_device(array)


def room(shape: int | tuple[int, ...], of: Any) -> Any:
    """An array on the device, not filled yet."""
    of = np.dtype(of)
    of = kind(of) if of.fields else of
    return np.empty(shape, of) if SIMULATED else cuda.device_array(shape, of)


def back(array: Any) -> NDArray:
    """A copy of a device's array here."""
    found = array.copy() if SIMULATED else array.copy_to_host()
    return found.view(np.ndarray)


def launch(kernel: Any, count: int, *arguments: Any, stream: Any = 0) -> None:
    """Run a kernel with a thread for each of so many walkers, behind what the stream has to do."""
    if not SIMULATED:
        kernel[(count + BLOCK - 1) // BLOCK, BLOCK, stream](*arguments)
        return
    with warnings.catch_warnings():  # what a device does in silence
        warnings.simplefilter("ignore", RuntimeWarning)
        kernel[count, 1](*arguments)


def kernel(function: Callable[..., None]) -> Any:
    """Compile a function of arrays that a thread for each walker runs."""
    return cuda.jit(function)
