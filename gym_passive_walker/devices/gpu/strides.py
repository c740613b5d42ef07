"""Strides on a GPU: `engine.run.advance` with a thread for each walker."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

from gym_passive_walker.devices.gpu import device
from gym_passive_walker.devices.gpu.device import cuda
from gym_passive_walker.devices.gpu.lane import ONE_HISTORY, ONE_TILE, device_code
from gym_passive_walker.engine import run
from gym_passive_walker.models.equations.hybrid import System


def _stride_kernel(records, bodies, phases, options):
    """Integrate the walker of this thread."""
    i = cuda.grid(1)
    if i < len(records):
        tiles, histories = cuda.local.array(1, ONE_TILE), cuda.local.array(1, ONE_HISTORY)
        own = i if len(bodies) == len(records) else 0
        run.integrate(records[i : i + 1], bodies[own : own + 1], phases, options, tiles, histories)


@lru_cache
def _made(system: str) -> tuple[Any, Any]:
    """Return the phases of a system on the GPU, and the kernel that integrates its walkers."""
    here = device_code(system)
    kernel = here.bound.rebound(_stride_kernel)
    kernel.__globals__.update(here.scratch)
    return device.upload(here.phases), cuda.jit(kernel)


@lru_cache
def _options(*, from_section: bool = True, **chosen: Any) -> Any:
    """Return the options of the engine on the GPU; see `run.options`."""
    return device.upload(run.options(from_section=from_section, **chosen))


def advance_there(system: System, bodies: Any, records: Any, **options: Any) -> None:
    """Integrate records on the GPU in place; see `advance` for the arguments."""
    phases, kernel = _made(system.name)
    device.launch(kernel, len(records), records, bodies, phases, _options(**options))


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
    """Integrate records in place, as `engine.run.advance` does, without derivatives.

    Args:
        system: Equations of the walkers.
        bodies: Constants of the walkers, (n, 1, constants), or (1, 1, constants) for equal walkers.
        records: States of the integration, (n, 1) of RECORD.
        tolerance: Error relative to the largest angle or angular velocity.
        scuff: Whether a kneed walker's locked swing leg below the ground ends the stride.
        from_section: Whether records are on the Poincaré section, just after heelstrike; else they
            continue in their phase.
        threads: Ignored.

    Returns:
        The records.

    Raises:
        NoDevice: if there is no GPU.
    """
    device.need_device()
    there, bodies = device.upload(records), device.upload(bodies)
    options = {"tolerance": tolerance, "scuff": scuff, "from_section": from_section}
    advance_there(system, bodies, there, **options)
    records[:] = device.to_host(there)
    return records
