"""Results of control steps, recorded for each walker as arguments of users' functions.

Fields that no function reads are not recorded.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from gym_passive_walker.engine.jit import Kernel, address, call, entry, jitted
from gym_passive_walker.engine.lanes import RESTING
from gym_passive_walker.engine.layout import NARROW, Layout
from gym_passive_walker.gaits.scenes.checks import CHECKS
from gym_passive_walker.gaits.scenes.rules import clip, work_of
from gym_passive_walker.gaits.scenes.transition import Transition
from gym_passive_walker.models.equations.hybrid import Outcome

STOPPED = len(Outcome) + len(CHECKS)
"""Outcome of an episode that the scene's own `terminated` ends."""

TIMED_OUT = STOPPED + 1
"""Outcome, in `info` alone, of an episode that the time limit ends."""

_HEELSTRIKE = int(Outcome.HEELSTRIKE)


BOOLEANS = ("knee_locked", "heelstrike", "fell")
"""Boolean fields; recorded as 1 or 0."""

SEVERAL = ("before", "state", "action", "last_action")
"""Fields of several numbers."""

OF_LEDGER = (
    "distance", "energy", "heelstrike", "fell", "step_length", "step_period", "strides", "steps",
    "slope", "reward",
)  # fmt: skip
"""Fields of the ledger; compiled rewards and terminations read them there."""

PARTS = (
    OF_LEDGER,
    ("before", "state", "knee_locked", "height_change", "slope_change"),
    ("action", "last_action"),
    ("hip_work", "hip_work_absolute", "ankle_work", "ankle_work_absolute", "push_off_work"),
    ("duration", "time", "collision_loss"),
)
"""Groups of fields that are recorded together: the bits of `noted`."""


@cache
def note_for(layout: Layout) -> np.dtype:
    """Return the data type of a recorded transition and of the results of its functions."""
    state, action = (2 * layout.links,), (layout.controls + 1,)
    sizes = {"before": state, "state": state, "action": action, "last_action": action}
    return np.dtype(
        [(name, "f8", sizes.get(name, ())) for name in Transition._fields]
        + [
            ("began", "f8"),  # time since the stride began, before the step
            ("lost", "f8"),  # energy / (m g l) lost at kneestrike in the stride, before the step
            ("paid", "f8"),  # result of `reward`
            ("ends", "f8"),  # result of `terminated`
        ]
    )


NOTE = note_for(NARROW)

USER_RULES = np.dtype([
    ("noted", "i8"),  # groups of PARTS to record, as bits
    ("paid", "i8"), ("ends", "i8"), ("look", "i8"),  # addresses of compiled functions; or 0
    ("native", "i8"),  # whether reward and termination are compiled, so that `after` applies them
])  # fmt: skip
"""Users' functions of a scene."""

_LEDGER, _STATES, _ACTS, _WORKS, _TIMES = (1 << part for part in range(len(PARTS)))


@jitted
def begin(here, lanes):
    """Clear the transitions of walkers at the beginning of their episodes."""
    for j in range(len(lanes)):
        i = lanes[j]
        note, record = here.notes[i], here.records[i, 0]
        for k in range(len(record.state)):
            note.before[k] = record.state[k]
            note.state[k] = record.state[k]
        for k in range(len(record.control) + 1):
            note.action[k], note.last_action[k] = 0.0, 0.0
        note.knee_locked = 1.0 * here.phases[record.phase].knee_locked
        note.distance, note.duration, note.time, note.energy = 0.0, 0.0, 0.0, 0.0
        note.reward, note.hip_work, note.hip_work_absolute = 0.0, 0.0, 0.0
        note.ankle_work, note.ankle_work_absolute, note.push_off_work = 0.0, 0.0, 0.0
        note.collision_loss, note.heelstrike, note.fell = 0.0, 0.0, 0.0
        note.step_length, note.step_period = 0.0, 0.0
        note.strides, note.steps, note.push, note.slope = 0.0, 0.0, 0.0, here.ledger[i].slope
        note.height_change, note.slope_change = record.ground[2], record.ground[3]


@jitted
def before(here, first, last):
    """Record the states before a step."""
    if here.own[0].noted & (_STATES | _TIMES) == 0:
        return
    for i in range(first, last):
        note, record = here.notes[i], here.records[i, 0]
        for k in range(len(record.state)):
            note.before[k] = record.state[k]
        note.began, note.lost = record.time, record.knee_loss / here.rules[0].weight


def note_ledger(note, row, struck):
    """Record the fields in OF_LEDGER."""
    note.distance, note.energy, note.reward = row.distance, row.energy, row.reward
    note.heelstrike, note.fell = 1.0 if struck else 0.0, 1.0 if row.ending != 0 else 0.0
    note.step_length = row.step_length if struck else 0.0
    note.step_period = row.step_period if struck else 0.0
    note.strides, note.steps, note.slope = row.strides, row.steps, row.slope


def evaluate_rules(here, first, last):
    """Evaluate compiled functions for the walkers from `first` to before `last`."""
    if first < last:
        rows, notes = entry(here.ledger, first), entry(here.notes, first)
        if here.own[0].paid != 0:
            call(here.own[0].paid, rows, notes, last - first, 0, 0.0, 0.0)
        if here.own[0].ends != 0:
            call(here.own[0].ends, rows, notes, last - first, 0, 0.0, 0.0)


@jitted
def note_step(here, i):
    """Record a step of a walker."""
    noted, rules, count = here.own[0].noted, here.rules[0], here.rules[0].actions
    if noted == 0:
        return
    record, row, note = here.records[i, 0], here.ledger[i], here.notes[i]
    struck = row.outcome == _HEELSTRIKE
    if noted & _LEDGER:
        note_ledger(note, row, struck)
    if noted & _STATES:
        for k in range(len(record.state)):
            note.state[k] = record.state[k]
        note.knee_locked = 1.0 * here.phases[record.phase].knee_locked
        note.height_change, note.slope_change = record.ground[2], record.ground[3]
    if noted & _ACTS:
        for j in range(count):
            note.last_action[j] = note.action[j]
            least = 0.0 if rules.channels[j] == len(record.control) else -1.0
            note.action[j] = clip(here.actions[i * count + j], least, 1.0)
    if noted & _WORKS:
        torque = record.control[0] * rules.works[0]
        net, absolute = work_of(torque, record.moved[0], record.turned[0])
        note.hip_work, note.hip_work_absolute = net, absolute
        torque = record.control[1] * rules.works[1]
        net, absolute = work_of(torque, record.moved[1], record.turned[1])
        note.ankle_work, note.ankle_work_absolute = net, absolute
        pushes = struck and rules.largest[len(record.control)] != 0.0
        note.push_off_work = record.push_work if pushes else 0.0
    if noted & _TIMES:
        note.duration = (row.step_period if struck else record.time) - note.began
        note.time = row.clock + record.time
        lost = row.collision_cost * row.step_length if struck else record.knee_loss / rules.weight
        note.collision_loss = lost - note.lost


@jitted
def after(here, first, last):
    """Record a step, and evaluate the compiled functions of reward and termination.

    Returns the number of episodes that end.
    """
    own, waiting = here.own[0], first
    for i in range(first, last):
        if here.records[i, 0].outcome == RESTING:
            evaluate_rules(here, waiting, i)
            waiting = i + 1
        else:
            note_step(here, i)
    evaluate_rules(here, waiting, last)
    return enter(here, first, last, own.paid != 0, own.ends != 0) if own.native else 0


@jitted
def enter(here, first, last, pays, stops):
    """Apply rewards and terminations in the notes; returns the number of episodes that end."""
    endings = 0
    for i in range(first, last):
        if here.records[i, 0].outcome == RESTING:
            continue
        row, note = here.ledger[i], here.notes[i]
        if pays:
            row.total += note.paid - row.reward
            row.reward = note.paid
            here.rewards[i] = note.paid
        if stops and note.ends != 0.0 and row.ending == 0:
            row.ending = STOPPED
            if row.outcome == 0:
                row.outcome = STOPPED
            here.terminated[i] = True
            endings += 1 - row.truncated
    return endings


@Kernel
def look(notes, function, numbers):
    """Write observations, (n, size), from a compiled function."""
    if len(notes) > 0:
        call(function, entry(notes, 0), address(numbers), len(notes), 0, 0.0, 0.0)
