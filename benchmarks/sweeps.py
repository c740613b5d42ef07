"""Scaling of time and memory with walkers, strides, parameters, tasks and workers.

    python -m benchmarks.sweeps                   Run all parts except `minutes`.
    python -m benchmarks.sweeps walkers           Run one part.
    python -m benchmarks.sweeps minutes           Run a hundred tasks of a minute: five minutes.

The tables are written to docs/scaling.md. Times of sweeps are wall times, reported with the load of
the machine.
"""

from __future__ import annotations

import os
import sys
import tempfile
import time
import tracemalloc
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numba
import numpy as np

import gym_passive_walker as gpw
from benchmarks.report import command, machine, seconds, table
from benchmarks.tables import DOCS, keep
from gym_passive_walker.apps.sweeps.description import Description
from gym_passive_walker.apps.sweeps.store import DONE, Store
from gym_passive_walker.gaits.stride_map import StrideMap

PAGE = DOCS / "scaling.md"
WALKER, SLOPE = "C", 0.03
MANY = 1_000_000  # largest number of walkers in a batch


def nothing(x: int) -> dict[str, Any]:
    """A task that takes no time."""
    return {"memory": _memory()}


def nap(x: int, rest: float) -> dict[str, Any]:
    """A task that sleeps for `rest` seconds, without load on the CPU."""
    time.sleep(rest)
    return {"memory": _memory()}


def _memory() -> float:
    """Peak memory of this process in MB; `getrusage` would include the parent's peak."""
    for line in Path("/proc/self/status").read_text(encoding="utf-8").splitlines():
        if line.startswith("VmHWM"):
            return float(line.split()[1]) / 1024.0
    return float("nan")


def walkers() -> None:
    """Measure strides of many walkers, and many strides, on one core and on two."""
    gait = gpw.find_gait(WALKER, SLOPE)
    stride_map = StrideMap.of(gait.walker, tolerance=1e-10)
    rows = []
    for count, strides in ((1000, 1), (10_000, 1), (100_000, 1), (MANY, 1), (10_000, 10)):
        states = np.repeat(gait.state[None], count, axis=0)
        points = stride_map.points_at(states)
        slopes = np.full(count, SLOPE)

        def walk(points: Any = points, slopes: Any = slopes, strides: int = strides) -> object:
            return stride_map.apply(points, slopes, strides=strides)

        times = []
        for cores in (1, 2):
            numba.set_num_threads(cores)
            times.append(seconds(walk, repeats=3) / count / strides * 1e6)
        tracemalloc.start()
        walk()
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        rows.append((count, strides, *times, peak / count))
    heads = ["walkers", "strides", "µs a stride, one core", "two cores", "bytes a walker"]
    keep("walkers", f"{table(heads, rows)}\n\n{_when()}", PAGE)


def parameters() -> None:
    """Measure the memory of a task before it runs, and its row on disk."""
    rows = []
    for count in (1, 10, 50):
        over = {f"parameter_{i}": [0.0, 1.0] for i in range(count)}
        tracemalloc.start()
        described = Description(
            analysis="benchmarks.sweeps:anything", over=over, how="latin-hypercube", samples=10_000
        )
        held = len(described.tasks) and tracemalloc.get_traced_memory()[0]
        tracemalloc.stop()
        with tempfile.TemporaryDirectory() as folder:
            found = gpw.sweep(described, Path(folder) / "out", workers=2, trust=True)
            size = sum(path.stat().st_size for path in (found.folder / "rows").iterdir())
        rows.append((count, held / 10_000, size / 10_000))
    heads = ["parameters", "bytes a task, in memory", "bytes a row, on disk"]
    keep("parameters", table(heads, rows), PAGE)


def anything(**parameters: float) -> dict[str, Any]:
    """A task with any parameters."""
    return {"sum": sum(parameters.values())}


def tasks() -> None:
    """Measure a sweep's overhead: its start, and the communication of each task."""
    rows = []
    for name, options in ways():
        few, many = (_swept("nothing", count, options)[0] for count in (2_000, 22_000))
        each = (many - few) / 20_000
        rows.append((name, few - 2_000 * each, each * 1e6))
    heads = ["", "start, s", "each task, µs"]
    keep("tasks", f"{table(heads, rows)}\n\n{_when()}", PAGE)


def keeper() -> None:
    """Measure the rate at which the single process that stores rows works; it limits workers."""
    over = {f"parameter_{i}": [0.0, 1.0] for i in range(10)}
    described = Description(
        analysis="benchmarks.sweeps:anything", over=over, how="latin-hypercube", samples=20_000
    )
    with tempfile.TemporaryDirectory() as folder:
        store = Store(Path(folder), described, "any")
        began = time.process_time()
        for number, given in enumerate(described.tasks):
            row = {"task": number, **given, "status": DONE, "error": None, "seconds": 0.0}
            store.add(row, {"sum": 1.0})
        store.flush(last=True)
        written = (time.process_time() - began) / len(described.tasks)
        store.close()
    rows = [("a row of ten parameters kept", written * 1e6)]
    if find_spec("ray"):
        rows.append(("a second's tasks sent through Ray, and their outcomes back", _call() * 1e6))
    keep("keeper", f"{table(['', 'µs of CPU time'], rows)}\n\n{_when()}", PAGE)


def _call() -> float:
    """Time that a call through Ray with twenty tasks costs the calling process."""
    import ray

    class Echo:
        def hear(self, tasks: Any) -> Any:
            return tasks

    ray.init("local", num_cpus=2, include_dashboard=False, log_to_driver=False)
    try:
        actors: Any = [ray.remote(num_cpus=1)(Echo).remote() for _ in range(2)]
        tasks = [(i, {f"parameter_{j}": 0.5 for j in range(10)}) for i in range(20)]
        ray.get([each.hear.remote(tasks) for each in actors])
        began = time.process_time()
        ray.get([actors[i % 2].hear.remote(tasks) for i in range(2000)])
        return (time.process_time() - began) / 2000
    finally:
        ray.shutdown()


def naps() -> None:
    """Measure a hundred thousand tasks of a millisecond."""
    rows = []
    for name, options in ways():
        wall, taken, _, size = _swept("nap", 100_000, options, rest=0.001)
        share = taken / int(options["workers"])
        rows.append((name, wall, share, (wall - share) / wall * 100.0, size))
    heads = ["", "s in all", "of it the tasks, s", "the rest, %", "MB on disk"]
    keep("naps", f"{table(heads, rows)}\n\n{_when()}", PAGE)


def minutes() -> None:
    """Measure a hundred tasks that sleep for a minute, by twenty workers."""
    rows = []
    for name, options in list(ways(20))[-2:]:
        wall, taken, memory, _ = _swept("nap", 100, options, rest=60.0)
        rows.append((name, wall, taken / 20.0, memory))
    keep("minutes", f"{table(['', 's in all', 'of it the tasks, s', 'MB a worker'], rows)}\n\n"
         f"{_when()}", PAGE)  # fmt: skip


def ways(most: int = 2) -> Iterator[tuple[str, dict[str, Any]]]:
    """Ways to run a sweep on this machine: name, and arguments of `gpw.sweep`."""
    yield "one worker", {"workers": 1}
    yield f"{most} workers", {"workers": most}
    if find_spec("ray"):
        yield f"Ray, {most} workers", {"workers": most, "ray": "here"}


def _swept(
    name: str, count: int, options: dict[str, Any], **given: Any
) -> tuple[float, float, float, float]:
    """Total seconds, seconds of the tasks, MB of the largest worker, and MB of the dataset."""
    with tempfile.TemporaryDirectory() as folder:
        began = time.perf_counter()
        found = gpw.sweep(
            f"benchmarks.sweeps:{name}", Path(folder) / "out", over={"x": list(range(count))},
            given=given, trust=True, **options,
        )  # fmt: skip
        wall = time.perf_counter() - began
        columns = found.columns()
        assert len(columns["task"]) == count and not found.failures
        size = sum(path.stat().st_size for path in (found.folder / "rows").iterdir()) / 1e6
    return wall, float(columns["seconds"].sum()), float(columns["memory"].max()), size


def _when() -> str:
    return f"*{machine('ray')}, load {os.getloadavg()[0]:.1f}.*"


PARTS = {each.__name__: each for each in (walkers, parameters, tasks, keeper, naps, minutes)}

if __name__ == "__main__":
    if len(sys.argv) == 1:
        sys.argv += ["walkers", "parameters", "tasks", "keeper", "naps"]
    command(__doc__, PARTS)
