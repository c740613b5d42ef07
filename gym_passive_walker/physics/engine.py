"""Phases and events composed into strides and ticks, for batches of records.

A stride follows McGeer's recipe. A kneed walker swings its leg with the knee free until kneestrike,
then straight until heelstrike, where the legs change roles; a straight-legged one has only the
second part. `advance` is the door for analyses; environments compose its kernels with their own.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from itertools import pairwise

import numba
import numpy as np
from numpy.typing import NDArray

from gym_passive_walker.physics import compass, integrator, kneed, runge_kutta, simplest
from gym_passive_walker.physics import events as E
from gym_passive_walker.physics import record as R
from gym_passive_walker.physics import tile as T
from gym_passive_walker.physics.constants import Kind
from gym_passive_walker.physics.events import Outcome
from gym_passive_walker.physics.lanes import inlined, jitted, kernel, new_tile

_CHUNK = 1024  # records carried through a stride together, so that they stay in the cache
_WORTH_A_THREAD = 1024  # records below which a second thread costs more than it saves


@inlined
def begin(record, phase):
    """Open a stride or a tick: the walker must be upright."""
    stance, thigh, shank = record[0].real, record[1].real, record[2].real
    record[R.OUTCOME] = 0.0
    record[R.PHASE] = float(phase)
    if stance <= -0.5 * np.pi:
        record[R.OUTCOME] = float(Outcome.FELL_FORWARD.value)
    elif stance >= 0.5 * np.pi:
        record[R.OUTCOME] = float(Outcome.FELL_BACKWARD.value)
    elif np.abs(thigh) >= np.pi or (phase == E.FREE and np.abs(shank) >= np.pi):
        record[R.OUTCOME] = float(Outcome.OVER_THE_TOP.value)


@jitted
def strike_knee(record, c, stub):
    """Lock the swing knee of a walker that has landed on kneestrike."""
    stance, thigh = record[R.ANGLES], record[R.ANGLES + 1]
    stance_rate, swing_rate, loss = kneed.kneestrike(
        c, stance, thigh, record[R.RATES], record[R.RATES + 1], record[R.RATES + 2]
    )
    record[R.ANGLES + 2] = thigh
    record[R.RATES] = stance_rate
    record[R.RATES + 1] = swing_rate
    record[R.RATES + 2] = swing_rate
    record[R.KNEE_TIME] = record[R.TIME]
    record[R.KNEE_LOSS] = loss
    record[R.PHASE] = float(E.LOCKED)
    record[R.OUTCOME] = 0.0
    below = compass.foot_clearance(c, stance, thigh).real < 0.0
    sinking = stance_rate.real + swing_rate.real <= 0.0
    if stub and below:
        record[R.OUTCOME] = float(Outcome.STUBBED_TOE.value)
    elif stance.real < 0.0 and (stance + thigh).real <= 0.0 and (thigh - stance).real > 0.0:
        if sinking:  # the foot is under the ground in front, and was let through by the free knee
            record[R.OUTCOME] = float(Outcome.BENT_KNEE.value)


@jitted
def strike_heel(record, c, kind):
    """Exchange the legs of a walker that has landed on heelstrike."""
    angle = 0.5 * (record[R.ANGLES + 1] - record[R.ANGLES])
    stance_rate, swing_rate = record[R.RATES], record[R.RATES + 1]
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
    record[R.ANGLES] = angle
    record[R.ANGLES + 1] = -angle
    record[R.ANGLES + 2] = -angle
    record[R.RATES] = stance_rate
    record[R.RATES + 1] = thigh_rate
    record[R.RATES + 2] = shank_rate
    record[R.HEEL_LOSS] = loss
    record[R.PHASE] = float(E.FREE if kind == 0 else E.LOCKED)


@inlined
def finish(records, constants, kind):
    """Close a chunk: exchange legs at heelstrikes, and say who is only out of time."""
    for i in range(len(records)):
        if records[i, R.OUTCOME].real == 1.0:  # Outcome.HEELSTRIKE
            strike_heel(records[i], constants[i if len(constants) > 1 else 0], kind)
        elif records[i, R.OUTCOME].real == -1.0:
            records[i, R.OUTCOME] = 0.0


@inlined
def part(constants, first, last):
    """The constants that belong to some records: their own, or the one row for all."""
    return constants[first:last] if len(constants) > 1 else constants


@kernel
def run_kneed(records, constants, tolerance, landing, first_step, stub, from_section):
    """Carry kneed walkers to heelstrike or to their time's end."""
    tile = new_tile(T.ROWS, records)
    for first in range(0, len(records), _CHUNK):
        chunk = records[first : first + _CHUNK]
        own = part(constants, first, first + _CHUNK)
        for i in range(len(chunk)):
            begin(chunk[i], E.FREE if from_section else int(chunk[i, R.PHASE].real))
        integrator.advance_free(chunk, own, tile, tolerance, landing, first_step, stub)
        for i in range(len(chunk)):
            if chunk[i, R.OUTCOME].real == 2.0:  # Outcome.KNEESTRIKE
                strike_knee(chunk[i], own[i if len(own) > 1 else 0], stub)
        integrator.advance_locked(chunk, own, tile, tolerance, landing, first_step, stub)
        finish(chunk, own, 0)


@kernel
def run_compass(records, constants, tolerance, landing, first_step, stub, from_section):
    """Carry straight-legged walkers to heelstrike or to their time's end."""
    tile = new_tile(T.ROWS, records)
    for i in range(len(records)):
        begin(records[i], E.LOCKED)
    integrator.advance_locked(records, constants, tile, tolerance, landing, first_step, 0)
    finish(records, constants, 1)


@kernel
def run_simplest(records, constants, tolerance, landing, first_step, stub, from_section):
    """Carry simplest walkers to heelstrike or to their time's end."""
    tile = new_tile(T.ROWS, records)
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
    pieces = threads * min(4, max(2, count // (threads * _CHUNK)))
    bounds = pairwise([count * i // pieces for i in range(pieces + 1)])

    def work() -> None:
        for first, last in bounds:  # shared: whoever is free takes the next piece
            job(first, last)

    helpers = [_crew(os.cpu_count() or 1).submit(work) for _ in range(threads - 1)]
    work()  # this thread too: to wake another takes as long as hundreds of walkers
    for helper in helpers:
        if not helper.cancel():
            helper.result()


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
        records: Shape (n, record.FIELDS), real or complex. Angles, rates, END, slope and
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
