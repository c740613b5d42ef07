"""Kernels of a WebAssembly module: strides of one walker, and its episodes in a scene.

All data of the walker is in one block of memory, a `WALK`. The functions are those of the
environments, for a batch of one.
"""

from __future__ import annotations

import numpy as np

from gym_passive_walker.engine.compiled import PHASE
from gym_passive_walker.engine.counter_rng import uniform
from gym_passive_walker.engine.jit import view
from gym_passive_walker.engine.layout import HISTORY, PAIR, RECORD, tile_for
from gym_passive_walker.engine.run import OPTIONS, integrate
from gym_passive_walker.envs import disturbance_kernels, task
from gym_passive_walker.envs.constraints import HOOK, ROOM
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

_MOST_SEEN = rules.SIZE + 2 + 2 * FARTHEST
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

WALK = np.dtype([
    # Addresses of the phases and of their native functions, and how many phases there are.
    ("phases", "i8"), ("hooks", "i8"), ("count", "i8"),
    ("constants", "i8"),  # of the body, without the notes behind them
    ("seen", "i8"),  # numbers in an observation
    ("late", "i8"),  # steps by which actions come late
    ("table", "i8"), ("footholds", "i8"),  # address and number of a terrain's footholds
    ("drawn", "i8"),  # whether starts are drawn by the key, instead of the numbers in `draws`
    ("key", "u8", (1,)),
    ("lanes", "i8", (1,)),
    ("slopes", "f8", (1,)),
    ("gaits", "f8", (1, 6)),
    ("draws", "f8", (1, DRAWS)),
    ("reset_noise_scale", "f8"),
    ("actions", "f8", (MOST_ACTIONS,)),
    ("rewards", "f8", (1,)),
    ("terminated", "i8", (1,)),
    ("truncated", "i8", (1,)),
    ("observations", "f4", (_MOST_SEEN,)),
    ("record", RECORD), ("before", RECORD), ("blank", RECORD),
    ("bodies", "f8", (len(KneedBody._fields) + ROOM,)),
    ("radii", "f8", (1,)),
    ("ledger", task.LEDGER), ("blank_row", task.LEDGER),
    ("rules", task.RULES),
    ("options", OPTIONS),
    ("disturbance", disturbance_kernels.DISTURBANCE),
    ("settings", disturbance_kernels.SETTINGS),
    ("pending", "f8", (LATEST * MOST_ACTIONS,)),
    ("spread", "f8", (3,)),
    ("shape", SHAPE), ("points", "f8", (2 * len(POINTS),)),
    ("tile", _ONE_TILE),
    ("history", HISTORY),
])  # fmt: skip
"""The block of memory of one walker."""

_NUMBER, _SINGLE, _BOOLEAN, _WORD = np.dtype("f8"), np.dtype("f4"), np.dtype("?"), np.dtype("i8")
_KEY, _LEDGER, _RULES, _DISTURBANCE, _SETTINGS = (
    np.dtype("u8"),
    task.LEDGER,
    task.RULES,
    disturbance_kernels.DISTURBANCE,
    disturbance_kernels.SETTINGS,
)
_AT = {name: int(place[1]) for name, place in WALK.fields.items()}  # type: ignore[union-attr]
(
    _KEYS, _LANES, _SLOPES, _GAITS, _DRAWS, _ACTIONS, _REWARDS, _TERMINATED, _TRUNCATED,
    _OBSERVATIONS, _RECORD, _BLANK, _BODIES, _RADII, _ROW, _BLANK_ROW, _SCENE_RULES, _OPTIONS_AT,
    _WALKS_DISTURBANCE, _SCENE_SETTINGS, _PENDING, _SPREAD, _TILE, _HISTORY,
) = (
    _AT[name] for name in (
        "key", "lanes", "slopes", "gaits", "draws", "actions", "rewards", "terminated", "truncated",
        "observations", "record", "blank", "bodies", "radii", "ledger", "blank_row", "rules",
        "options", "disturbance", "settings", "pending", "spread", "tile", "history",
    )
)  # fmt: skip
_HEAD = np.dtype([(name, WALK[name]) for name in WALK.names[: WALK.names.index("key")]])  # type: ignore[index]
_NOISE = _AT["reset_noise_scale"]

ADVANCE, BEGIN, STEP = range(3)
"""Numbers of the kernels, for `run`."""


def advance(base):
    """Integrate the record to heelstrike, a fall, or its time limit; see `run.integrate`."""
    head = view(base, (1,), _HEAD)[0]
    integrate(
        view(base + _RECORD, (1, 1), RECORD),
        view(base + _BODIES, (1, 1, head.constants), _NUMBER),
        view(head.phases, (head.count,), PHASE),
        view(base + _OPTIONS_AT, (1,), OPTIONS),
        view(base + _TILE, (1,), _ONE_TILE),
        view(base + _HISTORY, (1,), HISTORY),
    )


def begin(base):
    """Begin an episode near the given state, with the disturbances of the given key."""
    head = view(base, (1,), _HEAD)[0]
    records, ledger = view(base + _RECORD, (1, 1), RECORD), view(base + _ROW, (1,), _LEDGER)
    bodies = view(base + _BODIES, (1, 1, head.constants + ROOM), _NUMBER)
    lanes, observations = (
        view(base + _LANES, (1,), _WORD),
        view(base + _OBSERVATIONS, (head.seen,), _SINGLE),
    )
    phases, settings = (
        view(head.phases, (head.count,), PHASE),
        view(base + _SCENE_SETTINGS, (1,), _SETTINGS),
    )
    disturbance = view(base + _WALKS_DISTURBANCE, (1,), _DISTURBANCE)
    table = view(head.table, (head.footholds, 2), _NUMBER)
    spread = view(base + _SPREAD, (3,), _NUMBER)
    count = view(base + _SCENE_RULES, (1,), _RULES)[0].actions
    keys, draws = view(base + _KEYS, (1,), _KEY), view(base + _DRAWS, (1, DRAWS), _NUMBER)
    for k in range(DRAWS):
        if head.drawn:
            draws[0, k] = uniform(keys[0], k, START)
    records[0, 0] = view(base + _BLANK, (1,), RECORD)[0]
    ledger[0] = view(base + _BLANK_ROW, (1,), _LEDGER)[0]
    task.begin(
        records, bodies, view(base + _RADII, (1,), _NUMBER), ledger, phases, lanes,
        view(base + _SLOPES, (1,), _NUMBER), view(base + _GAITS, (1, 6), _NUMBER),
        draws, view(base + _NOISE, (1,), _NUMBER)[0], observations,
    )  # fmt: skip
    disturbance_kernels.begin(
        disturbance, settings, lanes, keys,
        view(base + _PENDING, (1, head.late, count), _NUMBER), records, ledger, table, spread,
    )  # fmt: skip
    disturbance_kernels.add_observation_noise(
        disturbance[0], ledger[0], settings[0], table, spread, observations, 0
    )


def step(base):
    """Take a control step by the actions in the block; see `disturbance_kernels.step`."""
    head = view(base, (1,), _HEAD)[0]
    rules = view(base + _SCENE_RULES, (1,), _RULES)
    count = rules[0].actions
    disturbance_kernels.step(
        view(base + _RECORD, (1, 1), RECORD),
        view(base + _BODIES, (1, 1, head.constants + ROOM), _NUMBER),
        view(base + _ROW, (1,), _LEDGER), rules, view(head.phases, (head.count,), PHASE),
        view(base + _OPTIONS_AT, (1,), OPTIONS), view(base + _TILE, (1,), _ONE_TILE),
        view(base + _HISTORY, (1,), HISTORY), view(base + _WALKS_DISTURBANCE, (1,), _DISTURBANCE),
        view(base + _PENDING, (1, head.late, count), _NUMBER),
        view(base + _SCENE_SETTINGS, (1,), _SETTINGS), view(head.hooks, (head.count,), HOOK),
        view(head.table, (head.footholds, 2), _NUMBER), view(base + _SPREAD, (3,), _NUMBER),
        view(base + _ACTIONS, (count,), _NUMBER),
        view(base + _OBSERVATIONS, (head.seen,), _SINGLE),
        view(base + _REWARDS, (1,), _NUMBER), view(base + _TERMINATED, (1,), _BOOLEAN),
        view(base + _TRUNCATED, (1,), _BOOLEAN),
    )  # fmt: skip


def run(what, base):
    """Run one of the functions above on the block at an address."""
    if what == ADVANCE:
        advance(base)
    elif what == BEGIN:
        begin(base)
    else:
        step(base)
