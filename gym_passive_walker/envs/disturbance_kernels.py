"""Disturbances of walkers: pushes, noise and delay; commands and constraints.

Scenes that have some of these step by `step` of this module in place of `task.step`. It is the same
step, but walkers stop where something is due, and go on from there as exactly as before.

Disturbances of a walker are a function of its key (`engine.counter_rng`). The key is drawn at each
reset from the walker's own random numbers, so disturbances do not depend on other walkers.
"""

from __future__ import annotations

import math

import numpy as np

from gym_passive_walker.engine.counter_rng import normal, uniform
from gym_passive_walker.engine.jit import Kernel, address, call, jitted
from gym_passive_walker.engine.run import integrate
from gym_passive_walker.envs import constraints, task
from gym_passive_walker.envs.checks import CHECKS
from gym_passive_walker.gaits.terrain import ground_at
from gym_passive_walker.physics.bodies import StraightBody
from gym_passive_walker.physics.hybrid import Outcome

PASSED = 8
"""Footholds that are remembered; pictures show as many."""

DISTURBANCE = np.dtype(
    [
        ("key", "u8"),  # of what is drawn
        ("command", "f8"),  # speed to keep
        ("due", "f8"),  # when the next push comes, since the stride began
        ("until", "f8"),  # when the step is over, since the stride began
        ("known", "f8"),  # of that push, where it is known beforehand
        ("extra_height", "f8"),  # height of one before the next foothold, besides the terrain
        ("pushes", "i8"),  # that have come
        ("push_work", "f8"),  # of those in this step
        ("episode_push_work", "f8"),
        ("idle", "i8"),  # whether the episode had ended before the step
        ("slope", "f8"),  # that is walked; footholds slope more or less
        ("tilt", "f8"),  # by how much this one slopes more
        ("x", "f8"),  # where the stride began to touch it, along the slope that is walked
        ("y", "f8"),  # over it
        ("passed", "f8", (PASSED, 2)),  # x and y of the strides before, the last one first
        ("impulse", "f8"),  # of the pushes in this step
    ]
)
"""What is kept of a walker besides its ledger."""

ODDS = np.dtype(
    [
        ("rate", "f8"),  # of pushes; 0 if there are none
        ("push", "f8", (2,)),  # least and greatest impulse
        ("noisy", "i8"),  # whether a sensor has errors
        ("noise", "f8", (task.SIZE,)),
        ("action_noise", "f8"),
        ("commanded", "i8"),
        ("command", "f8", (2,)),
        ("command_weight", "f8"),
        ("uneven", "i8"),  # whether there is terrain
        ("terrain_lookahead", "i8"),  # footholds ahead that agents see
        ("interval", "f8"),  # from one look at a walker to the next; infinite without looks
        ("friction", "f8"),
        ("knee_latch", "f8"),
        ("scuff_depth", "f8"),
        ("ends", "i8", (len(CHECKS),)),  # whether a check ends the episode
    ]
)
"""A scene's rules besides `task.RULES`."""

INTERVAL = 0.1
"""Time from one look at ground and knees to the next, at most; a stride takes some three."""

_INSTANT = 1e-9  # times closer than this are one
_DEPTH = 1e-9  # rounding of a foot's height
_FIRST_REASON = len(Outcome)
_HEELSTRIKE, _WORK, _ROOM = int(Outcome.HEELSTRIKE), len(constraints.NOTES) - 1, constraints.ROOM
_BLANK = constraints.BLANK
RADIUS = StraightBody._fields.index("foot_radius")  # of every kind's constants
_CONTACT, _FRICTION, _KNEE = range(len(CHECKS) - 1)
# Streams of a walker's key.
_WHEN, _HOW_HARD, _SENSOR, _MOTOR, _COMMAND = range(5)


@jitted
def add_observation_noise(disturbance, row, odds, table, spread, observations, first):
    """Add noise to what a walker's sensors measure; append its command and the footholds ahead."""
    if odds.noisy:
        for k in range(task.SIZE):
            if odds.noise[k] > 0.0:
                error = odds.noise[k] * normal(disturbance.key, task.SIZE * row.steps + k, _SENSOR)
                told = task.clipped(observations[first + k] + error, task.BOUNDS[k])
                observations[first + k] = max(told, task.LOWEST[k])
    if odds.commanded:
        observations[first + task.SIZE] = disturbance.command
    first += task.SIZE + odds.commanded
    for ahead in range(odds.terrain_lookahead):
        _, rise, turn = ground_at(table, spread, disturbance.key, row.strides + ahead)
        observations[first + 2 * ahead] = task.clipped(rise, task.HIGHEST)
        observations[first + 2 * ahead + 1] = task.clipped(turn, task.STEEPEST)


@Kernel
def observe(disturbances, ledger, odds, table, spread, lanes, observations):
    """Make walkers' observations, which `task.observe` has written, those of their sensors."""
    size = len(observations) // len(ledger)
    for i in lanes:
        add_observation_noise(
            disturbances[i], ledger[i], odds[0], table, spread, observations, i * size
        )


@Kernel
def add_noise(disturbances, ledger, noise, lanes, observations):
    """Add noise to the first numbers of some walkers' observations."""
    size = len(observations) // len(ledger)
    for i in lanes:
        for k in range(len(noise)):
            if noise[k] > 0.0:
                place = len(noise) * ledger[i].steps + k
                observations[i * size + k] += noise[k] * normal(disturbances[i].key, place, _SENSOR)


@jitted
def lay_ground(record, row, disturbance, table, spread):
    """Lay the ground of the stride that begins."""
    disturbance.tilt, rise, turn = ground_at(table, spread, disturbance.key, row.strides)
    row.slope = disturbance.slope + disturbance.tilt
    record.ground[0], record.ground[1] = math.sin(row.slope), math.cos(row.slope)
    record.ground[2], record.ground[3] = rise, turn


@jitted
def step_over(record, row, disturbance, radius, table, spread):
    """Enter where the foot has come down that stands now, and lay its ground."""
    here, rise, turn = ground_at(table, spread, disturbance.key, row.strides - 1)
    rise, disturbance.extra_height = rise + disturbance.extra_height, 0.0
    for k in range(PASSED - 1, 0, -1):
        disturbance.passed[k, 0], disturbance.passed[k, 1] = (
            disturbance.passed[k - 1, 0],
            disturbance.passed[k - 1, 1],
        )
    disturbance.passed[0, 0], disturbance.passed[0, 1] = disturbance.x, disturbance.y
    along = row.step_length
    # It touches the new ground above where it came down, as the two slope apart.
    off = rise + radius * (1.0 - math.cos(turn))
    sine, cosine = math.sin(here), math.cos(here)
    disturbance.x += along * cosine + off * sine
    disturbance.y += off * cosine - along * sine
    lay_ground(record, row, disturbance, table, spread)


@jitted
def time_to_push(disturbance, odds):
    """When the next push comes, after the last one."""
    return -math.log(1.0 - uniform(disturbance.key, disturbance.pushes, _WHEN)) / odds.rate


@Kernel
def begin(disturbances, odds, lanes, keys, pending, records, ledger, table, spread):
    """Draw some walkers' disturbances, each by its key; `pending` are actions that come late."""
    for j in range(len(lanes)):
        i = lanes[j]
        disturbance = disturbances[i]
        disturbance.key, disturbance.pushes, disturbance.episode_push_work = keys[j], 0, 0.0
        low, high = odds[0].command[0], odds[0].command[1]
        disturbance.command = low + (high - low) * uniform(disturbance.key, 0, _COMMAND)
        disturbance.due = time_to_push(disturbance, odds[0]) if odds[0].rate > 0.0 else np.inf
        disturbance.impulse, pending[i] = 0.0, 0.0
        disturbance.slope, disturbance.tilt, disturbance.x, disturbance.y = (
            ledger[i].slope,
            0.0,
            0.0,
            0.0,
        )
        disturbance.known, disturbance.extra_height = 0.0, 0.0
        if odds[0].uneven:
            lay_ground(records[i, 0], ledger[i], disturbance, table, spread)


@jitted
def copy_of(actions):
    """What agents do, to be changed on its way to the motors."""
    return actions.copy()


@jitted
def disturb_actions(disturbances, ledger, odds, pending, actions):
    """Make of what agents do what reaches the motors."""
    late = pending.shape[1]
    count = len(actions) // len(disturbances)
    for i in range(len(disturbances)):
        disturbance, step = disturbances[i], ledger[i].steps
        for j in range(count):
            share = task.clipped(actions[i * count + j], 1.0)
            if late > 0:
                share, pending[i, step % late, j] = pending[i, step % late, j], share
            if odds.action_noise > 0.0:
                share += odds.action_noise * normal(disturbance.key, step * count + j, _MOTOR)
            actions[i * count + j] = share


@jitted
def apply_due_events(records, bodies, i, disturbance, odds, natives):
    """What a walker meets as it stands, and when it is to stop next."""
    record = records[i, 0]
    native = natives[record.phase]
    if native.look != 0:
        call(native.look, address(records[i]), address(bodies[i]), 0, 0, 0.0, 0.0)
    while disturbance.due <= record.time + _INSTANT:
        low, high = odds.push[0], odds.push[1]
        impulse = low + (high - low) * uniform(disturbance.key, disturbance.pushes, _HOW_HARD)
        if disturbance.known != 0.0:
            impulse, disturbance.known = disturbance.known, 0.0
        call(native.push, address(records[i]), address(bodies[i]), 0, 0, -impulse, 0.0)
        disturbance.impulse += impulse
        disturbance.pushes += 1
        disturbance.due = (
            disturbance.due + time_to_push(disturbance, odds) if odds.rate > 0.0 else np.inf
        )
        if native.look != 0:
            call(native.look, address(records[i]), address(bodies[i]), 0, 0, 0.0, 0.0)
    end = min(disturbance.until, disturbance.due, record.time + odds.interval)
    record.end = disturbance.until if disturbance.until - end < _INSTANT else end


@jitted
def integrate_past_events(
    records, bodies, disturbances, phases, options, tiles, histories, odds, natives
):
    """Carry walkers to the end of their step, past all that they meet on the way."""
    going, count = np.empty(len(records), np.int64), 0
    for i in range(len(records)):
        disturbances[i].until, disturbances[i].impulse = records[i, 0].end, 0.0
        if not disturbances[i].idle:
            apply_due_events(records, bodies, i, disturbances[i], odds, natives)
            going[count] = i
            count += 1
    integrate(records, bodies, phases, options, tiles, histories)
    while True:
        before, count = count, 0
        for j in range(before):
            i = going[j]
            record = records[i, 0]
            if record.outcome == 0 and record.time < disturbances[i].until:
                apply_due_events(records, bodies, i, disturbances[i], odds, natives)
                going[count] = i
                count += 1
        if count == 0:
            return
        some, theirs = records[going[:count]], bodies[going[:count]]
        integrate(some, theirs, phases, options, tiles, histories)
        for j in range(count):
            records[going[j], 0] = some[j, 0]
            bodies[going[j]] = theirs[j]


@jitted
def violated_constraint(notes, odds):
    """The outcome by which a check ends the episode; 0 if none does."""
    for check in range(len(odds.ends)):
        if not odds.ends[check]:
            continue
        if check == _CONTACT:
            holds = notes[0] >= 0.0 and notes[1] >= 0.0
        elif check == _FRICTION:
            holds = notes[2] <= odds.friction
        elif check == _KNEE:
            holds = notes[3] >= -odds.knee_latch and notes[4] >= -odds.knee_latch
        else:
            holds = notes[5] >= -odds.scuff_depth - _DEPTH
        if not holds:
            return _FIRST_REASON + check
    return 0


@jitted
def check_step(records, bodies, i, row, disturbance, odds, phases, natives):
    """See whether a walker's step could have happened, and whether its episode goes on."""
    record = records[i, 0]
    look = natives[record.phase].look
    if look != 0 and record.outcome == 0:
        call(look, address(records[i]), address(bodies[i]), 0, 0, 0.0, 0.0)
    struck = record.outcome == _HEELSTRIKE
    if record.outcome == 0 or struck:
        row.violated = violated_constraint(bodies[i, 0, -_ROOM:], odds)
    if struck:
        disturbance.due -= record.time
        if row.violated != 0:  # it stands on its new foot all the same
            call(phases[0].place, address(records[i]), address(bodies[i]), 0, 0, 0.0, 0.0)
            row.origin -= record.place - record.passed


@jitted
def command_penalty(row, disturbance, odds):
    """What a stride loses for missing its command, at most its length.

    The walker was to go the commanded speed times the stride's time.
    """
    missed = abs(row.step_length - disturbance.command * row.step_period)
    return min(odds.command_weight * missed, row.step_length)


@Kernel
def step(
    records, bodies, ledger, rules, phases, options, tiles, histories, disturbances, pending, odds,
    natives, table, spread, actions, observations, rewards, terminated, truncated,
):  # fmt: skip
    """A step of every walker by finite actions; returns what `finish_step` does."""
    reached = copy_of(actions)
    disturb_actions(disturbances, ledger, odds[0], pending, reached)
    task.apply_action(records, ledger, rules[0], reached)
    for i in range(len(records)):
        disturbances[i].idle = task.over(ledger[i])
        for k in range(len(_BLANK)):
            bodies[i, 0, len(bodies[i, 0]) - _ROOM + k] = _BLANK[k]
    integrate_past_events(
        records, bodies, disturbances, phases, options, tiles, histories, odds[0], natives
    )
    for i in range(len(records)):
        if not disturbances[i].idle:
            check_step(records, bodies, i, ledger[i], disturbances[i], odds[0], phases, natives)
    strides, endings = task.finish_step(
        records, bodies, ledger, rules[0], phases, observations, rewards, terminated, truncated
    )
    size = len(observations) // len(records)
    for i in range(len(records)):
        row, disturbance = ledger[i], disturbances[i]
        if not disturbance.idle:
            disturbance.push_work = (
                bodies[i, 0, len(bodies[i, 0]) - _ROOM + _WORK] / rules[0].weight
            )
            disturbance.episode_push_work += disturbance.push_work
            if odds[0].commanded and row.outcome == _HEELSTRIKE:
                lost = command_penalty(row, disturbance, odds[0])
                row.reward -= lost
                row.total -= lost
                rewards[i] -= lost
            if odds[0].uneven and row.outcome == _HEELSTRIKE:
                step_over(records[i, 0], row, disturbance, bodies[i, 0, RADIUS], table, spread)
                task.write_observation(records[i, 0], row, phases, observations, i * size)
        add_observation_noise(disturbance, row, odds[0], table, spread, observations, i * size)
    return strides, endings
