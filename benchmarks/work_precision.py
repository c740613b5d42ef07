"""How much time does an accuracy cost? Run time against error, of the engine and of its rivals.

    python -m benchmarks.work_precision               all parts, a quarter of an hour
    python -m benchmarks.work_precision strides       one of them

Errors are against 80-bit arithmetic (see `problem.reference`). Tables land in docs/benchmarks.md,
plots in docs/images/.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks import measured, rivals
from benchmarks.measured import CROWD, Point
from benchmarks.problem import WALKS, Problem, crowd, error, problem, reference
from benchmarks.report import DOCS, keep, machine, seconds, table
from gym_passive_walker.physics import record as R
from gym_passive_walker.physics.engine import advance
from gym_passive_walker.physics.record import new_records

TOLERANCES = 10.0 ** -np.arange(3.0, 15.0)
LEVELS = (1e-4, 1e-6, 1e-8, 1e-10, 1e-12)

Curve = list[Point]
"""Errors and microseconds."""


def _at(curve: Curve, level: float) -> float:
    """Least time at which a method's error is no larger."""
    times = [time for reached, time in curve if reached <= level]
    return min(times) if times else math.nan


def _table(curves: dict[str, Curve]) -> str:
    heads = ["method", *(f"µs at error {level:.0e}" for level in LEVELS), "least error"]
    rows = [
        (name, *(_at(curve, level) for level in LEVELS), f"{min(e for e, _ in curve):.0e}")
        for name, curve in curves.items()
    ]
    return table(heads, rows)


def _plot(name: str, title: str, curves: dict[str, Curve]) -> None:
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(8, 4.2), layout="constrained")
    for label, curve in curves.items():
        ours = label.startswith("this engine")
        errors, times = zip(*curve, strict=True)
        axes.loglog(
            np.maximum(errors, 1e-17), times, "o-", markersize=3, label=label,
            linewidth=2.0 if ours else 1.0, zorder=3 if ours else 2,
        )  # fmt: skip
    axes.set(title=title, xlabel="error of the next section state", ylabel="µs a walker, one core")
    axes.invert_xaxis()
    axes.grid(alpha=0.3)
    figure.legend(loc="outside right upper", fontsize=8)
    figure.savefig(DOCS / "images" / f"{name}.png", dpi=130)
    plt.close(figure)


def strides() -> None:
    """A stride of each kind of walker."""
    text = []
    for name in WALKS:
        p = problem(name)
        exact, own = reference(p)
        methods: dict[str, Callable[[float], Point]] = {
            f"this engine, {CROWD} at once": partial(measured.engine, p, exact, CROWD),
            "this engine, alone": partial(measured.engine, p, exact, 1),
            "heyoka, 8 lanes": partial(measured.heyoka_batch, p, exact, 8),
            "heyoka, alone": partial(measured.heyoka, p, exact),
            **{
                f"diffrax {m}, {CROWD} at once": partial(measured.diffrax, p, exact, m)
                for m in ("Tsit5", "Dopri8")
            },
            **{
                f"SciPy {m}": partial(measured.scipy, p, exact, m)
                for m in ("DOP853", "RK45", "LSODA")
            },
        }
        curves = {}
        for label, method in methods.items():
            try:
                # JAX compiles each tolerance anew.
                tolerances = TOLERANCES[::2] if "diffrax" in label else TOLERANCES
                curves[label] = [method(float(tolerance)) for tolerance in tolerances]
            except ImportError:
                print(f"{label} is not installed")
            print(name, label, flush=True)
        walker, slope = WALKS[name]
        title = f"One stride, walker {walker} at slope {slope}"
        text += [f"{title}; the reference's own error is about {own:.0e}.", _table(curves)]
        _plot(f"work-precision-{name}", title, curves)
    keep("work-precision", "\n\n".join([*text, f"{machine('scipy', 'heyoka', 'diffrax')}."]))


def _walk(p: Problem, count: int, tolerance: float) -> NDArray:
    """Section states after a number of strides."""
    records = crowd(p, len(p.starts))
    for _ in range(count):
        states = records[:, :6].copy()
        records = new_records(states, np.full(len(states), p.slope))
        advance(p.kind, p.c[None], records, tolerance=tolerance, threads=1)
    return records[:, :6]


def walks() -> None:
    """A hundred strides on the stable gait of the lab walker."""
    p = problem("kneed")
    stride = rivals.heyoka_stride(p, 1e-19, np.longdouble)
    exact = p.starts[:4].astype(np.longdouble)
    for _ in range(100):
        exact = np.array([stride(start) for start in exact])
    rows = []
    for tolerance in (1e-4, 1e-6, 1e-8, 1e-10, 1e-12, 1e-14):
        reached = error(_walk(p, 100, tolerance)[:4], exact)
        took = seconds(lambda t=tolerance: _walk(p, 100, t), repeats=2) / len(p.starts) * 1e6
        rows.append((f"{tolerance:.0e}", reached, took))
    text = table(["tolerance", "error after 100 strides", "µs a walker, 64 at once"], rows)
    keep("walks", f"{text}\n\nA stable gait forgets errors of single strides. {machine('heyoka')}.")


def ticks() -> None:
    """A tick under torque: a tenth of a time unit from the start of a stride."""
    p = problem("kneed")
    torque, end = 0.02, 0.1

    def records(count: int) -> NDArray:
        states = np.resize(p.starts, (count, 6))
        return new_records(states, np.full(count, p.slope), torque, end=end)

    exact = _tick_reference(p, torque, end)
    rows = []
    for tolerance in (1e-4, 1e-6, 1e-8, 1e-10, 1e-12, 1e-14):
        few = records(len(p.starts))
        advance(p.kind, p.c[None], few, tolerance=tolerance, threads=1)
        fresh = records(CROWD)
        many = fresh.copy()

        def job(tolerance=tolerance, many=many, fresh=fresh) -> None:  # type: ignore[no-untyped-def]
            many[:] = fresh
            advance(p.kind, p.c[None], many, tolerance=tolerance, threads=1)

        took = seconds(job, at_least=0.05) / CROWD * 1e6
        mean = float(few[:, R.STEPS].mean())
        rows.append((f"{tolerance:.0e}", error(few[:, :6], exact), took, mean))
    text = table(["tolerance", "error", f"µs a walker, {CROWD} at once", "integration steps"], rows)
    keep("tick", f"{text}\n\nA tick of 0.1 √(l/g) with a hip torque of 0.02 m g l. {machine()}.")


def _tick_reference(p: Problem, torque: float, end: float) -> NDArray:
    """The starts a tick later, in 80-bit arithmetic."""
    import heyoka as hy

    from benchmarks.problem import motion

    accelerations = motion(p, "free", lambda x: (hy.sin(x), hy.cos(x)), torque)
    v = hy.make_vars("q0", "q1", "q2", "w0", "w1", "w2")
    equations = [*zip(v[:3], v[3:], strict=True), *zip(v[3:], accelerations(*v), strict=True)]
    number = np.longdouble
    ta = hy.taylor_adaptive(equations, np.zeros(6, number), tol=number(1e-19), fp_type=number)
    found = []
    for start in p.starts:
        ta.time, ta.state[:] = number(0.0), start
        ta.propagate_until(number(end))
        found.append(ta.state.copy())
    return np.array(found)


def penalties() -> None:
    """What exact events buy: the compass walker with a penalty contact, in MuJoCo."""
    from benchmarks import penalty

    keep("penalty", f"{penalty.report()}\n\n{machine('mujoco')}.")


PARTS: dict[str, Callable[[], Any]] = {
    "strides": strides, "walks": walks, "ticks": ticks, "penalties": penalties,
}  # fmt: skip


def main() -> int:
    """Run the parts asked for."""
    shape = argparse.RawTextHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=shape)
    parser.add_argument("parts", nargs="*", help=f"of {', '.join(PARTS)}; all if none")
    chosen = parser.parse_args().parts
    for name in chosen:
        if name not in PARTS:
            parser.error(f"no part {name!r}: choose from {', '.join(PARTS)}")
    for name in chosen or PARTS:
        PARTS[name]()
    return 0


if __name__ == "__main__":
    sys.exit(main())
