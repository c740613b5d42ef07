"""The integration of walkers as one differentiable operation of torch.

The engine computes the Jacobian of each walker together with the values. A backward pass or a
forward-mode derivative is then one batched product. All quantities are dimensionless, float64, and
on the CPU.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from gym_passive_walker.gaits.actuation import Actuation, check_actuation
from gym_passive_walker.gaits.flow import MIRRORED, MOTORS, ROWS, Walkers, go_on, new_records
from gym_passive_walker.physics.hybrid import Outcome, State
from gym_passive_walker.walkers import PARAMETERS, Walker, WalkerError

HELD = (
    "slope", "hip_torque", "ankle_torque", "push_off", "height_change", "slope_change", "push",
    "start", "end",
)  # fmt: skip
"""Inputs besides the state: slope, actuation, next foothold, initial impulse on the hip, stance
angle at the beginning of the stride, and time limit."""

INPUTS = (*State._fields, *HELD)
"""Columns of the operation's input; the differentiated parameters of the walker follow."""

RESULTS = (*ROWS, *MOTORS, "distance")
"""Columns of the result: `gaits.flow.ROWS`, `gaits.flow.MOTORS`, and the distance of the hip."""

_SIZE = len(State._fields)
_INFINITESIMAL = 1e-100  # complex step: its square underflows to zero
_RUNNING, _STRUCK, _STALLED, _DIVERGED = map(
    int, (Outcome.RUNNING, Outcome.HEELSTRIKE, Outcome.STALLED, Outcome.DIVERGED)
)


@dataclass(frozen=True)
class Manner:
    """Options of the operation.

    Attributes:
        walker: The walker.
        parameters: Names of the walker's parameters that are inputs.
        by: Inputs to differentiate with respect to, besides the state: names of HELD or parameters.
        using: Names of HELD that are used; the equations include their terms.
        tolerance: Tolerance of the integration.
        end_on_toe_stub: Whether a stubbed toe ends a stride.
        whole: Whether a whole stride is integrated from the Poincaré section; it is STALLED if the
            time ends before it does.
    """

    walker: Walker
    parameters: tuple[str, ...]
    by: tuple[str, ...]
    using: tuple[str, ...]
    tolerance: float
    end_on_toe_stub: bool
    whole: bool = False


class Moved(NamedTuple):
    """Results for n walkers, dimensionless; only the values have a gradient.

    Attributes:
        values: Results in the order of RESULTS, (n, results).
        jacobians: Derivatives of the values with respect to the inputs, (n, results, inputs).
        phases: Index of the phase in which each walker is, (n,).
        outcomes: An `Outcome` as a number, (n,); RUNNING where the time limit was reached.
        margins: Rates with which the events of impacts cross zero, (n,); see
            `gaits.flow.Flow.margins`.
    """

    values: Tensor
    jacobians: Tensor
    phases: Tensor
    outcomes: Tensor
    margins: Tensor

    def result(self, name: str) -> Tensor:
        """Return one of RESULTS, (n,)."""
        return self.values[:, RESULTS.index(name)]

    @property
    def walks(self) -> Tensor:
        """Whether each walker has not fallen, (n,)."""
        return self.outcomes <= _STRUCK

    @property
    def states(self) -> Tensor:
        """Final states, (n, 6)."""
        return self.values[:, :_SIZE]


def carry_on(inputs: Tensor, phases: Tensor, going: Tensor, manner: Manner) -> Moved:
    """Integrate each walker to its end time, its heelstrike or its fall.

    Args:
        inputs: Inputs in the order of INPUTS, then parameters, (n, inputs).
        phases: Index of the phase in which each walker is, (n,).
        going: Whether each walker is integrated, (n,) booleans; the other states do not change.
        manner: Options.

    Raises:
        ValueError: if the walker's feet do not permit an actuation.
        WalkerError: if the parameters describe no walker.
    """
    return Moved(*_CarryOn.apply(inputs, phases, going, manner))  # type: ignore[misc]


class _CarryOn(torch.autograd.Function):
    """Autograd function of `carry_on`."""

    @staticmethod
    def forward(inputs: Tensor, phases: Tensor, going: Tensor, manner: Manner) -> Any:
        told = _walked(inputs.numpy(force=True), phases.numpy(), going.numpy(), manner)
        return tuple(map(torch.from_numpy, told))

    @staticmethod
    def setup_context(ctx: Any, inputs: Any, output: Any) -> None:
        ctx.mark_non_differentiable(*output[1:])
        ctx.save_for_backward(inputs[0], output[1])
        ctx.save_for_forward(inputs[0], output[1])

    @staticmethod
    def backward(ctx: Any, gradient: Tensor, *_: Any) -> Any:  # type: ignore[override]
        inputs, jacobians = ctx.saved_tensors
        return _Product.apply(jacobians.mT, gradient, inputs), None, None, None

    @staticmethod
    def jvp(ctx: Any, tangent: Tensor, *_: Any) -> Any:  # type: ignore[override]
        inputs, jacobians = ctx.saved_tensors
        return _Product.apply(jacobians, tangent, inputs), None, None, None, None

    @staticmethod
    def vmap(info: Any, in_dims: Any, *given: Any) -> Any:
        *tensors, manner = given
        batch, several = info.batch_size, []
        for tensor, dim in zip(tensors, in_dims[:-1], strict=True):
            rows = tensor.expand(batch, *tensor.shape) if dim is None else tensor.movedim(dim, 0)
            several.append(rows)
        count = several[0].shape[1]
        moved = _CarryOn.apply(*(rows.flatten(0, 1) for rows in several), manner)
        return tuple(x.unflatten(0, (batch, count)) for x in moved), (0,) * len(moved)  # type: ignore[union-attr]


class _Product(torch.autograd.Function):
    """Jacobians (n, a, b) times vectors (n, b); second derivatives raise NotImplementedError."""

    generate_vmap_rule = True

    @staticmethod
    def forward(jacobians: Tensor, vectors: Tensor, inputs: Tensor) -> Tensor:
        return (jacobians @ vectors[..., None])[..., 0]

    @staticmethod
    def setup_context(ctx: Any, inputs: Any, output: Any) -> None:
        ctx.save_for_backward(inputs[0])
        ctx.save_for_forward(inputs[0])

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> Any:  # type: ignore[override]
        if ctx.needs_input_grad[2]:
            raise NotImplementedError(_SECOND)
        (jacobians,) = ctx.saved_tensors
        return None, (jacobians.mT @ gradient[..., None])[..., 0], None

    @staticmethod
    def jvp(ctx: Any, _: Any, tangent: Tensor, of_inputs: Any) -> Any:  # type: ignore[override]
        if of_inputs is not None:
            raise NotImplementedError(_SECOND)
        (jacobians,) = ctx.saved_tensors
        return (jacobians @ tangent[..., None])[..., 0]


_SECOND = (
    "walkers have first derivatives only: differentiate the gradient by differences, or use a "
    "method that does without second derivatives (create_graph=True is not needed for those)"
)


def _walked(
    inputs: NDArray, phases: NDArray, going: NDArray, manner: Manner
) -> tuple[NDArray, NDArray, NDArray, NDArray, NDArray]:
    """Compute the fields of `Moved` as arrays."""
    walker, count = manner.walker, len(inputs)
    values = np.zeros((count, len(RESULTS)))
    values[:, :_SIZE] = inputs[:, :_SIZE]
    jacobians = np.zeros((*values.shape, inputs.shape[1]))
    after, margins = phases.copy(), np.full(count, np.inf)
    outcomes = np.zeros(count, np.int64)
    lanes = np.flatnonzero(going & np.isfinite(inputs).all(axis=1))
    outcomes[going], margins[going] = _DIVERGED, np.nan
    if len(lanes) == 0:
        return values, jacobians, after, outcomes, margins
    own = inputs[lanes]
    _check(walker, manner.parameters, own[:, len(INPUTS) :])
    motors = Actuation(*own[:, _SIZE + 1 : _SIZE + 4].T)
    check_actuation(walker, motors)
    states, held = own[:, :_SIZE].copy(), dict(zip(HELD, own[:, _SIZE:].T, strict=False))
    if not walker.knees:
        states[:, 2], states[:, 5] = states[:, 1], states[:, 4]
    parameters = dict(zip(manner.parameters, own[:, len(INPUTS) :].T, strict=True))
    walkers = Walkers(
        walker=walker, parameters=parameters, tolerance=manner.tolerance,
        end_on_toe_stub=manner.end_on_toe_stub,
        using=tuple(name for name in manner.using if name not in ("push", "start")),
    )  # fmt: skip
    pushed = "push" in manner.using
    if pushed:
        states, by_push = _pushed(walkers, states, phases[lanes], held["push"], manner.parameters)
    records = new_records(
        states, held["slope"], np.stack(motors[:2], axis=1),
        push_off=held["push_off"], height_change=held["height_change"],
        slope_change=held["slope_change"], end=held["end"],
    )  # fmt: skip
    records["phase"][:, 0] = phases[lanes]
    if "start" in manner.using:
        records["start"][:, 0] = held["start"][:, None] * MIRRORED
    by = [name for name in manner.by if name != "push"]
    walked = go_on(walkers, records, ("state", *by), on_section=manner.whole)
    told = np.concatenate([walked.told((*ROWS, *MOTORS)), walked.distance[:, None]], axis=1)
    names = (*INPUTS, *manner.parameters)
    columns = [*range(_SIZE), *map(names.index, by)]
    values[lanes] = told[:, :, 0]
    own_jacobians = np.zeros((len(lanes), len(RESULTS), inputs.shape[1]))
    own_jacobians[:, :, columns] = told[:, :, 1:]
    if pushed:
        moved = [*range(_SIZE), INPUTS.index("push"), *range(len(INPUTS), inputs.shape[1])]
        own_jacobians[:, :, range(_SIZE)] = 0.0
        own_jacobians[:, :, moved] += told[:, :, 1 : 1 + _SIZE] @ by_push
    jacobians[lanes] = own_jacobians
    after[lanes], outcomes[lanes] = walked["phase"][:, 0], walked.outcomes
    margins[lanes] = walked.margins
    if manner.whole:
        stalled = going & (outcomes == _RUNNING)
        outcomes[stalled], margins[stalled], jacobians[stalled] = _STALLED, np.nan, 0.0
    return values, jacobians, after, outcomes, margins


def _pushed(
    walkers: Walkers, states: NDArray, phases: NDArray, pushes: NDArray, names: tuple[str, ...]
) -> tuple[NDArray, NDArray]:
    """Apply impulses (n,) on the hip along the slope to states (n, 6), with derivatives.

    Returns:
        The states after the impulses, (n, 6); and their derivatives with respect to the states
        before, the impulse and the named parameters, (n, 6, 7 + names).
    """
    bodies, (count, width) = walkers.bodies(names), (len(states), _SIZE + 1 + len(names))
    given = np.zeros((count, width, _SIZE + 1), complex)
    given[:] = np.concatenate([states, pushes[:, None]], axis=1)[:, None]
    given[:, : _SIZE + 1] += 1j * _INFINITESIMAL * np.eye(_SIZE + 1)
    constants = np.zeros((count, width, bodies.shape[2]), complex)
    constants[:] = bodies[:, :1]
    if bodies.shape[1] > 1:
        constants[:, _SIZE + 1 :] += 1j * _INFINITESIMAL * bodies[:, 1:]
    system, after = walkers.system(), given[..., :_SIZE].copy()
    for number, phase in enumerate(system.phases):
        here = phases == number
        if phase.push is None or not here.any():
            continue
        *state, push = np.moveaxis(given[here], -1, 0)
        body = system.Body(*np.moveaxis(constants[here], -1, 0))
        stance, thigh, *shank = phase.push(body, State(*state), -push, 0.0)
        after[here, :, 3:] += np.stack([stance, thigh, *(shank or [thigh])], axis=-1)
    return np.real(after[:, 0]).copy(), np.imag(after).swapaxes(1, 2) / _INFINITESIMAL


def _check(walker: Walker, names: tuple[str, ...], values: NDArray) -> None:
    if names:
        for row in set(map(tuple, values.tolist())):
            _walker_with(walker, names, row)


@lru_cache(maxsize=4096)
def _walker_with(walker: Walker, names: tuple[str, ...], values: tuple[float, ...]) -> Walker:
    return replace(walker, **dict(zip(names, values, strict=True)))


def as_tensor(value: Any, name: str) -> Tensor:
    """Return a number, an array or a tensor as a float64 tensor on the CPU.

    Raises:
        TypeError: if it is a tensor of another dtype than float64, or on another device.
    """
    if not isinstance(value, Tensor):
        return torch.from_numpy(np.array(value, dtype=float))
    if value.dtype != torch.float64:
        raise TypeError(
            f"walkers walk in float64, and {name} is {value.dtype}: give {name}.double(), and let "
            "policies compute in float64 (policy.double())"
        )
    if value.device.type != "cpu":
        raise TypeError(f"walkers walk on the processor, and {name} is on {value.device}: move it")
    return value


def check_parameters(parameters: Mapping[str, Any] | None) -> dict[str, Tensor]:
    """Return parameters as tensors, by name.

    Raises:
        WalkerError: if a walker has no such parameter.
    """
    given = dict(parameters or {})
    unknown = sorted(set(given) - set(PARAMETERS))
    if unknown:
        raise WalkerError(
            f"a walker has no parameter {', '.join(unknown)}: choose from {', '.join(PARAMETERS)}"
        )
    return {name: as_tensor(value, name) for name, value in given.items()}
