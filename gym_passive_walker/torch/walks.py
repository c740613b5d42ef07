"""Strides and control steps with exact gradients, in the walkers' own units."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple, TypeVar

import numpy as np
import torch
from torch import Tensor

from gym_passive_walker._tools.arguments import check_tolerance, shown, unknown
from gym_passive_walker.gaits.actuation import Actuation, actuation_units
from gym_passive_walker.gaits.flow import LONGEST_STRIDE
from gym_passive_walker.gaits.measures import RECORDED
from gym_passive_walker.gaits.scenes.rules import work_of
from gym_passive_walker.models.equations.systems import UNEVEN
from gym_passive_walker.models.units import Units
from gym_passive_walker.models.walkers import Walker, WalkerLike, as_walker
from gym_passive_walker.torch.operation import (
    FlowOptions,
    FlowResult,
    as_tensor,
    carry_on,
    check_parameters,
    columns_of,
)


class Stride(NamedTuple):
    """Strides with gradients, in the walker's own units; see `gym_passive_walker.stride`.

    Each field has shape (n,), `state` (n, 6), or (n, 2 m) of a `System`; () and (6,) for a single
    stride. `hip_work` of a `System` is that of all its controls. All gradients of a failed stride
    are zero. Fields of an impact that did not happen are 0, not NaN, so that sums
    stay finite.

    Attributes:
        state: Final state; after a heelstrike, the next state on the Poincaré section.
        duration: Duration of the stride.
        kneestrike_time: Time of kneestrike since the stride began; 0 without kneestrike.
        step_length: Distance from one contact point to the next; 0 without heelstrike.
        hip_work: Net work of the hip torque.
        hip_work_absolute: Integral of the absolute power of the hip torque.
        kneestrike_loss: Energy lost at kneestrike.
        heelstrike_loss: Energy lost at heelstrike.
        gravity_work: Work of gravity; 0 without heelstrike.
        spring_work: Net work of the springs on the walker; 0 without heelstrike.
        friction_loss: Energy lost to friction at the hip.
        ankle_work: Net work of the ankle torque.
        ankle_work_absolute: Integral of the absolute power of the ankle torque.
        push_off_work: Work of the push-off, just before heelstrike.
        outcome: Outcome of the stride, an `Outcome` as a number.
        walks: Whether the stride ended with a heelstrike; only then are gradients nonzero.
        margin: Smallest rate with which the event of an impact crosses zero, in rad over sqrt(l/g).
            0 at grazing, where derivatives are unbounded. NaN after a fall.
    """

    state: Tensor
    duration: Tensor
    kneestrike_time: Tensor
    step_length: Tensor
    hip_work: Tensor
    hip_work_absolute: Tensor
    kneestrike_loss: Tensor
    heelstrike_loss: Tensor
    gravity_work: Tensor
    spring_work: Tensor
    friction_loss: Tensor
    ankle_work: Tensor
    ankle_work_absolute: Tensor
    push_off_work: Tensor
    outcome: Tensor
    walks: Tensor
    margin: Tensor


class Tick(NamedTuple):
    """Control steps with gradients, in the walker's own units.

    Each field has shape (n,), `state` (n, 6), or (n, 2 m) of a `System`; () and (6,) for a single
    walker. `hip_work` of a `System` is that of all its controls.

    Attributes:
        state: Final state; after a heelstrike, the initial state of the next stride.
        phase: Index of the stride's phase; pass it to the next control step.
        duration: Duration; shorter than asked for if a heelstrike or a fall ended it.
        distance: Distance of the hip along the slope.
        hip_work: Net work of the hip torque.
        hip_work_absolute: Integral of the absolute power of the hip torque.
        collision_loss: Energy lost at kneestrike and heelstrike.
        friction_loss: Energy lost to friction at the hip.
        ankle_work: Net work of the ankle torque.
        ankle_work_absolute: Integral of the absolute power of the ankle torque.
        push_off_work: Work of the push-off; 0 without heelstrike.
        outcome: An `Outcome` as a number: RUNNING or HEELSTRIKE unless the walker fell.
        walks: Whether the walker has not fallen; only then are gradients nonzero.
        margin: Rate with which the event of an impact crosses zero, in rad over sqrt(l/g); infinite
            without impacts, NaN after a fall.
    """

    state: Tensor
    phase: Tensor
    duration: Tensor
    distance: Tensor
    hip_work: Tensor
    hip_work_absolute: Tensor
    collision_loss: Tensor
    friction_loss: Tensor
    ankle_work: Tensor
    ankle_work_absolute: Tensor
    push_off_work: Tensor
    outcome: Tensor
    walks: Tensor
    margin: Tensor


def stride(
    walker: WalkerLike,
    slope: Any,
    state: Any,
    *,
    hip_torque: Any = 0.0,
    ankle_torque: Any = 0.0,
    push_off: Any = 0.0,
    height_change: Any = 0.0,
    slope_change: Any = 0.0,
    controls: Mapping[str, Any] | None = None,
    parameters: Mapping[str, Any] | None = None,
    tolerance: float = 1e-10,
    max_stride_time: float = LONGEST_STRIDE,
    end_on_toe_stub: bool = False,
) -> Stride:
    """Apply the stride map, with gradients with respect to all arguments that are tensors.

    Dimensional arguments are in the walker's own units, as in `gym_passive_walker.stride`.

    Args:
        walker: The walker, in a form that `as_walker` takes, or a `System`.
        slope: Slope in rad, positive downhill; a number or (n,).
        state: State just after heelstrike, (6,) or (n, 6); of a `System` (2 m,) or (n, 2 m).
        hip_torque: Torque held through the stride, positive when it opens the legs in the walking
            direction; a number or (n,). Per unit of foot mass for the simplest walker.
        ankle_torque: Torque between ground and stance leg, held through the stride; a number or
            (n,). Requires point feet.
        push_off: Impulse along the stance leg just before heelstrike; a number or (n,).
        height_change: Height of the next foothold over this one, along this one's normal; a number
            or (n,).
        slope_change: Slope of the next foothold less that of this one, in rad; a number or (n,).
        controls: Values of a `System`'s controls by name, held as the torques are; numbers or
            (n,). Those that are not named are 0.
        parameters: Values by name of walker parameters, or of fields of a `System`'s body, which
            replace the walker's; numbers or (n,).
        tolerance: Error relative to the largest angle or (dimensionless) angular velocity.
        max_stride_time: Time in units of sqrt(l/g) after which a stride has STALLED.
        end_on_toe_stub: Whether a kneed walker's locked swing leg below the ground ends the stride.

    Raises:
        TypeError: if a tensor is not float64 or not on the CPU.
        ValueError: if shapes do not match, or the walker's feet do not permit an actuation.
        WalkerError: if the parameters describe no walker.
    """
    return _walk(
        Stride, walker, slope, state, Actuation(hip_torque, ankle_torque, push_off),
        (height_change, slope_change, 0.0), controls, parameters,
        end=max_stride_time, tolerance=tolerance, end_on_toe_stub=end_on_toe_stub, whole=True,
    )  # fmt: skip


def tick(
    walker: WalkerLike,
    slope: Any,
    state: Any,
    hip_torque: Any = 0.0,
    *,
    duration: Any,
    phase: Any = 0,
    ankle_torque: Any = 0.0,
    push_off: Any = 0.0,
    height_change: Any = 0.0,
    slope_change: Any = 0.0,
    push: Any = 0.0,
    controls: Mapping[str, Any] | None = None,
    parameters: Mapping[str, Any] | None = None,
    tolerance: float = 1e-10,
    end_on_toe_stub: bool = False,
) -> Tick:
    """Integrate walkers for a duration or to heelstrike, with gradients.

    Gradients are with respect to all arguments that are tensors. Dimensional arguments are in the
    walker's own units.

    Args:
        walker: The walker, in a form that `as_walker` takes, or a `System`.
        slope: Slope in rad, positive downhill; a number or (n,).
        state: Initial state, (6,) or (n, 6); of a `System` (2 m,) or (n, 2 m).
        hip_torque: Torque held through the control step, positive when it opens the legs in the
            walking direction; a number or (n,).
        duration: Duration of the control step, a number or (n,).
        phase: Index of the stride's phase, a number or (n,): 0 at the beginning of a stride, else
            the `phase` of the previous control step.
        ankle_torque: Torque between ground and stance leg, held through the control step; a number
            or (n,). Requires point feet.
        push_off: Impulse along the stance leg just before heelstrike; a number or (n,). Has no
            effect without heelstrike.
        height_change: Height of the next foothold over this one, along this one's normal; a number
            or (n,).
        slope_change: Slope of the next foothold less that of this one, in rad; a number or (n,).
        push: Impulse along the slope as the control step begins, positive downhill; a number or
            (n,). It acts on the hip, or at the centre of mass of a `System`.
        controls: Values of a `System`'s controls by name, held as the torques are; numbers or
            (n,). Those that are not named are 0.
        parameters: Values by name of walker parameters, or of fields of a `System`'s body, which
            replace the walker's; numbers or (n,).
        tolerance: Error relative to the largest angle or (dimensionless) angular velocity.
        end_on_toe_stub: Whether a kneed walker's locked swing leg below the ground ends the walk.

    Raises:
        TypeError: if a tensor is not float64 or not on the CPU.
        ValueError: if shapes do not match, the walker's feet do not permit an actuation, or a
            stride of it has no such phase.
        WalkerError: if the parameters describe no walker.
    """
    return _walk(
        Tick, walker, slope, state, Actuation(hip_torque, ankle_torque, push_off),
        (height_change, slope_change, push), controls, parameters,
        duration=duration, phase=phase, tolerance=tolerance, end_on_toe_stub=end_on_toe_stub,
    )  # fmt: skip


_Result = TypeVar("_Result", Stride, Tick)


def _found(
    kind: type[_Result], walker: Walker, units: Units, time: Tensor, moved: FlowResult, held: Tensor
) -> _Result:
    """Return results for n walkers in their own units, from dimensionless ones.

    `units` are those of the walkers, with `time` (n, 1); `held` are their torques, (n, controls).
    """
    works, half = walker.equations().works, moved.columns.report.size // 2
    found = {
        "state": torch.cat([moved.states[:, :half], moved.states[:, half:] / time], 1),
        "phase": moved.phases,
        "outcome": moved.outcomes,
        "walks": moved.walks,
        "margin": moved.margins,
    }
    for name, unit, entry, _ in RECORDED:
        if name in kind._fields:
            found[name] = moved.result(entry) * getattr(units, unit)
    if kind is Tick:
        knee, heel = (moved.result(name) * units.energy for name in ("knee_loss", "heel_loss"))
        found |= {"distance": moved.distance * units.length, "collision_loss": knee + heel}
    nothing = torch.zeros(len(time), dtype=torch.float64)
    done = {"hip": (nothing, nothing), "ankle": (nothing, nothing)}
    for j, work in enumerate(works):
        # All controls of a `System` count as the hip's.
        name = "ankle" if j and "actuation" in walker.supports else "hip"
        net, absolute = work_of(held[:, j] * work, *moved.moved(j))
        done[name] = done[name][0] + net, done[name][1] + absolute
    for name, (net, absolute) in done.items():
        found[f"{name}_work"] = net * units.energy
        found[f"{name}_work_absolute"] = absolute * units.energy
    fell = ~moved.walks  # then nothing has a gradient, neither by torques nor through the units
    for name, x in found.items():
        if x.is_floating_point():
            found[name] = torch.where(fell[:, None] if x.ndim > 1 else fell, x.detach(), x)
    return kind._make(found[name] for name in kind._fields)


def _walk(
    kind: type[_Result],
    walker: WalkerLike,
    slope: Any,
    state: Any,
    actuation: Actuation,
    met: tuple[Any, Any, Any],
    controls: Mapping[str, Any] | None,
    parameters: Mapping[str, Any] | None,
    *,
    duration: Any = None,
    end: float = math.inf,
    phase: Any = 0,
    tolerance: float,
    end_on_toe_stub: bool,
    whole: bool = False,
) -> _Result:
    """Integrate walkers through a stride of at most `end` sqrt(l/g), or for a duration."""
    walker = as_walker(walker)
    given = check_parameters(walker, parameters)
    units = walker.units_with(**given) if given else walker.units
    states, phases = as_tensor(state, "state"), torch.as_tensor(phase)
    if phases.is_floating_point():
        raise ValueError(f"phase must be a whole number or (n,) of them, not {shown(phase)}")
    columns, wanted = columns_of(walker), _controls(walker, actuation, met, controls)
    starts, size = columns.inputs["start"], columns.report.size
    names = (*columns.controls, *UNEVEN, "push", *("start",) * len(starts))
    given_held = (*wanted, *met, *(0.0,) * len(starts))
    if "actuation" in walker.supports:
        motors, impulse = actuation_units(units), units.impulse
    else:  # the units of a `System` are 1, and its pushes are per unit of mass
        motors, impulse = (1.0,) * len(wanted), walker.mass_with(**given)
    in_units = (*motors, units.length, 1.0, impulse, *(1.0,) * len(starts))
    held_inputs = [
        as_tensor(x, name) / unit for name, x, unit in zip(names, given_held, in_units, strict=True)
    ]
    ends = end if duration is None else as_tensor(duration, "duration") / units.time
    held = [
        as_tensor(slope, "slope"),
        *held_inputs,
        as_tensor(ends, "max_stride_time"),
        *given.values(),
    ]
    shapes = [states.shape[:-1], phases.shape, *(x.shape for x in held)]
    shape = max(shapes, key=len)
    if states.shape[-1:] != (size,) or len(shape) > 1 or not set(shapes) <= {shape, ()}:
        sizes = {name: tuple(x.shape) for name, x in zip(("slope", *names), held, strict=False)}
        others = ", ".join(f"{name} {size}" for name, size in sizes.items() if size)
        raise ValueError(
            f"state must have shape ({size},) or (n, {size}), and slope, {names[0]} and all else "
            f"be numbers or (n,), but state is {tuple(states.shape)}"
            f"{f', and {others}' if others else ''}"
        )
    count = math.prod(shape)
    time = torch.as_tensor(units.time, dtype=torch.float64).expand(shape).reshape(count, 1)
    states = states.expand(*shape, size).reshape(count, size)
    phases = phases.long().expand(shape).reshape(count)
    rest = torch.stack([x.expand(shape).reshape(count) for x in held], 1)
    inputs = torch.cat([states[:, : size // 2], states[:, size // 2 :] * time, rest], 1)
    asked = dict(zip(names, given_held, strict=True))
    using = [name for name, x in asked.items() if isinstance(x, Tensor) or np.any(x)]
    # Arguments in the walker's own units depend on its parameters through the units.
    by = ["slope"] if isinstance(slope, Tensor) else []
    by += [name for name in using if isinstance(asked[name], Tensor) or given]
    if duration is not None and (isinstance(duration, Tensor) or given):
        by.append("end")
    options = FlowOptions(
        walker=walker,
        parameters=tuple(given),
        by=(*by, *given),
        using=tuple(name for name in using if name != "hip_torque"),
        tolerance=check_tolerance(tolerance),
        end_on_toe_stub=end_on_toe_stub,
        whole=whole,
    )
    moved = carry_on(inputs, phases, torch.ones(count, dtype=torch.bool), options)
    torques = inputs[:, [columns.inputs[name][0] for name in columns.controls]]
    found = _found(kind, walker, units, time, moved, torques)
    return found if shape else kind._make(x[0] for x in found)


def _controls(
    walker: Any, actuation: Actuation, met: tuple[Any, Any, Any], controls: Any
) -> tuple[Any, ...]:
    """Return the values of the walker's controls in their order, after a check of all inputs."""
    asked = dict(controls or {})
    if "actuation" in walker.supports:
        if asked:
            raise ValueError(
                "controls are those of a System: give hip_torque, ankle_torque and push_off"
            )
        return actuation
    used = [
        name
        for name, x in zip((*Actuation._fields, "slope_change"), (*actuation, met[1]), strict=True)
        if isinstance(x, Tensor) or np.any(x)
    ]
    if used:
        raise ValueError(
            f"the system {walker.title!r} takes no {' or '.join(used)}: give its controls by name, "
            "as controls={...}; footholds may differ in height alone"
        )
    held = tuple(name for name in walker.controls if name not in walker.absent)
    if strange := unknown(asked, held, f"system {walker.title!r}"):
        raise ValueError(strange)
    return tuple(asked.get(name, 0.0) for name in walker.controls)
