"""The benchmark's strides by other solvers: SciPy, heyoka, diffrax and torchdiffeq.

Each solver has the engine's equations in its usual form: compiled by numba, or as its own symbols
or arrays.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.equations import compiled, coordinates, counts, falls, side, struck
from benchmarks.problem import Problem
from gym_passive_walker.models.equations.hybrid import Phase
from gym_passive_walker.models.equations.numbers import sine_cosine

_LONGEST = 10.0


def scipy_stride(p: Problem, method: str, tolerance: float) -> Callable[[NDArray], NDArray]:
    """A stride map of one state (6,) by `scipy.integrate.solve_ivp`.

    Right-hand sides and collisions are compiled by numba, which is the fastest usual way.
    """
    from scipy.integrate import solve_ivp

    parts = [(phase, *_in_numba(p, phase)) for phase in p.system.phases]

    def stride(start: NDArray) -> NDArray:
        y = np.array(coordinates(p.system.phases[0], start))
        for phase, f, collide in parts:

            def event(_, y, phase=phase):  # type: ignore[no-untyped-def]
                return falls(p, phase, y) if counts(p, phase, y) else 1.0

            event.terminal, event.direction = True, -1.0  # type: ignore[attr-defined]
            found = solve_ivp(
                lambda _, y, f=f: f(y), (0.0, _LONGEST), y, method, events=event,
                rtol=max(tolerance, 2.5e-14), atol=0.1 * tolerance,
            )  # fmt: skip
            assert len(found.y_events[0]) == 1
            y = np.array(collide(found.y_events[0][0]))
        return y

    return stride


def _in_numba(p: Problem, phase: Phase) -> tuple[Callable, Callable]:
    """A phase's right-hand side and collision, compiled by numba."""
    size = 2 * phase.links
    return compiled(partial(side, p, phase), size), compiled(partial(struck, p, phase), size)


def _symbols(phase: Phase) -> list[Any]:
    """Coordinates as heyoka's variables."""
    import heyoka as hy

    sine_cosine.register(hy.expression, lambda x: (hy.sin(x), hy.cos(x)))
    return hy.make_vars(*[f"{kind}{i}" for kind in "qw" for i in range(phase.links)])


def _motion(p: Problem, phase: Phase, torque: float = 0.0) -> tuple[list, Any]:
    """The equations of a phase for heyoka, and the event function at its end."""
    y = _symbols(phase)
    return list(zip(y, side(p, phase, y, torque), strict=True)), falls(p, phase, y)


def _collision(p: Problem, phase: Phase, number: type = float) -> Callable[[NDArray], NDArray]:
    """The impact map of coordinates (m,) or (m, n), compiled by heyoka."""
    import heyoka as hy

    y = _symbols(phase)
    function = hy.cfunc([hy.expression(x) for x in struck(p, phase, y)], y, fp_type=number)
    return lambda state: function(np.ascontiguousarray(state))


def heyoka_integrators(
    p: Problem, tolerance: float, number: type = float, *, torque: float = 0.0
) -> list[Any]:
    """Adaptive Taylor integrators of heyoka, one for each phase."""
    import heyoka as hy

    found = []
    for phase in p.system.phases:
        equations, event = _motion(p, phase, torque)
        ending = hy.t_event(event, direction=hy.event_direction.negative, fp_type=number)
        found.append(
            hy.taylor_adaptive(
                equations, np.zeros(2 * phase.links, number), t_events=[ending],
                tol=number(tolerance), fp_type=number,
                **({"fast_math": True} if number is float else {}),
            )
        )  # fmt: skip
    return found


def heyoka_stride(
    p: Problem, tolerance: float, number: type = float, *, spent: list[float] | None = None
) -> Callable[[NDArray], NDArray]:
    """A stride map of one state (6,) by heyoka.

    Args:
        p: The problem.
        tolerance: Heyoka's tolerance.
        number: Type of its numbers.
        spent: List to which the seconds of each call of the integrator are appended.
    """
    integrators = heyoka_integrators(p, tolerance, number)
    collisions = [_collision(p, phase, number) for phase in p.system.phases]

    def stride(start: NDArray) -> NDArray:
        y = np.array(coordinates(p.system.phases[0], start), dtype=number)
        for phase, ta, collide in zip(p.system.phases, integrators, collisions, strict=True):
            ta.time = number(0.0)
            ta.reset_cooldowns()
            ta.state[:] = y
            while True:
                began = time.perf_counter()
                found = ta.propagate_until(number(_LONGEST))
                if spent is not None:
                    spent.append(time.perf_counter() - began)
                if int(found[0]) != -1:
                    raise RuntimeError("heyoka missed an event")
                if counts(p, phase, ta.state):
                    break
            y = collide(ta.state)
        return y

    return stride


def heyoka_batch(p: Problem, tolerance: float, lanes: int) -> Callable[[NDArray], NDArray]:
    """A stride map of `lanes` states, (lanes, 6), by heyoka's batch mode."""
    import heyoka as hy

    phases, integrators = p.system.phases, []
    for phase in phases:
        equations, event = _motion(p, phase)
        ending = hy.t_event_batch(event, direction=hy.event_direction.negative)
        integrators.append(
            hy.taylor_adaptive_batch(
                equations, np.zeros((2 * phase.links, lanes)), tol=tolerance, fast_math=True,
                t_events=[ending],
            )
        )  # fmt: skip
    collisions = [_collision(p, phase) for phase in phases]

    def stride(starts: NDArray) -> NDArray:
        y = np.array(coordinates(phases[0], starts.T))
        for phase, ta, collide in zip(phases, integrators, collisions, strict=True):
            ta.set_time(np.zeros(lanes))
            ta.state[:] = y
            ta.reset_cooldowns()
            until = np.full(lanes, _LONGEST)
            running = np.ones(lanes, bool)
            while running.any():
                ta.propagate_until(until)
                stopped = np.array([int(r[0]) == -1 for r in ta.propagate_res])
                stopped &= counts(p, phase, ta.state)
                running &= ~stopped
                until[stopped] = ta.time[stopped]
            y = collide(ta.state)
        return y.T

    return stride


def heyoka_swings(p: Problem, end: float, lanes: int = 8) -> Callable[[NDArray, float], NDArray]:
    """A function that integrates initial states (n, 6) to `end` with the knee free, at a tolerance.

    It uses heyoka's batch mode without events.
    """
    import heyoka as hy

    equations, _ = _motion(p, p.system.phases[0])
    known: dict[float, Any] = {}

    def ends(starts: NDArray, tolerance: float) -> NDArray:
        if tolerance not in known:
            known[tolerance] = hy.taylor_adaptive_batch(
                equations, np.zeros((6, lanes)), tol=tolerance, fast_math=True
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
    """A stride map of states (n, 6) by diffrax, vectorized and compiled by JAX."""
    stride = diffrax_stride(p, method, tolerance)
    import jax

    strides = jax.jit(jax.vmap(stride))
    return lambda starts: np.asarray(strides(starts))


def diffrax_stride(p: Problem, method: str, tolerance: float, **options: Any) -> Callable:
    """A stride map of one state (6,) as a JAX function; `options` are those of `diffeqsolve`."""
    one_core = "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"
    os.environ.setdefault("XLA_FLAGS", one_core)
    import diffrax
    import jax
    import jax.numpy as jnp
    import optimistix

    jax.config.update("jax_enable_x64", True)
    for kind in (jax.Array, jax.core.Tracer):
        sine_cosine.register(kind, lambda x: (jnp.sin(x), jnp.cos(x)))
    control = diffrax.PIDController(rtol=tolerance, atol=0.1 * tolerance)
    finder = optimistix.Newton(rtol=tolerance, atol=0.1 * tolerance)

    def follow(phase: Phase, state: Any) -> Any:
        def rates(_, y, __):  # type: ignore[no-untyped-def]
            return jnp.stack(side(p, phase, y))

        def event(t, y, args, **_):  # type: ignore[no-untyped-def]  # diffrax names them
            return jnp.where(counts(p, phase, y), falls(p, phase, y), 1.0)

        found = diffrax.diffeqsolve(
            diffrax.ODETerm(rates), getattr(diffrax, method)(), 0.0, _LONGEST, None, state,
            stepsize_controller=control, event=diffrax.Event(event, finder, direction=False),
            throw=False, **options,
        )  # fmt: skip
        assert found.ys is not None
        return found.ys[-1]

    def stride(start: Any) -> Any:
        y = jnp.stack(coordinates(p.system.phases[0], start))
        for phase in p.system.phases:
            y = jnp.stack(struck(p, phase, follow(phase, y)))
        return y

    return stride


def torchdiffeq_stride(p: Problem, method: str, tolerance: float) -> Callable:
    """A stride map of one state (6,) as a torch function, by torchdiffeq's `odeint_event`."""
    import torch
    from torchdiffeq import odeint, odeint_event

    sine_cosine.register(torch.Tensor, lambda x: (torch.sin(x), torch.cos(x)))
    begin = torch.tensor(0.0, dtype=torch.float64)

    def stride(start: Any) -> Any:
        y = torch.stack(coordinates(p.system.phases[0], start))
        for phase in p.system.phases:

            def event(_, y, phase=phase):  # type: ignore[no-untyped-def]
                return falls(p, phase, y) if counts(p, phase, y) else torch.ones((), dtype=y.dtype)

            _, found = odeint_event(
                lambda _, y, phase=phase: torch.stack(side(p, phase, y)), y, begin,
                event_fn=event, odeint_interface=odeint, method=method,
                rtol=tolerance, atol=0.1 * tolerance,
            )  # fmt: skip
            y = torch.stack(list(struck(p, phase, found[-1])))
        return y

    return stride
