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

from benchmarks import engine, errors_and_times, reference
from benchmarks.errors_and_times import BATCH, Point
from benchmarks.problem import WALKS, error, problem
from benchmarks.report import command, machine, plot, seconds, table
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
    "strides": strides, "walks": walks, "ticks": ticks, "penalties": penalties,
}  # fmt: skip


if __name__ == "__main__":
    command(__doc__, PARTS)
