"""What a user would pick instead: SciPy, heyoka, diffrax, on the same equations and collisions."""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from typing import Any

import numpy as np
from gym_passive_walker.physics.constants import Kind
from numpy.typing import NDArray

from benchmarks.equations import compiled_sides, motion, strikes
from benchmarks.problem import Problem

_LONGEST = 10.0


def _phases(p: Problem) -> list[str]:
    return ["free", "locked"] if p.kind == Kind.KNEED else ["locked"]


def scipy_stride(p: Problem, method: str, tolerance: float) -> Callable[[NDArray], NDArray]:
    """A function from a section state to the next by `scipy.integrate.solve_ivp`.

    The right-hand sides are compiled by numba, as a careful user would have them.
    """
    from scipy.integrate import solve_ivp

    def kneestrike_event(_, y):  # type: ignore[no-untyped-def]
        return y[1] - y[2]

    def heelstrike_event(_, y):  # type: ignore[no-untyped-def]
        return y[0] + y[1] if y[0] < 0.0 else 1.0

    for event in (kneestrike_event, heelstrike_event):
        event.terminal, event.direction = True, -1.0  # type: ignore[attr-defined]
    sides = compiled_sides(p)
    events = {"free": kneestrike_event, "locked": heelstrike_event}
    knee, heel = strikes(p, lambda x: (math.sin(x), math.cos(x)))

    def stride(start: NDArray) -> NDArray:
        state = start
        if p.kind != Kind.KNEED:
            state = start[[0, 1, 3, 4]]
        for phase in _phases(p):
            found = solve_ivp(
                sides[phase], (0.0, _LONGEST), state, method, events=events[phase],
                rtol=max(tolerance, 2.5e-14), atol=0.1 * tolerance,
            )  # fmt: skip
            state = found.y_events[0][0]
            state = np.array(knee(state) if phase == "free" else heel(state))
            assert len(found.y_events[0]) == 1
        return state

    return stride


def _system(p: Problem, phase: str, torque: float = 0.0) -> tuple[list, Any]:
    """The equations of a phase for heyoka, and its event function."""
    import heyoka as hy

    accelerations = motion(p, phase, lambda x: (hy.sin(x), hy.cos(x)), torque)
    links = 3 if phase == "free" else 2
    variables = hy.make_vars(*[f"q{i}" for i in range(links)], *[f"w{i}" for i in range(links)])
    q, w = variables[:links], variables[links:]
    rates = [(q[i], w[i]) for i in range(links)]
    forces = list(zip(w, accelerations(*q, *w), strict=True))
    return rates + forces, (q[1] - q[2] if phase == "free" else q[0] + q[1])


def heyoka_integrators(
    p: Problem, tolerance: float, number: type = float, *, torque: float = 0.0
) -> list[Any]:
    """Adaptive Taylor integrators of heyoka, one a phase."""
    import heyoka as hy

    found = []
    for phase in _phases(p):
        equations, event = _system(p, phase, torque)
        ending = hy.t_event(event, direction=hy.event_direction.negative, fp_type=number)
        size = 2 * (3 if phase == "free" else 2)
        found.append(
            hy.taylor_adaptive(
                equations, np.zeros(size, number), t_events=[ending], tol=number(tolerance),
                fp_type=number, **({"fast_math": True} if number is float else {}),
            )
        )  # fmt: skip
    return found


def heyoka_stride(
    p: Problem, tolerance: float, number: type = float
) -> Callable[[NDArray], NDArray]:
    """A function from a section state to the next by heyoka, one walker at a time."""
    integrators = heyoka_integrators(p, tolerance, number)
    sine, cosine = (math.sin, math.cos) if number is float else (np.sin, np.cos)
    knee, heel = strikes(p, lambda x: (sine(x), cosine(x)))

    def stride(start: NDArray) -> NDArray:
        state = start.astype(number)
        if p.kind != Kind.KNEED:
            state = state[[0, 1, 3, 4]]
        for phase, ta in zip(_phases(p), integrators, strict=True):
            ta.time = number(0.0)
            ta.reset_cooldowns()
            ta.state[:] = state
            while True:
                outcome = ta.propagate_until(number(_LONGEST))[0]
                if int(outcome) != -1:
                    raise RuntimeError("heyoka missed an event")
                if phase == "free" or ta.state[0] < 0.0:
                    break
            state = np.array((knee if phase == "free" else heel)(ta.state), dtype=number)
        return state

    return stride


def heyoka_batch(
    p: Problem, tolerance: float, lanes: int, *, events: bool = True
) -> Callable[[NDArray], NDArray]:
    """A function from `lanes` section states to the next by heyoka's batch mode.

    Without `events` it integrates each phase for as long as that phase of the gait takes: the floor
    of what heyoka could do if events cost nothing. The states it returns are then not on events.
    """
    import heyoka as hy

    integrators = []
    for phase in _phases(p):
        equations, event = _system(p, phase)
        ending = hy.t_event_batch(event, direction=hy.event_direction.negative)
        size = 2 * (3 if phase == "free" else 2)
        integrators.append(
            hy.taylor_adaptive_batch(
                equations, np.zeros((size, lanes)), tol=tolerance, fast_math=True,
                **({"t_events": [ending]} if events else {}),
            )
        )  # fmt: skip
    knee, heel = strikes(p)
    durations: list[NDArray] = []

    def stride(starts: NDArray) -> NDArray:
        state = starts.T if p.kind == Kind.KNEED else starts.T[[0, 1, 3, 4]]
        for i, (phase, ta) in enumerate(zip(_phases(p), integrators, strict=True)):
            ta.set_time(np.zeros(lanes))
            ta.state[:] = state
            if not events:
                ta.propagate_until(durations[i])
            else:
                ta.reset_cooldowns()
                until = np.full(lanes, _LONGEST)
                running = np.ones(lanes, bool)
                while running.any():
                    ta.propagate_until(until)
                    stopped = np.array([int(r[0]) == -1 for r in ta.propagate_res])
                    if phase == "locked":
                        stopped &= ta.state[0] < 0.0
                    running &= ~stopped
                    until[stopped] = ta.time[stopped]
            state = (knee if phase == "free" else heel)(ta.state)
        return state.T

    if not events:
        timed = heyoka_integrators(p, 1e-12)
        state = p.starts[0] if p.kind == Kind.KNEED else p.starts[0][[0, 1, 3, 4]]
        scalar_knee, _ = strikes(p, lambda x: (math.sin(x), math.cos(x)))
        for phase, ta in zip(_phases(p), timed, strict=True):
            ta.state[:] = state
            ta.propagate_until(_LONGEST)
            while phase == "locked" and ta.state[0] >= 0.0:
                ta.propagate_until(_LONGEST)
            durations.append(np.full(lanes, ta.time))
            if phase == "free":
                state = np.array(scalar_knee(ta.state))
    return stride


def heyoka_swings(p: Problem, end: float, lanes: int = 8) -> Callable[[NDArray, float], NDArray]:
    """A function that carries starts through a swing with the knee free, at a tolerance.

    Heyoka's batch mode without events.
    """
    import heyoka as hy

    known: dict[float, Any] = {}

    def ends(starts: NDArray, tolerance: float) -> NDArray:
        if tolerance not in known:
            known[tolerance] = hy.taylor_adaptive_batch(
                _system(p, "free")[0], np.zeros((6, lanes)), tol=tolerance, fast_math=True
            )
        ta, found = known[tolerance], np.empty_like(starts)
        until = np.full(lanes, end)
        for i in range(0, len(starts), lanes):
            ta.set_time(np.zeros(lanes))
            ta.state[:] = starts[i : i + lanes].T
            ta.propagate_until(until)
            found[i : i + lanes] = ta.state.T
        return found

    return ends


def diffrax_batch(p: Problem, method: str, tolerance: float) -> Callable[[NDArray], NDArray]:
    """A function from section states to the next by diffrax, compiled by JAX for all at once."""
    one_core = "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"
    os.environ.setdefault("XLA_FLAGS", one_core)
    import diffrax
    import jax
    import jax.numpy as jnp
    import optimistix

    jax.config.update("jax_enable_x64", True)
    knee, heel = strikes(p, lambda x: (jnp.sin(x), jnp.cos(x)))
    control = diffrax.PIDController(rtol=tolerance, atol=0.1 * tolerance)
    finder = optimistix.Newton(rtol=tolerance, atol=0.1 * tolerance)

    def follow(phase: str, state: Any) -> Any:
        accelerations = motion(p, phase, lambda x: (jnp.sin(x), jnp.cos(x)))
        links = 3 if phase == "free" else 2

        def rates(_, y, __):  # type: ignore[no-untyped-def]
            return jnp.concatenate([y[links:], jnp.stack(accelerations(*y))])

        def event(t, y, args, **_):  # type: ignore[no-untyped-def]  # diffrax names them
            return y[1] - y[2] if phase == "free" else jnp.where(y[0] < 0.0, y[0] + y[1], 1.0)

        found = diffrax.diffeqsolve(
            diffrax.ODETerm(rates), getattr(diffrax, method)(), 0.0, _LONGEST, None, state,
            stepsize_controller=control, event=diffrax.Event(event, finder, direction=False),
            throw=False,
        )  # fmt: skip
        assert found.ys is not None
        return found.ys[-1]

    def stride(state: Any) -> Any:
        if p.kind == Kind.KNEED:
            state = jnp.stack(knee(follow("free", state)))
        else:
            state = state[jnp.array([0, 1, 3, 4])]
        return jnp.stack(heel(follow("locked", state)))

    strides = jax.jit(jax.vmap(stride))
    return lambda starts: np.asarray(strides(starts))
