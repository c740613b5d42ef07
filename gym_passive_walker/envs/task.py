"""Actions, observations and rewards: compiled kernels for control steps of a batch of walkers.

A single environment is a batch of one. Single and vector environments therefore run the same
instructions, and their results are bitwise equal. All numbers are dimensionless (see
`equations.hybrid`).

Each walker has a record and a row of the *ledger*. The record is the state of the integration
(`engine.layout`). The ledger holds the accounts of the present stride and episode.
"""

from __future__ import annotations

import math
from functools import cache

import numpy as np

from gym_passive_walker.engine.jit import address, call, copy, entry, jitted, merged
from gym_passive_walker.engine.lanes import RESTING
from gym_passive_walker.engine.layout import MOST_CONSTANTS, NARROW, Layout
from gym_passive_walker.engine.run import integrate
from gym_passive_walker.gaits.scenes.rules import (
    clip,
    distance_of,
    ends_episode,
    motor_charge,
    observation,
    outcome_of,
    reward,
    step_end,
)
from gym_passive_walker.models.equations.hybrid import Outcome

EVERY_STEP = ("distance", "energy", "episode_distance", "episode_energy", "strides")
"""Entries of `info` at every step: distance of the hip along the slope in this step, in leg
lengths; energy that the actuators are charged for, / (m g l); their sums over the episode; number
of heelstrikes in the episode."""

EVERY_STRIDE = (
    "step_length",
    "step_period",
    "speed",
    "cost_of_transport",  # work of gravity and energy of all actuators, over weight and step length
    "gravity_cost",
    "hip_cost",
    "net_hip_cost",
    "ankle_cost",
    "net_ankle_cost",
    "push_off_cost",
    "collision_cost",
    "friction_cost",
    "kneestrike_time",
)
"""Further entries of `info` at steps that end a stride; zero at other steps."""


@cache
def ledger_for(layout: Layout) -> np.dtype:
    """Return the data type of a ledger for walkers with records of a layout."""
    channels = (layout.controls + 1,)  # the controls, then the push-off
    return np.dtype(
        [(name, "f8") for name in (*EVERY_STEP[:-1], *EVERY_STRIDE)]
        + [
            ("strides", "i8"),
            ("outcome", "i8"),  # of the stride or the episode that this step ends; else 0
            ("ending", "i8"),  # outcome that ended the episode; 0 before
            ("violated", "i8"),  # constraint that ended the episode; else 0
            ("truncated", "i8"),
            ("steps", "i8"),  # number of control steps in the episode
            ("reward", "f8"),
            ("total", "f8"),  # sum of the rewards in the episode
            ("slope", "f8"),
            ("origin", "f8"),  # contact point of the stance foot at stance angle 0
            ("place", "f8"),  # position of the hip relative to the origin, before the step
            # Sums over the completed strides of the episode: time, and work of gravity.
            ("clock", "f8"),
            ("descent", "f8"),
            # Since the stride began: net work and charge of each channel, distance of the hip.
            ("net_work", "f8", channels),
            ("charge", "f8", channels),
            ("progress", "f8"),
        ]
    )


LEDGER = ledger_for(NARROW)


@cache
def rules_for(layout: Layout) -> np.dtype:
    """Return the data type of a scene's rules for walkers with records of a layout."""
    channels = (layout.controls + 1,)
    return np.dtype([
        ("tick", "f8"),
        ("max_stride_time", "f8"),
        ("actions", "i8"),  # number of actions
        ("channels", "i8", channels),  # index for each action; the last is the push-off
        ("largest", "f8", channels),  # largest value of each channel; 0 if it is not used
        ("energy_weight", "f8"),
        ("step_limit", "f8"),
        ("charged", "i8"),  # an index into ENERGIES
        # Work / (m g l) of a unit of each control; 0 if it costs none, as on feet without mass.
        ("works", "f8", channels),
        ("weight", "f8"),  # weight of the walker, in the unit of its records
        ("reset_noise_scale", "f8"),
        # Of a system, which is observed whole and begins with its gait's; else 0.
        ("coordinates", "i8"),
        # Places of constants that legs exchange at a heelstrike, pair after pair, and their number.
        ("exchange", "i8", (MOST_CONSTANTS,)),
        ("exchanged", "i8"),
    ])  # fmt: skip


RULES = rules_for(NARROW)

_HEELSTRIKE = int(Outcome.HEELSTRIKE)


@jitted
def over(row):
    """Return whether the walker's episode has ended."""
    return row.ending != 0 or row.truncated != 0


@jitted
def write_observation(here, i):
    """Write the observation of a walker."""
    record, first = here.records[i, 0], i * (len(here.observations) // len(here.records))
    slope, count = here.ledger[i].slope, here.rules[0].coordinates
    if count == 0:
        locked = 1.0 * here.phases[record.phase].knee_locked
        for k, value in enumerate(observation(record.state, locked, slope)):
            here.observations[first + k] = value
        return
    for k in range(count):
        here.observations[first + k] = record.state[k]
        here.observations[first + count + k] = record.state[len(record.start) + k]
    here.observations[first + 2 * count] = slope


def place_hip(here, i):
    """Set the place of a walker's hip."""
    body = here.bodies[i if len(here.bodies) > 1 else 0]  # equal walkers share one row
    call(here.phases[0].place, address(here.records[i]), address(body), 0, 0, 0.0, 0.0)


@jitted
def exchange_legs(here, i):
    """Exchange the constants in which a walker's legs differ, after a heelstrike."""
    rules, constants = here.rules[0], here.bodies
    for k in range(0, rules.exchanged, 2):
        a, b = rules.exchange[k], rules.exchange[k + 1]
        kept = constants[i, 0, a]
        constants[i, 0, a] = constants[i, 0, b]
        constants[i, 0, b] = kept


@jitted
def begin(here, lanes, slopes, gaits, draws):
    """Begin the episodes of some walkers, each near a state on the Poincaré section.

    Slopes and gaits have one row for each walker, or one row for all. One random factor scales the
    angles, one the angular velocity of the stance leg, one those of the swing leg. Each factor lies
    between 1 - reset_noise_scale and 1 + reset_noise_scale. Columns 1 to 3 of the draws, from 0 to
    1, give the factors. Thigh and shank share a factor, so that the knee of a leg that has just
    left the ground opens. A system keeps its coordinates, as other coordinates need not be on the
    section; the factor of the stance leg scales its first rate, that of the swing leg the others.
    """
    rules = here.rules[0]
    scale = rules.reset_noise_scale
    scale_of_angles = scale if rules.coordinates == 0 else 0.0
    for j in range(len(lanes)):
        i = lanes[j]
        if here.ledger[i].strides % 2 == 1:  # each episode begins on the same leg
            exchange_legs(here, i)
        copy(entry(here.records, i), address(here.blank), here.blank.itemsize)
        copy(entry(here.ledger, i), address(here.blank_row), here.blank_row.itemsize)
        record, row = here.records[i, 0], here.ledger[i]
        row.slope = slopes[j if len(slopes) > 1 else 0]
        record.ground[0], record.ground[1] = math.sin(row.slope), math.cos(row.slope)
        gait = gaits[j if len(gaits) > 1 else 0]
        links = len(record.start)
        for k in range(2 * links):
            which = 1 if k < links else (2 if k == links else 3)
            share = scale_of_angles if k < links else scale
            record.state[k] = gait[k] * (1.0 + share * (2.0 * draws[j, which] - 1.0))
        for k in range(links):
            record.start[k] = record.state[k]
        row.origin = here.radii[i if len(here.radii) > 1 else 0] * record.state[0]
        place_hip(here, i)
        row.place = record.place
        write_observation(here, i)


@jitted
def first_invalid(here, first, last):
    """Return the index of the first walker in an episode with a non-finite action, or -1."""
    count = here.rules[0].actions
    for i in range(first, last):
        for j in range(count):
            if not math.isfinite(here.actions[i * count + j]) and not over(here.ledger[i]):
                return i
    return -1


@jitted
def apply_action(here, first, last, actions):
    """Set the torques, push-off and end time of each walker; it rests after its episode."""
    rules, count = here.rules[0], here.rules[0].actions
    for i in range(first, last):
        record = here.records[i, 0]
        if over(here.ledger[i]):
            record.outcome = RESTING
            continue
        for j in range(count):
            channel = rules.channels[j]
            largest = rules.largest[channel]
            if channel == len(record.control):
                record.push_off = largest * clip(actions[i * count + j], 0.0, 1.0)
            else:
                record.control[channel] = largest * clip(actions[i * count + j], -1.0, 1.0)
                record.moved[channel] = 0.0
                record.turned[channel] = 0.0
        record.end = step_end(record.time, rules.tick, rules.max_stride_time)


@merged
def integrate_step(here, first, last, tiles, histories):
    """Integrate each walker to the end of its step; see `run.integrate`."""
    bodies = here.bodies
    if len(bodies) > 1:
        bodies = bodies[first:last]
    integrate(here.records[first:last], bodies, here.phases, here.options, tiles, histories)


@jitted
def charge(record, row, rules):
    """Add the energy of each actuator in this step to the ledger."""
    push_off = len(record.control)
    for channel in range(push_off):
        if rules.largest[channel] == 0.0 or rules.works[channel] == 0.0:
            continue
        torque = record.control[channel] * rules.works[channel]
        moved, turned = record.moved[channel], record.turned[channel]
        energy = motor_charge(rules.charged, torque, moved, turned)
        row.energy += energy
        row.charge[channel] += energy
        row.net_work[channel] += torque * moved
    if record.outcome == _HEELSTRIKE and rules.largest[push_off] != 0.0:
        row.energy += record.push_work
        row.charge[push_off] = record.push_work


@jitted
def end_stride(record, row, rules):
    """Write the measures of the stride that a heelstrike ended, and begin the next stride."""
    length, push_off = record.step_length, len(record.control)
    way = length * rules.weight
    row.strides += 1
    row.step_length = length
    row.step_period = record.time
    row.speed = length / record.time
    row.gravity_cost = record.gravity_work / way
    row.hip_cost, row.net_hip_cost = row.charge[0] / length, row.net_work[0] / length
    row.ankle_cost, row.net_ankle_cost = row.charge[1] / length, row.net_work[1] / length
    row.push_off_cost = row.charge[push_off] / length
    motors = row.hip_cost + row.ankle_cost
    for channel in range(2, push_off):
        motors += row.charge[channel] / length
    motors += row.push_off_cost
    row.cost_of_transport = row.gravity_cost + motors
    row.collision_cost = (record.knee_loss + record.heel_loss) / way
    row.friction_cost = record.friction_loss / way
    row.kneestrike_time = record.knee_time
    for channel in range(push_off + 1):
        row.net_work[channel], row.charge[channel] = 0.0, 0.0
    row.progress = 0.0
    row.clock += record.time
    row.descent += record.gravity_work / rules.weight
    row.origin -= record.place - record.passed
    record.time, record.knee_time = 0.0, 0.0
    record.knee_loss, record.heel_loss, record.friction_loss = 0.0, 0.0, 0.0


@jitted
def count_progress(record, row):
    """Add the distance of the hip in this step to the accounts of stride and episode."""
    came = record.passed if record.outcome == _HEELSTRIKE else record.place
    row.distance = distance_of(row.ending != 0, came - row.place, row.progress)
    row.place = record.place
    row.progress += row.distance
    row.episode_distance += row.distance


@jitted
def account_step(here, i):
    """Write the accounts, reward and termination of a walker after the integration of a step.

    Returns 1 if a stride ends, else 0.
    """
    record, row, rules = here.records[i, 0], here.ledger[i], here.rules[0]
    if row.outcome != 0:
        forget_stride(row)
    row.outcome = outcome_of(record.outcome, record.time, rules.max_stride_time)
    if row.violated != 0:
        row.outcome = row.violated
    struck = row.outcome == _HEELSTRIKE
    row.ending = row.outcome if ends_episode(row.outcome) else 0
    count_progress(record, row)
    row.energy = 0.0
    charge(record, row, rules)
    row.episode_energy += row.energy
    row.reward = reward(row.distance, row.energy, rules.energy_weight)
    row.total += row.reward
    row.steps += 1
    if struck:
        end_stride(record, row, rules)
    if row.steps >= rules.step_limit:
        row.truncated = 1
    here.rewards[i] = row.reward
    here.terminated[i], here.truncated[i] = row.ending != 0, row.truncated != 0
    return 1 if struck else 0


@jitted
def finish_step(here, first, last):
    """Compute the reward, observation and termination of each walker after integration.

    Returns:
        Number of strides that end, and number of episodes that end.
    """
    strides, endings = 0, 0
    rewards, terminated, truncated = here.rewards, here.terminated, here.truncated
    for i in range(first, last):
        record = here.records[i, 0]
        if record.outcome == RESTING:
            rewards[i], terminated[i], truncated[i] = 0.0, False, False
            write_observation(here, i)
            continue
        if record.outcome == _HEELSTRIKE:
            exchange_legs(here, i)
        place_hip(here, i)
        strides += account_step(here, i)
        endings += terminated[i] or truncated[i]
        write_observation(here, i)
    return strides, endings


@jitted
def forget_stride(row):
    """Set the measures of the last stride to zero."""
    row.step_length, row.step_period, row.speed, row.cost_of_transport = 0.0, 0.0, 0.0, 0.0
    row.gravity_cost, row.hip_cost, row.net_hip_cost = 0.0, 0.0, 0.0
    row.ankle_cost, row.net_ankle_cost, row.push_off_cost = 0.0, 0.0, 0.0
    row.collision_cost, row.friction_cost, row.kneestrike_time = 0.0, 0.0, 0.0


@merged
def step(here, first, last, tiles, histories):
    """Step each walker by its finite actions; returns the result of `finish_step`.

    Args:
        here: Arrays of the batch; see `memory`.
        first: Index of the first walker.
        last: Index after that of the last walker.
        tiles: Working memory of the thread, from `run.workspace`.
        histories: Working memory of the thread, from `run.workspace`.
    """
    apply_action(here, first, last, here.actions)
    integrate_step(here, first, last, tiles, histories)
    return finish_step(here, first, last)
