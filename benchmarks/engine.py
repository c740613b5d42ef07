"""Solutions of the benchmark problems by the package's engine, and their run times."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numba
import numpy as np
from numpy.typing import NDArray

from benchmarks.problem import STARTS, Problem
from benchmarks.report import seconds
from gym_passive_walker.engine import jit
from gym_passive_walker.engine.compiled import constants_used
from gym_passive_walker.engine.compiler import PRIMITIVES
from gym_passive_walker.engine.layout import TILE, WIDTH, aligned
from gym_passive_walker.engine.machine import loaded, object_code
from gym_passive_walker.engine.native import GROUP, Function, Memory, Module
from gym_passive_walker.engine.run import LONGEST_STRIDE, advance, new_records
from gym_passive_walker.engine.step import StepCode
from gym_passive_walker.models.equations.hybrid import Outcome

Code = Callable[[Memory], None]
"""Straight-line code over a tile of walkers."""

_TURNS, _RESTORE = 4000, 200  # timed calls of code; calls until the tile is restored
_call = PRIMITIVES[jit.call]


def new_batch(p: Problem, count: int, torque: float = 0.0, end: float = LONGEST_STRIDE) -> NDArray:
    """Records of `count` walkers, with the problem's initial states in turn.

    Args:
        p: The problem.
        count: Number of walkers.
        torque: Constant hip torque, over m g l.
        end: Time in sqrt(l/g) at which the integration ends, if no heelstrike comes before.
    """
    return new_records(np.resize(p.starts, (count, 6)), p.slope, torque, end=end)


def move(
    p: Problem,
    records: NDArray,
    tolerance: float,
    *,
    threads: int = 1,
    end_on_toe_stub: bool = False,
) -> NDArray:
    """Integrate records to their ends, in place; returns the states, (n, 6)."""
    body = np.array(p.body)[None, None]
    advance(p.system, body, records, tolerance=tolerance, threads=threads, scuff=end_on_toe_stub)
    return records["state"][:, 0]


def again(
    p: Problem, fresh: NDArray, tolerance: float, *, threads: int = 1, end_on_toe_stub: bool = False
) -> Callable[[], None]:
    """A function to be timed: each call integrates a copy of the records `fresh`."""
    records, body = fresh.copy(), np.array(p.body)[None, None]
    chosen = {"tolerance": tolerance, "threads": threads, "scuff": end_on_toe_stub}

    def job() -> None:
        records[:] = fresh
        advance(p.system, body, records, **chosen)

    return job


def strides(p: Problem, tolerance: float, count: int = STARTS, threads: int = 1) -> NDArray:
    """Next states on the Poincaré section of `count` walkers, (count, 6)."""
    records = new_batch(p, count)
    states = move(p, records, tolerance, threads=threads)
    if not np.all(records["outcome"] == Outcome.HEELSTRIKE):
        raise RuntimeError("a walker of the benchmark fell")
    return states


def walk(p: Problem, count: int, tolerance: float) -> NDArray:
    """States on the Poincaré section after `count` strides from the problem's initial states."""
    states = p.starts
    for _ in range(count):
        states = move(p, new_records(states, p.slope), tolerance)
    return states


def microseconds(p: Problem, count: int, tolerance: float, threads: int = 1) -> float:
    """Microseconds for a stride of one walker in a batch of `count`."""
    strides(p, tolerance, count, threads)  # none may fall
    fresh = new_batch(p, count)
    records = fresh.copy()

    def copying() -> None:
        records[:] = fresh

    job = again(p, fresh, tolerance, threads=threads)
    return (seconds(job) - seconds(copying)) / count * 1e6


def equations_of(p: Problem, phase: int = 0) -> tuple[StepCode, NDArray]:
    """A phase's functions, and a tile with walkers in that phase."""
    there = p.system.phases[phase]
    used = constants_used(p.system, there)
    tile = aligned(TILE, 1)
    states = np.resize(p.starts, (WIDTH, 6)).T
    tile["angle"], tile["rate"] = states[:3], states[3:]
    tile["ground"] = np.array(p.ground)[:, None]
    for i, name in enumerate(used):
        tile["body"][:, i] = getattr(p.body, name)
    tile["h"], tile["next"], tile["end"] = 0.2, 0.2, 1e3
    return StepCode(p.system, there, used), tile


def acceleration(equations: StepCode) -> Code:
    """One evaluation of the equations of motion."""

    def evaluate(tile: Memory) -> None:
        for link, a in enumerate(equations.accelerations(tile, equations.state(tile))):
            tile["angle", link] = tile["angle", link] + 1e-9 * a  # later calls need other values

    return evaluate


def over_tile(codes: Sequence[Code], *, alone: bool = False) -> Module:
    """A module with a function over the lanes of a tile, or over one lane."""
    module = Module()
    function = Function(module, "timed", (TILE,))
    for code in codes:
        function.once(code, lane=True) if alone else function.over_lanes(code)
    function.end()
    return module


def nanoseconds(module: Module, fresh: NDArray, *, alone: bool = False) -> float:
    """Nanoseconds per lane of a module's function, with the tile in the CPU's cache."""
    code = loaded(object_code(module))
    address, vectors = code.get_function_address("timed"), code.get_global_value_address("table")
    tile = aligned(TILE, 1)
    numbers, begun = tile.view(float), fresh.view(float).copy()

    @numba.njit
    def repeated(start, numbers, begun):  # type: ignore[no-untyped-def]
        for turn in range(_TURNS):
            if turn % _RESTORE == 0:
                numbers[:] = begun
            if alone:
                for lane in range(WIDTH):
                    _call(address, start, vectors, lane, 0, 0.0, 0.0)
            else:
                for group in range(WIDTH // GROUP):
                    _call(address, start + 8 * GROUP * group, vectors, 0, 0, 0.0, 0.0)

    job = partial(repeated, tile.ctypes.data, numbers, begun)
    return seconds(job) / _TURNS / WIDTH * 1e9
