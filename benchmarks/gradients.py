"""Run time and error of gradients through impacts, by this package and by other solvers.

    python -m benchmarks.gradients

The gradient is that of a compass walker's distance after some strides by its initial state. It is
computed by exact derivatives, by differences, and over a penalty contact. Errors are relative to
differences of order eight in 80-bit arithmetic.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks import other_solvers, penalty, reference
from benchmarks.problem import Problem, problem
from benchmarks.report import command, machine, plot, seconds, table
from benchmarks.tables import BENCHMARKS, keep
from gym_passive_walker import WALKERS
from gym_passive_walker._tools import console
from gym_passive_walker.gaits.stride_map import StrideMap
from gym_passive_walker.models.equations import legs

STRIDES = (1, 10, 100)
BATCH = 64
TOLERANCES = (1e-4, 1e-6, 1e-8, 1e-10, 1e-12, 1e-14)
TIME_STEPS = {1: (1e-2, 1e-3, 1e-4), 10: (1e-2, 1e-3), 100: (1e-2,)}
STEPS = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7)  # widths of this engine's differences
PENALTY_STEPS = (0.03, 0.01, 3e-3, 1e-3)  # widths over the penalty contact; smaller are worse
STENCIL = {1: 4 / 5, 2: -1 / 5, 3: 4 / 105, 4: -1 / 280}
"""Weights of central differences of order eight, by offset."""

Gradient = Callable[[], NDArray]
"""Derivative of the distance by stance angle and the two angular velocities, (3,)."""


def _states(points: Any) -> Any:
    """States (..., 6) of points (..., 3): stance angle, and angular velocities of both legs."""
    angle, stance, swing = np.moveaxis(points, -1, 0)
    return np.stack([angle, -angle, -angle, stance, swing, swing], axis=-1)


def _differences(distance: Callable, point: NDArray, step: Any, stencil: dict) -> NDArray:
    """Gradient (3,) by central differences, from distances (k,) of points (k, 3)."""
    moves = [(i, k * sign) for i in range(3) for k in stencil for sign in (1, -1)]
    points = np.array([point + step * k * np.eye(3, dtype=point.dtype)[i] for i, k in moves])
    found = np.zeros(3, points.dtype)
    for (i, k), value in zip(moves, distance(points), strict=True):
        found[i] += np.sign(k) * stencil[abs(k)] * value / step
    return found


def exact(p: Problem, point: NDArray, strides: int) -> tuple[NDArray, float]:
    """The gradient in 80-bit arithmetic, and its error from two widths of the differences."""

    def distance(points: NDArray) -> list:
        states = _states(points)
        way = np.zeros(len(points), np.longdouble)
        for _ in range(strides):
            after = reference.walks(p, states, 1)
            way += _step(p, states[:, 0], after[:, 0])
            states = after
        return list(way)

    wide, narrow = (
        _differences(distance, point.astype(np.longdouble), np.longdouble(step), STENCIL)
        for step in (2e-4, 1e-4)
    )
    return narrow.astype(float), _error(wide.astype(float), narrow.astype(float))


def _step(p: Problem, start: Any, end: Any) -> Any:
    """Step length from the stance angles at the beginning of a stride and of the next."""
    return legs.step_length(p.body, start, end)


def _error(found: NDArray, exact_value: NDArray) -> float:
    return float(np.abs(np.asarray(found) - exact_value).max() / np.abs(exact_value).max())


def engine(point: NDArray, p: Problem, strides: int, tolerance: float, count: int) -> Gradient:
    """Gradient by this engine's exact derivatives, of `count` walkers in a batch."""
    strides_of = StrideMap.of(WALKERS["A"], tolerance=tolerance)
    points = np.tile(point, (count, 1))
    return lambda: strides_of.linearize(points, p.slope, strides=strides)[1].lengths[0]


def by_torch(point: NDArray, p: Problem, strides: int, tolerance: float) -> Gradient:
    """Gradient by this engine's exact derivatives of single strides, and torch's reverse mode."""
    import torch

    from gym_passive_walker.torch import stride

    walker = WALKERS["A"]
    scale = np.array([1.0, *[1.0 / walker.time_unit] * 2])

    def gradient() -> NDArray:
        start = torch.tensor(point * scale, requires_grad=True)
        state = torch.stack([start[0], -start[0], -start[0], start[1], start[2], start[2]])
        way = torch.zeros((), dtype=torch.float64)
        for _ in range(strides):
            walked = stride(walker, p.slope, state, tolerance=tolerance)
            state, way = walked.state, way + walked.step_length
        (found,) = torch.autograd.grad(way, start)
        return found.numpy() * scale / walker.leg_length

    return gradient


def differences(
    point: NDArray, p: Problem, strides: int, tolerance: float, step: float
) -> Gradient:
    """Gradient by central differences of this engine's strides, six walks in a batch."""
    strides_of = StrideMap.of(WALKERS["A"], tolerance=tolerance)

    def distance(points: NDArray) -> NDArray:
        return strides_of.apply(points, p.slope, strides=strides).lengths

    return lambda: _differences(distance, point, step, {1: 0.5})


def diffrax(point: NDArray, p: Problem, strides: int, tolerance: float) -> Gradient:
    """Gradient by diffrax with its differentiable events and JAX's reverse mode, compiled."""
    stride = other_solvers.diffrax_stride(p, "Dopri8", tolerance, max_steps=4096)
    import jax
    import jax.numpy as jnp

    def distance(point: Any) -> Any:
        angle, stance, swing = point
        state = jnp.stack([angle, -angle, -angle, stance, swing, swing])

        def on(state: Any, _: Any) -> Any:
            after = stride(state)
            return after, _step(p, state[0], after[0])

        return jax.lax.scan(on, state, None, length=strides)[1].sum()

    gradient = jax.jit(jax.grad(distance))
    return lambda: np.asarray(gradient(point))


def torchdiffeq(point: NDArray, p: Problem, strides: int, tolerance: float) -> Gradient:
    """Gradient by torchdiffeq's `odeint_event` and torch's reverse mode."""
    stride = other_solvers.torchdiffeq_stride(p, "dopri8", tolerance)
    import torch

    def gradient() -> NDArray:
        start = torch.tensor(point, requires_grad=True)
        state = torch.stack([start[0], -start[0], -start[0], start[1], start[2], start[2]])
        way = torch.zeros((), dtype=torch.float64)
        for _ in range(strides):
            after = stride(state)
            state, way = after, way + _step(p, state[0], after[0])
        return torch.autograd.grad(way, start)[0].numpy()

    return gradient


def contact(point: NDArray, p: Problem, strides: int, time_step: float, step: float) -> Gradient:
    """Gradient by central differences over MuJoCo's penalty contact."""
    walker = penalty.Contact(p, time_step, "implicitfast")

    def distance(points: NDArray) -> list[float]:
        ways = []
        for angle, stance, swing in points:
            strikes, _ = walker.walk(np.array([angle, -angle, stance, swing]), strides)
            ends = 0.5 * (strikes[:, penalty.SWING] - strikes[:, penalty.STANCE])
            starts = np.append(angle, ends[:-1])
            whole = len(ends) == strides
            ways.append(float(np.sum(_step(p, starts, ends))) if whole else np.nan)
        return ways

    return lambda: _differences(distance, point, step, {1: 0.5})


def _setting(tolerance: float) -> str:
    return f"tolerance {tolerance:.0e}"


_PLOTTED_ONLY = [_setting(tolerance) for tolerance in TOLERANCES[1::2]]


def _methods(strides: int) -> Iterator[tuple[str, str, Callable[..., Gradient], int]]:
    """Label, setting and method, and the number of walkers in a batch."""
    for tolerance in TOLERANCES:
        setting = _setting(tolerance)
        yield (
            f"this engine, {BATCH} at once",
            setting,
            partial(engine, tolerance=tolerance, count=BATCH),
            BATCH,
        )
        yield "this engine, alone", setting, partial(engine, tolerance=tolerance, count=1), 1
        yield "this engine by torch", setting, partial(by_torch, tolerance=tolerance), 1
        for step in STEPS:
            yield (
                "differences of this engine",
                setting,
                partial(differences, tolerance=tolerance, step=step),
                1,
            )
    for tolerance in TOLERANCES[::2]:
        setting = _setting(tolerance)
        yield "diffrax, Dopri8", setting, partial(diffrax, tolerance=tolerance), 1
        if strides <= 10:  # a hundred take minutes
            yield "torchdiffeq, dopri8", setting, partial(torchdiffeq, tolerance=tolerance), 1
    for time_step in TIME_STEPS[strides]:
        for step in PENALTY_STEPS:
            yield (
                "MuJoCo, differences",
                f"time step {time_step:.0e}",
                partial(contact, time_step=time_step, step=step),
                1,
            )


def main() -> None:
    """Measure all methods; draw the results and write the table."""
    p = problem("straight")
    point, rows, notes = p.starts[0][[0, 3, 4]], [], []
    for strides in STRIDES:
        exact_value, own = exact(p, point, strides)
        notes.append(f"{own:.0e}")
        best: dict[tuple[str, str], tuple[float, float]] = {}
        for label, setting, method, count in _methods(strides):
            try:
                gradient = method(point, p, strides)
                gradient()  # compiles, if the method does
            except ImportError as missing:
                print(f"{label}: {missing}")
                continue
            began = time.perf_counter()
            reached = _error(gradient(), exact_value)
            took = time.perf_counter() - began
            if took < 0.1:
                took = seconds(gradient)
            took /= count
            key = (label, setting)
            if np.isfinite(reached) and reached < best.get(key, (np.inf,))[0]:
                best[key] = reached, took  # the best of several widths of differences
            print(strides, label, setting, reached, took, flush=True)
        rows += [
            (strides, *key, f"{e:.0e}", 1e3 * t)
            for key, (e, t) in best.items()
            if key[1] not in _PLOTTED_ONLY
        ]
        curves: dict[str, list[tuple[float, float]]] = {}
        for (label, _), (reached, took) in best.items():
            curves.setdefault(label, []).append((max(reached, 1e-16), took))
        drawn = {label: np.transpose(curve).tolist() for label, curve in curves.items()}
        title = f"The gradient of the distance after {strides} stride{'s' * (strides > 1)}"
        names = "relative error of the gradient", "s a gradient, one core"
        plot(f"gradients-{strides}", drawn, names, title=title, falling=True)
    text = table(["strides", "method", "setting", "relative error", "ms a gradient"], rows)
    used = machine("torch", "heyoka", "jax", "diffrax", "torchdiffeq", "mujoco")
    text += f"\n\nThe references' own errors are about {', '.join(notes)}. {used}."
    keep("gradients", text, BENCHMARKS)


if __name__ == "__main__":
    command(__doc__)
    raise SystemExit(console.run(main))
