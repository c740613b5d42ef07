"""Throughput: strides and control steps per second, beside other environments.

    python -m benchmarks.throughput               Run all parts, in some ten minutes.
    python -m benchmarks.throughput strides       Run one part.

Each part prints its table and writes the table to docs/benchmarks.md. Run it on an otherwise
idle machine.
"""

from __future__ import annotations

import math
import os
import time
from functools import partial
from itertools import product
from statistics import median
from typing import Any

import gymnasium as gym
import numpy as np

import gym_passive_walker  # noqa: F401  (registers the environment)
from benchmarks import engine, reference
from benchmarks.engine import microseconds
from benchmarks.problem import WALKS, error, problem
from benchmarks.report import command, machine, plot, seconds, table
from benchmarks.tables import BENCHMARKS, keep

CORES = os.cpu_count() or 1
SIZES = [10**k for k in range(7)]


def accelerations() -> None:
    """Measure one evaluation of the equations of motion: over a tile's lanes, and of one walker."""
    rows = []
    for name in WALKS:
        equations, tile = engine.equations_of(problem(name))
        together, alone = (
            engine.nanoseconds(
                engine.over_tile([engine.acceleration(equations)], alone=alone), tile, alone=alone
            )
            for alone in (False, True)
        )
        rows.append((name, together, alone, alone / together))
    heads = ["walker", "ns, one of a tile", "ns, one alone", "ratio"]
    keep("accelerations", f"{table(heads, rows)}\n\nOne core. {machine()}.", BENCHMARKS)


def strides() -> None:
    """Measure the time of a stride for one walker to a million, on one core and on all."""
    text, curves = [], {}
    for name, tolerance in (("kneed", 1e-4), ("kneed", 1e-6), ("kneed", 1e-12),
                            ("straight", 1e-6), ("simplest", 1e-6)):  # fmt: skip
        p = problem(name)
        reached = error(engine.strides(p, tolerance), reference.strides(p)[0])
        rows, alone = [], 0.0
        for count in SIZES:
            one = microseconds(p, count, tolerance)
            alone = alone or one
            every = microseconds(p, count, tolerance, CORES) if count >= 1000 else float("nan")
            rows.append((count, one, 1e6 / one, alone / one, every, 1e6 / every, one / every))
        curves[f"{name}, error {reached:.0e}"] = [row[1] for row in rows]
        text += [
            f"Walker {name}, tolerance {tolerance:.0e}: error reached {reached:.1e}",
            table(
                ["walkers", "µs a stride, one core", "strides/s, one core", "× one alone",
                 f"µs, {CORES} cores", f"strides/s, {CORES} cores", "× one core"],
                rows,
            ),
        ]  # fmt: skip
    size = engine.new_batch(problem("kneed"), 1).nbytes
    text += [f"Memory: {size} bytes a walker. {machine()}."]
    keep("strides", "\n\n".join(text), BENCHMARKS)
    names = "walkers in the batch", "µs a stride and walker, one core"
    plot("throughput", {name: (SIZES, times) for name, times in curves.items()}, names)


def ticks() -> None:
    """Measure control steps of the environments, beside other environments of the field."""
    rows: list[tuple] = []
    walker = _one(gym.make("PassiveWalker-v0", reset_noise_scale=0.02))
    bare = _one(gym.make("PassiveWalker-v0", reset_noise_scale=0.02).unwrapped)
    pendulum = _one(gym.make("Pendulum-v1"))
    pendulum_bare = _one(gym.make("Pendulum-v1").unwrapped)
    rows += [
        ("PassiveWalker-v0, as gym.make gives it", walker * 1e6, walker / pendulum),
        ("PassiveWalker-v0, unwrapped", bare * 1e6, bare / pendulum_bare),
        ("Pendulum-v1, as gym.make gives it", pendulum * 1e6, 1.0),
        ("Pendulum-v1, unwrapped", pendulum_bare * 1e6, 1.0),
    ]
    text = [table(["one environment", "µs a step", "× Pendulum-v1"], rows)]
    rows = []
    native = {}
    for count in (1, 10, 64, 1000, 1024, 10_000, 100_000, 1_000_000):
        for threads in (1, CORES) if count >= 1000 else (1,):
            envs = gym.make_vec("PassiveWalker-v0", num_envs=count, threads=threads)
            native[count, threads] = _many(envs) / count
            rows.append(
                (
                    f"PassiveWalker-v0, native batch, {threads} core{'s' * (threads > 1)}",
                    count,
                    native[count, threads] * 1e6,
                    1.0 / native[count, threads],
                    "",
                )
            )
            envs.close()  # fmt: skip
    for count in (64, 1024):
        envs = gym.make_vec("CartPole-v1", num_envs=count, vectorization_mode="vector_entry_point")
        took = _many(envs) / count
        rows.append(
            (
                "CartPole-v1, native batch (NumPy)",
                count,
                took * 1e6,
                1 / took,
                took / native[count, 1],
            )
        )
        for name, cores in product(("BipedalWalker-v3", "Walker2d-v4"), sorted({1, CORES})):
            what = f"EnvPool {name}, {cores} core{'s' * (cores > 1)}"
            try:
                took = _envpool(name, count, cores) / count
            except ImportError:
                rows.append((what, count, float("nan"), float("nan"), "absent"))
                continue
            own = native.get((count, cores), native[count, 1])
            rows.append((what, count, took * 1e6, 1 / took, took / own))
    text += [
        table(
            ["environments", "number", "µs a step each", "steps/s", "times ours on as many"], rows
        )
    ]
    scene = gym.make("PassiveWalker-v0").unwrapped.scene  # type: ignore[attr-defined]
    text += [
        f"A control step (tick) lasts {scene.tick} √(l/g), at a tolerance of "
        f"{scene.tolerance:.0e}. Actions are drawn beforehand. "
        f"{machine('gymnasium', 'envpool', 'mujoco')}."
    ]
    keep("ticks", "\n\n".join(text), BENCHMARKS)


def _one(env: gym.Env) -> float:
    """Seconds for a step of one environment, including resets at the end of episodes."""
    env.reset(seed=0)
    env.action_space.seed(0)
    actions = [env.action_space.sample() for _ in range(256)]

    def job() -> None:
        for action in actions:
            _, _, terminated, truncated, _ = env.step(action)
            if terminated or truncated:
                env.reset()

    return seconds(job) / len(actions)


def _many(envs: Any) -> float:
    """Seconds for a step of a vectorized environment."""
    envs.reset(seed=0)
    envs.action_space.seed(0)
    actions = [envs.action_space.sample() for _ in range(2 if envs.num_envs > 10_000 else 16)]

    def job() -> None:
        for action in actions:
            envs.step(action)

    return seconds(job) / len(actions)


def _envpool(name: str, count: int, threads: int) -> float:
    import envpool

    envs: Any = envpool.make_gymnasium(name, num_envs=count, num_threads=threads)
    envs.reset()
    random = np.random.default_rng(0)
    size = (count, *envs.action_space.shape)
    actions = [random.uniform(-1.0, 1.0, size).astype(np.float32) for _ in range(16)]

    def job() -> None:
        for action in actions:
            envs.step(action)

    return seconds(job) / len(actions)


def threads() -> None:
    """Measure control steps on several threads, at once and with other work in between."""
    numbers = [n for n in (1, 2, 4, 8, 16, 32, 64) if n <= CORES]
    counts, pauses = (512, 1024, 1536, 2048, 4096, 10_000, 100_000), (0.0, 0.3e-3, 2e-3)
    make = partial(gym.make_vec, "PassiveWalker-v0")
    batches = {(x, n): make(num_envs=x, threads=n) for x in counts for n in numbers}
    for envs in batches.values():
        envs.reset(seed=0)
    best: dict[tuple, float] = {}
    for _ in range(10):
        for pause, (of, envs) in product(pauses, batches.items()):
            best[pause, *of] = min(best.get((pause, *of), math.inf), _step(envs, pause))
    rows: list[tuple] = []
    for pause, count in product(pauses, counts):
        alone, *others = (best[pause, count, n] for n in numbers)
        rows.append((1e3 * pause, count, alone * 1e6, *(f"× {alone / x:.2f}" for x in others)))
    heads = [
        "ms between steps",
        "walkers",
        "µs a step, 1 thread",
        *(f"{n} threads" for n in numbers[1:]),
    ]
    text = "In between, the thread that steps computes. Medians, the best of ten by turns."
    keep("threads", f"{table(heads, rows)}\n\n{text} {machine('gymnasium')}.", BENCHMARKS)


def _step(envs: Any, pause: float) -> float:
    """Seconds of a step of a batch, the median of some."""
    random, times = np.random.default_rng(0), []
    actions = [random.uniform(-1.0, 1.0, (envs.num_envs, 1)).astype(np.float32) for _ in range(8)]
    for i in range(max(20, 50_000 // envs.num_envs)):
        until = time.perf_counter() + pause
        while time.perf_counter() < until:
            pass
        began = time.perf_counter()
        envs.step(actions[i % len(actions)])
        times.append(time.perf_counter() - began)
    return median(times)


def learning() -> None:
    """Measure frames per second of PPO with this environment, and with an empty one."""
    from benchmarks import frames

    keep("learning", frames.report(), BENCHMARKS)


def on_tensors() -> None:
    """Measure frames per second of PPO on tensors, beside PPO of stable-baselines3."""
    from benchmarks import frames

    keep("on_tensors", frames.on_tensors(), BENCHMARKS)


PARTS = {
    "accelerations": accelerations,
    "strides": strides,
    "ticks": ticks,
    "threads": threads,
    "learning": learning,
    "on_tensors": on_tensors,
}


if __name__ == "__main__":
    command(__doc__, PARTS)
