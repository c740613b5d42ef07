"""Carrying walkers through one phase, each with its own time and step, to its event.

Lanes whose walker is done are filled from the records still waiting, so no lane waits for another.
Lanes are filled in whole groups of `GROUP`, so every walker passes through the same instructions
wherever it stands: its trajectory is bitwise the same alone and in any crowd.
"""

from __future__ import annotations

import numpy as np

from gym_passive_walker.engine.jit import address, call, inlined, jitted
from gym_passive_walker.engine.landing import TIME_UP, attend
from gym_passive_walker.engine.layout import WIDTH
from gym_passive_walker.engine.native import GROUP
from gym_passive_walker.engine.step import ALERT, UP
from gym_passive_walker.physics.hybrid import Outcome

_DIVERGED = int(Outcome.DIVERGED)
_LINE = 8 * GROUP  # bytes from one group of a tile's lanes to the next

WAITING, HALTED = int(Outcome.RUNNING), -1
"""Outcomes of a record that is to be carried on, and of one whose time is up."""


@inlined
def came(tiles, courses, phase, lane, options):
    """What has come of a lane's step: as of `landing.attend`."""
    verdict = tiles[0].verdict[lane]
    if verdict == ALERT:
        return attend(tiles, courses, phase, lane, options.scuff, options.landing)
    return TIME_UP if verdict == UP else 0


@inlined
def leave(record, tiles, phase, lane, event):
    """Take a walker out of its lane, and say how its phase has ended."""
    up = 1.0 if event == TIME_UP else 0.0
    call(phase.unload, address(tiles), address(record), lane, len(tiles) - 1, up, 0.0)
    if event > 0:
        record[0].outcome = phase.outcomes[event - 1]
    else:
        record[0].outcome = HALTED if event == TIME_UP else _DIVERGED


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
    origin, planes, alike = address(tiles), len(tiles) - 1, len(bodies) == 1
    waiting, used, fresh, scuff = 0, 0, False, float(options.scuff)
    if alike:  # they stay
        for lane in range(WIDTH):
            call(phase.equip, origin, address(bodies[0]), lane, planes, 0.0, 0.0)
    while True:
        for lane in range(used):
            event = came(tiles, courses, phase, lane, options)
            if event != 0:
                leave(records[owner[lane]], tiles, phase, lane, event)
                owner[lane] = -1
        # Fill what is free from those who wait, or from the last lanes in use.
        lane = 0
        while lane < WIDTH:
            if lane >= used or owner[lane] < 0:
                while waiting < len(records):
                    record = records[waiting, 0]
                    if record.phase == number and record.outcome == WAITING:
                        break
                    waiting += 1
                if waiting < len(records):
                    if not alike:
                        body = address(bodies[waiting])
                        call(phase.equip, origin, body, lane, planes, 0.0, 0.0)
                    whole = address(records[waiting])
                    call(phase.load, origin, whole, lane, planes, options.first_step, 0.0)
                    owner[lane] = waiting
                    waiting += 1
                    used = max(used, lane + 1)
                    fresh = True
                elif lane >= used:
                    break
                else:
                    used -= 1
                    if lane < used:
                        source = origin + 8 * used
                        call(phase.move, origin + 8 * lane, source, 0, planes, 0.0, 0.0)
                        owner[lane] = owner[used]
                        continue
            lane += 1
        if used == 0:
            return
        for group in range((used + GROUP - 1) // GROUP):  # idle lanes compute along, unread
            here = origin + _LINE * group
            if fresh:
                call(phase.first, here, phase.table, 0, planes, 0.0, 0.0)
            call(phase.sweep, here, phase.table, 0, planes, options.tolerance, scuff)
        fresh = False
