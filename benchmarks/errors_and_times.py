"""Error and run time of a stride, by the engine and by other solvers.

Each function returns the error of the next states on the Poincaré section, and the microseconds of
one walker's stride on one core.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from benchmarks import engine as own
from benchmarks import other_solvers
from benchmarks.problem import Problem, error
from benchmarks.report import seconds

BATCH = 2048
"""Walkers in a batch, for solvers that permit any number."""

Point = tuple[float, float]
"""An error, and microseconds."""


def engine(p: Problem, exact: NDArray, count: int, tolerance: float) -> Point:
    """This engine, with `count` walkers in a batch."""
    reached = error(own.strides(p, tolerance), exact)
    return reached, own.microseconds(p, count, tolerance)


def scipy(p: Problem, exact: NDArray, method: str, tolerance: float) -> Point:
    """`scipy.integrate.solve_ivp` with one of its methods; the error is over eight strides."""
    stride = other_solvers.scipy_stride(p, method, tolerance)
    found = np.array([stride(start) for start in p.starts[:8]])
    return error(found, exact[:8]), seconds(lambda: stride(p.starts[0]), repeats=3) * 1e6


def heyoka(p: Problem, exact: NDArray, tolerance: float) -> Point:
    """Heyoka, one walker at a time."""
    stride = other_solvers.heyoka_stride(p, tolerance)
    found = np.array([stride(start) for start in p.starts])
    return error(found, exact), seconds(lambda: stride(p.starts[0]), repeats=3) * 1e6


def heyoka_batch(p: Problem, exact: NDArray, lanes: int, tolerance: float) -> Point:
    """Heyoka's batch mode."""
    stride, starts = other_solvers.heyoka_batch(p, tolerance, lanes), p.starts[:lanes]
    reached = error(stride(starts), exact[:lanes])
    return reached, seconds(lambda: stride(starts), repeats=3) / lanes * 1e6


def diffrax(p: Problem, exact: NDArray, method: str, tolerance: float) -> Point:
    """Diffrax with one of its solvers, and `BATCH` walkers in a batch."""
    strides, starts = (
        other_solvers.diffrax_batch(p, method, tolerance),
        np.resize(p.starts, (BATCH, 6)),
    )
    reached = error(strides(starts)[: len(exact)], exact)
    return reached, seconds(lambda: strides(starts), repeats=3, most=1.0) / BATCH * 1e6


def everyone_else(p: Problem, exact: NDArray) -> dict[str, Callable[[float], Point]]:
    """Other solvers by name, as functions from a tolerance to error and time.

    Args:
        p: The problem.
        exact: The exact next states on the Poincaré section, (n, 6).
    """
    return {
        "heyoka, 8 lanes": partial(heyoka_batch, p, exact, 8),
        "heyoka, alone": partial(heyoka, p, exact),
        **{
            f"diffrax {method}, {BATCH} at once": partial(diffrax, p, exact, method)
            for method in ("Tsit5", "Dopri8")
        },
        **{
            f"SciPy {method}": partial(scipy, p, exact, method)
            for method in ("DOP853", "RK45", "LSODA")
        },
    }
