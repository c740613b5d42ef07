"""Solutions of the benchmark problems by the package's engine, and their run times."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from benchmarks.problem import STARTS, Problem
from benchmarks.report import seconds
from gym_passive_walker.engine.run import LONGEST_STRIDE, advance, new_records
from gym_passive_walker.models.equations.hybrid import Outcome


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
