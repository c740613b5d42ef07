"""The engine's equations in the form that other solvers require, so that all solve one problem.

The motion of a phase is y' = f(y): y are the independent angles and their angular velocities.
Numbers may be of any type for which `sine_cosine` is registered.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import reduce
from itertools import count
from operator import and_
from typing import Any

import numba

from benchmarks.problem import Problem
from gym_passive_walker.models.equations.hybrid import Control, Guard, Number, Phase, State, Watch
from gym_passive_walker.models.expressions import Expression, read


def state_of(phase: Phase, y: Sequence[Number]) -> State:
    """The state from the coordinates of a phase; a straight leg's shank moves with its thigh."""
    links = [min(i, phase.links - 1) for i in range(3)]
    return State(*(y[i] for i in links), *(y[phase.links + i] for i in links))


def coordinates(phase: Phase, state: Sequence[Number]) -> list[Number]:
    """The coordinates of a state in a phase."""
    return [*state[: phase.links], *state[3 : 3 + phase.links]]


def side(p: Problem, phase: Phase, y: Sequence[Number], torque: float = 0.0) -> list[Number]:
    """The right-hand side f(y)."""
    control, state = Control(torque), state_of(phase, y)
    return [*y[phase.links :], *phase.accelerations(p.body, state, control, p.ground)]


def strike(phase: Phase) -> Guard:
    """The guard of the impact that ends a phase."""
    return next(guard for guard in phase.guards if guard.watch == Watch.STRIKE)


def falls(p: Problem, phase: Phase, y: Sequence[Number]) -> Number:
    """The event function, which falls through zero at the impact."""
    return strike(phase).falls(p.body, state_of(phase, y), p.ground)


def counts(p: Problem, phase: Phase, y: Sequence[Number]) -> Any:
    """Whether a zero of the event function is the impact."""
    positive = [where(p.body, state_of(phase, y), p.ground) > 0.0 for where in strike(phase).where]
    return reduce(and_, positive) if positive else True


def struck(p: Problem, phase: Phase, y: Sequence[Number]) -> list[Number]:
    """Coordinates of the next phase after the impact, or the next state on the Poincaré section."""
    reset = phase.resets[strike(phase).outcome]
    after, *_ = reset.strike(p.body, state_of(phase, y), 0.0, p.ground)
    return list(after) if reset.into is None else coordinates(p.system.phases[reset.into], after)


def compiled(function: Callable[[Sequence[Number]], Sequence[Number]], size: int) -> Callable:
    """Compile a function of `size` coordinates by numba; it takes a tuple or an array of them."""
    names: dict[Expression, str] = {}
    lines, numbers = ["def straight(y):"], count()

    def name(x: Expression) -> str:
        if x not in names:
            operands = x.args[:1] if x.op in ("sin", "cos") else x.args
            written = [name(a) if isinstance(a, Expression) else repr(a) for a in operands]
            code = _PYTHON[x.op].format(*written)
            names[x] = f"x{next(numbers)}"
            lines.append(f"    {names[x]} = {code}")
        return names[x]

    known: dict = {}
    results = function([read(known, i) for i in range(size)])
    lines.append(f"    return {', '.join(map(name, results))}")
    scope: dict[str, Any] = {}
    exec("\n".join(["from math import cos, sin", *lines]), scope)
    return numba.njit(error_model="numpy")(scope["straight"])


_PYTHON = {
    "read": "y[{}]", "constant": "{}", "neg": "-{}", "sin": "sin({})", "cos": "cos({})",
    "add": "{} + {}", "sub": "{} - {}", "mul": "{} * {}", "div": "{} / {}",
}  # fmt: skip
"""Python code of each operation of an expression."""
