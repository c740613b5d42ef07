"""What an agent does, sees and is paid for: one kernel for a step of any number of walkers.

A single environment is a batch of one, so it and every vector environment go through the same
instructions and agree to the last bit. All numbers are dimensionless (see `physics.hybrid`).

Each walker has its record, which the engine carries along (`engine.layout`), and an entry of the
*ledger*: what the environment keeps of a stride and an episode.
"""

from __future__ import annotations

import math
from functools import cache

import numpy as np

from gym_passive_walker.engine.jit import Kernel, address, call, jitted, merged, view
from gym_passive_walker.engine.lanes import RESTING
from gym_passive_walker.engine.layout import NARROW, Layout
from gym_passive_walker.engine.run import integrate
from gym_passive_walker.envs.rules import BOUNDS as BOUNDS
from gym_passive_walker.envs.rules import ENERGIES as ENERGIES
from gym_passive_walker.envs.rules import HIGHEST as HIGHEST
from gym_passive_walker.envs.rules import LARGEST_PROPORTION as LARGEST_PROPORTION
from gym_passive_walker.envs.rules import LOWEST as LOWEST
from gym_passive_walker.envs.rules import SIZE as SIZE
from gym_passive_walker.envs.rules import STEEPEST as STEEPEST
from gym_passive_walker.envs.rules import (
    clip,
    distance_of,
    ends_episode,
    motor_charge,
    observation,
    outcome_of,
    reward,
    step_end,
)
from gym_passive_walker.physics.hybrid import Outcome

EVERY_STEP = ("distance", "energy", "episode_distance", "episode_energy", "strides")
"""Entries of `info` at every step: progress of the hip along the slope in this step, in leg
lengths; what the motor is charged for in it, / (m g l); both since the episode began; heelstrikes
since then."""

CHANNELS = ("hip", "ankle", "push_off")
"""What agents may act by: the controls that are held, and the impulse before heelstrike."""

EVERY_STRIDE = (
    "step_length",
    "step_period",
    "speed",
    "cost_of_transport",  # gravity's work and all motors' charge, over weight and step length
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
"""Further entries of `info` where a stride ends; zero at other steps."""


@cache
def ledger_for(layout: Layout) -> np.dtype:
    """The layout of a ledger, for walkers with records of a layout."""
    channels = (layout.controls + 1,)  # the controls, then the push-off
    return np.dtype(
        [(name, "f8") for name in (*EVERY_STEP[:-1], *EVERY_STRIDE)]
        + [
            ("strides", "i8"),
            ("outcome", "i8"),  # of a stride or an episode that has ended in this step
            ("ending", "i8"),  # outcome that ended the episode; 0 while it goes on
            ("violated", "i8"),  # the same, by a rule of `disturbance_kernels`
            ("truncated", "i8"),
            ("steps", "i8"),  # of the episode
            ("reward", "f8"),
            ("total", "f8"),  # of the rewards
            ("slope", "f8"),
            ("origin", "f8"),  # where the stance foot would touch the ground at stance angle 0
            ("place", "f8"),  # of the hip from there, before the step
            # Of the strides that have ended since the episode began: time, and gravity's work.
            ("clock", "f8"),
            ("descent", "f8"),
            # Since the stride began: of each channel's motor, and of the hip.
            ("net_work", "f8", channels),
            ("charge", "f8", channels),
            ("progress", "f8"),
        ]
    )


LEDGER = ledger_for(NARROW)


@cache
def rules_for(layout: Layout) -> np.dtype:
    """The layout of a scene's rules, for walkers with records of a layout."""
    channels = (layout.controls + 1,)
    return np.dtype([
        ("tick", "f8"),
        ("max_stride_time", "f8"),
        ("actions", "i8"),  # how many an agent has
        ("channels", "i8", channels),  # of each action: the number of a control, or the last
        ("largest", "f8", channels),  # of each channel; 0 if it is not in use
        ("energy_weight", "f8"),
        ("step_limit", "f8"),
        ("charged", "i8"),  # an index into ENERGIES
        # Work / (m g l) of a unit of each control; 0 where it costs none: on feet without mass.
        ("works", "f8", channels),
        ("weight", "f8"),  # of the walker, in the unit of its records
    ])  # fmt: skip


RULES = rules_for(NARROW)

_HEELSTRIKE, _NUMBER = int(Outcome.HEELSTRIKE), np.dtype("f8")


@jitted
def over(row):
    """Whether the walker's episode has ended."""
    return row.ending != 0 or row.truncated != 0


@jitted
def write_observation(record, row, phases, observations, first):
    """Write a walker's observation."""
    locked = 1.0 if phases[record.phase].links == 2 else 0.0
    for i, value in enumerate(observation(record.state, locked, row.slope)):
        observations[first + i] = value  # of a user's own system, `custom.everything` is observed


@Kernel
def observe(records, ledger, phases, observations):
    """Write all walkers' observations, flat."""
    size = len(observations) // len(records)
    for i in range(len(records)):
        write_observation(records[i, 0], ledger[i], phases, observations, i * size)


@jitted
def write_info(ledger, asked, steps, counts, measures):
    """Write the numbers that infos report of the walkers asked about; of the others, zeros.

    Args:
        ledger: The ledger.
        asked: Which walkers are asked about.
        steps: Filled: a row for each of EVERY_STEP but the last.
        counts: Filled with the number of strides, and with the outcome, as a number, where a stride
            or an episode has ended.
        measures: Filled from the front: a row for each of these, with EVERY_STRIDE.

    Returns:
        How many walkers are asked about.
    """
    present, endings, first = 0, 0, len(steps)
    row_words = ledger.itemsize // 8
    words = view(address(ledger), (len(ledger), row_words), _NUMBER)  # EVERY_STEP, EVERY_STRIDE
    for i in range(len(ledger)):
        for k in range(first):
            steps[k, i] = words[i, k] if asked[i] else 0.0
        counts[0, i] = ledger[i].strides if asked[i] else 0
        counts[1, i] = ledger[i].outcome if asked[i] else 0
        present += asked[i]
        if counts[1, i] != 0:
            for k in range(measures.shape[1]):
                measures[endings, k] = words[i, first + k]
            endings += 1
    return present


@jitted
def begin(
    records, bodies, radii, ledger, blank_record, blank_row, phases, lanes,
    slopes, gaits, draws, reset_noise_scale, observations,
):  # fmt: skip
    """Begin the episodes of some walkers, each near a section state.

    Slopes and gaits have a row for each, or one for all. Angles, stance rate and swing rates have
    a factor each, between 1 - perturbation and 1 + perturbation. Columns 1 to 3 of the draws, from
    0 to 1, give these factors. Thigh and shank share theirs: so the knee of a leg that has just
    left the ground opens.
    """
    size = len(observations) // len(records)
    for j in range(len(lanes)):
        i = lanes[j]
        own = i if len(bodies) > 1 else 0
        records[i, 0], ledger[i] = blank_record[0], blank_row[0]
        record, row = records[i, 0], ledger[i]
        row.slope = slopes[j if len(slopes) > 1 else 0]
        record.ground[0], record.ground[1] = math.sin(row.slope), math.cos(row.slope)
        gait = gaits[j if len(gaits) > 1 else 0]
        links = len(record.start)
        for k in range(2 * links):
            which = 1 if k < links else (2 if k == links else 3)
            record.state[k] = gait[k] * (1.0 + reset_noise_scale * (2.0 * draws[j, which] - 1.0))
        for k in range(links):
            record.start[k] = record.state[k]
        row.origin = radii[own] * record.state[0]
        call(phases[0].place, address(records[i]), address(bodies[own]), 0, 0, 0.0, 0.0)
        row.place = record.place
        write_observation(record, row, phases, observations, i * size)


@jitted
def first_invalid(ledger, count, actions):
    """Return the first walker with an episode and an action that is not finite, or -1."""
    for i in range(len(ledger)):
        for j in range(count):
            if not math.isfinite(actions[i * count + j]) and not over(ledger[i]):
                return i
    return -1


@jitted
def apply_action(records, ledger, rules, actions):
    """Set every walker's torques, push-off and time to stop; after its episode it rests."""
    count = rules.actions
    for i in range(len(records)):
        record = records[i, 0]
        if over(ledger[i]):
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


@jitted
def charge(record, row, rules):
    """Enter the step's work of each motor."""
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
    """Measure the stride that a heelstrike has just ended, and open the next one."""
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
def progress(record, row):
    """Add the distance of the hip in the step to the stride and the episode."""
    came = record.passed if record.outcome == _HEELSTRIKE else record.place
    row.distance = distance_of(row.ending != 0, came - row.place, row.progress)
    row.place = record.place
    row.progress += row.distance
    row.episode_distance += row.distance


@jitted
def finish_step(
    records, bodies, ledger, rules, phases, observations, rewards, terminated, truncated
):
    """Work out what every walker's step has come to.

    Returns:
        How many strides, and how many episodes have ended.
    """
    strides, endings, size = 0, 0, len(observations) // len(records)
    for i in range(len(records)):
        record, row = records[i, 0], ledger[i]
        if record.outcome == RESTING:
            rewards[i], terminated[i], truncated[i] = 0.0, False, False
            write_observation(record, row, phases, observations, i * size)
            continue
        body = bodies[i if len(bodies) > 1 else 0]
        call(phases[0].place, address(records[i]), address(body), 0, 0, 0.0, 0.0)
        if row.outcome != 0:
            forget_stride(row)
        row.outcome = outcome_of(record.outcome, record.time, rules.max_stride_time)
        if row.violated != 0:
            row.outcome = row.violated
        struck = row.outcome == _HEELSTRIKE
        row.ending = row.outcome if ends_episode(row.outcome) else 0
        progress(record, row)
        row.energy = 0.0
        charge(record, row, rules)
        row.episode_energy += row.energy
        row.reward = reward(row.distance, row.energy, rules.energy_weight)
        row.total += row.reward
        row.steps += 1
        if struck:
            end_stride(record, row, rules)
            strides += 1
        if row.steps >= rules.step_limit:
            row.truncated = 1
        rewards[i] = row.reward
        terminated[i], truncated[i] = row.ending != 0, row.truncated != 0
        endings += terminated[i] or truncated[i]
        write_observation(record, row, phases, observations, i * size)
    return strides, endings


@jitted
def forget_stride(row):
    """Clear the measures of a stride's end."""
    row.step_length, row.step_period, row.speed, row.cost_of_transport = 0.0, 0.0, 0.0, 0.0
    row.gravity_cost, row.hip_cost, row.net_hip_cost = 0.0, 0.0, 0.0
    row.ankle_cost, row.net_ankle_cost, row.push_off_cost = 0.0, 0.0, 0.0
    row.collision_cost, row.friction_cost, row.kneestrike_time = 0.0, 0.0, 0.0


@merged
def step(
    records, bodies, ledger, rules, phases, options, tiles, histories,
    actions, observations, rewards, terminated, truncated,
):  # fmt: skip
    """Step every walker by finite actions; returns the result of `finish_step`."""
    apply_action(records, ledger, rules[0], actions)
    integrate(records, bodies, phases, options, tiles, histories)
    return finish_step(
        records, bodies, ledger, rules[0], phases, observations, rewards, terminated, truncated
    )
