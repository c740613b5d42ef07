"""Integration of one walker, on machines without vector units; replaces `lanes.integrate_phase`."""

from __future__ import annotations

from gym_passive_walker.engine import jit
from gym_passive_walker.engine.lanes import WAITING, finish_sweep, leave


def integrate_phase(records, bodies, phase, number, tiles, histories, options):
    """Integrate the one walker through a phase if it waits there; see `lanes.integrate_phase`."""
    record = records[0, 0]
    if record.phase != number or record.outcome != WAITING:
        return
    tile, tangents, event = jit.address(tiles), len(tiles) - 1, 0
    scuff = float(options.scuff)
    jit.call(phase.load_constants, tile, jit.address(bodies[0]), 0, tangents, 0.0, 0.0)
    jit.call(phase.load, tile, jit.address(records[0]), 0, tangents, options.first_step, 0.0)
    jit.call(phase.first, tile, tile, 0, tangents, 0.0, 0.0)
    while event == 0:
        if tangents > 0 and tiles[0].fresh[0] > 0.0:
            jit.call(phase.first, tile, tile, 0, tangents, 0.0, 0.0)
        jit.call(phase.sweep, tile, tile, 0, tangents, options.fineness, scuff)
        event = finish_sweep(tiles, histories, phase, 0, options)
    leave(records[0], bodies[0], tiles, phase, 0, event, options)


def entry(array, i):
    """Return the address of an array's entry."""
    return jit.address(array[i:])
