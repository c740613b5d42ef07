"""Integration of batches of records through strides and control steps.

`advance` is the entry point for analyses. Environments compose `integrate` with their own kernels.
"""

from __future__ import annotations

import math
import os
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache, lru_cache
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker.engine.compiled import compiled
from gym_passive_walker.engine.jit import Kernel, address, call
from gym_passive_walker.engine.lanes import CHUNK, RESTING, integrate_phase
from gym_passive_walker.engine.layout import (
    NARROW,
    PAIR,
    Layout,
    aligned,
    history_for,
    layout_in,
    record_for,
    tile_for,
)
from gym_passive_walker.engine.machine import default_threads
from gym_passive_walker.models.equations.hybrid import System

OPTIONS = np.dtype(
    [
        ("tolerance", "f8"),  # error of a step, relative to the largest angle or angular velocity
        ("landing", "f8"),  # share of its length by which a step's end may be moved onto an event
        ("doubt", "f8"),  # largest error, over the tolerance, of a move onto a predicted impact
        ("first_step", "f8"),
        ("fineness", "f8"),  # one over the allowed error estimate
        ("scuff", "i8"),  # whether a kneed walker's locked leg below the ground ends the stride
        ("from_section", "i8"),  # whether records begin on the Poincaré section, or in their phase
    ]
)
"""Options of a run of the engine."""

LONGEST_STRIDE = 100.0
"""Time in sqrt(l/g) after which a stride without heelstrike is STALLED; a usual stride takes 3."""

_WORTH_A_THREAD = 1024  # records below which a second thread costs more than it saves


@Kernel
def integrate(records, bodies, phases, options, tiles, histories):
    """Integrate records that are not RESTING to heelstrike, a fall, or their time limit, in place.

    Args:
        records: Records, (n, 1 + tangents) of RECORD.
        bodies: Constants of the walkers, (1 or n, 1 + tangents, constants).
        phases: Phases from `compiled.compiled`, with derivatives if there are tangents.
        options: Options from `options`, (1,).
        tiles: Working memory from `workspace`, (1 + tangents,) of TILE.
        histories: Working memory from `workspace`, (1 + tangents,) of HISTORY.
    """
    chosen, tangents = options[0], len(tiles) - 1
    for first in range(0, len(records), CHUNK):
        chunk = records[first : first + CHUNK]
        own = bodies[first : first + CHUNK] if len(bodies) > 1 else bodies
        for i in range(len(chunk)):
            if chunk[i, 0].outcome == RESTING:
                continue
            record, body = address(chunk[i]), address(own[i if len(own) > 1 else 0])
            # A walker that begins beyond a bound of its phase has fallen.
            if chosen.from_section:
                call(phases[0].begin, record, body, 0, tangents, 0.0, 0.0)
            else:
                call(phases[chunk[i, 0].phase].open, record, body, 0, tangents, 0.0, 0.0)
        for number in range(len(phases)):
            integrate_phase(chunk, own, phases[number], number, tiles, histories, chosen)


def new_records(
    states: NDArray,
    slopes: ArrayLike,
    controls: ArrayLike = 0.0,
    *,
    push_off: ArrayLike = 0.0,
    height_change: ArrayLike = 0.0,
    slope_change: ArrayLike = 0.0,
    end: ArrayLike = LONGEST_STRIDE,
    tangents: int = 0,
    layout: Layout = NARROW,
) -> NDArray:
    """Return records of walkers on the Poincaré section, (n, 1 + tangents) of RECORD.

    All quantities are dimensionless.

    Args:
        states: Dimensionless, (n, 6); of another system its coordinates, then their rates.
        slopes: In rad, one for all or (n,).
        controls: Of the hip alone, one for all or (n,); or of each control, (n, controls).
        push_off: Impulse at heelstrike, one for all or (n,).
        height_change: Height of the next foothold, one for all or (n,).
        slope_change: By how much it slopes more steeply, one for all or (n,).
        end: When to stop, one for all or (n,).
        tangents: Number of directions of derivatives, all zero.
        layout: The room of the walkers' system, from `layout_of`.
    """
    records = np.zeros((len(states), tangents + 1), record_for(layout))
    values = records[:, 0]
    put_states(values, states)
    values["ground"][:, 0], values["ground"][:, 1] = np.sin(slopes), np.cos(slopes)
    values["ground"][:, 2], values["ground"][:, 3] = height_change, slope_change
    controls = np.asarray(controls, dtype=float)
    values["control"][:, : controls.shape[1] if controls.ndim == 2 else 1] = (
        controls if controls.ndim == 2 else controls[..., None]
    )
    values["push_off"] = push_off
    values["end"] = end
    return records


def put_states(records: NDArray, states: NDArray) -> None:
    """Write states (..., 2 m) into records (...), which may have room for more coordinates."""
    count, room = states.shape[-1] // 2, records["start"].shape[-1]
    records["state"][..., :count] = states[..., :count]
    records["state"][..., room : room + count] = states[..., count:]


def states_in(records: NDArray, coordinates: int) -> NDArray[np.float64]:
    """States (..., 2 m) of a system of m coordinates in records (...)."""
    found, room = records["state"], records["start"].shape[-1]
    if coordinates == room:
        return found
    parts = found[..., :coordinates], found[..., room : room + coordinates]
    return np.concatenate(parts, axis=-1)


def workspace(tangents: int = 0, layout: Layout = NARROW) -> tuple[NDArray, NDArray]:
    """Return a tile and a guard history, each (1 + tangents,), for one thread at a time."""
    tile = aligned(tile_for(PAIR, layout=layout), tangents + 1)
    return tile, aligned(history_for(layout), tangents + 1)


class _Workspaces(threading.local):
    """Function `workspace` of each thread, which returns the same arrays in every call."""

    def __init__(self) -> None:
        self.of = cache(workspace)


_WORKSPACES = _Workspaces()


def thread_workspace(tangents: int = 0, layout: Layout = NARROW) -> tuple[NDArray, NDArray]:
    """Return this thread's own `workspace`, the same in every call."""
    return _WORKSPACES.of(tangents, layout)


@lru_cache
def options(
    tolerance: float, *, scuff: bool = False, from_section: bool = False, tangents: int = 0
) -> NDArray:
    """Return the engine's options for a tolerance, (1,) of OPTIONS."""
    # A step's end moves onto an event along the polynomial through its last stages. Derivatives
    # need a smaller move; 1e-13 would be below rounding where a foot descends slowly.
    landing, doubt = (1e-11, -1.0) if tangents else (0.1 * math.sqrt(tolerance), 0.02)
    first_step = tolerance ** (1.0 / PAIR.order)
    fineness = first_step ** -(PAIR.error_order + 1)
    return np.array(
        [(tolerance, landing, doubt, first_step, fineness, scuff, from_section)], OPTIONS
    )


@lru_cache(maxsize=1)
def _pool(threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads, thread_name_prefix="walkers")


def in_parts(job: Callable[[int, int], object], count: int, threads: int | None = None) -> None:
    """Call ``job(first, last)`` for parts of `count` walkers, on several threads.

    Args:
        job: Function for the walkers from `first` to before `last`; releases Python's lock.
        count: Number of walkers.
        threads: Largest number of threads; `default_threads` when None. Small batches use fewer.
    """
    most = count // _WORTH_A_THREAD
    if most > 1 and threads is None:
        threads = default_threads()
    threads = min(threads or 1, most)
    if threads < 2:
        job(0, count)
        return
    pieces = threads * min(4, max(2, count // (threads * CHUNK)))
    bounds = pairwise([count * i // pieces for i in range(pieces + 1)])

    def work() -> None:
        for first, last in bounds:  # shared by all threads: a free thread takes the next piece
            job(first, last)

    helpers = [_pool(os.cpu_count() or 1).submit(work) for _ in range(threads - 1)]
    try:
        work()  # in this thread too, as waking another takes as long as hundreds of walkers
    finally:
        for _ in bounds:  # after an interrupt, no thread takes another piece
            pass
        for helper in helpers:
            if not helper.cancel():
                helper.result()


def advance(
    system: System,
    bodies: NDArray,
    records: NDArray,
    *,
    tolerance: float,
    scuff: bool = False,
    from_section: bool = True,
    threads: int | None = None,
) -> NDArray:
    """Integrate records to heelstrike, a fall, or their time limit, in place.

    All quantities are dimensionless (see `equations.hybrid`). A record with the outcome HEELSTRIKE
    holds the next state on the Poincaré section.

    Args:
        system: The system of equations.
        bodies: Constants of the walkers, (1 or n, 1 + tangents, constants).
        records: Records, (n, 1 + tangents) of RECORD: values, then derivatives.
        tolerance: Error relative to the largest angle or angular velocity.
        scuff: Whether a kneed walker's locked swing leg below the ground ends the stride.
        from_section: Whether records begin on the Poincaré section; else in their phase.
        threads: Number of threads; `default_threads` when None. Results do not depend on it.

    Returns:
        The records.

    Raises:
        TypeError: if records or bodies have another number of axes, or records are not contiguous.
    """
    if records.ndim != 2 or bodies.ndim != 3 or not records.flags.c_contiguous:
        raise TypeError("records are a contiguous array of two axes, bodies an array of three")
    changes = records.shape[1] - 1
    still = changes > 0 and bodies.shape[1] == 1
    if still:
        values, bodies = bodies, np.zeros((len(bodies), changes + 1, bodies.shape[2]))
        bodies[:, :1] = values
    bodies = np.ascontiguousarray(bodies, float)
    run, phases, chosen, layout = _prepared(
        system.name, tolerance, scuff, from_section, changes, still, records.dtype
    )
    if len(records) < 2 * _WORTH_A_THREAD:  # to cut arrays takes as long as steps of one walker
        run(records, bodies, phases, chosen, *thread_workspace(changes, layout))
        return records

    def job(first: int, last: int) -> None:
        own = bodies[first:last] if len(bodies) > 1 else bodies
        run(records[first:last], own, phases, chosen, *thread_workspace(changes, layout))

    in_parts(job, len(records), threads)
    return records


@lru_cache
def _prepared(
    system: str,
    tolerance: float,
    scuff: bool,
    from_section: bool,
    tangents: int,
    still: bool,
    kind: np.dtype,
) -> tuple[Callable[..., object], NDArray, NDArray, Layout]:
    """Return `integrate` for records of a type, its phases and options, and the records' layout.

    The function does not check its arguments, which takes longer than many a stride.
    """
    phases, layout = compiled(system, derived=tangents > 0, still=still), layout_in(kind)
    chosen = options(tolerance, scuff=scuff, from_section=from_section, tangents=tangents)
    arrays = np.zeros((1, 1), kind), np.zeros((1, 1, 1)), phases, chosen
    run = integrate.native(*arrays, *thread_workspace(tangents, layout))
    return run, phases, chosen, layout
