"""The stride map: phases and events composed from one heelstrike to the next.

A stride follows McGeer's recipe. A kneed walker swings its leg with the knee free until kneestrike,
then straight until heelstrike, where the legs change roles; a straight-legged one has only the
second part. `advance` is the engine's door for batches of records, which environments and analyses
use; `stride` is the same for people, in a walker's own units.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from itertools import pairwise
from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker.physics import compass, integrator, kneed, runge_kutta, simplest
from gym_passive_walker.physics import constants as K
from gym_passive_walker.physics import events as E
from gym_passive_walker.physics import integrator as I
from gym_passive_walker.physics.constants import Kind
from gym_passive_walker.physics.events import Outcome
from gym_passive_walker.physics.lanes import inlined, jitted, kernel, sine_cosine
from gym_passive_walker.walkers import Walker, as_walker

LONGEST_STRIDE = 100.0
"""Time in sqrt(l/g) after which a stride without heelstrike has stalled; a usual one takes 3."""

FINEST_TOLERANCE, COARSEST_TOLERANCE = 1e-15, 0.1
_CHUNK = 256  # records carried through a stride together, so that they stay in the cache
_WORTH_A_THREAD = 512  # records below which a second thread costs more than it saves


@inlined
def begin(record, phase):
    """Open a stride or a tick: the walker must be upright."""
    stance, thigh, shank = record[0].real, record[1].real, record[2].real
    record[I.OUTCOME] = 0.0
    record[I.PHASE] = float(phase)
    if stance <= -0.5 * np.pi:
        record[I.OUTCOME] = float(Outcome.FELL_FORWARD.value)
    elif stance >= 0.5 * np.pi:
        record[I.OUTCOME] = float(Outcome.FELL_BACKWARD.value)
    elif np.abs(thigh) >= np.pi or (phase == E.FREE and np.abs(shank) >= np.pi):
        record[I.OUTCOME] = float(Outcome.OVER_THE_TOP.value)


@jitted
def strike_knee(record, c, stub):
    """Lock the swing knee of a walker that has landed on kneestrike."""
    stance, thigh = record[I.ANGLES], record[I.ANGLES + 1]
    stance_rate, swing_rate, loss = kneed.kneestrike(
        c, stance, thigh, record[I.RATES], record[I.RATES + 1], record[I.RATES + 2]
    )
    record[I.ANGLES + 2] = thigh
    record[I.RATES] = stance_rate
    record[I.RATES + 1] = swing_rate
    record[I.RATES + 2] = swing_rate
    record[I.KNEE_TIME] = record[I.TIME]
    record[I.KNEE_LOSS] = loss
    record[I.PHASE] = float(E.LOCKED)
    record[I.OUTCOME] = 0.0
    below = compass.foot_clearance(c, stance, thigh).real < 0.0
    sinking = stance_rate.real + swing_rate.real <= 0.0
    if stub and below:
        record[I.OUTCOME] = float(Outcome.STUBBED_TOE.value)
    elif stance.real < 0.0 and (stance + thigh).real <= 0.0 and (thigh - stance).real > 0.0:
        if sinking:  # the foot is under the ground in front, and was let through by the free knee
            record[I.OUTCOME] = float(Outcome.BENT_KNEE.value)


@jitted
def strike_heel(record, c, kind):
    """Exchange the legs of a walker that has landed on heelstrike."""
    angle = 0.5 * (record[I.ANGLES + 1] - record[I.ANGLES])
    stance_rate, swing_rate = record[I.RATES], record[I.RATES + 1]
    if kind == 0:  # Kind.KNEED
        stance_rate, thigh_rate, shank_rate, loss = kneed.heelstrike(
            c, -angle, stance_rate, swing_rate
        )
    elif kind == 1:  # Kind.COMPASS
        stance_rate, thigh_rate, loss = compass.heelstrike(c, -angle, stance_rate, swing_rate)
        shank_rate = thigh_rate
    else:
        stance_rate, thigh_rate, loss = simplest.heelstrike(-angle, stance_rate)
        shank_rate = thigh_rate
    record[I.ANGLES] = angle
    record[I.ANGLES + 1] = -angle
    record[I.ANGLES + 2] = -angle
    record[I.RATES] = stance_rate
    record[I.RATES + 1] = thigh_rate
    record[I.RATES + 2] = shank_rate
    record[I.HEEL_LOSS] = loss
    record[I.PHASE] = float(E.FREE if kind == 0 else E.LOCKED)


@inlined
def finish(records, constants, kind):
    """Close a chunk: exchange legs at heelstrikes, and say who is only out of time."""
    for i in range(len(records)):
        if records[i, I.OUTCOME].real == 1.0:  # Outcome.HEELSTRIKE
            strike_heel(records[i], constants[i if len(constants) > 1 else 0], kind)
        elif records[i, I.OUTCOME].real == -1.0:
            records[i, I.OUTCOME] = 0.0


@inlined
def part(constants, first, last):
    """The constants that belong to some records: their own, or the one row for all."""
    return constants[first:last] if len(constants) > 1 else constants


@kernel
def run_kneed(records, constants, tolerance, landing, first_step, stub, from_section):
    """Carry kneed walkers to heelstrike or to their time's end."""
    tile = np.zeros(I.ROWS * I.WIDTH, records.dtype)
    for first in range(0, len(records), _CHUNK):
        chunk = records[first : first + _CHUNK]
        own = part(constants, first, first + _CHUNK)
        for i in range(len(chunk)):
            begin(chunk[i], E.FREE if from_section else int(chunk[i, I.PHASE].real))
        integrator.advance_free(chunk, own, tile, tolerance, landing, first_step, stub)
        for i in range(len(chunk)):
            if chunk[i, I.OUTCOME].real == 2.0:  # Outcome.KNEESTRIKE
                strike_knee(chunk[i], own[i if len(own) > 1 else 0], stub)
        integrator.advance_locked(chunk, own, tile, tolerance, landing, first_step, stub)
        finish(chunk, own, 0)


@kernel
def run_compass(records, constants, tolerance, landing, first_step, stub, from_section):
    """Carry straight-legged walkers to heelstrike or to their time's end."""
    tile = np.zeros(I.ROWS * I.WIDTH, records.dtype)
    for i in range(len(records)):
        begin(records[i], E.LOCKED)
    integrator.advance_locked(records, constants, tile, tolerance, landing, first_step, 0)
    finish(records, constants, 1)


@kernel
def run_simplest(records, constants, tolerance, landing, first_step, stub, from_section):
    """Carry simplest walkers to heelstrike or to their time's end."""
    tile = np.zeros(I.ROWS * I.WIDTH, records.dtype)
    for i in range(len(records)):
        begin(records[i], E.SIMPLEST)
    integrator.advance_simplest(records, constants, tile, tolerance, landing, first_step, 0)
    finish(records, constants, 2)


@kernel
def strike_heels(records, constants, kind):
    """Exchange the legs of walkers that stand on the verge of heelstrike, in place."""
    for i in range(len(records)):
        strike_heel(records[i], constants[i if len(constants) > 1 else 0], kind)


_KERNELS = {Kind.KNEED: run_kneed, Kind.COMPASS: run_compass, Kind.SIMPLEST: run_simplest}


@lru_cache(maxsize=1)
def _crew(threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads, thread_name_prefix="walkers")


def in_parts(job: Callable[[int, int], object], count: int, threads: int | None = None) -> None:
    """Call ``job(first, last)`` until all of `count` walkers are covered, on several threads.

    Args:
        job: Does the walkers from `first` to before `last`; releases Python's lock.
        count: How many walkers there are.
        threads: How many threads to use, where there is enough to do; numba's number when None.
    """
    if threads is None:
        threads = numba.get_num_threads()
    threads = min(threads, count // _WORTH_A_THREAD)
    if threads < 2:
        job(0, count)
        return
    pieces = 4 * threads
    bounds = [count * i // pieces for i in range(pieces + 1)]
    for done in [_crew(os.cpu_count() or 1).submit(job, a, b) for a, b in pairwise(bounds)]:
        done.result()


def step_control(tolerance: float, *, real: bool = True) -> tuple[float, float, float]:
    """What a kernel is told of a tolerance: a step's error, its end's shift, its first length."""
    # A step's end is moved by up to `landing` of its length by its Taylor series of second order.
    # Derivatives need it smaller, but where a foot comes down slowly 1e-13 drowns in rounding.
    landing = 0.1 * math.sqrt(tolerance) if real else 1e-11
    return tolerance, landing, tolerance ** (1.0 / runge_kutta.ORDER)


def advance(
    kind: Kind,
    constants: NDArray,
    records: NDArray,
    *,
    tolerance: float,
    stub: bool = False,
    from_section: bool = True,
    threads: int | None = None,
) -> None:
    """Carry records to their heelstrike, their fall, or their time's end, in place.

    Everything is dimensionless (see `constants`). A record that ends on HEELSTRIKE holds the next
    section state.

    Args:
        kind: Which equations the walkers obey.
        constants: Walkers' constants, shape (1, COUNT) for all alike or (n, COUNT).
        records: Shape (n, integrator.FIELDS), real or complex. Angles, rates, END, slope and
            torque are read; TIME and the ledger's fields are added to.
        tolerance: Error relative to the largest angle or rate.
        stub: Whether a kneed walker's locked swing leg below the ground ends the stride.
        from_section: Whether records stand just after heelstrike; else at their PHASE.
        threads: How many threads to use; numba's number when None. It changes no result.
    """
    settings = step_control(tolerance, real=records.dtype == np.float64)

    def job(first: int, last: int) -> None:
        _KERNELS[kind](
            records[first:last],
            constants[first:last] if len(constants) > 1 else constants,
            *settings,
            int(stub),
            from_section,
        )

    in_parts(job, len(records), threads)


@inlined
def gravity_work(kind, c, start, end, sin_slope, cos_slope):
    """Work of gravity / (m g l) between two configurations over the same contact."""
    if kind == 0:  # Kind.KNEED
        gain = kneed.potential_gain(
            c, start[0], start[1], start[2], end[0], end[1], end[2], sin_slope, cos_slope
        )
    elif kind == 1:  # Kind.COMPASS
        gain = compass.potential_gain(c, start[0], start[1], end[0], end[1], sin_slope, cos_slope)
    else:
        gain = simplest.potential_gain(start[0], end[0], sin_slope, cos_slope)
    return -gain


@inlined
def kinetic_energy(kind, c, state):
    """Kinetic energy / (m g l) of a state (angles, rates)."""
    if kind == 0:  # Kind.KNEED
        return kneed.kinetic_energy(c, state[0], state[1], state[2], state[3], state[4], state[5])
    if kind == 1:  # Kind.COMPASS
        return compass.kinetic_energy(c, state[0], state[1], state[3], state[4])
    return simplest.kinetic_energy(state[3])


@inlined
def advance_of_contact(c, start, end):
    """Step length / l between two heelstrikes, by the stance angles just after them."""
    sine, _ = sine_cosine(end)
    return 2.0 * c[K.LEG] * sine + c[K.FOOT_RADIUS] * (start + end)


@kernel
def _ledgers(kind, constants, starts, records, gravity, length):
    """Gravity's work and step length of each record since its start."""
    for i in range(len(records)):
        c = constants[i if len(constants) > 1 else 0]
        record = records[i]
        end = record[I.ANGLES : I.ANGLES + 3].copy()
        length[i] = np.nan
        if record[I.OUTCOME].real == 1.0:  # Outcome.HEELSTRIKE: before the legs changed roles
            length[i] = advance_of_contact(c, starts[i, 0], end[0])
            end[:] = -end
        gravity[i] = gravity_work(kind, c, starts[i], end, record[I.SIN_SLOPE], record[I.COS_SLOPE])


@kernel
def _kinetic_energies(kind, constants, states, energy):
    for i in range(len(states)):
        energy[i] = kinetic_energy(kind, constants[i if len(constants) > 1 else 0], states[i])


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


class Frame(NamedTuple):
    """How a walker's own units and the dimensionless ones convert.

    Attributes:
        rate: 1 / time unit.
        time: sqrt(l/g).
        length: l.
        energy: m g l.
        torque: m g l; g l for the simplest walker, whose torque is per unit of foot mass.
    """

    rate: float
    time: float
    length: float
    energy: float
    torque: float


def frame_of(walker: Walker) -> Frame:
    """Unit conversions of a walker."""
    length, time = walker.leg_length, walker.time_unit
    energy = walker.total_mass * walker.gravity * length
    torque = walker.gravity * length if walker.massless_legs else energy
    return Frame(1.0 / time, time, length, energy, torque)


def check_tolerance(tolerance: float) -> float:
    """The tolerance, if it can be met."""
    if not FINEST_TOLERANCE <= tolerance <= COARSEST_TOLERANCE:
        raise ValueError(
            f"tolerance must lie between {FINEST_TOLERANCE} and {COARSEST_TOLERANCE}, "
            f"not {tolerance!r}"
        )
    return float(tolerance)


def check_slope(slope: ArrayLike) -> NDArray[np.float64]:
    """Slopes, if they are finite and less than upright."""
    slopes = np.asarray(slope, dtype=float)
    if not (np.all(np.isfinite(slopes)) and np.all(np.abs(slopes) < 0.5 * np.pi)):
        raise ValueError(f"slope must be an angle in rad between -pi/2 and pi/2, not {slope!r}")
    return slopes


def check_state(state: ArrayLike) -> NDArray[np.float64]:
    """States as an array of shape (..., 6), if finite."""
    states = np.asarray(state, dtype=float)
    if states.ndim == 0 or states.shape[-1] != 6:
        raise ValueError(
            "state must be [stance, thigh, shank angle, then their rates]: shape (6,) or (n, 6), "
            f"not {states.shape}"
        )
    if not np.all(np.isfinite(states)):
        raise ValueError("state must be finite")
    return states


def new_records(
    states: NDArray,
    slopes: NDArray,
    torques: NDArray | float = 0.0,
    *,
    end: float = LONGEST_STRIDE,
) -> NDArray:
    """Records of walkers at dimensionless states, shape (n, integrator.FIELDS)."""
    records = np.zeros((len(states), I.FIELDS), np.result_type(states, slopes, torques, float))
    records[:, :6] = states
    records[:, I.END] = end
    records[:, I.SIN_SLOPE] = np.sin(slopes)
    records[:, I.COS_SLOPE] = np.cos(slopes)
    records[:, I.TORQUE] = torques
    return records


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
    torques = np.asarray(hip_torque, dtype=float)
    if not np.all(np.isfinite(torques)):
        raise ValueError("hip_torque must be finite")
    if not 0.0 < longest < math.inf:
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
    _ledgers(int(kind), c, flat, records, gravity, length)
    outcome = records[:, I.OUTCOME].astype(np.int64)
    outcome[outcome == Outcome.RUNNING] = Outcome.STALLED
    knee_time = np.where(records[:, I.KNEE_TIME] > 0.0, records[:, I.KNEE_TIME], np.nan)
    torque = 0.0 if kind == Kind.SIMPLEST else records[:, I.TORQUE]

    def shaped(values: NDArray) -> NDArray:
        return values.reshape(shape) if shape else values[0]

    return Stride(
        state=(records[:, :6] / scale).reshape(*shape, 6),
        duration=shaped(records[:, I.TIME] * frame.time),
        outcome=shaped(outcome) if shape else Outcome(int(outcome[0])),  # type: ignore[arg-type]
        kneestrike_time=shaped(knee_time * frame.time),
        step_length=shaped(length * frame.length),
        hip_work=shaped(torque * records[:, I.HIP_NET] * frame.energy),
        hip_work_absolute=shaped(np.abs(torque) * records[:, I.HIP_TURN] * frame.energy),
        kneestrike_loss=shaped(records[:, I.KNEE_LOSS] * frame.energy),
        heelstrike_loss=shaped(records[:, I.HEEL_LOSS] * frame.energy),
        gravity_work=shaped(gravity * frame.energy),
        weight=frame.energy / frame.length,
    )
