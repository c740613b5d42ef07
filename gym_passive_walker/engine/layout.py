"""Memory layouts of the engine: records and tiles.

A *record* holds all data of a walker between two calls. A *tile* holds the walkers that are being
integrated through a phase: each entry is a row of `WIDTH` lanes. *Planes* of the same layout may
follow a record or a tile; each holds the derivatives along one direction.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gym_passive_walker.engine.native import GROUP
from gym_passive_walker.engine.runge_kutta import Pair
from gym_passive_walker.engine.verner import VERNER
from gym_passive_walker.models.equations.hybrid import Control, Ground, State, System

PAIR = VERNER
"""The Runge-Kutta pair."""

WIDTH = 2 * GROUP
"""Walkers in a tile: enough to hide the latency of vector instructions, few enough that a tile fits
in the first-level cache."""

MOST_CONSTANTS = 24
"""Largest number of constants of a body that the equations of one phase use."""

MOST_GUARDS = 16
"""Largest number of guards, coordinates of controls, and conditions of guards in a phase."""

_GROUND = len(Ground._fields)


class Layout(NamedTuple):
    """The room that records and tiles have for a system.

    Attributes:
        links: Number of coordinates; a state has the coordinates, then their rates.
        controls: Number of controls.
        rows: Rows of a guard history: guards, coordinates of controls, and conditions of guards.
    """

    links: int
    controls: int
    rows: int


NARROW = Layout(len(State._fields) // 2, len(Control._fields), MOST_GUARDS)
"""Layout of walkers with two legs, and of systems that need no more room."""

WIDE = Layout(8, 8, MOST_GUARDS + 8)
"""Layout of all other systems."""


def layout_of(system: System) -> Layout:
    """Return the smallest layout with room for a system."""
    needed = len(system.State._fields) // 2, len(system.Control._fields)  # type: ignore[attr-defined]
    return NARROW if needed[0] <= NARROW.links and needed[1] <= NARROW.controls else WIDE


@cache
def record_for(layout: Layout) -> np.dtype:
    """The layout of a record: what the engine knows of one walker."""
    links, controls = layout.links, layout.controls
    return np.dtype([
        ("state", "f8", (2 * links,)),
        ("start", "f8", (links,)),  # angles where the stride began
        ("ground", "f8", (_GROUND,)),
        ("control", "f8", (controls,)),
        ("push_off", "f8"),
        # What each control has moved, net and either way: the work of a unit control.
        ("moved", "f8", (controls,)),
        ("turned", "f8", (controls,)),
        ("time", "f8"),
        ("end", "f8"),  # when to stop
        ("step", "f8"),  # proposed length of the next integration step
        ("knee_time", "f8"),
        ("knee_loss", "f8"),
        ("heel_loss", "f8"),
        ("friction_loss", "f8"),
        ("step_length", "f8"),  # of the stride that a heelstrike has ended
        ("gravity_work", "f8"),  # in it
        ("spring_work", "f8"),
        ("push_work", "f8"),
        ("place", "f8"),  # of the hip, from its place at stance angle 0
        ("passed", "f8"),  # place of the hip over the old foot at the last heelstrike
        ("phase", "i8"),  # index in the system's phases
        ("outcome", "i8"),
        ("steps", "i8"),  # integration steps tried
    ])  # fmt: skip


RECORD = record_for(NARROW)


@cache
def layout_in(records: np.dtype) -> Layout:
    """The layout of records of a type."""
    return NARROW if records == RECORD else WIDE


@cache
def tile_for(pair: Pair, width: int = WIDTH, layout: Layout = NARROW) -> np.dtype:
    """The layout of a tile for steps made with a method, of as many walkers as it is wide."""
    line, places = (width,), max(pair.places()) + 1
    links, controls = layout.links, layout.controls
    return np.dtype(
        [
            ("angle", "f8", (links, *line)),
            ("rate", "f8", (links, *line)),
            ("new_angle", "f8", (links, *line)),
            ("new_rate", "f8", (links, *line)),
            # Of stages near which others follow: how far angles have turned, their sine and cosine.
            ("turn", "f8", (places, links, *line)),
            ("sine", "f8", (places, links, *line)),
            ("cosine", "f8", (places, links, *line)),
            # Accelerations at the step's start, in its stages, and at its end.
            ("stage", "f8", (pair.stages + 1, links, *line)),
            ("stage_rate", "f8", (pair.stages - 1, links, *line)),  # in the stages between
            ("moved", "f8", (controls, *line)),
            ("turned", "f8", (controls, *line)),
            ("lost", "f8", line),  # to friction
            ("power", "f8", line),  # of friction, mean over the step
            ("ground", "f8", (_GROUND, *line)),
            ("control", "f8", (controls, *line)),
            ("body", "f8", (MOST_CONSTANTS, *line)),
            ("h", "f8", line),  # length of the step
            ("ahead", "f8", line),  # predicted time of the impact after its end; 0 if not near
            ("next", "f8", line),  # proposed length of the next step
            ("time", "f8", line),
            ("end", "f8", line),
            ("error", "f8", line),  # of the step, over the tolerance
            ("growth", "f8", line),  # factor to the next step's length
            ("verdict", "f8", line),
            ("event", "f8", line),  # the guard that the step is aimed at, from 1 on
            ("low", "f8", line),  # bracket of that event's time
            ("high", "f8", line),
            ("steps", "f8", line),
            ("fresh", "f8", line),  # whether the walker has just been loaded
        ]
    )


TILE = tile_for(PAIR)


@cache
def history_for(layout: Layout) -> np.dtype:
    """Return the layout of a guard history: guards and their rates at both ends of a step."""
    rows = (layout.rows,)
    return np.dtype([
        # Guards, coordinates of controls and conditions of guards, at both ends of a step.
        ("before", "f8", rows),
        ("rate_before", "f8", rows),
        ("bend_before", "f8", rows),
        ("after", "f8", rows),
        ("rate_after", "f8", rows),
        ("bend_after", "f8", rows),
        # Fraction of the step at which the coordinate of a control reverses; or -1.
        ("turning", "f8", (layout.controls,)),
        # Predicted strike: time after the end of the step, whether it counts, and the error of the
        # prediction over the tolerance.
        ("late", "f8"),
        ("comes", "f8"),
        ("doubt", "f8"),
        ("counted", "f8"),  # whether the event counts in the state at the end of the step
    ])  # fmt: skip


HISTORY = history_for(NARROW)


def aligned(layout: np.dtype, count: int) -> NDArray:
    """Return zeros of a layout, (count,), in cache lines of 64 bytes that hold nothing else."""
    size = layout.itemsize * count
    buffer = np.zeros(size + 128, np.uint8)
    start = -buffer.ctypes.data % 64
    return buffer[start : start + size].view(layout)
