"""Strides on a device: `engine.run.advance` with a thread for each walker.

Threads of a warp run one instruction at a time, so a warp takes as long as its slowest walker, and
as all the ways that its walkers go. Either each thread takes its walker through all phases (a
"loop"); or each phase is a "pass" by itself, over those alone who wait in it.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np

from gym_passive_walker.engine import lanes, run
from gym_passive_walker.engine.lanes import WAITING
from gym_passive_walker.gpu import device
from gym_passive_walker.gpu.bookkeeping import Bound
from gym_passive_walker.gpu.device import cuda
from gym_passive_walker.gpu.lane import RUN, TILE, machinery
from gym_passive_walker.gpu.primitives import jitted
from gym_passive_walker.physics.hybrid import System

WAYS = "loop", "passes"
"""How threads go through phases."""


def _loop_kernel(records, bodies, phases, options):
    """Carry the walker of this thread on."""
    i = cuda.grid(1)
    if i < len(records):
        tiles, courses = cuda.local.array(1, TILE), cuda.local.array(1, RUN)
        own = i if len(bodies) == len(records) else 0
        run.carry_on(records[i : i + 1], bodies[own : own + 1], phases, options, tiles, courses)


def _ready_kernel(records, options):
    """Have every walker wait where it begins."""
    i = cuda.grid(1)
    if i < len(records):
        record = records[i, 0]
        record.outcome = WAITING
        if options[0].from_section:
            record.phase = 0


def _waiting_kernel(records, number, order, counts):
    """Find who waits in a phase."""
    i, mine = cuda.grid(1), False
    if i < len(records):
        record = records[i, 0]
        mine = record.phase == number and record.outcome == WAITING and record.time < record.end
    place = device.place_of(mine, 0, counts)
    if mine:
        order[place] = i


def _pass_kernel(records, bodies, phases, options, order, counts):
    """Carry the walker of this thread through a phase."""
    j = cuda.grid(1)
    if j < counts[0]:
        i = order[j]
        tiles, courses = cuda.local.array(1, TILE), cuda.local.array(1, RUN)
        own = i if len(bodies) == len(records) else 0
        run.carry_on(records[i : i + 1], bodies[own : own + 1], phases, options, tiles, courses)


@lru_cache
def _simple() -> tuple[Any, ...]:
    """The kernels that know no equation."""
    waiting = Bound({}).rebound(_waiting_kernel)
    return tuple(map(device.kernel, (_ready_kernel, device.none_kernel, waiting)))


@lru_cache
def _made(system: str, way: str, single: bool) -> tuple[Any, list[Any]]:
    """A system's phases on the device, and the kernels that carry walkers through them."""
    here = machinery(system, single=single)
    phases = device.put(here.phases)
    if way == "loop":
        return phases, [device.kernel(here.bound.rebound(_loop_kernel))]
    kernels = []
    for number in range(len(here.phases)):
        bound = here.bound.instead({lanes.carry: _only(number, here.bound(lanes.carry))})
        kernels.append(device.kernel(bound.rebound(_pass_kernel)))
    return phases, kernels


class Strides:
    """What carries a system's records on; used by one stream at a time.

    Args:
        system: Its name.
        way: One of WAYS.
        single: Whether equations are computed in single precision.

    Raises:
        ValueError: if there is no such way.
    """

    def __init__(self, system: str, way: str = "loop", *, single: bool = False) -> None:
        if way not in WAYS:
            raise ValueError(f"threads go through phases as {' or '.join(WAYS)}, not {way!r}")
        self._way = way
        self._phases, self._kernels = _made(system, way, single)
        self._order, self._counts = device.room(0, np.int64), device.room(2, np.int64)

    def __call__(
        self,
        records: Any,
        bodies: Any,
        *,
        tolerance: float,
        scuff: bool = False,
        from_section: bool = True,
        stream: Any = 0,
    ) -> None:
        """Carry the device's records on, in place; arguments as of `advance`.

        Args:
            records: Shape (n, 1).
            bodies: Shape (1 or n, 1, constants).
            tolerance: Error relative to the largest angle or rate.
            scuff: Whether a kneed walker's locked swing leg below the ground ends the stride.
            from_section: Whether records stand just after heelstrike; else at their phase.
            stream: Behind what to do it.
        """
        count = len(records)
        told = options(tolerance, scuff=scuff, from_section=from_section)
        if self._way == "loop":
            arguments = records, bodies, self._phases, told
            device.launch(self._kernels[0], count, *arguments, stream=stream)
            return
        ready, none, waiting = _simple()
        if len(self._order) < count:
            self._order = device.room(count, np.int64)
        device.launch(ready, count, records, told, stream=stream)
        for number, kernel in enumerate(self._kernels):
            device.launch(none, 1, self._counts, stream=stream)
            those = self._order, self._counts
            device.launch(waiting, count, records, number, *those, stream=stream)
            arguments = records, bodies, self._phases, told, *those
            device.launch(kernel, count, *arguments, stream=stream)
            told = options(tolerance, scuff=scuff)


def _only(number: int, carry: Any) -> Any:
    """Carrying through one phase, and not through others."""

    def carry_here(records, bodies, phase, other, tiles, courses, options):
        if other == number:
            carry(records, bodies, phase, other, tiles, courses, options)

    return jitted(carry_here)


@lru_cache
def options(tolerance: float, *, scuff: bool = False, from_section: bool = False) -> Any:
    """What the engine is told, on the device."""
    return device.put(run.options(tolerance, scuff=scuff, from_section=from_section))


def advance(
    system: System,
    bodies: Any,
    records: Any,
    *,
    tolerance: float,
    scuff: bool = False,
    from_section: bool = True,
    threads: int | None = None,
) -> Any:
    """Carry records on, in place; as `engine.run.advance`, without derivatives.

    Args:
        system: Which equations the walkers obey.
        bodies: Their constants, (1, 1, constants) for all alike or (n, 1, constants).
        records: Shape (n, 1) of RECORD.
        tolerance: Error relative to the largest angle or rate.
        scuff: Whether a kneed walker's locked swing leg below the ground ends the stride.
        from_section: Whether records stand just after heelstrike; else at their phase.
        threads: Of the processor; it has none to spend here.

    Returns:
        The records.

    Raises:
        NoDevice: if there is no device.
    """
    device.need_device()
    there, told = device.put(records), {"scuff": scuff, "from_section": from_section}
    Strides(system.name)(there, device.put(bodies), tolerance=tolerance, **told)
    records[:] = device.back(there)
    return records
