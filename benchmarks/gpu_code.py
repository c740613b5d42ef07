"""What a GPU would run, as far as it can be known without one: its code, and the host's time.

    python -m benchmarks.gpu_code            Run all parts.
    python -m benchmarks.gpu_code kernels    Registers, memory and loads of the kernels, from PTX.
    python -m benchmarks.gpu_code launch     Host time of a launch, up to the driver's call.
    python -m benchmarks.gpu_code warps      Instructions of a warp, by which walkers it steps.

Requires the extra "gpu"; `warps` also runs with NUMBA_ENABLE_CUDASIM=1 instead. Kernels are
compiled for sm_90. Each part prints its table and writes the table to docs/gpu.md.
"""

from __future__ import annotations

import ctypes
import re
import sys
import time
import warnings
from collections import Counter, namedtuple
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import SimpleNamespace
from typing import Any, NamedTuple
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


def ptx(scene: Any, capability: int = CAPABILITY) -> tuple[dict[str, str], Any]:
    """Return the PTX of all kernels of a scene, by name, and the batch that they are of."""
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
            return device.typed(np.array(array, order="C"))

        there = mock.patch.multiple(
            device, need_device=lambda: None, upload=put, launch=compiled, write=lambda *_: None,
            placed=lambda _: (0, None),
        )  # fmt: skip
        with there, mock.patch.object(primitives, "words_of"):
            walkers = batch.DeviceBatch(2, scene)
            walkers.reset()
            walkers.step()
        return found, walkers


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
    texts, walkers = ptx("level")
    for name, text in texts.items():
        registers, stack, size = assembled(text)
        counts = (
            len(re.findall(rf"\t{way}\.{where}", text))
            for where in ("global", "local")
            for way in ("ld", "st")
        )
        rows.append((name, parameters(text), registers, stack, size // 1024, *counts))
    heads = ["kernel", "parameters", "registers", "stack in bytes", "code in KiB", "global loads",
             "global stores", "local loads", "local stores"]  # fmt: skip
    there = walkers._columns
    names = "actions", "observations", "last", "rewards", "terminated", "truncated"
    passed = sum(getattr(there.arrays, name).nbytes for name in names) // walkers.count
    said = (
        f"Scene `level`, compiled for sm_{CAPABILITY}0. A step reads {8 * there.read} bytes of a "
        f"walker's column and writes {8 * there.size}; actions and results are {passed} more"
    )
    keep("gpu kernels", f"{table(heads, rows)}\n\n{said}.", GPU)


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
    keep("gpu launch", f"{text}\n\n{machine('numba-cuda')}", GPU)


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


WARP = 32
"""Threads that execute one instruction at a time."""

_EVENT = ("look", "predict_strike", "accept")


class _Step(NamedTuple):
    """What a control step of each walker takes, (walkers,)."""

    phase: Any  # as it begins
    time: Any  # time since the stride began
    sweeps: Any  # integration steps in each phase, (walkers, 2)
    events: Any  # whether an event ends each phase, (walkers, 2)
    ends: Any  # whether the episode ends


def warps() -> None:
    """Print instructions of a warp for a control step of kneed walkers with random actions.

    A warp executes what any of its walkers needs. Counted are traced operations, reads and writes
    of integration steps and events; not counted are loads of walkers, rewards and resets.
    """
    sweep, event = _operations()
    steps = _walked()

    def mean(cost: Callable[[_Step, Any], float], sorted_every: int = 0) -> float:
        total, order = 0.0, np.arange(len(steps[0].phase))
        for k, step in enumerate(steps):
            if sorted_every and k % sorted_every == 0:
                order = np.lexsort((step.time, step.phase))
            total += cost(step, order)
        return total / len(steps)

    def whole(step: _Step, order: Any) -> float:
        order = order[: len(order) // WARP * WARP].reshape(-1, WARP)
        rounds, events = step.sweeps[order].max(axis=1), step.events[order].any(axis=1)
        return float((rounds @ sweep + events @ event).sum() / (len(step.phase) / WARP))

    def parted(block: int) -> Callable[[_Step, Any], float]:
        def cost(step: _Step, order: Any) -> float:
            order = order.reshape(-1, block)
            by_phase = np.argsort(step.phase[order], axis=1, kind="stable")
            phase = step.phase[np.take_along_axis(order, by_phase, 1)].reshape(-1, WARP)
            once = np.stack([(phase == k).any(axis=1) for k in (0, 1)], axis=1) @ sweep
            left = np.flatnonzero((step.sweeps.sum(axis=1) > 1) | step.events.any(1) | step.ends)
            left = left[np.argsort(step.phase[left], kind="stable")]
            return float(once.mean()) + whole(step, left)

        return cost

    rows = [
        ("one kernel, walkers in order of their index", mean(whole)),
        *(
            (f"one kernel, sorted by phase and time in the stride every {k} steps", mean(whole, k))
            for k in (1, 8, 32)
        ),
        ("one integration step; then a kernel for the rest", mean(parted(WARP))),
        ("and walkers of a block of 128 parted by phase", mean(parted(128))),
        ("each walker alone", mean(lambda step, _: float(
            (step.sweeps @ sweep + step.events @ event).mean()))),
    ]  # fmt: skip
    share = np.mean([(s.sweeps.sum(axis=1) == 1) & ~s.events.any(1) & ~s.ends for s in steps])
    text = table(["kernels", "instructions"], [(name, round(cost, -2)) for name, cost in rows])
    ends = 100.0 * np.mean([step.ends for step in steps])
    said = (
        f"{100.0 * share:.0f} % of control steps are one integration step without an event; "
        f"{ends:.1f} % end an episode."
    )
    keep("gpu warps", f"{text}\n\n{said}", GPU)


def _operations() -> tuple[Any, Any]:
    """Return operations of an integration step and of an event in each phase of a kneed walker."""
    from gym_passive_walker.devices.gpu.source import Source
    from gym_passive_walker.engine.compiled import written
    from gym_passive_walker.models.equations.systems import SYSTEMS

    source, lines = Source(), Counter[str]()
    written(SYSTEMS["kneed"], module=source, width=1)
    for function in source.functions:
        head, *body = function.split("\n    ")
        lines[re.findall(r"def ([a-z_]+\d?)", head)[0]] += len(body)
    names = ("reset0_", "reset1_")
    resets = [sum(n for name, n in lines.items() if name.startswith(part)) for part in names]
    sweep = [lines[f"sweep{k}"] for k in (0, 1)]
    event = [resets[k] + sum(lines[f"{name}{k}"] for name in _EVENT) for k in (0, 1)]
    return np.array(sweep), np.array(event)


def _walked(count: int = 4096, warm: int = 100, steps: int = 32) -> list[_Step]:
    """Return what control steps of walkers with random actions take, on the CPU.

    Of a step with a kneestrike, half of the integration steps count to each phase.
    """
    import gymnasium as gym

    import gym_passive_walker  # noqa: F401  (registers the environment)

    envs, rng = gym.make_vec("PassiveWalker-v0", num_envs=count), np.random.default_rng(0)
    envs.reset(seed=0)
    records, found = envs.unwrapped.batch.records[:, 0], []  # type: ignore[attr-defined]
    over = np.zeros(count, bool)
    for k in range(warm + steps):
        before = records.copy()
        _, _, fell, late, infos = envs.step(rng.uniform(-1.0, 1.0, (count, 1)).astype(np.float32))
        if k >= warm:
            tried = np.where(over, 0, records["steps"] - before["steps"])
            first, last = before["phase"] == 0, records["phase"] == 1
            struck = np.asarray(infos["step_length"]) > 0.0
            knee = first & (last | struck) & ~over
            sweeps = np.stack([np.where(first, tried, 0), np.where(first, 0, tried)], axis=1)
            sweeps[knee] = np.stack([tried[knee] - tried[knee] // 2, tried[knee] // 2], axis=1)
            events = np.stack([knee, struck & ~over], axis=1)
            found.append(
                _Step(before["phase"], before["time"], sweeps, events, (fell | late) & ~over)
            )
        over = fell | late
    return found


PARTS = {"kernels": kernels, "launch": launch, "warps": warps}


if __name__ == "__main__":
    sys.exit(command(__doc__, PARTS))
