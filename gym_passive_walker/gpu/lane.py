"""One walker on one thread of a device: what carries it there, in the engine's own words."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from numba import cuda
from numpy.typing import NDArray

from gym_passive_walker.engine import jit, lanes, layout
from gym_passive_walker.engine.compiled import phases_of, written
from gym_passive_walker.engine.lanes import WAITING, came, leave
from gym_passive_walker.engine.layout import PAIR, tile_for
from gym_passive_walker.gpu import primitives
from gym_passive_walker.gpu.bookkeeping import Bound
from gym_passive_walker.gpu.source import Source
from gym_passive_walker.physics.systems import SYSTEMS

TILE, COURSE = (np.dtype((np.record, kind)) for kind in (tile_for(PAIR, width=1), layout.COURSE))
"""A tile for one walker, and how guards run over its step."""


@jit.jitted
def carry(records, bodies, phase, number, tiles, courses, options):
    """Take the one walker through a phase if it waits there; as of `lanes.carry`."""
    record = records[0, 0]
    if record.phase != number or record.outcome != WAITING:
        return
    tile, planes, event = jit.address(tiles), len(tiles) - 1, 0
    scuff = float(options.scuff)
    jit.call(phase.equip, tile, jit.address(bodies[0]), 0, planes, 0.0, 0.0)
    jit.call(phase.load, tile, jit.address(records[0]), 0, planes, options.first_step, 0.0)
    jit.call(phase.first, tile, tile, 0, planes, 0.0, 0.0)
    while event == 0:
        jit.call(phase.sweep, tile, tile, 0, planes, options.tolerance, scuff)
        event = came(tiles, courses, phase, 0, options)
    leave(records[0], tiles, phase, 0, event)


class Machinery:
    """A system's traced code and the engine's bookkeeping, for a device.

    Attributes:
        phases: What the engine knows of the system's phases, with numbers for addresses.
        bound: Makes a device's function of one of the engine's.
    """

    def __init__(self, system: str) -> None:
        source = Source()
        written(SYSTEMS[system], module=source, width=1)
        self.phases: NDArray = phases_of(SYSTEMS[system], source)
        names = {
            "apart": primitives.apart,
            "get": primitives.get,
            "put": primitives.put,
            "get_whole": primitives.get_whole,
            "put_whole": primitives.put_whole,
            "select": primitives.select,
            "flip": primitives.flip,
            "fma": primitives.fma,
            "sqrt": primitives.sqrt,
            "fabs": abs,
            "inf": np.inf,
            "nan": np.nan,
        }
        exec(compile(str(source), f"<the equations {system}>", "exec"), names)
        for name in source.parts:
            names[name] = primitives.inlined(names[name])
        for name in [*source.names, "call"]:
            names[name] = primitives.jitted(names[name])
        self.bound = Bound(
            primitives.jitted,
            {
                jit.call: names["call"],
                jit.address: primitives.address,
                jit.fma: primitives.fma,
            },
        )
        self.bound._made[lanes.carry] = self.bound(carry)


@lru_cache
def machinery(system: str) -> Machinery:
    """The machinery of a system."""
    return Machinery(system)
