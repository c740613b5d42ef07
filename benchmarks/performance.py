"""Run time of a stride's parts: counts of operations, and the CPU's peak arithmetic.

    python -m benchmarks.performance               Run all parts, in a minute.
    python -m benchmarks.performance operations    Run one part.

The tables are written to docs/benchmarks.md. Run it on an otherwise idle machine.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from benchmarks import engine
from benchmarks.problem import WALKS, problem
from benchmarks.report import command, machine, table
from benchmarks.tables import BENCHMARKS, keep
from gym_passive_walker.engine.native import Memory

COUNTED = ("fma", "fmul", "fadd", "fsub", "fdiv", "sqrt")
"""Arithmetic instructions; signs, comparisons, selections and memory accesses cost little."""

TOLERANCES = (1e-4, 1e-6, 1e-8, 1e-10, 1e-12)
_BATCH = 2048
_CHAINS, _LINKS = 12, 100  # independent chains of dependent multiply-adds, to measure the peak


class Timed:
    """Straight-line code over the lanes of a tile: its instructions and its run time.

    Attributes:
        counts: Number of vector instructions, each of eight lanes, by name.
        nanoseconds: Nanoseconds per lane.
    """

    def __init__(self, codes: Sequence[engine.Code], fresh: np.ndarray) -> None:
        module = engine.over_tile(codes)
        found = re.findall(r"call <8 x double> @llvm\.(\w+)|= (f\w+) <8 x double>", str(module))
        self.counts = Counter(first or second for first, second in found)
        self.nanoseconds = engine.nanoseconds(module, fresh)

    @property
    def operations(self) -> int:
        """Number of arithmetic vector instructions."""
        return sum(self.counts[name] for name in COUNTED)


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

    timed = Timed([chains], engine.equations_of(problem("simplest"))[1])
    return timed.nanoseconds / timed.operations


def operations() -> None:
    """Measure operations of an acceleration and of a step, and their ratio to the CPU's peak."""
    rows = []
    for name in WALKS:
        p = problem(name)
        for index, phase in enumerate(p.system.phases):
            equations, tile = engine.equations_of(p, index)
            of_phase = (
                f"{p.system.name}, {phase.stage.name.lower()}"
                if len(p.system.phases) > 1
                else p.system.name
            )
            for what, codes in (
                ("acceleration", [engine.acceleration(equations)]),
                ("step", equations.sweep()),
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
        phases = (engine.equations_of(p, index) for index in range(len(p.system.phases)))
        each = [Timed(equations.sweep(), tile).nanoseconds for equations, tile in phases]
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


if __name__ == "__main__":
    command(__doc__, {"operations": operations, "strides": strides})
