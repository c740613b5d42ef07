"""Start-up times on one core, with an empty and with a filled cache of compiled code.

    python -m benchmarks.cold_start               Run all parts, in a quarter of an hour.
    python -m benchmarks.cold_start waits         Run one part.

Each time is that of a fresh process, in CPU seconds: first with an empty cache, then with the cache
that the first process filled. The tables are written to docs/benchmarks.md.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from benchmarks.report import command, machine, table
from benchmarks.tables import BENCHMARKS, DOCS, keep

WALKS = {"C": 0.03, "A": 0.03, "D": 0.009}
"""A kneed, a straight-legged and the simplest walker, with a slope in rad for each."""

_BEGIN = "import gym_passive_walker as gpw; import numpy as np"
_ENVIRONMENT = f"{_BEGIN}; import gymnasium as gym"
_RESET = "env = gym.make('PassiveWalker-v0', walker='{0}', slope={1}); env.reset(seed=0)"
_STEP = "env.step(np.zeros(env.action_space.shape))"
_GAIT = "gpw.find_gait('{0}', {1})"
_FAMILY = "gpw.gait_family('{0}', {2}, {1})"


def tasks() -> dict[str, list[str]]:
    """Python code of each task, by name; the last part is timed."""
    found = {
        "import gymnasium": ["import gymnasium"],
        "import gym_passive_walker after it": ["import gymnasium", "import gym_passive_walker"],
    }
    for walker, slope in WALKS.items():
        own = [part.format(walker, slope, 0.8 * slope) for part in (_RESET, _STEP, _GAIT, _FAMILY)]
        reset, step, gait, family = own
        found |= {
            f"first reset, walker {walker}": [_ENVIRONMENT, reset],
            f"first step after it, walker {walker}": [_ENVIRONMENT, reset, step],
            f"first find_gait, walker {walker}": [_BEGIN, gait],
            f"first gait_family, walker {walker}": [_BEGIN, family],
        }
    return found


def alone(cache: str) -> dict[str, str]:
    """Environment variables of a process on one core, with its own cache."""
    names = ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")
    kept = {k: v for k, v in os.environ.items() if k != "NUMBA_CACHE_DIR"}
    return kept | dict.fromkeys(names, "1") | {"XDG_CACHE_HOME": cache}


_TIMED = """
import json, sys, time
parts = json.loads(sys.argv[1])
scope = {}
for part in parts:
    began = time.process_time()
    exec(part, scope)
    took = time.process_time() - began
print(took)
"""


def wait(
    parts: list[str], cache: str, python: str = sys.executable, cwd: str | None = None, **model: str
) -> float:
    """CPU seconds of the last part, in a fresh process; `model` selects another CPU."""
    line = [python, "-c", _TIMED, json.dumps(parts)]
    variables = alone(cache) | model
    found = subprocess.run(line, env=variables, cwd=cwd, capture_output=True, text=True, check=True)
    return float(found.stdout.split()[-1])


def waits() -> None:
    """Measure the times that a user waits, for the first and for later starts."""
    rows = []
    for name, parts in tasks().items():
        with tempfile.TemporaryDirectory() as cache:
            rows.append((name, wait(parts, cache), wait(parts, cache)))
        print(*rows[-1], flush=True)
    text = table(["CPU seconds", "empty cache", "filled cache"], rows)
    keep("cold start", f"{text}\n\nOne core, each in a fresh process. {_machine()}.", BENCHMARKS)


_BATCH = (
    "states = np.array(gpw.find_gait('lab', 0.036).state) * np.linspace(0.99, 1.01, 2048)[:, None]"
)
_STRIDES = "for _ in range(50): gpw.stride('lab', 0.036, states, tolerance=1e-6, threads=1)"


def levels() -> None:
    """Measure code for the levels of a wheel that this CPU has: start-up, size and speed."""
    rows = []
    reset, step = (part.format("lab", 0.036) for part in (_RESET, _STEP))
    for name, model in _targets():
        with tempfile.TemporaryDirectory() as cache:
            begun = [_ENVIRONMENT, f"{reset}; {step}"]
            empty, filled = (wait(begun, cache, **model) for _ in range(2))
            size = sum(file.stat().st_size for file in Path(cache).rglob("*.o")) / 1e3
            strides = [_BEGIN, _BATCH + "; " + _STRIDES.partition(": ")[2], _STRIDES]
            took = min(wait(strides, cache, **model) for _ in range(5)) / (50 * 2048)
        rows.append((name, empty, filled, size, 1e6 * took))
        print(*rows[-1], flush=True)
    text = table(["made for", "CPU s, none there", "all there", "kB", "µs a stride"], rows)
    keep(
        "levels",
        f"{text}\n\nOne core, scene lab: a first reset and step. {_machine()}.",
        BENCHMARKS,
    )


def _targets() -> Iterator[tuple[str, dict[str, str]]]:
    """Yield targets by name, with the variables that ask for them: this CPU, and its levels."""
    from llvmlite.binding import get_host_cpu_features

    from gym_passive_walker.engine.machine import LEVELS

    yield "this CPU", {}
    has = get_host_cpu_features()
    for name, level in LEVELS.items():
        if all(has.get(feature) for feature in level.needs):
            yield name, {"NUMBA_CPU_NAME": level.cpu, "NUMBA_CPU_FEATURES": level.features}


def kernels() -> None:
    """Measure the parts of the time to compile a kernel."""
    with tempfile.TemporaryDirectory() as cache:
        line = [sys.executable, "-c", "from benchmarks.cold_start import _taken; _taken()"]
        found = subprocess.run(line, env=alone(cache), capture_output=True, text=True, check=True)
    modules, compilations = json.loads(found.stdout.splitlines()[-1])
    text = [
        table(["equations, CPU seconds", "traced", "LLVM", "loaded", "kB"], modules),
        table(["bookkeeping compiled by numba, CPU seconds", "alone"], compilations),
    ]
    keep("kernels", "\n\n".join([*text, f"One core. {_machine()}."]), BENCHMARKS)


def _machine() -> str:
    return machine("llvmlite", "scipy", "gymnasium")


def _taken() -> None:
    """Print the compilation times of each kernel, in this process."""
    print(json.dumps([list(_modules()), _compilations()]))


def _modules() -> Iterator[tuple[str, float, float, float, float]]:
    """Name of each native module, CPU seconds of its three stages, and size in kB.

    The last ones are systems of one's own, as `examples` states them.
    """
    from examples.five_links import FIVE_LINKS
    from examples.torso import TORSO
    from gym_passive_walker.engine.compiled import written
    from gym_passive_walker.engine.machine import loaded, object_code
    from gym_passive_walker.models.equations.systems import SYSTEMS

    examples = {f"examples: {own.name}": own.hybrid for own in (TORSO, FIVE_LINKS)}
    for name, system in {**SYSTEMS, **examples}.items():
        for derived in (False, True):
            label = name + ", and derivatives" * derived
            start = time.process_time()
            module = written(system, derived=derived)
            traced = time.process_time()
            data = object_code(module)
            made = time.process_time()
            loaded(data)
            done = time.process_time()
            yield label, traced - start, made - traced, done - made, len(data) / 1e3


@contextmanager
def _clocked(taken: dict[str, float]) -> Iterator[None]:
    """Record numba's CPU seconds for each function, without the functions that it calls."""
    from numba.core import event

    class Clock(event.Listener):
        def __init__(self) -> None:
            self.running: list[list[float]] = []

        def on_start(self, event: event.Event) -> None:
            self.running.append([time.process_time(), 0.0])

        def on_end(self, event: event.Event) -> None:
            began, within = self.running.pop()
            took = time.process_time() - began
            function = event.data["dispatcher"].py_func
            name = f"{function.__module__.removeprefix('gym_passive_walker.')}.{function.__name__}"
            taken[name] = taken.get(name, 0.0) + took - within
            if self.running:
                self.running[-1][1] += took

    with event.install_listener("numba:compile", Clock()):
        yield


def _compilations() -> list[tuple[str, float]]:
    """CPU seconds that numba takes for each function of a first gait and a first step."""
    taken: dict[str, float] = {}
    scope: dict = {}
    with _clocked(taken):
        for parts in ([_ENVIRONMENT, _RESET, _STEP], [_BEGIN, _GAIT, _FAMILY]):
            for part in parts:
                exec(part.format("C", WALKS["C"], 0.8 * WALKS["C"]), scope)
    rows = sorted(taken.items(), key=lambda each: -each[1])
    return [*rows, ("all", sum(taken.values()))]


_STEPS = "env.reset(seed=0); env.step(np.zeros(env.action_space.shape))"
_WALKER2D = f"import gymnasium as gym, numpy as np; env = gym.make('Walker2d-v5'); {_STEPS}"
_OURS = f"{_ENVIRONMENT}; env = gym.make('PassiveWalker-v0'); {_STEPS}"
_OWN = "reward=lambda step: step.distance - step.energy"
WITHOUT_COMPILER = {
    "`import gymnasium`": ["import gymnasium"],
    "Walker2d-v5 from its import to its first step": [_WALKER2D],
    "PassiveWalker-v0, the same": [_OURS],
    "its scene `rough`, after that": [
        _OURS,
        f"env = gym.make('PassiveWalker-v0', scene='rough'); {_STEPS}",
    ],
    "a reward of one's own, after that": [
        _OURS,
        f"env = gym.make('PassiveWalker-v0', {_OWN}); {_STEPS}",
    ],
    "`import` and `find_gait('lab', 0.036)`": [f"{_BEGIN}; gpw.find_gait('lab', 0.036)"],
}
"""Tasks in an environment with a wheel, MuJoCo and no compiler; the last part is timed."""


def wheel() -> None:
    """Measure first steps where a wheel is installed, beside those of MuJoCo's Walker2d."""
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        python = str(Path(folder) / "venv" / "bin" / "python")
        subprocess.run([sys.executable, "-m", "venv", Path(folder) / "venv"], check=True)
        pip = ["-m", "pip", "--quiet", "--disable-pip-version-check"]
        subprocess.run(
            [python, *pip, "wheel", "--no-deps", "--wheel-dir", folder, str(DOCS.parent)],
            check=True,
        )
        (made,) = Path(folder).glob("*.whl")
        given = [str(made), "gymnasium[mujoco]", "-c", str(DOCS.parent / "constraints.txt")]
        subprocess.run([python, *pip, "install", *given], check=True)
        for name, parts in WITHOUT_COMPILER.items():
            took = []
            for number in range(5):
                cache = str(Path(folder) / f"{len(rows)}-{number}")  # empty
                took.append(wait(parts, cache, python=python, cwd=folder))
            rows.append((name, min(took), sorted(took)[len(took) // 2]))
            print(*rows[-1], flush=True)
        size = made.stat().st_size / 1e6
    text = table(
        ["CPU seconds, each in a fresh process with an empty cache", "least of 5", "median"], rows
    )
    keep("wheel", f"{text}\n\nThe wheel has {size:.2f} MB. One core. {_machine()}.", BENCHMARKS)


PARTS: dict[str, Callable[[], None]] = {
    "wheel": wheel,
    "waits": waits,
    "levels": levels,
    "kernels": kernels,
}


if __name__ == "__main__":
    command(__doc__, PARTS)
