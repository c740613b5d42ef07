"""The stride map in a walker's own units: from one heelstrike to the next."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker._tools.arguments import (
    boolean,
    check_slope,
    check_state,
    check_tolerance,
    number,
    real_array,
    shown,
    whole,
)
from gym_passive_walker._tools.shown import Table
from gym_passive_walker.engine.layout import Layout, layout_in
from gym_passive_walker.gaits.actuation import PASSIVE, check_actuation, to_dimensionless
from gym_passive_walker.gaits.flow import (
    LONGEST_STRIDE,
    Walkers,
    advance,
    flow,
    numbers_of,
    offsets,
    states_in,
)
from gym_passive_walker.gaits.given import GaitLike, walk_of
from gym_passive_walker.gaits.measures import RECORDED, InUnits, StrideQuantities, in_words
from gym_passive_walker.models.equations.hybrid import Ground, Outcome, System
from gym_passive_walker.models.model import check_heights_only
from gym_passive_walker.models.units import Units
from gym_passive_walker.models.walkers import Walker

_OWN = [each.name for each in RECORDED if each.name != "push_off_work"]
_RUNNING, _STRUCK, _STALLED = map(int, (Outcome.RUNNING, Outcome.HEELSTRIKE, Outcome.STALLED))


class _Fields(NamedTuple):
    state: NDArray[np.float64]
    duration: NDArray[np.float64]
    outcome: NDArray[np.int64]
    kneestrike_time: NDArray[np.float64]
    step_length: NDArray[np.float64]
    hip_work: NDArray[np.float64]
    hip_work_absolute: NDArray[np.float64]
    kneestrike_loss: NDArray[np.float64]
    heelstrike_loss: NDArray[np.float64]
    gravity_work: NDArray[np.float64]
    walker: Walker
    spring_work: NDArray[np.float64]
    friction_loss: NDArray[np.float64]
    ankle_work: NDArray[np.float64]
    ankle_work_absolute: NDArray[np.float64]
    push_off_work: NDArray[np.float64]


class Stride(StrideQuantities, InUnits, Table, _Fields):
    """One application of the stride map, with its energy balance, in the walker's own units.

    A stride is one step, heelstrike to heelstrike. Each field is a number for one walker and an
    array of shape (n,) for n walkers; `state` has shape (6,) or (n, 6). Speed, costs and further
    quantities of `gaits.measures.MEASURES` are attributes too, as is a `dimensionless` view.

    The energy balance closes: gravity_work + spring_work + hip_work + ankle_work + push_off_work =
    kinetic energy gained + kneestrike_loss + heelstrike_loss + friction_loss. Energies of the
    simplest walker are those of its hip mass. Its hip torque, spring and friction act on feet of
    vanishing mass, so hip_work, spring_work and friction_loss are 0.

    Attributes:
        state: Final state: [stance, thigh, shank] angles in rad, then their angular velocities. If
            the outcome is HEELSTRIKE, this is the next state on the Poincaré section.
        duration: Time taken; the step period on a gait.
        outcome: `Outcome` of the stride.
        kneestrike_time: Time at which the knee locked; NaN if it did not.
        step_length: Distance from one contact point to the next, along the ground of the first
            foothold; NaN without heelstrike.
        hip_work: Net work of the hip torque.
        hip_work_absolute: Integral of the absolute hip power.
        kneestrike_loss: Energy lost at kneestrike.
        heelstrike_loss: Energy lost at heelstrike.
        gravity_work: Work of gravity.
        walker: The walker.
        spring_work: Net work of the springs.
        friction_loss: Energy lost to friction at the hip.
        ankle_work: Net work of the ankle torque.
        ankle_work_absolute: Integral of the absolute ankle power.
        push_off_work: Work of the push-off, just before heelstrike.
    """

    __slots__ = ()

    def facts(self) -> dict[str, str]:
        """Outcome and measures of one stride; of several, how many ended with a heelstrike."""
        if np.ndim(self.outcome):
            struck = np.count_nonzero(self.outcome == _STRUCK)
            return {"strides": f"{np.size(self.outcome)}, {struck} end with a heelstrike"}
        names = ["duration", "step_length", "cost_of_transport", "gravity_work", "hip_work"]
        names += ["kneestrike_loss", "heelstrike_loss"]
        if self.spring_work or self.friction_loss:
            names += ["spring_work", "friction_loss"]
        ends = {"ends": str(Outcome(int(self.outcome)))}
        return ends | {name.replace("_", " "): in_words(self, name) for name in names}

    def columns(self) -> dict[str, NDArray]:
        """One row for each stride; its final state comes first."""
        size = np.shape(self.state)[-1]
        names = self.walker.state_names
        table = dict(zip(names, np.reshape(self.state, (-1, size)).T, strict=True))
        results = (name for name in self._fields[1:] if name != "walker")
        return table | {name: np.ravel(getattr(self, name)) for name in results}


def check_foothold(
    height_change: ArrayLike | None, slope_change: ArrayLike | None
) -> tuple[NDArray, NDArray] | None:
    """Return the changes to the next foothold as arrays; None if all are zero or not given.

    Raises:
        ValueError: if a number is not finite, or a slope change is not between -pi and pi.
    """
    if height_change is None and slope_change is None:
        return None
    allowed = "a number or an array of them"
    ground = (
        real_array(0.0 if height_change is None else height_change, "height_change", allowed),
        real_array(0.0 if slope_change is None else slope_change, "slope_change", allowed),
    )
    if not np.all(np.abs(ground[1]) < np.pi):
        raise ValueError(
            f"slope_change must be an angle in rad between -pi and pi, not {shown(slope_change)}"
        )
    return ground if any(part.any() for part in ground) else None


def stride(
    walker: GaitLike,
    slope: ArrayLike | None = None,
    state: ArrayLike | None = None,
    *,
    hip_torque: ArrayLike | None = None,
    ankle_torque: ArrayLike | None = None,
    push_off: ArrayLike | None = None,
    height_change: ArrayLike | None = None,
    slope_change: ArrayLike | None = None,
    tolerance: float = 1e-10,
    max_stride_time: float = LONGEST_STRIDE,
    end_on_toe_stub: bool = False,
    threads: int | None = None,
    backend: Callable[..., object] = advance,
) -> Stride:
    """Apply the stride map: follow walkers from one heelstrike to the next.

    Args:
        walker: The walker, in a form that `as_walker` takes; or a stride map or a `Gait`, which
            supplies slope, state and actuation where they are not given.
        slope: Slope in rad, positive downhill; a number or shape (n,).
        state: [stance, thigh, shank] angles in rad and their angular velocities, just after
            heelstrike, shape (6,) or (n, 6). A straight-legged walker's shank is ignored.
        hip_torque: Torque held through the stride, positive when it opens the legs in the walking
            direction; a number or shape (n,). Per unit of foot mass for the simplest walker. 0 by
            default, or the gait's own.
        ankle_torque: Torque between ground and stance leg held through the stride, positive when it
            tips the walker forward; a number or shape (n,). Requires point feet. 0 by default, or
            the gait's own.
        push_off: Impulse of the ground along the stance leg just before heelstrike; a number or
            shape (n,). 0 by default, or the gait's own.
        height_change: Height of the next foothold over this one, along this one's normal; a number
            or shape (n,). 0 by default; a map with a terrain begins on its first foothold if
            neither this nor `slope_change` is given.
        slope_change: Slope of the next foothold beyond this one's, in rad, positive downhill; a
            number or shape (n,). 0 by default. The final state's angles are from the next
            foothold's normal.
        tolerance: Error relative to the largest angle or (dimensionless) angular velocity. The
            final state's error stays within a hundred times this on ordinary gaits, and is usually
            below it.
        max_stride_time: Time in units of sqrt(l/g) after which a stride has STALLED.
        end_on_toe_stub: Whether a kneed walker's locked swing leg below the ground ends the stride.
            Garcia (1999), chapter 4, ignores such scuffing; so does the default.
        threads: Number of threads; as many as there are free CPUs when None. Results do not
            depend on it.
        backend: Function that integrates: `engine.run.advance` on the CPU, `gpu.advance` on a GPU.

    Returns:
        A `Stride`. Its `outcome` says how the stride ended; a failed stride does not raise.

    Raises:
        ValueError: if a number is not finite or out of its range, or shapes do not fit.
    """
    walker, slope, state, actuation, _, controlled = walk_of(
        walker, slope, state, hip_torque, ankle_torque, push_off
    )
    tolerance, ground = check_tolerance(tolerance), check_foothold(height_change, slope_change)
    if controlled is not None and (
        max_stride_time != LONGEST_STRIDE or end_on_toe_stub or backend is not advance
    ):
        raise ValueError(
            "a stride map with a controller or a terrain has its own rules: "
            "leave max_stride_time, end_on_toe_stub and backend out"
        )
    size = walker.size
    states, slopes = check_state(state, of=walker), check_slope(slope)  # type: ignore[arg-type]
    actuation = check_actuation(walker, actuation)
    max_stride_time = number(max_stride_time, "max_stride_time", above=0.0)
    end_on_toe_stub = boolean(end_on_toe_stub, "end_on_toe_stub")
    threads = None if threads is None else whole(threads, "threads")
    if not callable(backend):
        raise ValueError(f"backend must be a function, such as gpu.advance, not {shown(backend)}")
    if ground is not None:
        check_heights_only(walker, ground[1])
    try:
        around = [part.shape for part in (*actuation, *(ground or ())) if type(part) is not float]
        shape = np.broadcast_shapes(states.shape[:-1], slopes.shape, *around)
    except ValueError:
        raise ValueError(
            f"slope {slopes.shape}, hip_torque {np.shape(actuation.hip_torque)}, ankle_torque "
            f"{np.shape(actuation.ankle_torque)}, push_off {np.shape(actuation.push_off)}, "
            f"height_change, slope_change {[part.shape for part in ground or ()]} and "
            f"states {states.shape[:-1]} do not fit together: give one of each, or the same number"
        ) from None
    if controlled is not None:
        return controlled.with_tolerance(tolerance).stride(
            np.broadcast_to(states, (*shape, size)), np.broadcast_to(slopes, shape),
            height_change=height_change, slope_change=slope_change,
        )  # fmt: skip
    units, count = walker.units, math.prod(shape)
    flat = np.empty((*shape, size))
    flat[:] = units.to_dimensionless(states)
    walker.chart.straighten(flat)
    if shape:
        slopes = np.broadcast_to(slopes, shape).reshape(count)
    given: dict[str, Any] = {}
    if actuation is not PASSIVE:
        hip, ankle, push = (
            part if type(part) is float else np.broadcast_to(part, shape).ravel()
            for part in to_dimensionless(units, actuation)
        )
        held = np.empty((count, 2))
        held[:, 0], held[:, 1] = hip, ankle
        given |= {"controls": held, "push_offs": push}
    if ground:
        rises, turns = (np.broadcast_to(part, shape).ravel() for part in ground)
        given |= {"rises": rises / units.length, "turns": turns}
    walked = flow(
        Walkers(walker=walker, using=actuation.using, tolerance=tolerance,
        end_on_toe_stub=end_on_toe_stub),
        flat.reshape(count, size), slopes, until=max_stride_time, threads=threads, backend=backend,
        **given,
    )  # fmt: skip
    record = walked.records[:, 0]
    nothing = np.zeros(count)
    works, pushed = [(nothing, nothing), (nothing, nothing)], nothing
    if actuation is not PASSIVE:  # each costs time for a single walker
        powers = (record["control"] * (np.array(walked.system.works) * units.energy)).T
        moved, turned = record["moved"].T, record["turned"].T
        works = [
            (power * net, np.abs(power) * absolute)
            for power, net, absolute in zip(powers, moved, turned, strict=True)
        ]
    if actuation.using:
        pushed = record["push_work"] * units.energy
    return account(walker, walked.system, walked.bodies, record, works, pushed, shape)


@lru_cache
def _places(layout: Layout) -> NDArray[np.int64]:
    return np.array(offsets(tuple(each.of for each in RECORDED if each.name in _OWN), layout))


@lru_cache(maxsize=4096)  # one walker's stride waits for it
def _own_units(units: Units) -> NDArray[np.float64]:
    return np.array([getattr(units, each.unit) for each in RECORDED if each.name in _OWN])


def account(
    walker: Walker,
    system: System,
    bodies: NDArray,
    record: NDArray,
    works: Any,
    pushed: NDArray,
    shape: tuple[int, ...],
) -> Stride:
    """Return strides in a walker's own units from dimensionless records and actuator work.

    Args:
        walker: The walker.
        system: The walker's equations.
        bodies: Constants of the walkers, from `Walkers.bodies`.
        record: Records at the end of the strides, (n,); modified in place.
        works: Net and absolute work of hip and of ankle, in the walker's units, (n,) each.
        pushed: Work of push-offs in the walker's units, (n,).
        shape: Shape of the strides: (n,), or () for one.
    """
    (hip, ankle), outcome = works, record["outcome"]
    lost = outcome != _STRUCK
    if lost.any():
        outcome[outcome == _RUNNING] = _STALLED
        record["step_length"][lost] = np.nan
        gravity, spring = conservative_work(system, bodies, record[lost])
        record["gravity_work"][lost], record["spring_work"][lost] = gravity, spring
    knee_time = record["knee_time"]
    knee_time[knee_time <= 0.0] = np.nan
    numbers = numbers_of(record).take(_places(layout_in(record.dtype)), axis=1)
    numbers *= _own_units(walker.units)
    state: Any = walker.units.to_own(states_in(record, system.coordinates))
    if shape:
        own: Any = numbers.T.reshape(len(_OWN), *shape)
        state = state.reshape(*shape, 2 * system.coordinates)
        outcome, pushed = outcome.reshape(shape), pushed.reshape(shape)
        hip, ankle = (tuple(part.reshape(shape) for part in work) for work in works)
    else:
        own, state, outcome, pushed = numbers[0], state[0], Outcome(int(outcome[0])), pushed[0]
        hip, ankle = ((net[0], absolute[0]) for net, absolute in works)
    return Stride(
        state=state, outcome=outcome,  # type: ignore[arg-type]
        walker=walker, hip_work=hip[0], hip_work_absolute=hip[1],
        ankle_work=ankle[0], ankle_work_absolute=ankle[1], push_off_work=pushed,
        **dict(zip(_OWN, own)),  # noqa: B905 - strictness takes a microsecond
    )  # fmt: skip


def reported_as(walker: Walker) -> list[int]:
    """Return where a stride reports the work of each motor: with the hip's, or the ankle's.

    The work of all motors of a system stands with the hip's.
    """
    return [each * ("actuation" in walker.supports) for each in range(len(walker.controls))]


def together(strides: Sequence[Stride]) -> Stride:
    """Combine single strides of one walker into one `Stride` of arrays."""
    names = (name for name in Stride._fields if name not in ("walker", "outcome"))
    return strides[0]._replace(
        outcome=np.array([int(one.outcome) for one in strides]),
        **{name: np.array([getattr(one, name) for one in strides]) for name in names},
    )


def one_of(strides: Stride, function: Callable[[NDArray], Any]) -> Stride:
    """Return the stride, ended by a heelstrike, with a function of each field of strides."""
    parts = {name: function(x) for name, x in strides._asdict().items() if name != "walker"}
    return strides._replace(**parts | {"outcome": Outcome.HEELSTRIKE})


def conservative_work(
    system: System, own: NDArray, record: NDArray
) -> tuple[NDArray[np.float64], NDArray[np.float64] | float]:
    """Work of gravity and of springs since the start of a stride, before any heelstrike."""
    body, ground = system.Body(*own[0, 0]), Ground(*record["ground"].T)
    now, rates = np.split(states_in(record, system.coordinates).T, 2)
    began = record["start"].T[: system.coordinates]
    start, end = (system.State(*part, *rates) for part in (began, now))
    springs = system.spring_gain(body, start, end) if system.spring_gain else 0.0
    return -system.potential_gain(body, start, end, ground), -springs
