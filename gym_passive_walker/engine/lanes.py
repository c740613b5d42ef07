"""Integration of a batch through one phase, each walker with its own time and step size.

A lane that finishes takes the next waiting record, so no lane waits for another. Lanes run in whole
groups, the last few in half a group. Every walker takes the same operations in any lane, so its
trajectory is bitwise equal alone and in any batch.
"""

from __future__ import annotations

import numpy as np

from gym_passive_walker.engine.event_location import LOST, TIME_UP, process_events
from gym_passive_walker.engine.jit import address, call, merged, stack, view
from gym_passive_walker.engine.layout import WIDTH
from gym_passive_walker.engine.step import ALERT, PLAIN, UP
from gym_passive_walker.models.equations.hybrid import Outcome

_DIVERGED, _STALLED = int(Outcome.DIVERGED), int(Outcome.STALLED)
_FALLS = int(Outcome.FELL_FORWARD)
_WORD = np.dtype("i8")

CHUNK = 1024
"""Number of records that are integrated together, so that they stay in the cache."""

WAITING, RESTING = int(Outcome.RUNNING), -1
"""Outcomes of a record that is to be integrated or has reached its time limit; and of one that must
not change."""


@merged
def finish_sweep(tiles, histories, phase, lane, options):
    """Return the result of a lane's step, as `event_location.process_events` does.

    Returns:
        The event that ends the phase; TIME_UP, LOST or GIVEN_UP; 0 to go on.
    """
    verdict = tiles[0].verdict[lane]
    if verdict == ALERT:
        return process_events(tiles, histories, phase, lane, options)
    return TIME_UP if verdict == UP else 0


def leave(record, body, tiles, phase, lane, event, options):
    """Write a walker from its lane to its record, and apply the impact that ended its phase."""
    tangents, up = len(tiles) - 1, 1.0 if event == TIME_UP else 0.0
    call(phase.unload, address(tiles), address(record), lane, tangents, up, 0.0)
    if event == TIME_UP:
        return
    if event > 0:
        outcome = phase.outcomes[event - 1]
    else:
        outcome = _DIVERGED if event == LOST else _STALLED
    record[0].outcome = outcome
    if outcome < _FALLS:
        scuff = float(options.scuff)
        call(phase.resets[outcome], address(record), address(body), 0, tangents, 0.0, scuff)


@merged
def integrate_phase(records, bodies, phase, number, tiles, histories, options):
    """Integrate every record that waits in a phase to its event or its time limit, in place.

    Records with an outcome other than RUNNING are not changed. An event sets the outcome; at the
    time limit the outcome stays RUNNING. An impact is applied, after which a record may wait in
    another phase.

    Args:
        records: Records, (n, 1 + tangents) of RECORD; n is at most CHUNK.
        bodies: Constants of the walkers, (1 or n, 1 + tangents, constants).
        phase: A `compiled.PHASE`.
        number: Index of the phase in its system.
        tiles: Working memory, (1 + tangents,) of TILE.
        histories: Working memory, (1 + tangents,) of HISTORY.
        options: An `OPTIONS`.
    """
    owner, queue = view(stack(WIDTH), (WIDTH,), _WORD), view(stack(CHUNK), (CHUNK,), _WORD)
    waiting = 0
    for i in range(len(records)):  # without a branch, which would be mispredicted
        queue[waiting] = i
        waiting += (records[i, 0].phase == number) & (records[i, 0].outcome == WAITING)
    origin, tangents, alike = address(tiles), len(tiles) - 1, len(bodies) == 1
    called, used, going, equipped, fresh = 0, 0, 0, 0, False
    scuff = float(options.scuff)
    while True:
        for lane in range(used):
            if tiles[0].verdict[lane] == PLAIN or owner[lane] < 0:
                continue
            event = finish_sweep(tiles, histories, phase, lane, options)
            if tangents > 0:  # with values alone, accelerations at a step's end are known
                fresh = fresh or tiles[0].fresh[lane] > 0.0
            if event != 0:
                i = owner[lane]
                body = bodies[0 if alike else i]
                leave(records[i], body, tiles, phase, lane, event, options)
                owner[lane] = -1
                going -= 1
        # Fill free lanes with waiting records.
        lane = 0
        while going < WIDTH and lane < WIDTH and called < waiting:
            if lane >= used or owner[lane] < 0:
                i = queue[called]
                if not alike or lane >= equipped:
                    body = address(bodies[0 if alike else i])
                    call(phase.load_constants, origin, body, lane, tangents, 0.0, 0.0)
                    equipped = max(equipped, lane + 1)
                whole = address(records[i])
                call(phase.load, origin, whole, lane, tangents, options.first_step, 0.0)
                owner[lane], fresh = i, True
                used = max(used, lane + 1)
                called += 1
                going += 1
            lane += 1
        if going == 0:
            return
        # When no records wait, the last walkers move together to use fewer groups.
        whole = (going + phase.few - 1) & -phase.few
        lane = 0
        while used > whole:
            used -= 1
            if owner[used] < 0:
                continue
            while owner[lane] >= 0:
                lane += 1
            source = origin + 8 * used
            call(phase.move, origin + 8 * lane, source, 0, tangents, 0.0, 0.0)
            owner[lane] = owner[used]
        lane = 0
        while lane < whole:  # idle lanes compute too; their results are ignored
            here = origin + 8 * lane
            if fresh:
                call(phase.first, here, phase.table, 0, tangents, 0.0, 0.0)
            few = whole - lane < phase.group
            sweep = phase.sweep_few if few else phase.sweep
            call(sweep, here, phase.table, 0, tangents, options.fineness, scuff)
            lane += phase.few if few else phase.group
        fresh = False
