"""The stride map, for people: from one heelstrike to the next, in a walker's own units."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker.arguments import (
    check_slope,
    check_state,
    check_tolerance,
    real_array,
)
from gym_passive_walker.physics import constants as K
from gym_passive_walker.physics import record as R
from gym_passive_walker.physics.constants import Kind
from gym_passive_walker.physics.engine import advance
from gym_passive_walker.physics.events import Outcome
from gym_passive_walker.physics.frame import frame_of
from gym_passive_walker.physics.ledger import ledgers
from gym_passive_walker.physics.record import LONGEST_STRIDE, new_records
from gym_passive_walker.walkers import Walker, as_walker


class Stride(NamedTuple):
    """One application of the stride map, with its ledger, in the walker's own units.

    Each field is a number for one walker and an array of shape (n,) for n of them; `state` has
    shape (6,) or (n, 6). The ledger closes: gravity_work + hip_work is the kinetic energy gained
    plus kneestrike_loss plus heelstrike_loss. For the simplest walker energies are the hip's; its
    torque works on feet of vanishing mass, so hip_work is 0.

    Attributes:
        state: Where the stride ended: [stance, thigh, shank] angles in rad, then their rates;
            the next section state if the outcome is HEELSTRIKE.
        duration: Time taken; the step period on a gait.
        outcome: How it ended, an `Outcome`.
        kneestrike_time: When the knee locked; NaN if it did not.
        step_length: From one contact point to the next along the slope; NaN without heelstrike.
        hip_work: Net work of the hip torque.
        hip_work_absolute: Integral of the absolute hip power.
        kneestrike_loss: Energy lost at kneestrike.
        heelstrike_loss: Energy lost at heelstrike.
        gravity_work: Work of gravity.
        weight: Total mass times gravity.
    """

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
    weight: float

    @property
    def hip_work_positive(self) -> NDArray[np.float64]:
        """Work of the hip torque where it drives."""
        return 0.5 * (self.hip_work_absolute + self.hip_work)

    @property
    def collision_loss(self) -> NDArray[np.float64]:
        """Energy lost at both strikes."""
        return self.kneestrike_loss + self.heelstrike_loss

    @property
    def cost_of_transport(self) -> NDArray[np.float64]:
        """Energy lost over weight times step length: sin(slope) on a passive gait."""
        return self.collision_loss / (self.weight * self.step_length)


def stride(
    walker: Walker | str,
    slope: ArrayLike,
    state: ArrayLike,
    *,
    hip_torque: ArrayLike = 0.0,
    tolerance: float = 1e-10,
    longest: float = LONGEST_STRIDE,
    stub: bool = False,
    threads: int | None = None,
) -> Stride:
    """Follow walkers from one heelstrike to the next: the stride map.

    Args:
        walker: The walker, or a preset's name.
        slope: Slope in rad, positive downhill; a number or shape (n,).
        state: [stance, thigh, shank] angles in rad and their rates, just after heelstrike, shape
            (6,) or (n, 6). A straight-legged walker's shank is ignored.
        hip_torque: Torque held through the stride, positive when it opens the legs in the walking
            direction; a number or shape (n,). Per unit of foot mass for the simplest walker.
        tolerance: Error relative to the largest angle or (dimensionless) rate. The next state's
            error stays within a hundred times this on ordinary gaits, and usually below it.
        longest: Time in units of sqrt(l/g) after which a stride has STALLED.
        stub: Whether a kneed walker's locked swing leg below the ground ends the stride; the
            source document ignores such scuffing, and so does this by default.
        threads: How many threads to use; all of numba's when None. It changes no result.

    Returns:
        A `Stride`, whatever happens: its `outcome` says how it ended.

    Raises:
        ValueError: if a number is not finite or out of its range, or shapes do not fit.
    """
    walker = as_walker(walker)
    tolerance = check_tolerance(tolerance)
    states, slopes = check_state(state), check_slope(slope)
    torques = real_array(hip_torque, "hip_torque", "a torque or an array of them")
    if not (isinstance(longest, (int, float, np.number)) and 0.0 < longest < math.inf):
        raise ValueError(f"longest must be a positive time, not {longest!r}")
    try:
        shape = np.broadcast_shapes(states.shape[:-1], slopes.shape, torques.shape)
    except ValueError:
        raise ValueError(
            f"slope {slopes.shape}, hip_torque {torques.shape} and states {states.shape[:-1]} "
            "do not fit together: give one of each, or the same number"
        ) from None
    kind, frame, c = K.kind_of(walker), frame_of(walker), K.constants(walker)[None]
    scale = np.array([1.0, 1.0, 1.0, frame.time, frame.time, frame.time])
    count = math.prod(shape)
    flat = np.broadcast_to(states, (*shape, 6)).reshape(count, 6) * scale
    if kind != Kind.KNEED:
        flat[:, 2], flat[:, 5] = flat[:, 1], flat[:, 4]
    records = new_records(
        flat,
        np.broadcast_to(slopes, shape).reshape(count),
        np.broadcast_to(torques, shape).reshape(count) / frame.torque,
        end=longest,
    )
    advance(kind, c, records, tolerance=tolerance, stub=stub, threads=threads)
    gravity, length = np.empty(count), np.empty(count)
    ledgers(int(kind), c, flat, records, gravity, length)
    outcome = records[:, R.OUTCOME].astype(np.int64)
    outcome[outcome == Outcome.RUNNING] = Outcome.STALLED
    knee_time = np.where(records[:, R.KNEE_TIME] > 0.0, records[:, R.KNEE_TIME], np.nan)
    torque = 0.0 if kind == Kind.SIMPLEST else records[:, R.TORQUE]

    def shaped(values: NDArray) -> NDArray:
        return values.reshape(shape) if shape else values[0]

    return Stride(
        state=(records[:, :6] / scale).reshape(*shape, 6),
        duration=shaped(records[:, R.TIME] * frame.time),
        outcome=shaped(outcome) if shape else Outcome(int(outcome[0])),  # type: ignore[arg-type]
        kneestrike_time=shaped(knee_time * frame.time),
        step_length=shaped(length * frame.length),
        hip_work=shaped(torque * records[:, R.HIP_NET] * frame.energy),
        hip_work_absolute=shaped(np.abs(torque) * records[:, R.HIP_TURN] * frame.energy),
        kneestrike_loss=shaped(records[:, R.KNEE_LOSS] * frame.energy),
        heelstrike_loss=shaped(records[:, R.HEEL_LOSS] * frame.energy),
        gravity_work=shaped(gravity * frame.energy),
        weight=frame.energy / frame.length,
    )
