"""Kernels of the WebAssembly module of a user's system: strides, control steps, pushes, ground.

All data of the walker is in one block of memory, of `block_for` the system's layout. Its constants
and the footholds of a terrain are behind the block.
"""

from __future__ import annotations

import math
from types import FunctionType
from typing import Any

import numpy as np

from gym_passive_walker.engine.compiled import PHASE
from gym_passive_walker.engine.jit import address, call, view
from gym_passive_walker.engine.layout import (
    NARROW,
    PAIR,
    Layout,
    history_for,
    record_for,
    tile_for,
)
from gym_passive_walker.engine.run import OPTIONS, integrate
from gym_passive_walker.envs.constraints import HOOK
from gym_passive_walker.gaits.terrain import ground_at

ADVANCE, LAY_GROUND, PUSH = range(3)
"""Numbers of the kernels, for `run`."""

_HEAD = np.dtype([
    # Addresses of the phases and of their native functions, and how many phases there are.
    ("phases", "i8"), ("hooks", "i8"), ("count", "i8"),
    ("bodies", "i8"), ("constants", "i8"),  # address and number of the body's constants
    ("table", "i8"), ("footholds", "i8"),  # address and number of a terrain's footholds
    ("key", "u8"),  # of random footholds
    ("strides", "i8"),  # since the walk began
    ("slope", "f8"),
    ("impulse", "f8"),  # of a push, positive downhill
])  # fmt: skip
_SPREAD, _NUMBER = _HEAD.itemsize, np.dtype("f8")
_RECORD, _TILE, _HISTORY = record_for(NARROW), tile_for(PAIR, 1), history_for(NARROW)
_RECORD_AT = _OPTIONS_AT = _TILE_AT = _HISTORY_AT = 0


def block_for(layout: Layout) -> np.dtype:
    """Return the layout of the block of memory of one walker."""
    return np.dtype([
        *_HEAD.descr,
        ("spread", "f8", (3,)),  # of a terrain, see `Terrain`
        ("record", record_for(layout)), ("before", record_for(layout)),
        ("options", OPTIONS),
        ("tile", tile_for(PAIR, 1, layout)), ("history", history_for(layout)),
    ])  # fmt: skip


def advance(base):
    """Integrate the record to heelstrike, a fall, or its time limit; see `run.integrate`."""
    head = view(base, (1,), _HEAD)[0]
    integrate(
        view(base + _RECORD_AT, (1, 1), _RECORD),
        view(head.bodies, (1, 1, head.constants), _NUMBER),
        view(head.phases, (head.count,), PHASE),
        view(base + _OPTIONS_AT, (1,), OPTIONS),
        view(base + _TILE_AT, (1,), _TILE),
        view(base + _HISTORY_AT, (1,), _HISTORY),
    )


def lay_ground(base):
    """Set the ground of the stride that begins, as `disturbance_kernels.lay_ground` does."""
    head, record = view(base, (1,), _HEAD)[0], view(base + _RECORD_AT, (1,), _RECORD)[0]
    table, spread = (
        view(head.table, (head.footholds, 2), _NUMBER),
        view(base + _SPREAD, (3,), _NUMBER),
    )
    tilt, rise, turn = ground_at(table, spread, head.key, head.strides)
    slope = head.slope + tilt
    record.ground[0], record.ground[1] = math.sin(slope), math.cos(slope)
    record.ground[2], record.ground[3] = rise, turn


def push(base):
    """Apply the impulse in the block at the centre of mass, along the ground."""
    head, records = view(base, (1,), _HEAD)[0], view(base + _RECORD_AT, (1,), _RECORD)
    native = view(head.hooks, (head.count,), HOOK)[records[0].phase]
    call(native.push, address(records), head.bodies, 0, 0, -head.impulse, 0.0)


def run(what, base):
    """Run one of the functions above on the block at an address."""
    if what == ADVANCE:
        advance(base)
    elif what == LAY_GROUND:
        lay_ground(base)
    else:
        push(base)


def run_for(layout: Layout) -> FunctionType:
    """Return `run` for blocks of a layout, as a plain function."""
    fields: Any = block_for(layout).fields
    names: dict[str, Any] = {
        f"_{name.upper()}_AT": fields[name][1] for name in ("record", "options", "tile", "history")
    }
    names |= {f"_{name.upper()}": fields[name][0] for name in ("record", "tile", "history")}
    parts = {
        part.__name__: FunctionType(part.__code__, globals() | names, part.__name__)
        for part in (advance, lay_ground, push)
    }
    return FunctionType(run.__code__, globals() | parts, run.__name__)
