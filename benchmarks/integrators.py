"""Which Runge-Kutta pair should carry the walkers? Time against error of some, over lanes.

    python -m benchmarks.integrators

Each pair is compiled into the same loop over lanes, with the engine's accelerations and
second-order form, and takes the lab walker through its swing with the knee free, without events.
Beside them: heyoka's Taylor method in batch mode, the best of its kind. The table lands in
docs/benchmarks.md.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from gym_passive_walker.physics.lanes import WIDTH, align_stack, get, jitted, new_tile, put
from numpy.typing import NDArray
from scipy.integrate import DOP853, RK45

from benchmarks import reference
from benchmarks.equations import lane_accelerations
from benchmarks.problem import Problem, error, problem
from benchmarks.report import command, keep, machine, seconds, table
from benchmarks.rivals import heyoka_swings

HORIZON = 1.2
COUNT = 1024
ERRORS = (1e-4, 1e-6, 1e-8, 1e-10, 1e-12, 1e-13)


class Pair(NamedTuple):
    """An explicit Runge-Kutta pair.

    Attributes:
        name: Whose it is.
        lower: Order of the error estimate.
        a: Matrix, shape (stages, stages).
        b: Weights of the result.
        e: Weights of the error estimate, of the stages and (if longer) of the step's end.
        e3: Weights of a second estimate, of order 3, as in DOP853; zeros without.
    """

    name: str
    lower: int
    a: NDArray
    b: NDArray
    e: NDArray
    e3: NDArray


def pairs() -> list[Pair]:
    """The pairs tried."""
    found = [
        Pair(
            "Dormand-Prince 5(4)", 4, np.pad(RK45.A, ((0, 0), (0, 1))), RK45.B, RK45.E, 0.0 * RK45.E
        ),
        Pair("Dormand-Prince 8(5,3)", 7, DOP853.A, DOP853.B, DOP853.E5, DOP853.E3),
    ]
    text = (Path(__file__).parent / "tableaus.json").read_text(encoding="utf-8")
    for name, t in json.loads(text).items():
        a = np.zeros((len(t["b"]), len(t["b"])))
        for i, row in enumerate(t["A"]):
            a[i, :i] = row
        b, e = np.array(t["b"]), np.array(t["e"])
        if np.array_equal(a[-1], b):  # the last stage is the step's end
            a, b = a[:-1, :-1], b[:-1]
        found.append(Pair(name, t["lower"], a, b, e, 0.0 * e))
    return found


def _sum(weights: NDArray, coordinate: int) -> str:
    """Code for a weighted sum of stage accelerations."""
    terms = [f"{float(w)!r} * k{j}_{coordinate}" for j, w in enumerate(weights) if w != 0.0]
    return " + ".join(terms) or "0.0"


def _source(pair: Pair) -> str:
    """Python code of one step of every lane: a loop for each stage, as the engine has it."""
    stages = len(pair.b)
    rows = [*pair.a, pair.b]
    lines = ["def step(tile, tolerance, end):", "    align_stack()"]
    for i in range(stages + 1):
        weights = rows[i][: min(i, stages)]
        lines += ["    for lane in range(WIDTH):", "        h = get(tile, H, lane)"]
        lines += [f"        k{j}_{q} = get(tile, {_k(j, q)}, lane)"
                  for j, w in enumerate(weights) for q in range(3)
                  if w != 0.0 or np.any(weights @ pair.a[: len(weights), j : j + 1])]  # fmt: skip
        for q in range(3):
            twice = weights @ pair.a[: len(weights), : len(weights)]
            node = float(weights.sum())
            lines += [
                f"        w{q} = get(tile, {3 + q}, lane)",
                f"        shift = {node!r} * w{q} + h * ({_sum(twice, q)})",
                f"        q{q} = get(tile, {q}, lane) + h * shift",
                f"        w{q} = w{q} + h * ({_sum(weights, q)})",
            ]
        lines += ["        a0, a1, a2 = accelerations(q0, q1, q2, w0, w1, w2)"]
        lines += [f"        put(tile, {_k(i, q)}, lane, a{q})" for q in range(3)]
        if i == stages:
            lines += [f"        put(tile, {6 + q}, lane, q{q})" for q in range(3)]
            lines += [f"        put(tile, {9 + q}, lane, w{q})" for q in range(3)]
    lines += [
        "    for lane in range(WIDTH):",
        "        h = get(tile, H, lane)",
        "        scale = 1e-290",
    ]
    for row in range(12):
        lines.append(f"        scale = max(scale, abs(get(tile, {row}, lane)))")
    lines += [
        "        weight = h / (tolerance * scale)",
        "        fifth = 1e-60",
        "        third = 0.0",
    ]
    for q in range(3):
        needed = [j for j in range(len(pair.e)) if pair.e[j] != 0.0 or pair.e3[j] != 0.0]
        matrix = np.vstack([pair.a, pair.b])[: len(pair.e), :stages]
        for weights, name in ((pair.e, "fifth"), (pair.e3, "third")):
            if not weights.any():
                continue
            twice = weights @ matrix
            used = sorted({*needed, *np.flatnonzero(twice).tolist()})
            lines += [f"        k{j}_{q} = get(tile, {_k(j, q)}, lane)" for j in used]
            lines += [
                f"        r = weight * ({_sum(weights, q)})",
                f"        s = weight * h * ({_sum(twice, q)})",
                f"        {name} = {name} + r * r + s * s",
            ]
    estimate = "fifth / np.sqrt(fifth + 0.01 * third)" if pair.e3.any() else "np.sqrt(fifth)"
    lines += [
        f"        error = {estimate}",
        f"        factor = 0.9 * np.exp(-np.log(error) / {pair.lower + 1}.0)",
        "        factor = min(6.0, max(0.2, factor))",
        "        good = error <= 1.0",
        "        for row in range(6):",
        "            old, new = get(tile, row, lane), get(tile, row + 6, lane)",
        "            put(tile, row, lane, new if good else old)",
        "        for q in range(3):",
        f"            first = get(tile, {_k(0, 0)} + q, lane)",
        f"            last = get(tile, {_k(stages, 0)} + q, lane)",
        f"            put(tile, {_k(0, 0)} + q, lane, last if good else first)",
        "        time = get(tile, TIME, lane) + (h if good else 0.0)",
        "        put(tile, TIME, lane, time)",
        "        put(tile, H, lane, min(h * factor, end - time))",
    ]
    return "\n".join(lines)


_H, _TIME, _STAGE = 12, 13, 14


def _k(stage: int, coordinate: int) -> int:
    return _STAGE + 3 * stage + coordinate


def compiled(p: Problem, pair: Pair) -> Callable[[NDArray, float], NDArray]:
    """A function that carries starts to the horizon, at a tolerance."""
    accelerations = lane_accelerations(p)
    names: dict[str, Any] = {
        "WIDTH": WIDTH, "H": _H, "TIME": _TIME, "get": get, "put": put, "np": np,
        "align_stack": align_stack,
        "accelerations": accelerations,
    }  # fmt: skip
    exec(_source(pair), names)
    step, rows, first = jitted(names["step"]), _k(len(pair.b) + 1, 0), 1.0 / (pair.lower + 1)

    @jitted
    def run(starts, tolerance, ends):  # type: ignore[no-untyped-def]
        tile = new_tile(rows, starts)
        owner = np.full(WIDTH, -1)
        waiting, left = 0, len(starts)
        while left > 0:
            for lane in range(WIDTH):
                done = owner[lane] >= 0 and get(tile, _TIME, lane) >= HORIZON
                if done:
                    for row in range(6):
                        ends[owner[lane], row] = get(tile, row, lane)
                    owner[lane] = -1
                    left -= 1
                if owner[lane] < 0 and waiting < len(starts):
                    owner[lane] = waiting
                    s = starts[waiting]
                    waiting += 1
                    for row in range(6):
                        put(tile, row, lane, s[row])
                    a0, a1, a2 = accelerations(s[0], s[1], s[2], s[3], s[4], s[5])
                    put(tile, _STAGE, lane, a0)
                    put(tile, _STAGE + 1, lane, a1)
                    put(tile, _STAGE + 2, lane, a2)
                    put(tile, _TIME, lane, 0.0)
                    put(tile, _H, lane, min(0.5 * tolerance**first, HORIZON))
            step(tile, tolerance, HORIZON)

    def ends(starts: NDArray, tolerance: float) -> NDArray:
        found = np.empty_like(starts)
        run(starts, tolerance, found)
        return found

    return ends


def at_errors(ends: Callable[[NDArray, float], NDArray], p: Problem, exact: NDArray) -> list[float]:
    """Microseconds a walker at each of ERRORS, between tolerances by the logarithms."""
    crowd = np.resize(p.starts, (COUNT, 6))
    errors, times = [], []
    for tolerance in 10.0 ** -np.arange(2.0, 16.0, 0.5):
        found = ends(p.starts, tolerance)
        errors.append(error(found, exact))
        times.append(seconds(lambda t=tolerance: ends(crowd, t), at_least=0.05, repeats=3) / COUNT)
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
    """Print the table and keep it."""
    command(__doc__)
    p = problem("kneed")
    exact = reference.swings(p, HORIZON)
    rows: list[tuple] = []
    for pair in pairs():
        stages = f"{len(pair.b)} stages"
        rows.append((pair.name, stages, *at_errors(compiled(p, pair), p, exact)))
        print(rows[-1], flush=True)
    rows.append(("Taylor, heyoka, 8 lanes", "", *at_errors(heyoka_swings(p, HORIZON), p, exact)))
    heads = ["method", "", *(f"µs at error {error:.0e}" for error in ERRORS)]
    keep("integrators", f"{table(heads, rows)}\n\nOne core. {machine('heyoka')}.")


if __name__ == "__main__":
    main()
