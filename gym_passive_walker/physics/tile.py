"""What a tile holds, and how walkers enter and leave its lanes (see `lanes`)."""

from __future__ import annotations

from gym_passive_walker.physics import constants as K
from gym_passive_walker.physics import events as E
from gym_passive_walker.physics import record as R
from gym_passive_walker.physics import runge_kutta
from gym_passive_walker.physics.lanes import get, inlined, jitted, put

# A tile's rows. Stage accelerations: three rows for each of the stages, and for the step's end.
ANGLE, RATE, NEW_ANGLE, NEW_RATE, STAGE = 0, 3, 6, 9, 12
NEW_STAGE = STAGE + 3 * runge_kutta.STAGES
H = NEW_STAGE + 3  # length of the step
NEXT, TIME, END, ERROR, VERDICT, EVENT, LOW, HIGH, STEPS, TURN = range(H + 1, H + 11)
FRESH, SIN, COS, TORQUE = range(H + 11, H + 15)
CONSTANT = H + 15
CONSTANTS = K.KNEE_SINE + 1
ROWS = CONSTANT + CONSTANTS


@inlined
def larger(a, b):
    """The larger of two reals."""
    return a if a > b else b


@inlined
def settle(tile, lane, i, plain):
    """Take the step's end as the new start, if it is plain that this is right."""
    angle, rate = get(tile, ANGLE + i, lane), get(tile, RATE + i, lane)
    first = get(tile, STAGE + i, lane)
    put(tile, ANGLE + i, lane, get(tile, NEW_ANGLE + i, lane) if plain else angle)
    put(tile, RATE + i, lane, get(tile, NEW_RATE + i, lane) if plain else rate)
    put(tile, STAGE + i, lane, get(tile, NEW_STAGE + i, lane) if plain else first)


@inlined
def equip(tile, lane, c):
    """Give a lane its walker's constants."""
    for i in range(CONSTANTS):
        put(tile, CONSTANT + i, lane, c[i])


@jitted
def load(phase, tile, lane, records, constants, index, first_step):
    """Put a walker into a lane."""
    record = records[index]
    for i in range(3):
        put(tile, ANGLE + i, lane, record[R.ANGLES + i])
        put(tile, RATE + i, lane, record[R.RATES + i])
    put(tile, TIME, lane, record[R.TIME])
    put(tile, END, lane, record[R.END])
    put(tile, SIN, lane, record[R.SIN_SLOPE])
    put(tile, COS, lane, record[R.COS_SLOPE])
    put(tile, TORQUE, lane, record[R.TORQUE])
    put(tile, EVENT, lane, 0.0)
    put(tile, STEPS, lane, 0.0)
    put(tile, TURN, lane, 0.0)
    put(tile, FRESH, lane, 1.0)
    if phase != E.SIMPLEST and len(constants) > 1:
        equip(tile, lane, constants[index])
    proposed = record[R.STEP]
    if proposed.real <= 0.0:
        proposed = 0.0 * proposed + first_step
    put(tile, NEXT, lane, proposed)
    go_on(tile, lane)


@jitted
def unload(phase, tile, lane, record, event):
    """Take a walker that is done out of its lane."""
    record[R.HIP_NET] -= record[R.ANGLES + 1] - record[R.ANGLES]
    for i in range(3):
        record[R.ANGLES + i] = get(tile, ANGLE + i, lane)
        record[R.RATES + i] = get(tile, RATE + i, lane)
    if phase != E.FREE:
        record[R.ANGLES + 2] = record[R.ANGLES + 1]
        record[R.RATES + 2] = record[R.RATES + 1]
    record[R.HIP_NET] += record[R.ANGLES + 1] - record[R.ANGLES]
    record[R.TIME] = get(tile, TIME, lane)
    record[R.STEP] = get(tile, NEXT, lane)
    record[R.STEPS] += get(tile, STEPS, lane)
    record[R.HIP_TURN] += get(tile, TURN, lane)
    if event == -1:
        record[R.TIME] = record[R.END]
        record[R.OUTCOME] = -1.0
    elif event == -2:
        record[R.OUTCOME] = float(E.Outcome.DIVERGED.value)
    else:
        record[R.OUTCOME] = float(E.OUTCOMES[event])


@jitted
def move(tile, source, target):
    """Move a walker from one lane to another; the stages between a step's ends are spent."""
    for row in range(STAGE + 3):
        put(tile, row, target, get(tile, row, source))
    for row in range(NEW_STAGE, ROWS):
        put(tile, row, target, get(tile, row, source))


@inlined
def next_waiting(records, index, phase):
    """The first record from an index on that waits for a phase; their number if none does."""
    while index < len(records):
        if records[index, R.PHASE].real == phase and records[index, R.OUTCOME].real == 0.0:
            break
        index += 1
    return index


@inlined
def go_on(tile, lane):
    """Next step: the proposed length, or what is left of the time."""
    rest = get(tile, END, lane) - get(tile, TIME, lane)
    following = get(tile, NEXT, lane)
    put(tile, H, lane, following if 1.1 * following.real < rest.real else rest)
