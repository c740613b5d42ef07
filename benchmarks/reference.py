"""Reference solutions of the problems, by heyoka's Taylor method in 80-bit arithmetic.

A machine without 80-bit numbers reads the ends of the strides from `references/`.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.other_solvers import heyoka_integrators, heyoka_stride
from benchmarks.problem import Problem, error

REFERENCES = Path(__file__).parent / "references"

_NUMBER = np.longdouble
_FINE = 1e-19


def strides(p: Problem) -> tuple[NDArray[np.longdouble], float]:
    """Next states on the Poincaré section, (n, 6), and an estimate of their error.

    They are stored in `references/`; delete the file to compute them again (this requires heyoka
    and a machine with 80-bit numbers).
    """
    path = REFERENCES / f"{p.name}.npz"
    if path.exists():
        kept = np.load(path)
        if np.array_equal(kept["starts"], p.starts) and np.array_equal(kept["body"], p.body):
            return kept["high"].astype(_NUMBER) + kept["low"], float(kept["error"])
    fine, other = walks(p, p.starts, 1), walks(p, p.starts, 1, tolerance=1e-17)
    estimate = error(other, fine)
    REFERENCES.mkdir(exist_ok=True)
    high = fine.astype(float)
    low = (fine - high).astype(float)
    np.savez(path, starts=p.starts, body=p.body, high=high, low=low, error=estimate)
    return fine, estimate


def walks(p: Problem, starts: NDArray, count: int, *, tolerance: float = _FINE) -> NDArray:
    """States on the Poincaré section after `count` strides from initial states (n, 6)."""
    stride = heyoka_stride(p, tolerance, _NUMBER)
    states = starts.astype(_NUMBER)
    for _ in range(count):
        states = np.array([stride(state) for state in states])
    return states


def swings(p: Problem, end: float, torque: float = 0.0) -> NDArray:
    """States at time `end` from the problem's initial states, with the knee free throughout."""
    ta: Any = heyoka_integrators(p, _FINE, _NUMBER, torque=torque)[0]
    found = []
    for start in p.starts:
        ta.time, ta.state[:] = _NUMBER(0.0), start
        ta.reset_cooldowns()
        while ta.time < end:
            ta.propagate_until(_NUMBER(end))  # a kneestrike interrupts it: the loop continues
        found.append(ta.state.copy())
    return np.array(found)
