"""Work-precision diagrams: run time over error, of the engine and of other solvers.

    python -m benchmarks.work_precision               Run all parts, in a quarter of an hour.
    python -m benchmarks.work_precision strides       Run one part.

Errors are relative to 80-bit arithmetic (see `reference`). Tables are written to
docs/benchmarks.md, plots to docs/images/.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks import engine, errors_and_times, other_solvers, reference
from benchmarks.errors_and_times import BATCH, Point
from benchmarks.problem import WALKS, Problem, error, problem
from benchmarks.report import command, in_turns, machine, plot, seconds, table, timed
from benchmarks.tables import BENCHMARKS, keep

TOLERANCES = 10.0 ** -np.arange(3.0, 14.1, 0.5)
LEVELS = (1e-4, 1e-6, 1e-8, 1e-10, 1e-12)

Curve = list[Point]
"""Pairs of error and microseconds."""


def _at(curve: Curve, level: float) -> float:
    """Least time of a method, among its points with at most this error; NaN if there are none."""
    times = [time for reached, time in curve if reached <= level]
    return min(times) if times else math.nan


def _table(curves: dict[str, Curve]) -> str:
    heads = ["method", *(f"µs at error {level:.0e}" for level in LEVELS), "least error"]
    rows = [
        (name, *(_at(curve, level) for level in LEVELS), f"{min(e for e, _ in curve):.0e}")
        for name, curve in curves.items()
    ]
    return table(heads, rows)


def strides() -> None:
    """Measure a stride of each kind of walker."""
    text = []
    for name in WALKS:
        p = problem(name)
        exact, own = reference.strides(p)
        methods: dict[str, Callable[[float], Point]] = {
            f"this engine, {BATCH} at once": partial(errors_and_times.engine, p, exact, BATCH),
            "this engine, alone": partial(errors_and_times.engine, p, exact, 1),
            **errors_and_times.everyone_else(p, exact),
        }
        curves = {}
        for label, method in methods.items():
            try:
                # JAX compiles for each tolerance, so take only every fourth.
                tolerances = TOLERANCES[::4] if "diffrax" in label else TOLERANCES
                curves[label] = [method(float(tolerance)) for tolerance in tolerances]
            except ImportError:
                print(f"{label} is not installed")
            print(name, label, flush=True)
        walker, slope = WALKS[name]
        title = f"One stride, walker {walker} at slope {slope}"
        text += [f"{title}; the reference's own error is about {own:.0e}.", _table(curves)]
        drawn = {label: np.transpose(curve).tolist() for label, curve in curves.items()}
        names = "error of the next section state", "µs a walker, one core"
        plot(f"work-precision-{name}", drawn, names, title=title, falling=True)
    keep(
        "work-precision",
        "\n\n".join([*text, f"{machine('scipy', 'heyoka', 'diffrax')}."]),
        BENCHMARKS,
    )


def _in_turns(p: Problem) -> tuple[Curve, Curve, Curve]:
    """One walker by the engine, by heyoka, and by heyoka's integrators without Python between."""
    exact, fresh, ours, theirs = reference.strides(p)[0], engine.new_batch(p, 1), [], []
    measures = [partial(timed, partial(fresh.copy().__setitem__, slice(None), fresh))]

    def inner(stride: Callable[[NDArray], NDArray], spent: list[float]) -> float:
        spent.clear()
        stride(p.starts[0])
        return sum(spent)

    for tolerance in map(float, TOLERANCES):
        spent: list[float] = []
        stride = other_solvers.heyoka_stride(p, tolerance, spent=spent)
        ours.append(error(engine.strides(p, tolerance), exact))
        theirs.append(error(np.array([stride(start) for start in p.starts]), exact))
        measures += [
            partial(timed, engine.again(p, fresh, tolerance)),
            partial(timed, partial(stride, p.starts[0])),
            partial(inner, stride, spent),
        ]
    copying, *times = (1e6 * time for time in in_turns(measures))
    own = [time - copying for time in times[::3]]
    return (
        list(zip(ours, own, strict=True)),
        list(zip(theirs, times[1::3], strict=True)),
        list(zip(theirs, times[2::3], strict=True)),
    )


def alone() -> None:
    """Measure one walker alone beside heyoka, in turns."""
    rows: list[tuple] = []
    for name, (walker, _) in WALKS.items():
        own, *others = _in_turns(problem(name))
        rows.append((walker, "this engine, µs", *(_at(own, level) for level in LEVELS)))
        for label, curve in zip(("heyoka", "its integrator alone"), others, strict=True):
            ratios = (_at(curve, level) / _at(own, level) for level in LEVELS)
            rows.append(("", f"{label}, times that", *ratios))
        print(rows[-3:], flush=True)
    text = table(["walker", "", *(f"error {level:.0e}" for level in LEVELS)], rows)
    keep("alone", f"{text}\n\nOne core. {machine('heyoka')}.", BENCHMARKS)


def walks() -> None:
    """Measure a hundred strides on the stable gait of the lab walker."""
    p = problem("kneed")
    exact = reference.walks(p, p.starts[:4], 100)
    rows = []
    for tolerance in (1e-4, 1e-6, 1e-8, 1e-10, 1e-12, 1e-14):
        reached = error(engine.walk(p, 100, tolerance)[:4], exact)
        took = seconds(lambda t=tolerance: engine.walk(p, 100, t), repeats=2)
        rows.append((f"{tolerance:.0e}", reached, took / len(p.starts) * 1e6))
    text = table(["tolerance", "error after 100 strides", "µs a walker, 64 at once"], rows)
    keep(
        "walks",
        f"{text}\n\nA stable gait forgets errors of single strides. {machine('heyoka')}.",
        BENCHMARKS,
    )


def ticks() -> None:
    """Measure a control step with a torque: 0.1 sqrt(l/g) from the start of a stride."""
    p = problem("kneed")
    held = {"torque": 0.02, "end": 0.1}
    exact = reference.swings(p, **held)
    rows = []
    for tolerance in (1e-4, 1e-6, 1e-8, 1e-10, 1e-12, 1e-14):
        few = engine.new_batch(p, len(p.starts), **held)
        reached = error(engine.move(p, few, tolerance), exact)
        job = engine.again(p, engine.new_batch(p, BATCH, **held), tolerance)
        took = seconds(job, at_least=0.05) / BATCH * 1e6
        rows.append((f"{tolerance:.0e}", reached, took, float(few["steps"].mean())))
    text = table(["tolerance", "error", f"µs a walker, {BATCH} at once", "integration steps"], rows)
    keep(
        "tick",
        f"{text}\n\nA tick of 0.1 √(l/g) with a hip torque of 0.02 m g l. {machine()}.",
        BENCHMARKS,
    )


def penalties() -> None:
    """Measure the benefit of exact events over a penalty contact in MuJoCo."""
    from benchmarks import penalty

    keep("penalty", f"{penalty.report()}\n\n{machine('mujoco')}.", BENCHMARKS)


PARTS: dict[str, Callable[[], Any]] = {
    "strides": strides, "alone": alone, "walks": walks, "ticks": ticks, "penalties": penalties,
}  # fmt: skip


if __name__ == "__main__":
    command(__doc__, PARTS)
