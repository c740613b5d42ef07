"""What an agent does, sees and is paid for: one kernel for a step of any number of walkers.

A single environment is a batch of one, so it and every vector environment go through the same
instructions and agree to the last bit. All numbers are dimensionless (see `physics.constants`).

Each walker has its record, which the engine carries along (`physics.record`), and a row of the
*ledger*, whose columns are named here: what the environment keeps of a stride and an episode.
"""

from __future__ import annotations

import math

import numpy as np

from gym_passive_walker.physics import constants as K
from gym_passive_walker.physics import record as R
from gym_passive_walker.physics.engine import run_compass, run_kneed, run_simplest
from gym_passive_walker.physics.events import Outcome
from gym_passive_walker.physics.lanes import inlined, jitted, kernel, sine_cosine
from gym_passive_walker.physics.ledger import advance_of_contact, gravity_work

# Columns of the ledger. What `info` tells at every step:
DISTANCE = 0  # progress of the hip along the slope in this step, in leg lengths
ENERGY = 1  # what the motor is charged for in this step, / (m g l)
EPISODE_DISTANCE, EPISODE_ENERGY = 2, 3
STRIDES = 4  # heelstrikes since the episode began
EVERY_STEP = 5
# ... and when a stride or the episode ends; zero at other steps:
OUTCOME = 5
MEASURES = 6
STEP_LENGTH, STEP_PERIOD, SPEED = 6, 7, 8
COST_OF_TRANSPORT = 9  # gravity's work and the motor's charge, over weight and step length
GRAVITY_COST, HIP_COST, NET_HIP_COST, COLLISION_COST = 10, 11, 12, 13
KNEESTRIKE_TIME = 14
TOLD = 15
# What is kept besides:
REWARD = 15
ENDING = 16  # outcome that ended the episode; 0 while it goes on
TRUNCATED = 17
STEPS, RETURN = 18, 19  # of the episode
SLOPE = 20
ORIGIN = 21  # where the stance foot would touch the ground with its leg along the normal
STANCE = 22  # stance angle before the step
START = 23  # the stride's first angles: stance, thigh, shank
NET_WORK, CHARGE = 26, 27  # of the motor since the stride began
PROGRESS = 28  # of the hip since the stride began
COLUMNS = 29

# Entries of the rules.
TICK, LONGEST_STRIDE, MAX_HIP_TORQUE, ENERGY_WEIGHT, CHARGED, STEP_LIMIT = range(6)
TOLERANCE, LANDING, FIRST_STEP, STUB = range(6, 10)
RULES = 10

ENERGIES = ("absolute", "positive", "net")
"""How the motor is charged for hip work; `CHARGED` is an index into this."""

SIZE = 8
"""Numbers in an observation."""

RATE_BOUND = 10.0
"""Rates are clipped to this; walking and falling stay well below."""

BOUNDS = np.array([0.5 * math.pi, math.pi, math.pi, *[RATE_BOUND] * 3, 1.0, 0.5 * math.pi])
"""Largest size of each number in an observation."""


@inlined
def clipped(value, bound):
    """The value, no larger than a bound either way; not-a-number becomes the lower one."""
    value = value if value > -bound else -bound
    return value if value < bound else bound


@inlined
def over(row):
    """Whether the walker's episode has ended."""
    return row[ENDING] != 0.0 or row[TRUNCATED] != 0.0


@jitted
def hip_from_contact(c, stance):
    """How far the hip is ahead of the point that the stance foot stands on at stance angle 0."""
    sine, _ = sine_cosine(stance)
    return -(c[K.FOOT_RADIUS] * stance + c[K.LEG] * sine)


@jitted
def see(record, row, kind, observations, first):
    """Write a walker's observation."""
    for i in range(6):
        observations[first + i] = clipped(record[i], BOUNDS[i])
    locked = kind != 0 or record[R.PHASE] == 1.0
    observations[first + 6] = 1.0 if locked else 0.0
    observations[first + 7] = clipped(row[SLOPE], BOUNDS[7])


@kernel
def observe(records, ledger, kind, observations):
    """Write all walkers' observations, flat."""
    for i in range(len(records)):
        see(records[i], ledger[i], kind, observations, i * SIZE)


@kernel
def tell(ledger, asked, columns, strides, outcomes, ended, struck):
    """Write the ledger's first columns, of the walkers asked about; of the others, zeros.

    Args:
        ledger: The ledger.
        asked: Which walkers are asked about.
        columns: Zeros, filled: a row for each of the first columns, EVERY_STEP or TOLD of them.
        strides: Filled with the number of strides.
        outcomes: Filled with outcomes, as numbers.
        ended: Filled: whose stride or episode has ended.
        struck: Filled: whose stride has ended with a heelstrike.

    Returns:
        How many walkers are asked about, how many of them have ended something, and how many have
        ended a stride.
    """
    present, endings, strikes = 0, 0, 0
    for i in range(len(ledger)):
        row = ledger[i]
        outcome = int(row[OUTCOME]) if asked[i] else 0
        if asked[i]:
            for k in range(len(columns) if outcome else EVERY_STEP):
                columns[k, i] = row[k]
        strides[i] = int(columns[STRIDES, i])
        outcomes[i] = outcome
        ended[i] = outcome != 0
        struck[i] = outcome == 1  # Outcome.HEELSTRIKE
        present += asked[i]
        endings += ended[i]
        strikes += struck[i]
    return present, endings, strikes


@kernel
def begin(
    records, constants, ledger, kind, lanes, slopes, gaits, draws, perturbation, observations
):
    """Begin the episodes of some walkers, each near a section state.

    Slopes and gaits have a row for each, or one for all. Angles, stance rate and swing rates are
    off by a factor each, which the draws (from 0 to 1, in columns 1 to 3) put between
    1 - perturbation and 1 + perturbation. Thigh and shank share theirs: so the knee of a leg that
    has just left the ground opens.
    """
    for j in range(len(lanes)):
        i = lanes[j]
        record, row = records[i], ledger[i]
        record[:] = 0.0
        row[:] = 0.0
        row[SLOPE] = slopes[j if len(slopes) > 1 else 0]
        record[R.SIN_SLOPE], record[R.COS_SLOPE] = sine_cosine(row[SLOPE])
        gait = gaits[j if len(gaits) > 1 else 0]
        for k in range(6):
            which = 1 if k < 3 else (2 if k == 3 else 3)
            record[k] = gait[k] * (1.0 + perturbation * (2.0 * draws[j, which] - 1.0))
        row[START : START + 3] = record[:3]
        radius = constants[i if len(constants) > 1 else 0, K.FOOT_RADIUS]
        row[ORIGIN] = radius * record[R.ANGLES]
        see(record, row, kind, observations, i * SIZE)


@inlined
def command(records, ledger, rules, actions):
    """Set every walker's torque and the time to stop.

    Returns:
        The first walker whose action is no finite number, before anything has changed; else -1.
    """
    for i in range(len(records)):
        if not np.isfinite(actions[i]) and not over(ledger[i]):
            return i
    for i in range(len(records)):
        record, row = records[i], ledger[i]
        share = 0.0 if over(row) else clipped(actions[i], 1.0)
        record[R.TORQUE] = rules[MAX_HIP_TORQUE] * share
        record[R.HIP_NET] = 0.0
        record[R.HIP_TURN] = 0.0
        until = record[R.TIME] + rules[TICK]
        record[R.END] = until if until < rules[LONGEST_STRIDE] else rules[LONGEST_STRIDE]
        row[STANCE] = record[R.ANGLES]
    return -1


@jitted
def charge(record, row, rules):
    """Enter the step's hip work; a torque held constant works by the angle that it turns."""
    net = record[R.TORQUE] * record[R.HIP_NET]
    absolute = abs(record[R.TORQUE]) * record[R.HIP_TURN]
    if rules[CHARGED] == 0.0:
        row[ENERGY] = absolute
    elif rules[CHARGED] == 1.0:
        row[ENERGY] = 0.5 * (absolute + net)
    else:
        row[ENERGY] = net
    row[NET_WORK] += net
    row[CHARGE] += row[ENERGY]


@jitted
def end_stride(record, row, c, kind):
    """Measure the stride that a heelstrike has just ended, and open the next one."""
    end = (-record[0], -record[1], -record[2])  # before the legs changed roles
    start = row[START : START + 3]
    length = advance_of_contact(c, start[0], record[0])
    work = gravity_work(kind, c, start, end, record[R.SIN_SLOPE], record[R.COS_SLOPE])
    row[STRIDES] += 1.0
    row[STEP_LENGTH] = length
    row[STEP_PERIOD] = record[R.TIME]
    row[SPEED] = length / record[R.TIME]
    row[GRAVITY_COST] = work / length
    row[HIP_COST] = row[CHARGE] / length
    row[NET_HIP_COST] = row[NET_WORK] / length
    row[COST_OF_TRANSPORT] = row[GRAVITY_COST] + row[HIP_COST]
    row[COLLISION_COST] = (record[R.KNEE_LOSS] + record[R.HEEL_LOSS]) / length
    row[KNEESTRIKE_TIME] = record[R.KNEE_TIME]
    row[START : START + 3] = record[R.ANGLES : R.ANGLES + 3]
    row[NET_WORK] = 0.0
    row[CHARGE] = 0.0
    row[PROGRESS] = 0.0
    row[ORIGIN] -= 2.0 * hip_from_contact(c, record[0])
    record[R.TIME] = 0.0
    record[R.KNEE_TIME] = 0.0
    record[R.KNEE_LOSS] = 0.0
    record[R.HEEL_LOSS] = 0.0


@jitted
def progress(record, row, c):
    """Enter how far the hip has come.

    A stride without heelstrike does not count: what was paid for it in advance is taken back, or
    agents learn to dive, which carries the hip a whole leg length at once.
    """
    struck = record[R.OUTCOME] == 1.0  # Outcome.HEELSTRIKE
    stance = -record[R.ANGLES] if struck else record[R.ANGLES]  # before the legs changed roles
    row[DISTANCE] = hip_from_contact(c, stance) - hip_from_contact(c, row[STANCE])
    if row[ENDING] != 0.0:
        row[DISTANCE] = 0.0 - row[PROGRESS]
    row[PROGRESS] += row[DISTANCE]
    row[EPISODE_DISTANCE] += row[DISTANCE]


@inlined
def settle(records, constants, ledger, rules, kind, observations, rewards, terminated, truncated):
    """Work out what every walker's step has come to.

    Returns:
        How many strides, and how many episodes have ended.
    """
    strides, endings = 0, 0
    for i in range(len(records)):
        record, row = records[i], ledger[i]
        c = constants[i if len(constants) > 1 else 0]
        idle = over(row)
        struck = record[R.OUTCOME] == 1.0  # Outcome.HEELSTRIKE
        row[OUTCOME:TOLD] = 0.0
        row[OUTCOME] = record[R.OUTCOME]
        if record[R.OUTCOME] == 0.0 and record[R.TIME] >= rules[LONGEST_STRIDE]:
            row[OUTCOME] = float(Outcome.STALLED.value)
        row[ENDING] = 0.0 if struck else row[OUTCOME]
        progress(record, row, c)
        row[ENERGY] = 0.0
        if rules[MAX_HIP_TORQUE] != 0.0 and kind != 2:  # feet without mass cost no work to move
            charge(record, row, rules)
        row[EPISODE_ENERGY] += row[ENERGY]
        row[REWARD] = row[DISTANCE] - rules[ENERGY_WEIGHT] * row[ENERGY]
        row[RETURN] += row[REWARD]
        row[STEPS] += 1.0
        if struck:
            end_stride(record, row, c, kind)
            strides += 1
        if row[STEPS] >= rules[STEP_LIMIT]:
            row[TRUNCATED] = 1.0
        rewards[i] = 0.0 if idle else row[REWARD]
        terminated[i] = row[ENDING] != 0.0 and not idle
        truncated[i] = row[TRUNCATED] != 0.0 and not idle
        endings += terminated[i] or truncated[i]
        see(record, row, kind, observations, i * SIZE)
    return strides, endings


@kernel
def step_kneed(
    records, constants, ledger, rules, actions, observations, rewards, terminated, truncated
):
    """A step of kneed walkers; returns `command`'s and `settle`'s answers."""
    wrong = command(records, ledger, rules, actions)
    if wrong >= 0:
        return wrong, 0, 0
    stub = int(rules[STUB])
    run_kneed(records, constants, rules[TOLERANCE], rules[LANDING], rules[FIRST_STEP], stub, False)
    strides, endings = settle(
        records, constants, ledger, rules, 0, observations, rewards, terminated, truncated
    )
    return wrong, strides, endings


@kernel
def step_compass(
    records, constants, ledger, rules, actions, observations, rewards, terminated, truncated
):
    """A step of straight-legged walkers; returns as `step_kneed` does."""
    wrong = command(records, ledger, rules, actions)
    if wrong >= 0:
        return wrong, 0, 0
    run_compass(records, constants, rules[TOLERANCE], rules[LANDING], rules[FIRST_STEP], 0, False)
    strides, endings = settle(
        records, constants, ledger, rules, 1, observations, rewards, terminated, truncated
    )
    return wrong, strides, endings


@kernel
def step_simplest(
    records, constants, ledger, rules, actions, observations, rewards, terminated, truncated
):
    """A step of simplest walkers; returns as `step_kneed` does."""
    wrong = command(records, ledger, rules, actions)
    if wrong >= 0:
        return wrong, 0, 0
    run_simplest(records, constants, rules[TOLERANCE], rules[LANDING], rules[FIRST_STEP], 0, False)
    strides, endings = settle(
        records, constants, ledger, rules, 2, observations, rewards, terminated, truncated
    )
    return wrong, strides, endings


KERNELS = {
    K.Kind.KNEED: step_kneed,
    K.Kind.COMPASS: step_compass,
    K.Kind.SIMPLEST: step_simplest,
}
