"""Memory of a batch of walkers: its arrays, each declared once.

Compiled code takes `(here, first, last)`: the arrays as attributes, and the walkers to work on,
from `first` to before `last`. On a CPU `here` is an address, elsewhere a named tuple. Arrays in
memory, their addresses for compiled code, saved states with their limits, and the arrays on a GPU
and in a page come from this declaration.
"""

from __future__ import annotations

from collections import namedtuple
from collections.abc import Container, Mapping
from functools import cache
from math import inf, prod
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gym_passive_walker.engine.compiled import PHASE
from gym_passive_walker.engine.jit import Arrays
from gym_passive_walker.engine.lanes import RESTING
from gym_passive_walker.engine.layout import NARROW, Layout, record_for
from gym_passive_walker.engine.run import OPTIONS
from gym_passive_walker.envs.constraints import HOOK
from gym_passive_walker.envs.disturbance_kernels import DISTURBANCE, SETTINGS
from gym_passive_walker.envs.task import EVERY_STRIDE, ledger_for, rules_for
from gym_passive_walker.envs.transitions import USER_RULES, note_for
from gym_passive_walker.models.equations.hybrid import Outcome

FINITE = -float(np.finfo(float).max), float(np.finfo(float).max)
"""Limits of a finite number."""

COUNTER = 0, 2**53
"""Limits of a number of events."""

_TIME, _STEPS, _REASON = (0.0, "max_stride_time"), (0, "steps"), (0, "reason")


class BatchArray(NamedTuple):
    """Declaration of an array.

    Attributes:
        kind: Data type, or the function that returns it for a layout.
        axes: Length of each axis: a number, a name in AXES, or a product of them.
        needs: Feature of the scenes that have it: "disturbed", "custom", or "" for all.
        limits: Smallest and largest value in a saved state: numbers, or names in
            `saved.limits_of`, by field, or by the name of an array without fields. Other fields
            must be finite; None is no limit. None for an array that is not saved.
    """

    kind: Any
    axes: str
    needs: str = ""
    limits: Mapping[str, tuple[Any, Any] | None] | None = None


ARRAYS = {
    "records": BatchArray(record_for, "walkers 1", limits={
        "phase": (0, "phase"), "outcome": (RESTING, len(Outcome) - 1), "steps": COUNTER,
        "time": _TIME, "knee_time": _TIME, "end": _TIME, "step": (0.0, FINITE[1]),
        "control": ("lowest", "largest"), "push_off": (0.0, "push_off"),
    }),
    "bodies": BatchArray("f8", "rows 1 constants"),
    "radii": BatchArray("f8", "rows"),  # of the feet, in leg lengths
    "ledger": BatchArray(ledger_for, "walkers", limits=dict.fromkeys(EVERY_STRIDE) | {
        "outcome": _REASON, "ending": _REASON, "violated": _REASON, "truncated": (0, 1),
        "steps": _STEPS, "strides": _STEPS,
    }),
    "blank": BatchArray(record_for, "1"),  # record and row of the ledger as an episode begins
    "blank_row": BatchArray(ledger_for, "1"),
    "rules": BatchArray(rules_for, "1"),
    "phases": BatchArray(PHASE, "parts"),
    "options": BatchArray(OPTIONS, "1"),
    "slope_range": BatchArray("f8", "2"),  # smallest and largest slope at a start, in rad
    "nodes": BatchArray("f8", "known"),  # slopes in rad with known initial states
    "states": BatchArray("f8", "known numbers"),  # these states
    "actions": BatchArray("f8", "walkers*channels"),
    "observations": BatchArray("f4", "walkers*seen"),
    "rewards": BatchArray("f8", "walkers"),
    "terminated": BatchArray("?", "walkers"),
    "truncated": BatchArray("?", "walkers"),
    "notes": BatchArray(note_for, "walkers", "custom", dict.fromkeys(note_for(NARROW).names or ())),
    "own": BatchArray(USER_RULES, "1", "custom"),
    "disturbances": BatchArray(DISTURBANCE, "walkers", "disturbed", {
        "pushes": COUNTER, "idle": (0, 1), "command": ("slowest", "fastest"), "due": (-inf, inf),
        "delay": (0, "delay"), "strength": (0.0, 1.0),
    }),
    "pending": BatchArray("f8", "walkers delay channels", "disturbed", {"pending": (-1.0, 1.0)}),
    "acted": BatchArray("f8", "walkers*channels", "disturbed"),  # delayed actions with noise
    "settings": BatchArray(SETTINGS, "1", "disturbed"),
    "hooks": BatchArray(HOOK, "parts", "disturbed"),
    "table": BatchArray("f8", "footholds 2", "disturbed"),
    "spread": BatchArray("f8", "3", "disturbed"),
}  # fmt: skip
"""Arrays of a batch, by name."""

COMPILED = "phases", "hooks", "own"
"""Arrays with addresses of code, which no other process has."""

AXES = sorted({
    name for array in ARRAYS.values() for name in array.axes.replace("*", " ").split()
    if not name.isdigit()
})  # fmt: skip
"""Names of lengths: `walkers`; `rows` of constants, 1 for equal walkers; `constants` of a walker;
`parts`, phases of the system; `known` slopes with initial states of `numbers`; `channels`, actions
of the scene, which are late by a `delay` in steps; numbers `seen` in an observation; `footholds`
of a terrain."""


def present(*features: str) -> dict[str, BatchArray]:
    """Return the arrays of scenes with some features, by name."""
    return {name: array for name, array in ARRAYS.items() if array.needs in ("", *features)}


@cache
def named_arrays(names: tuple[str, ...]) -> Any:
    """Return the type of `here`: a named tuple of arrays."""
    return namedtuple("Here", names)


def array_shape(array: BatchArray, lengths: Mapping[str, int]) -> tuple[int, ...] | None:
    """Return the shape of an array from the lengths of axes; None if one is unknown."""
    axes = [axis.split("*") for axis in array.axes.split()]
    if not all(factor.isdigit() or factor in lengths for axis in axes for factor in axis):
        return None
    return tuple(prod(int(lengths.get(factor, factor)) for factor in axis) for axis in axes)


def made(
    arrays: Mapping[str, BatchArray],
    layout: Layout,
    lengths: Mapping[str, int],
    given: Mapping[str, Any],
) -> dict[str, NDArray]:
    """Return arrays by name: given ones, and zeros of the declared shapes.

    Args:
        arrays: Their declarations; those of unknown length are left out.
        layout: Layout of the records.
        lengths: Lengths of axes, by name.
        given: Arrays with content, by name.
    """
    found = {}
    for name, array in arrays.items():
        shape = array_shape(array, lengths)
        if name in given:
            found[name] = given[name]
        elif shape is not None:
            found[name] = np.zeros(shape, kind_of(array, layout))
    return found


def kind_of(array: BatchArray, layout: Layout) -> np.dtype:
    """Return the data type of an array for records of a layout."""
    kind: Any = array.kind(layout) if callable(array.kind) else array.kind
    return np.dtype(kind)


def arrays_in(
    kind: str,
    arrays: Mapping[str, BatchArray],
    layout: Layout,
    places: Mapping[str, int],
    lengths: Mapping[str, int],
    apart: Container[str],
) -> Arrays:
    """Return arrays of a block of memory for compiled code, by offsets in bytes.

    Args:
        kind: Name of their type in compiled code.
        arrays: Their declarations.
        layout: Layout of the records.
        places: Offset of each array, or of a word with its address.
        lengths: Offsets of words with the lengths of axes; other axes have length 1.
        apart: Names of the arrays that have such words.
    """

    def length(axis: str) -> tuple[int, list[int]]:
        number = int(axis) if axis.isdigit() else 1
        return number, [lengths[name] for name in axis.split("*") if name in lengths]

    return Arrays(kind, {
        name: (kind_of(array, layout), places[name], name in apart,
               [length(axis) for axis in array.axes.split()])
        for name, array in arrays.items()
    })  # fmt: skip
