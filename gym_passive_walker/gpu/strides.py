"""Strides on a device: `engine.run.advance` with a thread for each walker."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

from numba import cuda
from numpy.typing import NDArray

from gym_passive_walker.engine import run
from gym_passive_walker.gpu import device
from gym_passive_walker.gpu.lane import RUN, TILE, machinery
from gym_passive_walker.physics.hybrid import System


def _carried(records, bodies, phases, options):
    """Carry the walker of this thread on, as of `run.carry_on`."""
    i = cuda.grid(1)
    if i < len(records):
        tiles, courses = cuda.local.array(1, TILE), cuda.local.array(1, RUN)
        own = i if len(bodies) > 1 else 0
        alone = records[i : i + 1], bodies[own : own + 1]
        run.carry_on(alone[0], alone[1], phases, options, tiles, courses)


@lru_cache
def _made(system: str) -> tuple[Any, Any]:
    """The kernel of a system, and its phases on the device."""
    here = machinery(system)
    return device.kernel(here.bound.rebound(_carried)), device.put(here.phases)


@lru_cache
def _options(tolerance: float, scuff: bool, from_section: bool) -> Any:
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
        records: Shape (n, 1) of RECORD: here, or (with bodies) on the device, from `device.put`;
            then nothing is moved to or fro.
        tolerance: Error relative to the largest angle or rate.
        scuff: Whether a kneed walker's locked swing leg below the ground ends the stride.
        from_section: Whether records stand just after heelstrike; else at their phase.
        threads: Of the processor, which has none to spend here; as of `run.advance`.

    Returns:
        The records.

    Raises:
        NoDevice: if there is no device.
    """
    device.need_device()
    kernel, phases = _made(system.name)
    told = _options(tolerance, scuff, from_section)
    if not isinstance(records, NDArray.__origin__):
        device.launch(kernel, len(records), records, bodies, phases, told)
        return records
    there = device.put(records)
    device.launch(kernel, len(records), there, device.put(bodies), phases, told)
    records[:] = device.back(there)
    return records
