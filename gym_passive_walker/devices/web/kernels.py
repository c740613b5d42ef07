"""Kernels of a WebAssembly module: strides of one walker, and its episodes in a scene.

All data of the walker is in one block of memory, a `WALK`. The functions are those of the
environments, for a batch of one.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import prod
from typing import Any

import numpy as np

from gym_passive_walker.engine.counter_rng import uniform
from gym_passive_walker.engine.jit import arrays_at, view
from gym_passive_walker.engine.layout import HISTORY, NARROW, PAIR, RECORD, tile_for
from gym_passive_walker.envs import disturbance_kernels, memory, task
from gym_passive_walker.envs.constraints import ROOM
from gym_passive_walker.gaits.scenes import rules
from gym_passive_walker.gaits.scenes.starts import DRAWS
from gym_passive_walker.models.equations.bodies import KneedBody
from gym_passive_walker.models.walkers.walker import PARAMETERS

START = 200
"""Stream of a key from which starts are drawn, as on a GPU."""

MOST_ACTIONS = len(rules.CHANNELS)
LATEST = 64
"""Largest delay of actions, in control steps."""

FARTHEST = 32
"""Largest number of footholds ahead that are observed."""

_ONE_TILE = tile_for(PAIR, width=1)

SHAPE = np.dtype([
    ("parameters", "f8", (len(PARAMETERS),)),  # of the walker, in its own units
    ("angles", "f8", (3,)),  # of stance leg, thigh and shank from the normal of the slope
    ("tilt", "f8"),  # of the foothold beyond the slope
])  # fmt: skip
"""Quantities that determine the positions of a walker's joints."""

POINTS = (
    "hip",
    "stance_knee",
    "stance_foot",
    "stance_tip",
    "swing_knee",
    "swing_foot",
    "swing_tip",
)
"""Points of a walker, each (x, y) from the contact point, in its own units."""

_MOST = {
    "walkers": 1, "rows": 1, "constants": len(KneedBody._fields) + ROOM, "channels": MOST_ACTIONS,
    "delay": LATEST, "seen": rules.SIZE + 2 + 2 * FARTHEST,
}  # fmt: skip
"""Largest lengths of the axes of arrays in the block; those with other axes are elsewhere."""

_ARRAYS = {
    {"records": "record", "disturbances": "disturbance"}.get(name, name): (name, array)
    for name, array in memory.present("disturbed").items()
}
"""Declared arrays, by their names in the block."""


def _in_block() -> Iterator[tuple]:
    """Yield the fields of the declared arrays that the block has."""
    for name, (_, array) in _ARRAYS.items():
        kind, shape = memory.kind_of(array, NARROW), memory.array_shape(array, _MOST)
        if shape is not None:
            # A boolean has a word.
            yield (name, kind) if kind.names else (name, "i8" if kind == "?" else kind, prod(shape))


WALK = np.dtype([
    # Addresses of the phases and of their native functions, and how many phases there are.
    ("phases", "i8"), ("hooks", "i8"), ("count", "i8"),
    ("constants", "i8"),  # of the body, and readings behind them
    ("seen", "i8"),  # numbers in an observation
    ("late", "i8"),  # steps by which actions come late
    ("table", "i8"), ("footholds", "i8"),  # address and number of a terrain's footholds
    ("drawn", "i8"),  # whether starts are drawn by the key, instead of the numbers in `draws`
    ("key", "u8", (1,)),
    ("lanes", "i8", (1,)),
    ("slopes", "f8", (1,)),
    ("gaits", "f8", (1, 6)),
    ("draws", "f8", (1, DRAWS)),
    *_in_block(),
    ("before", RECORD),
    ("shape", SHAPE), ("points", "f8", (2 * len(POINTS),)),
    ("tile", _ONE_TILE),
    ("history", HISTORY),
])  # fmt: skip
"""The block of memory of one walker."""

_NUMBER, _WORD, _KEY = np.dtype("f8"), np.dtype("i8"), np.dtype("u8")
_PLACES: Any = WALK.fields
_AT = {name: int(place[1]) for name, place in _PLACES.items()}
_KEYS, _LANES, _SLOPES, _GAITS, _DRAWS, _TILE, _HISTORY = (
    _AT[name] for name in ("key", "lanes", "slopes", "gaits", "draws", "tile", "history")
)
_HEAD = np.dtype([(name, WALK[name]) for name in WALK.names[: WALK.names.index("key")]])  # type: ignore[index]
_ACTIONS: Any = task.RULES.fields
_LENGTHS = {
    "constants": _AT["constants"], "parts": _AT["count"], "delay": _AT["late"], "seen": _AT["seen"],
    "footholds": _AT["footholds"], "channels": _AT["rules"] + _ACTIONS["actions"][1],
}  # fmt: skip
_WALK = memory.arrays_in(
    "page", {name: array for at, (name, array) in _ARRAYS.items() if at in _AT}, NARROW,
    {name: _AT[at] for at, (name, _) in _ARRAYS.items() if at in _AT}, _LENGTHS,
    _HEAD.names or (),
)  # fmt: skip

ADVANCE, BEGIN, STEP = range(3)
"""Numbers of the kernels, for `run`."""


def advance(base):
    """Integrate the record to heelstrike, a fall, or its time limit; see `run.integrate`."""
    tiles, histories = view(base + _TILE, (1,), _ONE_TILE), view(base + _HISTORY, (1,), HISTORY)
    task.integrate_step(arrays_at(base, _WALK), 0, 1, tiles, histories)


def begin(base):
    """Begin an episode near the given state, with the disturbances of the given key."""
    here, key = arrays_at(base, _WALK), view(base + _KEYS, (1,), _KEY)[0]
    draws = view(base + _DRAWS, (1, DRAWS), _NUMBER)
    for k in range(DRAWS):
        if view(base, (1,), _HEAD)[0].drawn:
            draws[0, k] = uniform(key, k, START)
    lanes, slopes = view(base + _LANES, (1,), _WORD), view(base + _SLOPES, (1,), _NUMBER)
    task.begin(here, lanes, slopes, view(base + _GAITS, (1, 6), _NUMBER), draws)
    disturbance_kernels.begin(here, 0, key)


def step(base):
    """Take a control step by the actions in the block; see `disturbance_kernels.step`."""
    tiles, histories = view(base + _TILE, (1,), _ONE_TILE), view(base + _HISTORY, (1,), HISTORY)
    disturbance_kernels.step(arrays_at(base, _WALK), 0, 1, tiles, histories)


def run(what, base):
    """Run one of the functions above on the block at an address."""
    if what == ADVANCE:
        advance(base)
    elif what == BEGIN:
        begin(base)
    else:
        step(base)
