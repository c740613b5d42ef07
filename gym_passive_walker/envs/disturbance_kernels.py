"""Disturbances of walkers: pushes, noise and delay; commands and constraints.

Scenes with any of these use `step` of this module instead of `task.step`. Integration stops at each
push and each check, and continues with an unchanged error tolerance.

Disturbances of a walker are a function of its key (`engine.counter_rng`). Each reset draws the key
from the walker's own random generator, so disturbances do not depend on other walkers.
"""

from __future__ import annotations

import math

import numpy as np

from gym_passive_walker.engine.counter_rng import normal, uniform
from gym_passive_walker.engine.jit import Kernel, address, call, jitted, merged
from gym_passive_walker.engine.lanes import RESTING
from gym_passive_walker.engine.run import integrate
from gym_passive_walker.envs import constraints, task
from gym_passive_walker.gaits.scenes.checks import CHECKS
from gym_passive_walker.gaits.scenes.rules import (
    BOUNDS,
    LOWEST,
    SIZE,
    clip,
    command_penalty,
    foothold,
)
from gym_passive_walker.gaits.terrain import ground_at
from gym_passive_walker.models.equations.bodies import StraightBody
from gym_passive_walker.models.equations.hybrid import Outcome

PASSED = 8
"""Number of past footholds in the state; pictures show them."""

_ASIDE = 2
"""Added to the outcome of a walker that has made its step while others go on, as its `idle`."""

DISTURBANCE = np.dtype([
    ("key", "u8"),  # of the counter-based random numbers
    ("command", "f8"),  # commanded speed
    ("due", "f8"),  # time of the next push, since the stride began
    ("until", "f8"),  # end of the control step, since the stride began
    ("known", "f8"),  # impulse of the next push, if it was scheduled; else 0
    ("extra_height", "f8"),  # added to the height change of the next foothold
    ("pushes", "i8"),  # number of pushes in the episode
    ("push_work", "f8"),  # work of the pushes in this step
    ("episode_push_work", "f8"),
    ("idle", "i8"),  # whether the episode ended before the step; see `_ASIDE` too
    ("slope", "f8"),  # mean slope, in rad
    ("tilt", "f8"),  # slope of the foothold minus the mean slope
    ("x", "f8"),  # first contact point of the stride, along the mean slope
    ("y", "f8"),  # its height above the mean slope
    ("passed", "f8", (PASSED, 2)),  # x and y of previous strides, latest first
    ("impulse", "f8"),  # sum of the pushes in this step
])  # fmt: skip
"""Disturbance state of a walker."""

SETTINGS = np.dtype([
    ("rate", "f8"),  # mean number of pushes per time; 0 without pushes
    ("push", "f8", (2,)),  # smallest and largest impulse
    ("noisy", "i8"),  # whether observations have noise
    ("noise", "f8", (SIZE,)),
    ("action_noise", "f8"),
    ("commanded", "i8"),
    ("command", "f8", (2,)),
    ("command_weight", "f8"),
    ("uneven", "i8"),  # whether there is terrain
    ("terrain_lookahead", "i8"),  # number of footholds ahead that are observed
    ("interval", "f8"),  # time between checks of a walker; infinite without checks
    ("friction", "f8"),
    ("knee_latch", "f8"),
    ("scuff_depth", "f8"),
    ("ends", "i8", (len(CHECKS),)),  # whether a check ends the episode
])  # fmt: skip
"""Settings of a scene besides `task.RULES`."""

INTERVAL = 0.1
"""Largest time between checks of contact and knees, in sqrt(l/g); a stride takes about 3."""

_INSTANT = 1e-9  # times closer than this are equal
_DEPTH = 1e-9  # rounding of a foot's height
_FIRST_REASON = len(Outcome)
_HEELSTRIKE, _WORK, _ROOM = int(Outcome.HEELSTRIKE), len(constraints.NOTES) - 1, constraints.ROOM
_BLANK = constraints.BLANK
RADIUS = StraightBody._fields.index("foot_radius")  # of every kind's constants
_CONTACT, _FRICTION, _KNEE = range(len(CHECKS) - 1)
# Streams of a walker's key.
_WHEN, _HOW_HARD, _SENSOR, _MOTOR, _COMMAND = range(5)


@jitted
def add_observation_noise(disturbance, row, settings, table, spread, observations, first):
    """Add noise to a walker's observation; append its command and the footholds ahead."""
    if settings.noisy:
        for k in range(SIZE):
            if settings.noise[k] > 0.0:
                draw = normal(disturbance.key, SIZE * row.steps + k, _SENSOR)
                error = settings.noise[k] * draw
                noisy = observations[first + k] + error
                observations[first + k] = clip(noisy, LOWEST[k], BOUNDS[k])
    if settings.commanded:
        observations[first + SIZE] = disturbance.command
    first += SIZE + settings.commanded
    for ahead in range(settings.terrain_lookahead):
        _, rise, turn = ground_at(table, spread, disturbance.key, row.strides + ahead)
        seen = foothold(rise, turn)
        observations[first + 2 * ahead], observations[first + 2 * ahead + 1] = seen


@Kernel
def observe(disturbances, ledger, settings, table, spread, lanes, observations):
    """Apply `add_observation_noise` to observations of some walkers from `task.observe`."""
    size = len(observations) // len(ledger)
    for i in lanes:
        add_observation_noise(
            disturbances[i], ledger[i], settings[0], table, spread, observations, i * size
        )


@Kernel
def add_noise(disturbances, ledger, noise, lanes, observations):
    """Add noise to the first numbers in observations of some walkers of a `System`."""
    size = len(observations) // len(ledger)
    for i in lanes:
        for k in range(len(noise)):
            if noise[k] > 0.0:
                place = len(noise) * ledger[i].steps + k
                observations[i * size + k] += noise[k] * normal(disturbances[i].key, place, _SENSOR)


@jitted
def lay_ground(record, row, disturbance, table, spread):
    """Set the ground of the stride that begins."""
    disturbance.tilt, rise, turn = ground_at(table, spread, disturbance.key, row.strides)
    row.slope = disturbance.slope + disturbance.tilt
    record.ground[0], record.ground[1] = math.sin(row.slope), math.cos(row.slope)
    record.ground[2], record.ground[3] = rise, turn


@jitted
def step_over(record, row, disturbance, radius, table, spread):
    """Set the contact point of the new stance foot, and the ground of its stride."""
    here, rise, turn = ground_at(table, spread, disturbance.key, row.strides - 1)
    rise, disturbance.extra_height = rise + disturbance.extra_height, 0.0
    for k in range(PASSED - 1, 0, -1):
        for axis in range(2):
            disturbance.passed[k, axis] = disturbance.passed[k - 1, axis]
    disturbance.passed[0, 0], disturbance.passed[0, 1] = disturbance.x, disturbance.y
    along = row.step_length
    # The slope changes at impact, so the contact point lies higher than the foothold.
    off = rise + radius * (1.0 - math.cos(turn))
    sine, cosine = math.sin(here), math.cos(here)
    disturbance.x += along * cosine + off * sine
    disturbance.y += off * cosine - along * sine
    lay_ground(record, row, disturbance, table, spread)


@jitted
def time_to_push(disturbance, settings):
    """Return the time from the last push to the next one; infinite without random pushes."""
    if settings.rate == 0.0:
        return np.inf
    return -math.log(1.0 - uniform(disturbance.key, disturbance.pushes, _WHEN)) / settings.rate


@Kernel
def begin(disturbances, settings, lanes, keys, pending, records, ledger, table, spread):
    """Draw the disturbances of some walkers by their keys, and clear delayed actions `pending`."""
    for j in range(len(lanes)):
        i = lanes[j]
        disturbance = disturbances[i]
        disturbance.key, disturbance.pushes, disturbance.episode_push_work = keys[j], 0, 0.0
        low, high = settings[0].command[0], settings[0].command[1]
        disturbance.command = low + (high - low) * uniform(disturbance.key, 0, _COMMAND)
        disturbance.due = time_to_push(disturbance, settings[0])
        disturbance.impulse, pending[i] = 0.0, 0.0
        disturbance.slope = ledger[i].slope
        disturbance.tilt, disturbance.x, disturbance.y = 0.0, 0.0, 0.0
        disturbance.known, disturbance.extra_height = 0.0, 0.0
        if settings[0].uneven:
            lay_ground(records[i, 0], ledger[i], disturbance, table, spread)


@jitted
def disturb_actions(disturbances, ledger, settings, pending, actions):
    """Apply delay and noise to actions, in place."""
    late = pending.shape[1]
    count = len(actions) // len(disturbances)
    for i in range(len(disturbances)):
        disturbance, step = disturbances[i], ledger[i].steps
        for j in range(count):
            share = clip(actions[i * count + j], -1.0, 1.0)
            if late > 0:
                share, pending[i, step % late, j] = pending[i, step % late, j], share
            if settings.action_noise > 0.0:
                share += settings.action_noise * normal(disturbance.key, step * count + j, _MOTOR)
            actions[i * count + j] = share


@jitted
def apply_due_events(records, bodies, i, disturbance, settings, hooks):
    """Check a walker, apply the pushes that are due, and set the end of the integration."""
    record = records[i, 0]
    native = hooks[record.phase]
    if native.look != 0:
        call(native.look, address(records[i]), address(bodies[i]), 0, 0, 0.0, 0.0)
    while disturbance.due <= record.time + _INSTANT:
        low, high = settings.push[0], settings.push[1]
        impulse = low + (high - low) * uniform(disturbance.key, disturbance.pushes, _HOW_HARD)
        if disturbance.known != 0.0:
            impulse, disturbance.known = disturbance.known, 0.0
        call(native.push, address(records[i]), address(bodies[i]), 0, 0, -impulse, 0.0)
        disturbance.impulse += impulse
        disturbance.pushes += 1
        disturbance.due += time_to_push(disturbance, settings)
        if native.look != 0:
            call(native.look, address(records[i]), address(bodies[i]), 0, 0, 0.0, 0.0)
    end = min(disturbance.until, disturbance.due, record.time + settings.interval)
    record.end = disturbance.until if disturbance.until - end < _INSTANT else end


@jitted
def integrate_past_events(
    records, bodies, disturbances, phases, options, tiles, histories, settings, hooks
):
    """Integrate walkers to the end of their step, with all pushes and checks on the way."""
    for i in range(len(records)):
        disturbances[i].until, disturbances[i].impulse = records[i, 0].end, 0.0
        if not disturbances[i].idle:
            apply_due_events(records, bodies, i, disturbances[i], settings, hooks)
    integrate(records, bodies, phases, options, tiles, histories)
    while apply_later_events(records, bodies, disturbances, settings, hooks):
        integrate(records, bodies, phases, options, tiles, histories)
        for i in range(len(records)):
            if disturbances[i].idle >= _ASIDE:
                records[i, 0].outcome = disturbances[i].idle - _ASIDE
                disturbances[i].idle = 0


def goes_on(record, disturbance):
    """Return whether a walker's step goes on after an event."""
    return not disturbance.idle and record.outcome == 0 and record.time < disturbance.until


@jitted
def apply_later_events(records, bodies, disturbances, settings, hooks):
    """Apply the events of walkers that go on with their step, and put the others aside.

    Returns whether there are any; else nothing has changed.
    """
    going = False
    for i in range(len(records)):
        going |= goes_on(records[i, 0], disturbances[i])
    if not going:
        return False
    for i in range(len(records)):
        record, disturbance = records[i, 0], disturbances[i]
        if goes_on(record, disturbance):
            apply_due_events(records, bodies, i, disturbance, settings, hooks)
        elif not disturbance.idle:
            disturbance.idle, record.outcome = _ASIDE + record.outcome, RESTING
    return True


@jitted
def violated_constraint(notes, settings):
    """Return the outcome of the first violated constraint that ends the episode, or 0."""
    for check in range(len(settings.ends)):
        if not settings.ends[check]:
            continue
        if check == _CONTACT:
            holds = notes[0] >= 0.0 and notes[1] >= 0.0
        elif check == _FRICTION:
            holds = notes[2] <= settings.friction
        elif check == _KNEE:
            holds = notes[3] >= -settings.knee_latch and notes[4] >= -settings.knee_latch
        else:
            holds = notes[5] >= -settings.scuff_depth - _DEPTH
        if not holds:
            return _FIRST_REASON + check
    return 0


@jitted
def check_step(records, bodies, i, row, disturbance, settings, phases, hooks):
    """Check the constraints of a walker after its step; a violated one ends its episode."""
    record = records[i, 0]
    look = hooks[record.phase].look
    if look != 0 and record.outcome == 0:
        call(look, address(records[i]), address(bodies[i]), 0, 0, 0.0, 0.0)
    struck = record.outcome == _HEELSTRIKE
    if record.outcome == 0 or struck:
        row.violated = violated_constraint(bodies[i, 0, -_ROOM:], settings)
    if struck:
        disturbance.due -= record.time
        if row.violated != 0:  # the record already has the legs exchanged
            call(phases[0].place, address(records[i]), address(bodies[i]), 0, 0, 0.0, 0.0)
            row.origin -= record.place - record.passed


@merged
def step(
    records, bodies, ledger, rules, phases, options, tiles, histories, disturbances, pending,
    settings, hooks, table, spread, actions, observations, rewards, terminated, truncated,
):  # fmt: skip
    """Step every walker by finite actions, which delay and noise change in place.

    Returns the result of `task.finish_step`.
    """
    disturb_actions(disturbances, ledger, settings[0], pending, actions)
    task.apply_action(records, ledger, rules[0], actions)
    for i in range(len(records)):
        disturbances[i].idle = task.over(ledger[i])
        for k in range(len(_BLANK)):
            bodies[i, 0, k - _ROOM] = _BLANK[k]
    integrate_past_events(
        records, bodies, disturbances, phases, options, tiles, histories, settings[0], hooks
    )
    for i in range(len(records)):
        if not disturbances[i].idle:
            check_step(records, bodies, i, ledger[i], disturbances[i], settings[0], phases, hooks)
    strides, endings = task.finish_step(
        records, bodies, ledger, rules[0], phases, observations, rewards, terminated, truncated
    )
    size = len(observations) // len(records)
    for i in range(len(records)):
        row, disturbance = ledger[i], disturbances[i]
        if not disturbance.idle:
            disturbance.push_work = bodies[i, 0, _WORK - _ROOM] / rules[0].weight
            disturbance.episode_push_work += disturbance.push_work
            if settings[0].commanded and row.outcome == _HEELSTRIKE:
                command, weight = disturbance.command, settings[0].command_weight
                lost = command_penalty(row.step_length, row.step_period, command, weight)
                row.reward -= lost
                row.total -= lost
                rewards[i] -= lost
            if settings[0].uneven and row.outcome == _HEELSTRIKE:
                step_over(records[i, 0], row, disturbance, bodies[i, 0, RADIUS], table, spread)
                task.write_observation(records[i, 0], row, phases, observations, i * size)
        add_observation_noise(disturbance, row, settings[0], table, spread, observations, i * size)
    return strides, endings
