"""How fast are many walkers? Strides and ticks a second, beside what a user would pick instead.

    python -m benchmarks.throughput               all parts, some ten minutes
    python -m benchmarks.throughput strides       one of them

Each part prints its table and puts it into docs/benchmarks.md. Run it on a quiet machine.
"""

from __future__ import annotations

import os
from functools import partial
from itertools import product
from typing import Any

import gymnasium as gym
import numba
import numpy as np

import gym_passive_walker  # noqa: F401  (registers the environment)
from benchmarks import engine, measured, reference
from benchmarks.engine import microseconds
from benchmarks.problem import WALKS, Problem, error, problem
from benchmarks.report import command, keep, machine, plot, seconds, table
from gym_passive_walker.engine.compiled import constants_used, loaded, object_code
from gym_passive_walker.engine.equations import Equations
from gym_passive_walker.engine.jit import call
from gym_passive_walker.engine.layout import TILE, WIDTH, aligned
from gym_passive_walker.engine.native import GROUP, Function, Memory, Module

CORES = os.cpu_count() or 1
SIZES = [10**k for k in range(7)]


def accelerations() -> None:
    """One evaluation of the equations of motion: over the lanes of a tile, and of one walker."""
    rows = []
    for name in WALKS:
        crowded, alone = (_nanoseconds(problem(name), crowd) for crowd in (True, False))
        rows.append((name, crowded, alone, alone / crowded))
    heads = ["walker", "ns, one of a tile", "ns, one alone", "ratio"]
    keep("accelerations", f"{table(heads, rows)}\n\nOne core. {machine()}.")


def _nanoseconds(p: Problem, crowd: bool) -> float:
    """Time of an evaluation, of a whole tile's or of one lane after another."""
    phase = p.system.phases[0]
    used = constants_used(p.system, phase)
    equations, module = Equations(p.system, phase, used), Module()
    function = Function(module, "evaluate", (TILE,))

    def evaluate(tile: Memory) -> None:
        for link, a in enumerate(equations.accelerations(tile, equations.state(tile))):
            # A little further each time, as a motion goes on.
            tile["angle", link] = tile["angle", link] + 1e-9 * a

    function.over_lanes(evaluate) if crowd else function.once(evaluate, lane=True)
    function.end()
    code = loaded(object_code(module))
    address, vectors = code.get_function_address("evaluate"), code.get_global_value_address("table")
    tile, times = aligned(TILE, 1), 20_000
    tile["angle"] = np.random.default_rng(0).uniform(-1.0, 1.0, tile["angle"].shape)
    tile["ground"] = np.array(p.ground)[:, None]
    body = np.array([getattr(p.body, name) for name in used])
    tile["body"][:, : len(body)] = body[:, None]

    @numba.njit
    def evaluated(start, times):  # type: ignore[no-untyped-def]
        for turn in range(times):
            if not crowd:
                call(address, start, vectors, turn % WIDTH, 0, 0.0, 0.0)
                continue
            for group in range(WIDTH // GROUP):
                call(address, start + 8 * GROUP * group, vectors, 0, 0, 0.0, 0.0)

    job = partial(evaluated, tile.ctypes.data, times)
    return seconds(job) / times / (WIDTH if crowd else 1) * 1e9


def strides() -> None:
    """One walker and a million: time of a stride, on one core and on all."""
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
    size = engine.crowd(problem("kneed"), 1).nbytes
    text += [f"Memory: {size} bytes a walker. {machine()}."]
    keep("strides", "\n\n".join(text))
    names = "walkers in the batch", "µs a stride and walker, one core"
    plot("throughput", {name: (SIZES, times) for name, times in curves.items()}, names)


def against() -> None:
    """The kneed walker's stride by its rivals, and by the engine at no larger error."""
    p = problem("kneed")
    exact, _ = reference.strides(p)
    ours = []
    for tolerance in 10.0 ** -np.arange(3.0, 15.0):
        ours.append((error(engine.strides(p, tolerance), exact), microseconds(p, 4096, tolerance),
                     microseconds(p, 1, tolerance)))  # fmt: skip
    rows = [(f"this engine, {n} at once" if n > 1 else "this engine, alone", f"{10.0 ** -k:.0e}",
             ours[k - 3][0], ours[k - 3][1 if n > 1 else 2], "")
            for n in (4096, 1) for k in (4, 6, 8, 10, 12, 14)]  # fmt: skip
    makers = measured.everyone_else(p, exact, lanes=(8, 16, 32))
    makers["heyoka, 8 lanes, events left out"] = partial(measured.heyoka_floor, p, 8)
    for name, make in makers.items():
        for tolerance in (1e-4, 1e-6, 1e-8, 1e-10, 1e-12, 1e-14):
            try:
                reached, took = make(tolerance)
            except ImportError:
                rows.append((name, f"{tolerance:.0e}", float("nan"), float("nan"), "not installed"))
                break
            column = 2 if "alone" in name else 1
            good = [o for o in ours if o[0] <= (reached if reached == reached else tolerance)]
            best = min(o[column] for o in (good or ours[-1:]))
            rows.append((name, f"{tolerance:.0e}", reached, took, f"{took / best:.3g}"))
    text = table(
        ["method", "tolerance", "error reached", "µs a stride", "times this engine's"], rows
    )
    keep(
        "against",
        f"{text}\n\nThe last column compares with the engine at an error no larger, alone with "
        "alone and crowd with crowd; where no error can be told (events left out), at an error no "
        f"larger than the tolerance. One core. {machine('scipy', 'heyoka', 'diffrax')}.",
    )


def ticks() -> None:
    """Control ticks of the environments, beside other environments of the field."""
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
    fast = min(value for (count, _), value in native.items() if count in (64, 1024))
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
        f"A tick lasts {scene.tick} √(l/g), at a tolerance of {scene.tolerance:.0e}; actions are "
        f"drawn beforehand. The fastest native tick here takes {fast * 1e9:.0f} ns. "
        f"{machine('gymnasium', 'envpool', 'mujoco')}."
    ]
    keep("ticks", "\n\n".join(text))


def _one(env: gym.Env) -> float:
    """Time of a step of one environment, resets included where episodes end."""
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
    """Time of a step of a whole batch."""
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


def learning() -> None:
    """Frames a second of PPO with this environment, and with one that costs nothing."""
    from benchmarks import frames

    keep("learning", frames.report())


def on_tensors() -> None:
    """Frames a second of PPO on tensors, beside that of stable-baselines3."""
    from benchmarks import frames

    keep("on_tensors", frames.on_tensors())


PARTS = {
    "accelerations": accelerations,
    "strides": strides,
    "against": against,
    "ticks": ticks,
    "learning": learning,
    "on_tensors": on_tensors,
}


if __name__ == "__main__":
    command(__doc__, PARTS)
