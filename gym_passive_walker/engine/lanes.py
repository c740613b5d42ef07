"""Carrying walkers through one phase, each with its own time and step, to its event.

Lanes whose walker is done are filled from the records still waiting, so no lane waits for another.
Lanes are filled in whole groups of `GROUP`, so every walker passes through the same instructions
wherever it stands: its trajectory is bitwise the same alone and in any crowd.
"""

from __future__ import annotations

import numpy as np

from gym_passive_walker.engine.jit import address, call, inlined, jitted
from gym_passive_walker.engine.landing import TIME_UP, attend, go_on, look
from gym_passive_walker.engine.layout import WIDTH
from gym_passive_walker.engine.native import GROUP
from gym_passive_walker.engine.step import ALERT, UP
from gym_passive_walker.physics.hybrid import Control, Ground, Outcome

_CONTROLS, _GROUND = len(Control._fields), len(Ground._fields)
_DIVERGED = int(Outcome.DIVERGED)
_LINE = 8 * GROUP  # bytes from one group of a tile's lanes to the next

WAITING, HALTED = int(Outcome.RUNNING), -1
"""Outcomes of a record that is to be carried on, and of one whose time is up."""


@inlined
def equip(tiles, lane, phase, body):
    """Give a lane its walker's constants."""
    for plane in range(len(tiles)):
        for i in range(phase.constants):
            tiles[plane].body[i, lane] = body[plane, phase.uses[i]]


@jitted
def load(tiles, lane, phase, record, first_step):
    """Put a walker into a lane."""
    for plane in range(len(tiles)):
        tile, given = tiles[plane], record[plane]
        for i in range(3):
            tile.angle[i, lane] = given.state[i]
            tile.rate[i, lane] = given.state[3 + i]
        for i in range(_GROUND):
            tile.ground[i, lane] = given.ground[i]
        for i in range(_CONTROLS):
            tile.control[i, lane] = given.control[i]
            tile.moved[i, lane] = 0.0
            tile.turned[i, lane] = 0.0
        tile.time[lane] = given.time
        tile.end[lane] = given.end
        tile.h[lane] = 0.0
    tile, given = tiles[0], record[0]
    tile.event[lane] = 0.0
    tile.steps[lane] = 0.0
    tile.fresh[lane] = 1.0
    tile.next[lane] = given.step if given.step > 0.0 else first_step
    go_on(tile, lane)


@jitted
def unload(tiles, courses, lane, phase, record, event):
    """Take a walker that is done out of its lane."""
    if event == TIME_UP and len(tiles) > 1:
        look(tiles, courses, phase, lane)
        follow_end(tiles, courses[0], lane, phase)
    for plane in range(len(tiles)):
        tile, given = tiles[plane], record[plane]
        for i in range(3):
            link = min(i, phase.links - 1)  # the shank of a straight leg goes with the thigh
            given.state[i] = tile.angle[link, lane]
            given.state[3 + i] = tile.rate[link, lane]
        for i in range(_CONTROLS):
            given.moved[i] += tile.moved[i, lane]
            given.turned[i] += tile.turned[i, lane]
        given.time = tile.end[lane] if event == TIME_UP else tile.time[lane]
    given = record[0]
    given.step = tiles[0].next[lane]
    given.steps += int(tiles[0].steps[lane])
    if event > 0:
        given.outcome = phase.outcomes[event - 1]
    else:
        given.outcome = HALTED if event == TIME_UP else _DIVERGED


@jitted
def follow_end(tiles, course, lane, phase):
    """Have derivatives follow the time's end, which they reach sooner or later than the value."""
    tile = tiles[0]
    for plane in range(1, len(tiles)):
        change = tiles[plane]
        late = change.end[lane] - change.time[lane]
        for i in range(phase.links):
            change.angle[i, lane] += late * tile.rate[i, lane]
            change.rate[i, lane] += late * tile.stage[0, i, lane]
        for k in range(_CONTROLS):
            rate = course.rate_after[phase.guards + k]
            change.moved[k, lane] += late * rate
            change.turned[k, lane] += late * abs(rate)


@jitted
def move(tiles, source, target):
    """Move a walker from one lane to another; the stages between a step's ends are spent."""
    for plane in range(len(tiles)):
        tile = tiles[plane]
        for i in range(3):
            tile.angle[i, target] = tile.angle[i, source]
            tile.rate[i, target] = tile.rate[i, source]
            tile.new_angle[i, target] = tile.new_angle[i, source]
            tile.new_rate[i, target] = tile.new_rate[i, source]
            tile.stage[0, i, target] = tile.stage[0, i, source]
            tile.stage[-1, i, target] = tile.stage[-1, i, source]
        for i in range(_CONTROLS):
            tile.moved[i, target] = tile.moved[i, source]
            tile.turned[i, target] = tile.turned[i, source]
            tile.control[i, target] = tile.control[i, source]
        for i in range(_GROUND):
            tile.ground[i, target] = tile.ground[i, source]
        for i in range(len(tile.body)):
            tile.body[i, target] = tile.body[i, source]
        tile.h[target] = tile.h[source]
        tile.next[target] = tile.next[source]
        tile.time[target] = tile.time[source]
        tile.end[target] = tile.end[source]
    tile = tiles[0]
    tile.error[target] = tile.error[source]
    tile.verdict[target] = tile.verdict[source]
    tile.event[target] = tile.event[source]
    tile.low[target] = tile.low[source]
    tile.high[target] = tile.high[source]
    tile.steps[target] = tile.steps[source]
    tile.fresh[target] = tile.fresh[source]


@inlined
def next_waiting(records, index, phase):
    """The first record from an index on that waits for a phase; their number if none does."""
    while index < len(records):
        if records[index, 0].phase == phase and records[index, 0].outcome == WAITING:
            break
        index += 1
    return index


@jitted
def carry(records, bodies, phase, number, tiles, courses, options):
    """Take every record that waits in a phase through it: to its event, or to its time's end.

    Records with an outcome other than RUNNING are left alone; the outcome becomes an `Outcome`, or
    HALTED where the time is up.

    Args:
        records: Shape (n, planes).
        bodies: Walkers' constants, (1 or n, planes, constants).
        phase: A `compiled.PHASE`.
        number: Its place in the system.
        tiles: Shape (planes,).
        courses: Shape (planes,).
        options: An `OPTIONS`.
    """
    owner = np.empty(WIDTH, np.int64)
    origin, alike = address(tiles), len(bodies) == 1
    waiting, used, fresh = 0, 0, False
    if alike:  # they stay
        for lane in range(WIDTH):
            equip(tiles, lane, phase, bodies[0])
    while True:
        lane = 0
        while lane < used:
            event, verdict = 0, tiles[0].verdict[lane]
            if verdict == ALERT:
                event = attend(tiles, courses, phase, lane, options.scuff, options.landing)
            elif verdict == UP:
                event = TIME_UP
            if event == 0:
                lane += 1
                continue
            unload(tiles, courses, lane, phase, records[owner[lane]], event)
            owner[lane] = -1
            lane += 1
        # Fill what is free from those who wait, or from the last lanes in use.
        lane = 0
        while lane < WIDTH:
            if lane >= used or owner[lane] < 0:
                waiting = next_waiting(records, waiting, number)
                if waiting < len(records):
                    if not alike:
                        equip(tiles, lane, phase, bodies[waiting])
                    load(tiles, lane, phase, records[waiting], options.first_step)
                    owner[lane] = waiting
                    waiting += 1
                    used = max(used, lane + 1)
                    fresh = True
                elif lane >= used:
                    break
                else:
                    used -= 1
                    if lane < used:
                        move(tiles, used, lane)
                        owner[lane] = owner[used]
                        continue
            lane += 1
        if used == 0:
            return
        for group in range((used + GROUP - 1) // GROUP):  # idle lanes compute along, unread
            here = origin + _LINE * group
            if fresh:
                call(phase.first, here, phase.table, 0, 0.0, 0.0)
            call(phase.sweep, here, phase.table, 0, options.tolerance, float(options.scuff))
        fresh = False
