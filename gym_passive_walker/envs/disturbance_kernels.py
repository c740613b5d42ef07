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
from gym_passive_walker.engine.jit import address, call, jitted, merged
from gym_passive_walker.engine.lanes import RESTING
from gym_passive_walker.engine.layout import WIDE
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
    # Of domain randomization; else those of the scene.
    ("delay", "i8"),  # control steps between an action and its effect
    ("friction", "f8"),  # coefficient
    ("strength", "f8", (WIDE.controls + 1,)),  # of each action, over its largest value
])  # fmt: skip
"""Disturbance state of a walker."""

SETTINGS = np.dtype([
    ("rate", "f8"),  # mean number of pushes per time; 0 without pushes
    ("push", "f8", (2,)),  # smallest and largest impulse
    ("noisy", "i8"),  # whether observations have noise
    ("noise", "f8", (2 * WIDE.links + 1,)),  # standard deviations
    ("action_noise", "f8"),
    ("commanded", "i8"),
    ("command", "f8", (2,)),
    ("command_weight", "f8"),
    ("uneven", "i8"),  # whether there is terrain
    ("terrain_lookahead", "i8"),  # number of footholds ahead that are observed
    ("interval", "f8"),  # time between checks of a walker; infinite without checks
    ("friction", "f8"),  # coefficient, where it is not drawn
    ("knee_latch", "f8"),
    ("scuff_depth", "f8"),
    ("ends", "i8", (len(CHECKS),)),  # whether a check ends the episode
])  # fmt: skip
"""Settings of a scene besides `task.RULES`."""

INTERVAL = 0.1
"""Largest time between checks of contact and knees, in sqrt(l/g); a stride takes about 3."""

INSTANT = 1e-9
"""Times closer than this are equal."""

_DEPTH = 1e-9  # rounding of a foot's height
_FIRST_REASON = len(Outcome)
_HEELSTRIKE, _WORK, _ROOM = int(Outcome.HEELSTRIKE), len(constraints.NOTES) - 1, constraints.ROOM
_BLANK = constraints.BLANK
RADIUS = StraightBody._fields.index("foot_radius")  # of every kind's constants
_CONTACT, _FRICTION, _KNEE = range(len(CHECKS) - 1)
# Streams of a walker's key.
_WHEN, _HOW_HARD, _SENSOR, _MOTOR, _COMMAND = range(5)


def observation_draw(key, steps, size, k):
    """Return the normal number of the noise on entry k of `size` observed ones, after `steps`."""
    return normal(key, size * steps + k, _SENSOR)


def action_draw(key, steps, count, j):
    """Return the normal number of the noise on action j of `count`, in the step after `steps`."""
    return normal(key, count * steps + j, _MOTOR)


@jitted
def add_observation_noise(here, i):
    """Add noise to a walker's observation; append its command and the footholds ahead."""
    disturbance, row, settings = here.disturbances[i], here.ledger[i], here.settings[0]
    observations, first = here.observations, i * (len(here.observations) // len(here.ledger))
    count = here.rules[0].coordinates
    size = SIZE if count == 0 else 2 * count + 1
    if settings.noisy:
        for k in range(size):
            if settings.noise[k] > 0.0:
                draw = observation_draw(disturbance.key, row.steps, size, k)
                error = settings.noise[k] * draw
                noisy = observations[first + k] + error
                observations[first + k] = clip(noisy, LOWEST[k], BOUNDS[k]) if count == 0 else noisy
    if settings.commanded:
        observations[first + size] = disturbance.command
    first += size + settings.commanded
    for ahead in range(settings.terrain_lookahead):
        place = row.strides + ahead
        _, rise, turn = ground_at(here.table, here.spread, disturbance.key, place)
        seen = foothold(rise, turn)
        observations[first + 2 * ahead], observations[first + 2 * ahead + 1] = seen


@jitted
def lay_ground(here, i):
    """Set the ground of the stride that begins."""
    record, row, disturbance = here.records[i, 0], here.ledger[i], here.disturbances[i]
    tilt, rise, turn = ground_at(here.table, here.spread, disturbance.key, row.strides)
    disturbance.tilt, row.slope = tilt, disturbance.slope + tilt
    record.ground[0], record.ground[1] = math.sin(row.slope), math.cos(row.slope)
    record.ground[2], record.ground[3] = rise, turn


@jitted
def step_over(here, i):
    """Set the contact point of the new stance foot, and the ground of its stride."""
    row, disturbance = here.ledger[i], here.disturbances[i]
    slope, rise, turn = ground_at(here.table, here.spread, disturbance.key, row.strides - 1)
    rise, disturbance.extra_height = rise + disturbance.extra_height, 0.0
    for k in range(PASSED - 1, 0, -1):
        for axis in range(2):
            disturbance.passed[k, axis] = disturbance.passed[k - 1, axis]
    disturbance.passed[0, 0], disturbance.passed[0, 1] = disturbance.x, disturbance.y
    along = row.step_length
    # The slope changes at impact, so the contact point lies higher than the foothold.
    off = rise + here.bodies[i, 0, RADIUS] * (1.0 - math.cos(turn))
    sine, cosine = math.sin(slope), math.cos(slope)
    disturbance.x += along * cosine + off * sine
    disturbance.y += off * cosine - along * sine
    lay_ground(here, i)


@jitted
def time_to_push(disturbance, settings):
    """Return the time from the last push to the next one; infinite without random pushes."""
    if settings.rate == 0.0:
        return np.inf
    return -math.log(1.0 - uniform(disturbance.key, disturbance.pushes, _WHEN)) / settings.rate


def drawn_impulse(disturbance, settings):
    """Return the impulse of the next random push, over m sqrt(g l)."""
    low, high = settings.push[0], settings.push[1]
    return low + (high - low) * uniform(disturbance.key, disturbance.pushes, _HOW_HARD)


def clear_readings(here, i):
    """Set the readings of a walker's checks to those before any check."""
    for k in range(len(_BLANK)):
        here.bodies[i, 0, k - _ROOM] = _BLANK[k]


@jitted
def begin(here, i, key):
    """Draw a walker's disturbances by its key, and add them to its observation."""
    disturbance, settings = here.disturbances[i], here.settings[0]
    clear_readings(here, i)
    disturbance.key, disturbance.pushes = key, 0
    disturbance.push_work, disturbance.episode_push_work = 0.0, 0.0
    low, high = settings.command[0], settings.command[1]
    disturbance.command = low + (high - low) * uniform(disturbance.key, 0, _COMMAND)
    disturbance.due = time_to_push(disturbance, settings)
    disturbance.impulse, here.pending[i] = 0.0, 0.0
    disturbance.slope = here.ledger[i].slope
    disturbance.tilt, disturbance.x, disturbance.y = 0.0, 0.0, 0.0
    disturbance.known, disturbance.extra_height = 0.0, 0.0
    disturbance.delay, disturbance.friction = here.pending.shape[1], settings.friction
    for j in range(len(disturbance.strength)):
        disturbance.strength[j] = 1.0
    if settings.uneven:
        lay_ground(here, i)
    add_observation_noise(here, i)


@jitted
def disturb_actions(here, first, last):
    """Apply delay and noise to actions; the results are in `acted`."""
    rules, count = here.rules[0], here.rules[0].actions
    noise, torques = here.settings[0].action_noise, len(here.records[0, 0].control)
    for i in range(first, last):
        disturbance, step = here.disturbances[i], here.ledger[i].steps
        late = disturbance.delay
        for j in range(count):
            least = 0.0 if rules.channels[j] == torques else -1.0
            share = clip(here.actions[i * count + j], least, 1.0)
            if late > 0:
                sent, here.pending[i, step % late, j] = here.pending[i, step % late, j], share
                share = sent
            if noise > 0.0:
                share += noise * action_draw(disturbance.key, step, count, j)
            here.acted[i * count + j] = clip(share, -1.0, 1.0) * disturbance.strength[j]


@jitted
def apply_due_events(here, i):
    """Check a walker, apply the pushes that are due, and set the end of the integration."""
    record, disturbance, settings = here.records[i, 0], here.disturbances[i], here.settings[0]
    native = here.hooks[record.phase]
    if native.look != 0:
        call(native.look, address(here.records[i]), address(here.bodies[i]), 0, 0, 0.0, 0.0)
    while disturbance.due <= record.time + INSTANT:
        impulse = drawn_impulse(disturbance, settings)
        if disturbance.known != 0.0:
            impulse, disturbance.known = disturbance.known, 0.0
        call(native.push, address(here.records[i]), address(here.bodies[i]), 0, 0, -impulse, 0.0)
        disturbance.impulse += impulse
        disturbance.pushes += 1
        disturbance.due += time_to_push(disturbance, settings)
        if native.look != 0:
            call(native.look, address(here.records[i]), address(here.bodies[i]), 0, 0, 0.0, 0.0)
    end = min(disturbance.until, disturbance.due, record.time + settings.interval)
    record.end = disturbance.until if disturbance.until - end < INSTANT else end


@jitted
def integrate_past_events(here, first, last, tiles, histories):
    """Integrate walkers to the end of their step, with all pushes and checks on the way."""
    disturbances = here.disturbances
    for i in range(first, last):
        disturbances[i].until, disturbances[i].impulse = here.records[i, 0].end, 0.0
        if not disturbances[i].idle:
            apply_due_events(here, i)
    task.integrate_step(here, first, last, tiles, histories)
    while apply_later_events(here, first, last):
        task.integrate_step(here, first, last, tiles, histories)
        for i in range(first, last):
            if disturbances[i].idle >= _ASIDE:
                here.records[i, 0].outcome = disturbances[i].idle - _ASIDE
                disturbances[i].idle = 0


def goes_on(record, disturbance):
    """Return whether a walker's step goes on after an event."""
    return not disturbance.idle and record.outcome == 0 and record.time < disturbance.until


@jitted
def apply_later_events(here, first, last):
    """Apply the events of walkers that go on with their step, and put the others aside.

    Returns whether there are any; else nothing has changed.
    """
    going = False
    for i in range(first, last):
        going |= goes_on(here.records[i, 0], here.disturbances[i])
    if not going:
        return False
    for i in range(first, last):
        record, disturbance = here.records[i, 0], here.disturbances[i]
        if goes_on(record, disturbance):
            apply_due_events(here, i)
        elif not disturbance.idle:
            disturbance.idle, record.outcome = _ASIDE + record.outcome, RESTING
    return True


@jitted
def violated_constraint(notes, settings, friction):
    """Return the outcome of the first violated constraint that ends the episode, or 0."""
    for check in range(len(settings.ends)):
        if not settings.ends[check]:
            continue
        if check == _CONTACT:
            holds = notes[0] >= 0.0 and notes[1] >= 0.0
        elif check == _FRICTION:
            holds = notes[2] <= friction
        elif check == _KNEE:
            holds = notes[3] >= -settings.knee_latch and notes[4] >= -settings.knee_latch
        else:
            holds = notes[5] >= -settings.scuff_depth - _DEPTH
        if not holds:
            return _FIRST_REASON + check
    return 0


@jitted
def check_step(here, i):
    """Check the constraints of a walker after its step; a violated one ends its episode."""
    record, row = here.records[i, 0], here.ledger[i]
    look = here.hooks[record.phase].look
    if look != 0 and record.outcome == 0:
        call(look, address(here.records[i]), address(here.bodies[i]), 0, 0, 0.0, 0.0)
    struck = record.outcome == _HEELSTRIKE
    if record.outcome == 0 or struck:
        friction = here.disturbances[i].friction
        row.violated = violated_constraint(here.bodies[i, 0, -_ROOM:], here.settings[0], friction)
    if struck:
        here.disturbances[i].due -= record.time
        if row.violated != 0:  # the record already has the legs exchanged
            task.place_hip(here, i)
            row.origin -= record.place - record.passed


@merged
def step(here, first, last, tiles, histories):
    """Step every walker by finite actions, with its disturbances; see `task.step`."""
    settings, disturbances = here.settings[0], here.disturbances
    disturb_actions(here, first, last)
    task.apply_action(here, first, last, here.acted)
    for i in range(first, last):
        disturbances[i].idle = task.over(here.ledger[i])
        clear_readings(here, i)
    integrate_past_events(here, first, last, tiles, histories)
    for i in range(first, last):
        if not disturbances[i].idle:
            check_step(here, i)
    strides, endings = task.finish_step(here, first, last)
    for i in range(first, last):
        row, disturbance = here.ledger[i], disturbances[i]
        if not disturbance.idle:
            disturbance.push_work = here.bodies[i, 0, _WORK - _ROOM] / here.rules[0].weight
            disturbance.episode_push_work += disturbance.push_work
            if settings.commanded and row.outcome == _HEELSTRIKE:
                command, weight = disturbance.command, settings.command_weight
                lost = command_penalty(row.step_length, row.step_period, command, weight)
                row.reward -= lost
                row.total -= lost
                here.rewards[i] -= lost
            if settings.uneven and row.outcome == _HEELSTRIKE:
                step_over(here, i)
                task.write_observation(here, i)
        add_observation_noise(here, i)
    return strides, endings
