"""Run time of a stride's parts: counts of operations, and the CPU's peak arithmetic.

    python -m benchmarks.performance               Run all parts, in a minute.
    python -m benchmarks.performance operations    Run one part.

The tables are written to docs/benchmarks.md. Run it on an otherwise idle machine.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Sequence
from functools import lru_cache, partial

import numba
import numpy as np

from benchmarks import engine
from benchmarks.problem import WALKS, Problem, problem
from benchmarks.report import command, machine, seconds, table
from benchmarks.tables import BENCHMARKS, keep
from gym_passive_walker.engine import jit
from gym_passive_walker.engine.compiled import constants_used
from gym_passive_walker.engine.compiler import PRIMITIVES
from gym_passive_walker.engine.layout import TILE, WIDTH, aligned
from gym_passive_walker.engine.machine import loaded, object_code
from gym_passive_walker.engine.native import GROUP, Function, Memory, Module
from gym_passive_walker.engine.step import StepCode

call = PRIMITIVES[jit.call]

COUNTED = ("fma", "fmul", "fadd", "fsub", "fdiv", "sqrt")
"""Arithmetic instructions; signs, comparisons, selections and memory accesses cost little."""

TOLERANCES = (1e-4, 1e-6, 1e-8, 1e-10, 1e-12)
_BATCH, _TURNS, _RESTORE = 2048, 4000, 200  # walkers; timed calls; calls until the tile is restored
_CHAINS, _LINKS = 12, 100  # independent chains of dependent multiply-adds, to measure the peak

Code = Callable[[Memory], None]


class Timed:
    """Straight-line code over the lanes of a tile: its instructions and its run time.

    Attributes:
        counts: Number of vector instructions, each of eight lanes, by name.
        nanoseconds: Nanoseconds per lane.
    """

    def __init__(self, codes: Sequence[Code], fresh: np.ndarray) -> None:
        module = Module()
        function = Function(module, "timed", (TILE,))
        for code in codes:
            function.over_lanes(code)
        function.end()
        found = re.findall(r"call <8 x double> @llvm\.(\w+)|= (f\w+) <8 x double>", str(module))
        self.counts = Counter(first or second for first, second in found)
        self.nanoseconds = _clocked(module, fresh)

    @property
    def operations(self) -> int:
        """Number of arithmetic vector instructions."""
        return sum(self.counts[name] for name in COUNTED)


def _clocked(module: Module, fresh: np.ndarray) -> float:
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
            for group in range(WIDTH // GROUP):
                call(address, start + 8 * GROUP * group, vectors, 0, 0, 0.0, 0.0)

    return seconds(partial(repeated, tile.ctypes.data, numbers, begun)) / _TURNS / WIDTH * 1e9


def equations_of(p: Problem, phase: int = 0) -> tuple[StepCode, np.ndarray]:
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


def step(equations: StepCode) -> list[Code]:
    """One step: its stages, its error estimate and its result."""
    return equations.sweep()


@lru_cache
def fastest() -> float:
    """Nanoseconds per lane of the fastest arithmetic: independent multiply-adds."""

    def chains(tile: Memory) -> None:
        factor, term = tile["h"], tile["next"]
        for chain in range(_CHAINS):
            place = "stage", chain // 3, chain % 3
            x = tile[place]
            for _ in range(_LINKS):
                x = x * factor + term
            tile[place] = x

    timed = Timed([chains], equations_of(problem("simplest"))[1])
    return timed.nanoseconds / timed.operations


def operations() -> None:
    """Measure operations of an acceleration and of a step, and their ratio to the CPU's peak."""
    rows = []
    for name in WALKS:
        p = problem(name)
        for index, phase in enumerate(p.system.phases):
            equations, tile = equations_of(p, index)
            of_phase = (
                f"{p.system.name}, {phase.stage.name.lower()}"
                if len(p.system.phases) > 1
                else p.system.name
            )
            for what, codes in (
                ("acceleration", [acceleration(equations)]),
                ("step", step(equations)),
            ):
                timed = Timed(codes, tile)
                least = timed.operations * fastest()
                counts = timed.counts
                rows.append([
                    of_phase, what, counts["fma"], counts["fmul"], counts["fadd"] + counts["fsub"],
                    counts["fdiv"] + counts["sqrt"], least, timed.nanoseconds,
                    timed.nanoseconds / least,
                ])  # fmt: skip
    heads = [
        "system", "code", "a b + c", "a b", "a ± b", "a / b, √a", "least ns a lane",
        "measured", "ratio",
    ]  # fmt: skip
    best = f"The fastest a b + c takes {fastest():.3f} ns a lane"
    keep("operations", f"{table(heads, rows)}\n\n{best}. One core. {machine()}.", page=BENCHMARKS)


def strides() -> None:
    """Measure the number of steps in a stride, and their share of its run time."""
    rows = []
    for name in WALKS:
        p = problem(name)
        each = [Timed(step(equations), tile).nanoseconds for equations, tile in _phases(p)]
        for tolerance in TOLERANCES:
            records = engine.new_batch(p, _BATCH)
            engine.move(p, records, tolerance)
            steps = float(records["steps"].mean())
            whole = engine.microseconds(p, _BATCH, tolerance)
            stepping = steps * float(np.mean(each)) * 1e-3
            rows.append([
                f"{name}", f"{tolerance:.0e}", steps, stepping, whole, stepping / whole,
            ])  # fmt: skip
    heads = ["walker", "tolerance", "steps a stride", "µs in steps", "µs in all", "share"]
    keep("parts of a stride", f"{table(heads, rows)}\n\nOne core. {machine()}.", page=BENCHMARKS)


def _phases(p: Problem) -> list[tuple[StepCode, np.ndarray]]:
    return [equations_of(p, index) for index in range(len(p.system.phases))]


if __name__ == "__main__":
    command(__doc__, {"operations": operations, "strides": strides})
