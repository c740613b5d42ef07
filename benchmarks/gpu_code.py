"""What a GPU would run, as far as it can be known without one: its code, and the host's time.

    python -m benchmarks.gpu_code            Run all parts.
    python -m benchmarks.gpu_code kernels    Registers, memory and loads of the kernels, from PTX.
    python -m benchmarks.gpu_code launch     Host time of a launch, up to the driver's call.

Requires the extra "gpu". Kernels are compiled for sm_90. Each part prints its table and writes the
table to docs/gpu.md.
"""

from __future__ import annotations

import ctypes
import re
import sys
import time
import warnings
from collections import namedtuple
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import SimpleNamespace
from typing import Any
from unittest import mock

import numpy as np

from benchmarks.report import command, machine, table
from benchmarks.tables import GPU, keep

CAPABILITY = 9
"""Compute capability of the GPU: 9 for sm_90."""

_ASSEMBLED = re.compile(r"used (\d+) registers.*?(\d+) stack")


@contextmanager
def no_driver(capability: int = CAPABILITY) -> Iterator[None]:
    """Let numba-cuda compile for a GPU of a capability, without a GPU and its driver."""
    import numba.cuda.api
    import numba.cuda.cudadrv.devices as devices
    import numba.cuda.dispatcher

    context = SimpleNamespace(device=SimpleNamespace(compute_capability=(capability, 0), id=0))
    with (
        mock.patch.object(devices, "get_context", lambda *_: context),
        mock.patch.object(numba.cuda.dispatcher, "get_context", lambda *_: context),
        mock.patch.object(numba.cuda.api, "current_context", lambda *_: context),
    ):
        yield


def ptx(scene: Any, capability: int = CAPABILITY) -> dict[str, str]:
    """Return the PTX of all kernels of a scene, by name."""
    with no_driver(capability):
        from numba import cuda
        from numba.cuda.typing.typeof import typeof

        from gym_passive_walker.devices.gpu import batch, device, primitives

        found = {}

        def compiled(kernel: Any, count: int, *arguments: Any, stream: Any) -> None:
            kinds = tuple(map(typeof, arguments))
            text = cuda.compile_ptx(kernel.py_func, kinds, cc=(capability, 0))[0]
            found[kernel.py_func.__name__] = text

        def put(array: Any) -> Any:
            array = np.array(array, order="C")
            return array.view(device.kind(array.dtype)) if array.dtype.fields else array

        there = mock.patch.multiple(
            device, need_device=lambda: None, upload=put, launch=compiled, write=lambda *_: None,
            empty=lambda shape, of: put(np.zeros(shape, of)), placed=lambda _: (0, None),
        )  # fmt: skip
        with there, mock.patch.object(primitives, "words_of"):
            walkers = batch.DeviceBatch(2, scene)
            walkers.reset()
            walkers.step()
        return found


def parameters(text: str) -> int:
    """Return the number of parameters of the kernel in PTX."""
    (taken,) = re.findall(r"\.visible \.entry \S+\((.*?)\)\n", text, re.S)
    return taken.count(".param")


def assembled(text: str, capability: int = CAPABILITY) -> tuple[int, int, int]:
    """Return registers and bytes of stack of a thread, and bytes of machine code, of PTX."""
    from cuda.bindings import nvjitlink  # type: ignore[import-not-found]

    options = [f"-arch=sm_{capability}0", "-verbose"]
    link, data = nvjitlink.create(len(options), options), text.encode()
    nvjitlink.add_data(link, nvjitlink.InputType.PTX, data, len(data), "kernel")
    nvjitlink.complete(link)
    log = bytearray(nvjitlink.get_info_log_size(link))
    nvjitlink.get_info_log(link, log)
    size = nvjitlink.get_linked_cubin_size(link)
    registers, stack = _ASSEMBLED.findall(log.decode(errors="replace"))[-1]
    return int(registers), int(stack), size


def kernels() -> None:
    """Print registers, stack, code, parameters and accesses to memory of each kernel."""
    rows = []
    for name, text in ptx("level").items():
        registers, stack, size = assembled(text)
        counts = (
            len(re.findall(rf"\t{way}\.{where}", text))
            for where in ("global", "local")
            for way in ("ld", "st")
        )
        rows.append((name, parameters(text), registers, stack, size // 1024, *counts))
    heads = ["kernel", "parameters", "registers", "stack in bytes", "code in KiB", "global loads",
             "global stores", "local loads", "local stores"]  # fmt: skip
    _report("gpu kernels", f"Scene `level`, compiled for sm_{CAPABILITY}0:\n\n{table(heads, rows)}")


def launch() -> None:
    """Print the host's time to launch a kernel, by what it takes."""
    with no_driver():
        import numba.cuda.dispatcher as dispatcher
        from numba import cuda
        from numba.cuda import codegen
        from numba.cuda.cudadrv.devicearray import DeviceNDArray

        memory = SimpleNamespace(device_ctypes_pointer=ctypes.c_void_p(4096))
        memory.view = lambda *_: memory

        def array(shape: Any, kind: Any) -> Any:
            like = np.empty(shape, kind)
            return DeviceNDArray(like.shape, like.strides, like.dtype, gpu_data=memory)

        record = np.dtype([("state", "f8", (6,)), ("steps", "i8")], align=True)
        parts = [array((64, 1), record) if i % 4 == 0 else array(64, "f8") for i in range(36)]
        here = namedtuple("here", [f"a{i}" for i in range(36)])(*parts)
        library = codegen.CUDACodeLibrary
        quiet = (
            mock.patch.object(dispatcher, "launch", _handed_over),
            mock.patch.object(dispatcher._Kernel, "bind", lambda _: None),
            mock.patch.object(library, "get_cufunc", lambda _: SimpleNamespace(kernel=None)),
        )
        with warnings.catch_warnings(), quiet[0], quiet[1], quiet[2]:
            warnings.simplefilter("ignore")  # of small grids
            rows = []
            for label, argument in (("36 arrays", here), ("an address", 4096)):
                kernel = cuda.jit(lambda given: None)
                rows.append((label, _microseconds(lambda k=kernel, a=argument: k[16, 64, 0](a))))
    text = table(["a kernel takes", "µs"], rows)
    _report("gpu launch", f"{text}\n\n{machine('numba-cuda')}")


def _handed_over(stream: Any, config: Any, kernel: Any, *arguments: Any) -> None:
    """Prepare arguments as `cuda.core.launch` does before it calls the driver."""
    from cuda.core._kernel_arg_handler import ParamHolder  # type: ignore[import-not-found]

    ParamHolder(arguments)


def _microseconds(job: Callable[[], object], repeats: int = 2000) -> float:
    """Return the shortest time of a call, in microseconds."""
    job()  # compiles
    took = []
    for _ in range(repeats):
        began = time.perf_counter()
        job()
        took.append(time.perf_counter() - began)
    return 1e6 * min(took)


def _report(name: str, text: str) -> None:
    keep(name, text, GPU)


PARTS = {"kernels": kernels, "launch": launch}


if __name__ == "__main__":
    sys.exit(command(__doc__, PARTS))
