"""What is measured: strides from around a gait, and their ends in 80-bit arithmetic.

The equations of every rival are the engine's own, read as plain Python over the rival's numbers, so
that all solve the same problem to the digit.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from types import FunctionType, ModuleType, SimpleNamespace
from typing import Any, NamedTuple

import numba
import numpy as np
from numba.core.dispatcher import Dispatcher
from numpy.typing import NDArray

from gym_passive_walker import WALKERS, find_gait
from gym_passive_walker.physics import compass, kneed, simplest
from gym_passive_walker.physics import constants as K
from gym_passive_walker.physics import record as R
from gym_passive_walker.physics.constants import Kind
from gym_passive_walker.physics.engine import advance
from gym_passive_walker.physics.events import Outcome
from gym_passive_walker.physics.record import new_records

REFERENCES = Path(__file__).parent / "references"
STARTS = 64
_PHYSICS = "gym_passive_walker.physics"


class Problem(NamedTuple):
    """Strides of one walker, dimensionless.

    Attributes:
        name: How tables and files call it.
        kind: Which equations it obeys.
        c: Its constants, shape (COUNT,).
        slope: In rad.
        starts: Section states, shape (STARTS, 6): a gait's, moved by up to 1 %.
    """

    name: str
    kind: Kind
    c: NDArray
    slope: float
    starts: NDArray


WALKS = {"simplest": ("D", 0.009), "straight": ("A", 0.03), "kneed": ("lab", 0.036)}


def problem(name: str) -> Problem:
    """A problem by name: "simplest", "straight" or "kneed"."""
    walker, slope = WALKERS[WALKS[name][0]], WALKS[name][1]
    gait = find_gait(walker, slope)
    state = gait.state * np.repeat([1.0, walker.time_unit], 3)
    random = np.random.default_rng(1)
    starts = state * (1.0 + 0.01 * random.uniform(-1.0, 1.0, (STARTS, 6)))
    starts[:, 1] = starts[:, 2] = -starts[:, 0]
    kind = K.kind_of(walker)
    if kind != Kind.KNEED:
        starts[:, 5] = starts[:, 4]
    return Problem(name, kind, K.constants(walker), slope, starts)


def crowd(p: Problem, count: int) -> NDArray:
    """Records of `count` walkers, which begin at the problem's starts in turn."""
    return new_records(np.resize(p.starts, (count, 6)), np.full(count, p.slope))


def ends(p: Problem, tolerance: float, count: int = STARTS, threads: int = 1) -> NDArray:
    """Next section states by the engine, shape (count, 6)."""
    records = crowd(p, count)
    advance(p.kind, p.c[None], records, tolerance=tolerance, threads=threads)
    if not np.all(records[:, R.OUTCOME] == Outcome.HEELSTRIKE):
        raise RuntimeError("a walker of the benchmark fell")
    return records[:, :6]


def error(found: NDArray, reference: NDArray) -> float:
    """Largest error of a state, relative to its largest angle or rate."""
    difference = np.abs(np.asarray(found - reference, dtype=float)).max(axis=-1)
    return float((difference / np.abs(reference).max(axis=-1)).max())


def plain(function: Any, sine_cosine: Callable) -> Callable:
    """A compiled function of the engine as plain Python.

    Args:
        function: Any of `physics`' inlined functions.
        sine_cosine: What to use for the engine's sines: it says over which numbers this runs.
    """
    seen: dict[str, Any] = {}

    def reread(value: Any) -> Any:
        if isinstance(value, Dispatcher):
            if value.py_func.__name__ == "sine_cosine":
                return sine_cosine
            key = f"{value.py_func.__module__}.{value.py_func.__name__}"
            if key not in seen:
                code, names = value.py_func.__code__, value.py_func.__globals__
                globals_: dict[str, Any] = {"__builtins__": __builtins__}
                seen[key] = FunctionType(code, globals_)
                for name in code.co_names:
                    if name in names:
                        globals_[name] = reread(names[name])
            return seen[key]
        if isinstance(value, ModuleType) and value.__name__.startswith(_PHYSICS):
            entries = vars(value).items()
            late = {n: _Late(reread, e) for n, e in entries if isinstance(e, Dispatcher)}
            return SimpleNamespace(**{n: e for n, e in entries if n[:2] != "__"} | late)
        return value

    return reread(function)


class _Late:
    """A function of another module, read when it is first called."""

    def __init__(self, reread: Callable, entry: Any) -> None:
        self._reread, self._entry = reread, entry

    def __call__(self, *arguments: Any) -> Any:
        return self._reread(self._entry)(*arguments)


def motion(p: Problem, phase: str, sine_cosine: Callable, torque: float = 0.0) -> Callable:
    """Accelerations of a phase ("free" or "locked") as a function of angles and rates."""
    c, slope = [float(value) for value in p.c], (math.sin(p.slope), math.cos(p.slope))
    common = c[K.FOOT_RADIUS : K.STANCE_INERTIA + 1]
    if phase == "free":
        own = [*c[K.THIGH_ALONG : K.THIGH_INERTIA + 1], c[K.SHANK_ALONG], c[K.SHANK_ACROSS]]
        own += c[K.SHANK_MOBILITY : K.KNEE_SINE + 1]
        function = plain(kneed.accelerations, sine_cosine)
    elif p.kind == Kind.SIMPLEST:
        common, own, function = [], [], plain(simplest.accelerations, sine_cosine)
    else:
        own = c[K.SWING_ALONG : K.SWING_INERTIA + 1]
        function = plain(compass.accelerations, sine_cosine)
    return lambda *state: function(*state, *common, *own, *slope, torque)


def strikes(p: Problem, sine_cosine: Callable | None = None) -> tuple[Callable, Callable]:
    """The collisions: what kneestrike makes of a free state, heelstrike of a locked one.

    Args:
        p: The problem.
        sine_cosine: As for `motion`; None compiles them, for arrays of states.

    Returns:
        Functions of a free state [stance, thigh, shank, and their rates] and of a locked one
        [stance, swing, and their rates]: the locked state, and the next section state. Compiled
        ones take and give arrays with a state in each column.
    """
    heels = {Kind.KNEED: kneed, Kind.COMPASS: compass, Kind.SIMPLEST: simplest}
    knee, heel, c, kind = kneed.kneestrike, heels[p.kind].heelstrike, p.c, int(p.kind)
    if sine_cosine is not None:
        knee, heel = plain(knee, sine_cosine), plain(heel, sine_cosine)

    def kneestrike(state):  # type: ignore[no-untyped-def]
        rate, swing_rate, _ = knee(c, state[0], state[1], state[3], state[4], state[5])
        return state[0], state[1], rate, swing_rate

    def heelstrike(state):  # type: ignore[no-untyped-def]
        angle = (state[1] - state[0]) / 2
        if kind == 0:
            first, second, third, _ = heel(c, -angle, state[2], state[3])
            return angle, -angle, -angle, first, second, third
        first, second, _ = heel(c, -angle, state[2], state[3])
        return angle, -angle, -angle, first, second, second

    def simplest_heelstrike(state):  # type: ignore[no-untyped-def]
        angle = (state[1] - state[0]) / 2
        first, second, _ = heel(-angle, state[2])
        return angle, -angle, -angle, first, second, second

    heelstrike = simplest_heelstrike if p.kind == Kind.SIMPLEST else heelstrike
    if sine_cosine is not None:
        return kneestrike, heelstrike
    return _over_columns(kneestrike, 4), _over_columns(heelstrike, 6)


def _over_columns(strike: Callable, size: int) -> Callable:
    """Compile a collision for arrays of states."""
    struck = numba.njit(strike)

    @numba.njit
    def strikes(states):  # type: ignore[no-untyped-def]
        new = np.empty((size, states.shape[1]))
        for i in range(states.shape[1]):
            values = struck(states[:, i])
            for k in range(size):
                new[k, i] = values[k]
        return new

    return strikes


def reference(p: Problem) -> tuple[NDArray[np.longdouble], float]:
    """Next section states in 80-bit arithmetic, and an estimate of their own error.

    They are kept in `references/`; delete the file to compute them again (it needs heyoka and a
    machine with 80-bit numbers).
    """
    path = REFERENCES / f"{p.name}.npz"
    if path.exists():
        kept = np.load(path)
        if np.array_equal(kept["starts"], p.starts) and np.array_equal(kept["c"], p.c):
            return kept["high"].astype(np.longdouble) + kept["low"], float(kept["error"])
    from benchmarks.rivals import heyoka_strides

    fine = heyoka_strides(p, 1e-19, np.longdouble)
    other = heyoka_strides(p, 1e-17, np.longdouble)
    estimate = error(other, fine)
    REFERENCES.mkdir(exist_ok=True)
    high = fine.astype(float)
    np.savez(
        path, starts=p.starts, c=p.c, high=high, low=(fine - high).astype(float), error=estimate
    )
    return fine, estimate
