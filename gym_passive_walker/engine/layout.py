"""Memory layouts of the engine: records and tiles.

A *record* holds all data of a walker between two calls. A *tile* holds the walkers that are being
integrated through a phase: each entry is a row of `WIDTH` lanes. *Planes* of the same layout may
follow a record or a tile; each holds the derivatives along one direction.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gym_passive_walker.engine.native import GROUP
from gym_passive_walker.engine.runge_kutta import Pair
from gym_passive_walker.engine.verner import VERNER
from gym_passive_walker.physics.hybrid import Control, Ground, State

PAIR = VERNER
"""The Runge-Kutta pair."""

WIDTH = 2 * GROUP
"""Walkers in a tile: enough to hide the latency of vector instructions, few enough that a tile fits
in the first-level cache."""

MOST_CONSTANTS = 24
"""Largest number of constants of a body that the equations of one phase use."""

MOST_GUARDS = 16
"""Largest number of guards, coordinates of controls, and conditions of guards in a phase."""

LINKS = 3
_CONTROLS, _GROUND = len(Control._fields), len(Ground._fields)

RECORD = np.dtype(
    [
        ("state", "f8", (len(State._fields),)),
        ("start", "f8", (LINKS,)),  # angles where the stride began
        ("ground", "f8", (_GROUND,)),
        ("control", "f8", (_CONTROLS,)),
        ("push_off", "f8"),
        # Net and total change of each control's coordinate: the work of a unit control.
        ("moved", "f8", (_CONTROLS,)),
        ("turned", "f8", (_CONTROLS,)),
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
    ]
)


def tile_for(pair: Pair, width: int = WIDTH) -> np.dtype:
    """Return the layout of a tile of `width` lanes for a Runge-Kutta pair."""
    line, places = (width,), max(pair.places()) + 1
    return np.dtype(
        [
            ("angle", "f8", (LINKS, *line)),
            ("rate", "f8", (LINKS, *line)),
            ("new_angle", "f8", (LINKS, *line)),
            ("new_rate", "f8", (LINKS, *line)),
            # Of stages from which others start: change of the angles, their sine and cosine.
            ("turn", "f8", (places, LINKS, *line)),
            ("sine", "f8", (places, LINKS, *line)),
            ("cosine", "f8", (places, LINKS, *line)),
            # Accelerations at the step's start, in its stages, and at its end.
            ("stage", "f8", (pair.stages + 1, LINKS, *line)),
            ("stage_rate", "f8", (pair.stages - 1, LINKS, *line)),  # in the stages between
            ("moved", "f8", (_CONTROLS, *line)),
            ("turned", "f8", (_CONTROLS, *line)),
            ("lost", "f8", line),  # to friction
            ("power", "f8", line),  # of friction, mean over the step
            ("ground", "f8", (_GROUND, *line)),
            ("control", "f8", (_CONTROLS, *line)),
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

COURSE = np.dtype(
    [
        # Values and two derivatives at a step's start and end, of each guard, each control's
        # coordinate, and each condition of a guard.
        ("before", "f8", (MOST_GUARDS,)),
        ("rate_before", "f8", (MOST_GUARDS,)),
        ("bend_before", "f8", (MOST_GUARDS,)),
        ("after", "f8", (MOST_GUARDS,)),
        ("rate_after", "f8", (MOST_GUARDS,)),
        ("bend_after", "f8", (MOST_GUARDS,)),
        # Fraction of the step at which each control's coordinate reverses; -1 if it does not.
        ("turning", "f8", (_CONTROLS,)),
        # Predicted impact after the step's end: its time, whether it counts, and the error of the
        # extrapolation, over the tolerance.
        ("late", "f8"),
        ("comes", "f8"),
        ("doubt", "f8"),
        ("counted", "f8"),  # whether the event counts in the step's final state
    ]
)
"""Guards over a step."""


def aligned(layout: np.dtype, planes: int) -> NDArray:
    """Return zeros of a layout, (planes,), aligned to cache lines of 64 bytes."""
    size = layout.itemsize * planes
    buffer = np.zeros(size + 64, np.uint8)
    start = -buffer.ctypes.data % 64
    return buffer[start : start + size].view(layout)
