"""Run time and error of Runge-Kutta pairs, over vector lanes.

    python -m benchmarks.integrators

Each pair replaces the engine's own: its step is compiled from the engine's equations into native
code over lanes. The engine's loop then integrates the swing of the lab walker, with a knee that
does not lock. Heyoka's Taylor method in batch mode is measured beside them, the best method of its
kind. The table is written to docs/benchmarks.md.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import DOP853, RK45

from benchmarks import reference
from benchmarks.other_solvers import heyoka_swings
from benchmarks.problem import Problem, error, problem
from benchmarks.report import command, machine, seconds, table
from benchmarks.tables import BENCHMARKS, keep
from gym_passive_walker._tools import console
from gym_passive_walker.engine.compiled import phases_of, written
from gym_passive_walker.engine.layout import HISTORY, PAIR, aligned, tile_for
from gym_passive_walker.engine.machine import loaded, object_code
from gym_passive_walker.engine.native import GROUP
from gym_passive_walker.engine.run import integrate, new_records, options
from gym_passive_walker.engine.runge_kutta import Pair
from gym_passive_walker.models.equations.hybrid import System
from gym_passive_walker.models.equations.legs import STANCE_FALLS

HORIZON = 1.2
COUNT = 1024
ERRORS = (1e-4, 1e-6, 1e-8, 1e-10, 1e-12, 1e-13)
TOLERANCES = 10.0 ** -np.arange(0.0, 16.0, 0.5)


def pair_of(
    matrix: list[list[float]], weights: list[float], error: list[float], orders: tuple[int, int]
) -> Pair:
    """A pair from its tableau; the error may include the derivative at the step's end."""
    if list(matrix[-1]) + [0.0] * (len(weights) - len(matrix[-1])) == list(weights):
        matrix, weights = matrix[:-1], weights[:-1]  # the last stage is the step's end
    order, error_order = orders
    pair = Pair.from_tableau(
        matrix, weights, error[: len(weights)], order=order, error_order=error_order
    )
    return pair._replace(error=np.array(error, np.longdouble))


def pairs() -> dict[str, Pair]:
    """The pairs tried, by name."""
    found = {
        "Dormand-Prince 5(4)": pair_of(RK45.A.tolist(), RK45.B, RK45.E, (5, 4)),
        # The second error estimate, of order 3, is not used: steps would be a little longer.
        "Dormand-Prince 8(5)": pair_of(DOP853.A.tolist(), DOP853.B, DOP853.E5, (8, 5)),
    }
    found["Verner 9, this engine's"] = PAIR
    text = (Path(__file__).parent / "tableaus.json").read_text(encoding="utf-8")
    for name, t in json.loads(text).items():
        found[name] = pair_of(t["A"], t["b"], t["e"], (t["order"], t["lower"]))
    return found


def swinging(system: System) -> System:
    """A system of the first phase only, which ends with a fall."""
    phase = system.phases[0]._replace(guards=STANCE_FALLS, resets={})
    return system._replace(name="swinging", phases=(phase,))


def compiled(p: Problem, pair: Pair) -> Callable[[NDArray, float], NDArray]:
    """A function that integrates initial states (n, 6) to `HORIZON`, at a tolerance."""
    system, body = swinging(p.system), np.array(p.body)[None, None]
    phases = phases_of(system, loaded(object_code(written(system, pair=pair))), GROUP)
    working = aligned(tile_for(pair), 1), np.zeros(1, HISTORY)

    def ends(starts: NDArray, tolerance: float) -> NDArray:
        records = new_records(starts, p.slope, end=HORIZON)
        records["step"] = min(0.5, tolerance ** (1.0 / pair.order))
        chosen = options(tolerance, from_section=True).copy()
        if pair is not PAIR:
            chosen["fineness"] = 1.0 / tolerance
        integrate(records, body, phases, chosen, *working)
        return records["state"][:, 0]

    return ends


def at_errors(ends: Callable[[NDArray, float], NDArray], p: Problem, exact: NDArray) -> list[float]:
    """Microseconds per walker at each of ERRORS, interpolated logarithmically."""
    many = np.resize(p.starts, (COUNT, 6))
    errors, times = [], []
    for tolerance in TOLERANCES:
        found = ends(p.starts, tolerance)
        errors.append(error(found, exact))
        times.append(seconds(lambda t=tolerance: ends(many, t), at_least=0.05, repeats=3) / COUNT)
    best = []
    for level in ERRORS:
        usable = [i for i, e in enumerate(errors) if e <= level]
        if not usable:
            best.append(float("nan"))
            continue
        i = usable[0]
        if i == 0 or errors[i - 1] <= errors[i]:
            best.append(times[i] * 1e6)
            continue
        share = np.log(level / errors[i]) / np.log(errors[i - 1] / errors[i])
        best.append(float(times[i] ** (1.0 - share) * times[i - 1] ** share * 1e6))
    return best


def main() -> None:
    """Print the table and write it to the page."""
    command(__doc__)
    p = problem("kneed")
    exact = reference.swings(p, HORIZON)
    rows: list[tuple] = []
    for name, pair in pairs().items():
        times = at_errors(compiled(p, pair), p, exact)
        rows.append((name, f"{pair.stages} stages", *times))
        print(rows[-1], flush=True)
    rows.append(("Taylor, heyoka, 8 lanes", "", *at_errors(heyoka_swings(p, HORIZON), p, exact)))
    heads = ["method", "", *(f"µs at error {error:.0e}" for error in ERRORS)]
    keep("integrators", f"{table(heads, rows)}\n\nOne core. {machine('heyoka')}.", BENCHMARKS)


if __name__ == "__main__":
    raise SystemExit(console.run(main))
