"""The integration of walkers as one differentiable operation of torch.

The engine computes the Jacobian of each walker together with the values. A backward pass or a
forward-mode derivative is then one batched product. All quantities are dimensionless, float64, and
on the CPU.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from gym_passive_walker._tools.arguments import shown, unknown
from gym_passive_walker.engine.layout import layout_of
from gym_passive_walker.gaits.actuation import Actuation, check_actuation
from gym_passive_walker.gaits.control.ticks import hold
from gym_passive_walker.gaits.flow import Entry, Reported, Walkers, go_on, new_records, report_of
from gym_passive_walker.models.equations.hybrid import Outcome
from gym_passive_walker.models.equations.numbers import complex_step, step_derivative
from gym_passive_walker.models.equations.systems import UNEVEN
from gym_passive_walker.models.model import check_supports
from gym_passive_walker.models.walkers import Walker, WalkerError, describe


class Columns(NamedTuple):
    """Columns of the operation's input and result for a kind of walker.

    Attributes:
        report: The results; the distance follows them.
        controls: Names of inputs that actuators hold; see `Model.inputs`.
        inputs: Places of each input besides the state, by name: the slope, the controls, the next
            foothold, and the initial impulse on the hip. Then the coordinates at the beginning of
            the stride (the stance angle if legs mirror each other), and the time limit. Those of
            the differentiated parameters follow.
    """

    report: Reported
    controls: tuple[str, ...]
    inputs: dict[str, list[int]]

    @property
    def width(self) -> int:
        """Number of inputs without parameters."""
        return self.inputs["end"][0] + 1


@lru_cache
def columns_of(walker: Walker) -> Columns:
    """Return the columns of the operation for a walker."""
    system, controls = walker.equations(), walker.inputs
    size, starts = walker.size, len(walker.chart.starts)
    names = ("slope", *controls, *UNEVEN, "push", *("start",) * starts, "end")
    inputs = {name: [size + i for i, each in enumerate(names) if each == name] for name in names}
    return Columns(report_of(system), controls, inputs)


_RUNNING, _STRUCK, _STALLED, _DIVERGED = map(
    int, (Outcome.RUNNING, Outcome.HEELSTRIKE, Outcome.STALLED, Outcome.DIVERGED)
)


@dataclass(frozen=True)
class FlowOptions:
    """Options of the operation.

    Attributes:
        walker: The walker.
        parameters: Names of the walker's parameters that are inputs.
        by: Inputs to differentiate with respect to, besides the state: names of `Columns.inputs` or
            parameters.
        using: Names of `Columns.inputs` that are used; the equations include their terms.
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


class FlowResult(NamedTuple):
    """Results for n walkers, dimensionless; only the values have a gradient.

    Attributes:
        values: Results in the order of `columns`, (n, results).
        jacobians: Derivatives of the values with respect to the inputs, (n, results, inputs).
        phases: Index of the phase in which each walker is, (n,).
        outcomes: An `Outcome` as a number, (n,); RUNNING where the time limit was reached.
        margins: Rates with which the events of impacts cross zero, (n,); see
            `gaits.flow.Flow.margins`.
        columns: Columns of inputs and results.
    """

    values: Tensor
    jacobians: Tensor
    phases: Tensor
    outcomes: Tensor
    margins: Tensor
    columns: Columns

    def result(self, entry: Entry) -> Tensor:
        """Return one of the results, (n,)."""
        return self.values[:, self.columns.report.at[entry]]

    def moved(self, control: int) -> tuple[Tensor, Tensor]:
        """Return how far a control has moved, net and either way, (n,) each."""
        return self.result(("moved", control)), self.result(("turned", control))

    @property
    def distance(self) -> Tensor:
        """Distance of each hip along the slope, in leg lengths, (n,)."""
        return self.values[:, -1]

    @property
    def walks(self) -> Tensor:
        """Whether each walker has not fallen, (n,)."""
        return self.outcomes <= _STRUCK

    @property
    def states(self) -> Tensor:
        """Final states, (n, 6), or (n, 2 m) of a `System`."""
        return self.values[:, : self.columns.report.size]


def carry_on(inputs: Tensor, phases: Tensor, going: Tensor, options: FlowOptions) -> FlowResult:
    """Integrate each walker to its end time, its heelstrike or its fall.

    Args:
        inputs: Inputs in the order of `columns_of` the walker, then parameters, (n, inputs).
        phases: Index of the phase in which each walker is, (n,).
        going: Whether each walker is integrated, (n,) booleans; the other states do not change.
        options: Options.

    Raises:
        ValueError: if the walker's feet do not permit an actuation, or a stride has no such phase.
        WalkerError: if the parameters describe no walker.
    """
    moved = _CarryOn.apply(inputs, phases, going, options)
    return FlowResult(*moved, columns=columns_of(options.walker))  # type: ignore[misc]


class _CarryOn(torch.autograd.Function):
    """Autograd function of `carry_on`."""

    @staticmethod
    def forward(inputs: Tensor, phases: Tensor, going: Tensor, options: FlowOptions) -> Any:
        reported = _walked(inputs.numpy(force=True), phases.numpy(), going.numpy(), options)
        return tuple(map(torch.from_numpy, reported))

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
        *tensors, options = given
        batch, several = info.batch_size, []
        for tensor, dim in zip(tensors, in_dims[:-1], strict=True):
            rows = tensor.expand(batch, *tensor.shape) if dim is None else tensor.movedim(dim, 0)
            several.append(rows)
        count = several[0].shape[1]
        moved = _CarryOn.apply(*(rows.flatten(0, 1) for rows in several), options)
        return tuple(x.unflatten(0, (batch, count)) for x in moved), (0,) * len(moved)  # type: ignore[union-attr]


class _Product(torch.autograd.Function):
    """Jacobians (n, a, b) times vectors (n, b); second derivatives raise NotImplementedError."""

    generate_vmap_rule = True

    @staticmethod
    def forward(jacobians: Tensor, vectors: Tensor, inputs: Tensor) -> Tensor:
        return (jacobians @ vectors[..., None])[..., 0]

    @staticmethod
    def setup_context(ctx: Any, inputs: Any, output: Any) -> None:
        ctx.set_materialize_grads(False)  # None says that a tangent is zero
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
    inputs: NDArray, phases: NDArray, going: NDArray, options: FlowOptions
) -> tuple[NDArray, NDArray, NDArray, NDArray, NDArray]:
    """Compute the fields of `FlowResult` as arrays."""
    walker, count, columns = options.walker, len(inputs), columns_of(options.walker)
    size, names = columns.report.size, columns.inputs
    values = np.zeros((count, len(columns.report.entries) + 1))
    values[:, :size] = inputs[:, :size]
    jacobians = np.zeros((*values.shape, inputs.shape[1]))
    after, margins = phases.copy(), np.full(count, np.inf)
    outcomes = np.zeros(count, np.int64)
    lanes = np.flatnonzero(going & np.isfinite(inputs).all(axis=1))
    outcomes[going], margins[going] = _DIVERGED, np.nan
    if len(lanes) == 0:
        return values, jacobians, after, outcomes, margins
    check_phases(walker, phases[lanes])
    own = inputs[lanes]
    if options.parameters:
        walker.check_values(options.parameters, own[:, columns.width :])
    held = {name: own[:, places[0]] for name, places in names.items()}
    states, begun = own[:, :size].copy(), own[:, names["start"]]
    parameters = dict(zip(options.parameters, own[:, columns.width :].T, strict=True))
    if "actuation" in walker.supports:
        actuation = Actuation(*(held[name] for name in columns.controls))
        check_actuation(walker, actuation, foot_radii=parameters.get("foot_radius"))
    begun = begun @ walker.chart.starts
    walker.chart.straighten(states)
    walkers = Walkers(
        walker=walker, parameters=parameters, tolerance=options.tolerance,
        end_on_toe_stub=options.end_on_toe_stub,
        using=tuple(name for name in options.using if name not in ("push", "start")),
    )  # fmt: skip
    pushed = "push" in options.using
    if pushed:
        states, by_push = _pushed(walkers, states, phases[lanes], held["push"], options.parameters)
    records = new_records(
        states, held["slope"], end=held["end"], height_change=held["height_change"],
        slope_change=held["slope_change"], layout=layout_of(walkers.system()),
    )  # fmt: skip
    motors = [names[name][0] for name in columns.controls]
    hold(records, range(len(motors)), own[:, motors])
    records["phase"][:, 0] = phases[lanes]
    if "start" in options.using:
        records["start"][:, 0, : begun.shape[1]] = begun
    by = [name for name in options.by if name != "push"]
    walked = go_on(walkers, records, ("state", *by), on_section=options.whole)
    reported = np.concatenate([walked.rows, walked.distance[:, None]], axis=1)
    of_parameters = {name: [columns.width + i] for i, name in enumerate(options.parameters)}
    moving = [*range(size), *(i for name in by for i in (names | of_parameters)[name])]
    values[lanes] = reported[:, :, 0]
    own_jacobians = np.zeros((len(lanes), values.shape[1], inputs.shape[1]))
    own_jacobians[:, :, moving] = reported[:, :, 1:]
    if pushed:
        moved = [*range(size), *names["push"], *range(columns.width, inputs.shape[1])]
        own_jacobians[:, :, range(size)] = 0.0
        own_jacobians[:, :, moved] += reported[:, :, 1 : 1 + size] @ by_push
    jacobians[lanes] = own_jacobians
    after[lanes], outcomes[lanes] = walked.records["phase"][:, 0], walked.outcomes
    margins[lanes] = walked.margins
    if options.whole:
        stalled = going & (outcomes == _RUNNING)
        outcomes[stalled], margins[stalled], jacobians[stalled] = _STALLED, np.nan, 0.0
    return values, jacobians, after, outcomes, margins


def _pushed(
    walkers: Walkers, states: NDArray, phases: NDArray, pushes: NDArray, names: tuple[str, ...]
) -> tuple[NDArray, NDArray]:
    """Apply impulses (n,) along the slope to states (n, 6), with derivatives.

    They act on the hip, or at the centre of mass of a `System`.

    Returns:
        The states after the impulses, (n, 6); and their derivatives with respect to the states
        before, the impulse and the named parameters, (n, 6, 7 + names).
    """
    check_supports(walkers.walker, "pushes")
    bodies, (count, size) = walkers.bodies(names), states.shape
    given = np.zeros((count, size + 1 + len(names), size + 1), complex)
    given[:] = np.concatenate([states, pushes[:, None]], axis=1)[:, None]
    given[:, : size + 1] = complex_step(given[:, : size + 1], np.eye(size + 1))
    constants = np.zeros((*given.shape[:2], bodies.shape[2]), complex)
    constants[:] = bodies[:, :1]
    if bodies.shape[1] > 1:
        constants[:, size + 1 :] = complex_step(bodies[:, :1], bodies[:, 1:])
    system, after, half = walkers.system(), given[..., :size].copy(), size // 2
    for number, phase in enumerate(system.phases):
        here = phases == number
        if not here.any():
            continue
        assert phase.push is not None
        *state, push = np.moveaxis(given[here], -1, 0)
        body = system.Body(*np.moveaxis(constants[here], -1, 0))
        jumps = list(phase.push(body, system.State(*state), -push, 0.0))
        jumps += jumps[-1:] * (half - len(jumps))  # a straight leg's thigh and shank are one body
        after[here, :, half:] += np.stack(jumps, axis=-1)
    return np.real(after[:, 0]).copy(), step_derivative(after).swapaxes(1, 2)


def as_tensor(value: Any, name: str) -> Tensor:
    """Return a number, an array or a tensor as a float64 tensor on the CPU.

    Raises:
        TypeError: if it is a tensor of another dtype than float64, or on another device.
        ValueError: if it is not a number, nor an array of them.
    """
    if not isinstance(value, Tensor):
        try:
            return torch.from_numpy(np.array(value, dtype=float))
        except (TypeError, ValueError):
            raise ValueError(
                f"{name} must be a number, an array or a tensor, not {shown(value)}"
            ) from None
    if value.dtype != torch.float64:
        raise TypeError(
            f"walkers walk in float64, and {name} is {value.dtype}: give {name}.double(), and let "
            "policies compute in float64 (policy.double())"
        )
    if value.device.type != "cpu":
        raise TypeError(f"{name} is on {value.device}: move it to the CPU, as walkers are there")
    return value


def array_of(values: Tensor) -> NDArray:
    """Return the numbers of a tensor."""
    try:
        return values.numpy(force=True)
    except RuntimeError:  # it has no memory within `torch.func.grad` and its like
        kind = str(values.dtype).removeprefix("torch.")
        return np.array(values.tolist(), kind).reshape(values.shape)


def check_phases(walker: Walker, phases: NDArray) -> None:
    """Check that strides of a walker have phases of these indices, (n,).

    Raises:
        ValueError: if they have not.
    """
    last = len(walker.equations().phases) - 1
    if np.any(strange := (phases < 0) | (phases > last)):
        raise ValueError(
            f"phase must be 0{f' to {last}' if last else ''}, as strides of {describe(walker)} "
            f"have no other, not {phases[strange][0]}"
        )


def check_parameters(walker: Walker, parameters: Mapping[str, Any] | None) -> dict[str, Tensor]:
    """Return parameters of a walker as tensors, by name.

    Raises:
        WalkerError: if the walker has no such parameter.
    """
    given = dict(parameters or {})
    known = tuple(walker.parameters)
    if strange := unknown(given, known, "this walker"):
        raise WalkerError(strange)
    return {name: as_tensor(value, name) for name, value in given.items()}
