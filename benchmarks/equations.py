"""The engine's own equations for its rivals, so that all solve the same problem to the digit.

Here alone it is known how the engine's kernels are written: which constants an equation takes, in
which order, and how compiled code is read as plain Python over a rival's own numbers.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from types import FunctionType, ModuleType, SimpleNamespace
from typing import Any

import numba
import numpy as np
from gym_passive_walker.physics.constants import Kind
from gym_passive_walker.physics.lanes import inlined
from numba.core.dispatcher import Dispatcher

from benchmarks.problem import Problem
from gym_passive_walker.physics import compass, kneed, simplest
from gym_passive_walker.physics import constants as K

_PHYSICS = "gym_passive_walker.physics"


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


def compiled_sides(p: Problem) -> dict[str, Callable]:
    """Right-hand sides y' = f(t, y) of each phase, compiled by numba, for a state in an array."""
    c, sin, cos = p.c, math.sin(p.slope), math.cos(p.slope)

    @numba.njit(error_model="numpy")
    def free(_, y):  # type: ignore[no-untyped-def]
        a = kneed.accelerations(
            y[0], y[1], y[2], y[3], y[4], y[5], c[K.FOOT_RADIUS], c[K.LEG], c[K.STANCE_ALONG],
            c[K.STANCE_ACROSS], c[K.STANCE_INERTIA], c[K.THIGH_ALONG], c[K.THIGH_ACROSS],
            c[K.THIGH_INERTIA], c[K.SHANK_ALONG], c[K.SHANK_ACROSS], c[K.SHANK_MOBILITY],
            c[K.KNEE_COSINE], c[K.KNEE_SINE], sin, cos, 0.0,
        )  # fmt: skip
        return np.array([y[3], y[4], y[5], a[0], a[1], a[2]])

    @numba.njit(error_model="numpy")
    def straight(_, y):  # type: ignore[no-untyped-def]
        a = compass.accelerations(
            y[0], y[1], y[2], y[3], c[K.FOOT_RADIUS], c[K.LEG], c[K.STANCE_ALONG],
            c[K.STANCE_ACROSS], c[K.STANCE_INERTIA], c[K.SWING_ALONG], c[K.SWING_ACROSS],
            c[K.SWING_INERTIA], sin, cos, 0.0,
        )  # fmt: skip
        return np.array([y[2], y[3], a[0], a[1]])

    @numba.njit(error_model="numpy")
    def light(_, y):  # type: ignore[no-untyped-def]
        a = simplest.accelerations(y[0], y[1], y[2], y[3], sin, cos, 0.0)
        return np.array([y[2], y[3], a[0], a[1]])

    return {"free": free, "locked": light if p.kind == Kind.SIMPLEST else straight}


def lane_accelerations(p: Problem) -> Callable:
    """Accelerations with the knee free, to be inlined into a loop over lanes."""
    c = p.c
    constants = (
        *c[K.FOOT_RADIUS : K.STANCE_INERTIA + 1], *c[K.THIGH_ALONG : K.THIGH_INERTIA + 1],
        c[K.SHANK_ALONG], c[K.SHANK_ACROSS], *c[K.SHANK_MOBILITY : K.KNEE_SINE + 1],
        np.sin(p.slope), np.cos(p.slope), 0.0,
    )  # fmt: skip
    (r, leg, sa, sc, si, ta, tc, ti, ha, hc, hm, kc, ks, sin, cos, torque) = map(float, constants)

    @inlined
    def accelerations(q0, q1, q2, w0, w1, w2):  # type: ignore[no-untyped-def]
        return kneed.accelerations(
            q0, q1, q2, w0, w1, w2, r, leg, sa, sc, si, ta, tc, ti, ha, hc, hm, kc, ks,
            sin, cos, torque,
        )  # fmt: skip

    return accelerations
