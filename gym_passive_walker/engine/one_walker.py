"""Integration of one walker, for machines without vector units: in the place of `lanes.carry`."""

from __future__ import annotations

from gym_passive_walker.engine import jit
from gym_passive_walker.engine.lanes import WAITING, came, leave


def carry(records, bodies, phase, number, tiles, courses, options):
    """Integrate the one walker through a phase if it waits there; see `lanes.carry`."""
    record = records[0, 0]
    if record.phase != number or record.outcome != WAITING:
        return
    tile, planes, event = jit.address(tiles), len(tiles) - 1, 0
    scuff = float(options.scuff)
    jit.call(phase.load_constants, tile, jit.address(bodies[0]), 0, planes, 0.0, 0.0)
    jit.call(phase.load, tile, jit.address(records[0]), 0, planes, options.first_step, 0.0)
    jit.call(phase.first, tile, tile, 0, planes, 0.0, 0.0)
    while event == 0:
        jit.call(phase.sweep, tile, tile, 0, planes, options.fineness, scuff)
        event = came(tiles, courses, phase, 0, options)
    leave(records[0], bodies[0], tiles, phase, 0, event, options)


def entry(array, i):
    """Return the address of an array's entry."""
    return jit.address(array[i:])
