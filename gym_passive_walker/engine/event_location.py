"""Event location within an integration step, one lane at a time.

Steps end on or near predicted impacts. The remaining time is then integrated along the polynomial
through the step's last accelerations, if that is as accurate as the step. Otherwise the step is
repeated from its start, with Newton's method on its *length*. A quintic through both ends of the
step gives the initial guess.

Events are the guards of a phase, numbered from 1 on. `history` is the guard history: values
and derivatives of guards at both ends of the step, as `one_lane.OneLane.look` writes them. Tangents
are integrated with the values: derivatives of a step's length shift the end along the motion.
"""

from __future__ import annotations

from gym_passive_walker.engine.jit import address, call, fma, jitted
from gym_passive_walker.engine.step import (
    LONGEST_STEP,
    MOST_STEPS,
    MUCH,
    NEAR,
    SAFETY,
    STRETCH,
)
from gym_passive_walker.models.equations.hybrid import Watch

TIME_UP, LOST, GIVEN_UP = -1, -2, -3
"""Ends of a phase other than guards: the time limit, numbers that are not finite, or a motion too
fast for `MOST_STEPS` integration steps."""

_DOUBT = 0.05
"""Share of a guard's change in a step within which the sign of its extremum is uncertain: the
quintic is of lower order than the step."""

_BRINK = 1e-6
"""Share of a step near its ends in which an extremum cannot hide two crossings: its depth is within
rounding."""

_TOUCH = 1e-4
"""Share of a step within which a guard that falls and rises only touches zero."""

_TOGETHER = 1e-14
"""Distance of a guard from zero at which the first of two events is decided; where both guards are
as near, either event may be chosen."""

_SCUFF = int(Watch.SCUFF)


def set_next_step(tile, lane):
    """Set the next step to the proposed length, or to the remaining time."""
    rest = tile.end[lane] - tile.time[lane]
    following = tile.next[lane]
    tile.h[lane] = following if STRETCH * following < rest else rest


def value(p, x):
    """Evaluate a polynomial of fifth degree at x."""
    return fma(x, fma(x, fma(x, fma(x, fma(x, p[5], p[4]), p[3]), p[2]), p[1]), p[0])


def derivative(p):
    """Return the coefficients of the derivative of a polynomial of fifth degree."""
    return p[1], 2.0 * p[2], 3.0 * p[3], 4.0 * p[4], 5.0 * p[5], 0.0 * p[5]


@jitted
def root(p):
    """Find a root in [0, 1] by bracketed Newton steps; the signs at 0 and 1 must differ."""
    low, high = 0.0, 1.0
    first, last = value(p, 0.0), value(p, 1.0)
    rising = last > 0.0
    d = derivative(p)
    x = first / (first - last)
    if not 0.0 <= x <= 1.0:  # rounding of huge coefficients may hide the sign change
        x = 0.5
    for _ in range(60):
        g = value(p, x)
        slope = value(d, x)
        if (g > 0.0) == rising:
            high = x
        else:
            low = x
        new = x - g / slope if slope != 0.0 else 0.5 * (low + high)
        if not low < new < high:
            new = 0.5 * (low + high)
        if abs(new - x) < 1e-6:  # quadratic convergence: the next change is about its square
            return new
        x = new
    return x


def quintic(history, i, h):
    """Return the quintic that matches guard i's values and two derivatives at both ends of a step.

    Its variable is the fraction of the step, of length h.
    """
    g0, v0, a0 = history.before[i], history.rate_before[i] * h, history.bend_before[i] * h * h
    v1, a1 = history.rate_after[i] * h, history.bend_after[i] * h * h
    rise = history.after[i] - g0 - v0 - 0.5 * a0
    turn = v1 - v0 - a0
    bend = a1 - a0
    return (
        g0,
        v0,
        0.5 * a0,
        10.0 * rise - 4.0 * turn + 0.5 * bend,
        -15.0 * rise + 7.0 * turn - bend,
        6.0 * rise - 3.0 * turn + 0.5 * bend,
    )


def extrapolated(history, i, ahead):
    """Extrapolate a guard by the time `ahead` beyond the step's end, to second order."""
    return history.after[i] + ahead * (history.rate_after[i] + 0.5 * ahead * history.bend_after[i])


def may_count(phase, history, i, h, x):
    """Return whether a guard's crossing may count at a fraction x of the step.

    Where a condition of the guard is near zero, the crossing may count; the state at the event
    decides. At the start of the step the conditions are known.
    """
    for k in range(phase.first_where[i], phase.first_where[i] + phase.wheres[i]):
        before, after = history.before[k], history.after[k]
        p = quintic(history, k, h)
        sway = abs(p[1]) + abs(p[2]) + abs(after - before)
        there = before if x < _BRINK else max(value(p, x) + _DOUBT * sway, after)
        if not there > 0.0:
            return False
    return True


def crossing(phase, history, i, h, scuff, ahead):
    """Return the fraction of the step at which a guard falls through zero and may count; or -1.

    A crossing up to the time `ahead` beyond the end is included, with the fraction 1.
    """
    if phase.watch[i] == _SCUFF and not scuff:
        return -1.0
    if not (history.before[i] > 0.0 and extrapolated(history, i, ahead) <= 0.0):
        return -1.0
    x = root(quintic(history, i, h)) if history.after[i] <= 0.0 else 1.0
    return x if may_count(phase, history, i, h, x) else -1.0


def turning(tile, phase, history, lane, k):
    """Return the fraction of the step at which a control's coordinate reverses; or -1."""
    i = phase.guards + k
    if history.rate_before[i] * history.rate_after[i] >= 0.0 or tile.control[k, lane] == 0.0:
        return -1.0
    return root(derivative(quintic(history, i, tile.h[lane])))


def between_turns(history, i, h):
    """Return the fraction of the step between two reversals of a coordinate; or -1 if not two.

    Split there, each part has one reversal. A coordinate that speeds up at the start or slows down
    at the end is skipped: its acceleration would need three sign changes in one step.
    """
    before, after = history.rate_before[i], history.rate_after[i]
    if before * history.bend_before[i] >= 0.0 or after * history.bend_after[i] <= 0.0:
        return -1.0
    if before * after < 0.0:
        return -1.0
    rate = derivative(quintic(history, i, h))
    between = root(derivative(rate))
    turns = before * value(rate, between) < 0.0
    return between if turns and _BRINK < between < 1.0 - _BRINK else -1.0


def hidden_crossings(history, i, h):
    """Find an extremum of a guard near zero, where the guard may cross zero twice.

    Returns:
        The fraction of the step; -1 if there is none, or the step starts or ends there already.
    """
    if history.rate_before[i] * history.rate_after[i] >= 0.0:
        return -1.0
    p = quintic(history, i, h)
    fraction = root(derivative(p))
    extreme = value(p, fraction)
    span = max(abs(p[0] - extreme), abs(value(p, 1.0) - extreme))
    unsure = (extreme > 0.0) != (p[0] > 0.0) or abs(extreme) < _DOUBT * span
    return fraction if unsure and _BRINK < fraction < 1.0 - _BRINK else -1.0


def most_zeros(p, low, high):
    """Return how many zeros a quintic has between two places at most.

    It has none or one if the result is so, since it has no more zeros than its Bernstein
    coefficients have changes of sign, and fewer by an even number.
    """
    rate, fifth = derivative(p), 0.2 * (high - low)
    bend, square = derivative(rate), 1.25 * fifth * fifth
    g0, v0, b0 = value(p, low), fifth * value(rate, low), square * value(bend, low)
    g1, v1, b1 = value(p, high), fifth * value(rate, high), square * value(bend, high)
    changes, before = 0, g0 > 0.0
    for bound in (g0 + v0, g0 + 2.0 * v0 + b0, g1 - 2.0 * v1 + b1, g1 - v1, g1):
        if (bound > 0.0) != before:
            changes, before = changes + 1, not before
    return changes


@jitted
def first_of_several(phase, history, i, h):
    """Return the fraction of the step after a guard's first of several crossings; or -1.

    It is -1 too if no fall among them may count.
    """
    p = quintic(history, i, h)
    low, high, first, several, counts = 0.0, 1.0, -1.0, False, False
    while low < 1.0:
        zeros = most_zeros(p, low, high)
        if zeros > 1 and high - low > _TOUCH:
            high = 0.5 * (low + high)
            continue
        if zeros == 1:
            several, first = several or first > 0.0, first if first > 0.0 else high
            counts = counts or (value(p, low) > 0.0 and may_count(phase, history, i, h, high))
        low, high = high, 1.0
    return first if several and counts else -1.0


def out_of_reach(history, i, h):
    """Return whether a guard stays so far above zero that its quintic cannot reach zero."""
    sway = (
        h * (abs(history.rate_before[i]) + abs(history.rate_after[i]))
        + h * h * (abs(history.bend_before[i]) + abs(history.bend_after[i]))
        + abs(history.after[i] - history.before[i])
    )
    return min(history.before[i], history.after[i]) > 2.0 * sway


@jitted
def earliest(phase, history, h, scuff, but):
    """Find the first event within a step, except the event `but` (0 for none).

    Returns:
        A fraction of the step, and the event there; or -1 for an extremum that may hide one; or 0
        for no event.
    """
    first, event = 2.0, 0
    for i in range(phase.guards):
        if i + 1 == but or out_of_reach(history, i, h):
            continue
        fraction, found = -1.0, -1
        if phase.bends[i] and (scuff or phase.watch[i] != _SCUFF):
            fraction = first_of_several(phase, history, i, h)
        if fraction < 0.0:
            fraction, found = crossing(phase, history, i, h, scuff, 0.0), i + 1
        if fraction < 0.0 and phase.watch[i] != _SCUFF:
            fraction, found = hidden_crossings(history, i, h), -1
        if 0.0 <= fraction < first:
            first, event = fraction, found
    return first, event


def accept(tiles, histories, phase, lane, event, late):
    """Take a step's end as the new start: moved by a time onto an event, or for 0.0 as it is."""
    for k in range(len(histories[0].turning)):
        histories[0].turning[k] = turning(tiles[0], phase, histories[0], lane, k)
    here, history, tangents = address(tiles), address(histories), len(tiles) - 1
    call(phase.accept, here, history, lane, tangents, event, late)


def retry_at_event(tile, lane, event, fraction, high):
    """Repeat the step from its start, with the length of the first estimate of an event."""
    tile.event[lane] = event
    tile.low[lane], tile.high[lane] = 0.0, high
    tile.h[lane] = fraction * high


@jitted
def other_event(phase, history, event, h, scuff, ahead):
    """Return another event up to the time `ahead` beyond the step's end; 0 if there is none."""
    for i in range(phase.guards):
        if i + 1 != event and crossing(phase, history, i, h, scuff, ahead) >= 0.0:
            return i + 1
    return 0


def evaluate_guards(tiles, histories, phase, lane):
    """Evaluate the phase's guards at both ends of a lane's step, into the guard history."""
    call(phase.look, address(tiles), address(histories), lane, len(tiles) - 1, 0.0, 0.0)


def predict_impact(tiles, histories, phase, lane, options):
    """Predict the time of the impact after a step's end, into the guard history."""
    call(phase.predict_strike, address(tiles), address(histories), lane, 0, options.tolerance, 0.0)


def correction_to(history, event, strike, h, options):
    """Return the time from the step's end to an event.

    Also returns the guard's rate at the end, and whether the end may be moved by that time.
    """
    g, speed = history.after[event - 1], history.rate_after[event - 1]
    late, close = -g / speed if speed != 0.0 else 0.0, False
    if event == strike and abs(history.late) <= NEAR * h:
        late, close = history.late, history.doubt <= options.doubt
    return late, speed, close or abs(late) <= options.landing * max(h, 1e-3)


def accepted_event(tile, history, lane, event):
    """Return the event that a step has ended on; 0, with a next step, if it does not count."""
    if history.counted > 0.0:
        return event
    set_next_step(tile, lane)
    return 0


def with_tangents(tiles, lane, event):
    """Return the event that a step has ended on; 0 if it does not count.

    Tangents at the event are those at its own time, which varies. The accelerations there, in which
    the next step begins, are then evaluated again with their tangents.
    """
    if len(tiles) > 1 and event == 0:
        tiles[0].fresh[lane] = 1.0
    return event


def approach_event(tiles, histories, phase, lane, options):
    """Take one Newton step on the length of the step that ends on the lane's event.

    Returns:
        The event, if the step ends on it; 0 to try again.
    """
    tile, history, scuff = tiles[0], histories[0], options.scuff
    event = int(tile.event[lane])
    h, low, high = tile.h[lane], tile.low[lane], tile.high[lane]
    g = history.after[event - 1]
    if g > 0.0:
        low = h
    else:
        high = h
    if event == phase.strike:
        predict_impact(tiles, histories, phase, lane, options)
    correction, speed, close = correction_to(history, event, phase.strike, h, options)
    narrow = high - low <= 4e-16 * high
    # Where the guard rises or touches zero, Newton's method finds the wrong root or none. Between
    # neighbours with signs of rounding it goes back and forth: a bound is not tried again.
    inside = speed < 0.0 and (low < h + correction < high or close)
    close = close and speed < 0.0
    other = 0
    if close or narrow:
        if narrow and not close:
            correction = 0.0  # the slope here may be too small to divide by
        other = other_event(phase, history, event, h, scuff, correction)
    in_doubt = other != 0 and abs(g) > _TOGETHER and not narrow
    if not (close or narrow) or in_doubt:
        tile.low[lane], tile.high[lane] = low, high
        tile.h[lane] = h + correction if inside else 0.5 * (low + high)
        return 0
    if other != 0 and extrapolated(history, other - 1, 0.0) < -_TOGETHER:
        retry_at_event(tile, lane, other, root(quintic(history, other - 1, h)), h)
        return 0
    accept(tiles, histories, phase, lane, float(event if close else -event), correction)
    return with_tangents(tiles, lane, accepted_event(tile, history, lane, event))


def move_to_impact(tiles, histories, phase, lane, options):
    """Move the end of a step onto the impact if it is near enough; return whether it was moved."""
    tile, history = tiles[0], histories[0]
    predict_impact(tiles, histories, phase, lane, options)
    late, speed, close = correction_to(history, phase.strike, phase.strike, tile.h[lane], options)
    if not (
        close and speed < 0.0 and history.comes > 0.0 and history.before[phase.strike - 1] > 0.0
    ):
        return False
    if tile.time[lane] + tile.h[lane] + late > tile.end[lane]:
        return False
    if other_event(phase, history, phase.strike, tile.h[lane], options.scuff, late):
        return False
    accept(tiles, histories, phase, lane, float(phase.strike), late)
    return True


def process_events(tiles, histories, phase, lane, options):
    """Process one lane after its step: reject or shorten the step, locate an event, or accept it.

    Returns:
        The event that ends the phase; TIME_UP, LOST or GIVEN_UP; 0 to go on.
    """
    tile, history, scuff = tiles[0], histories[0], options.scuff
    h, error = tile.h[lane], tile.error[lane]
    if not h * 0.0 == 0.0:
        return LOST
    if tile.steps[lane] > MOST_STEPS:
        return GIVEN_UP
    evaluate_guards(tiles, histories, phase, lane)
    aimed = tile.event[lane] != 0.0
    if aimed and error <= 1.0:
        return approach_event(tiles, histories, phase, lane, options)

    if not error <= 1.0:
        tile.event[lane] = 0.0  # the event of a rejected step is not reliable
        shorter = tile.growth[lane] if error > 1.0 else 0.1
        tile.next[lane] = h * shorter
        tile.h[lane] = h * shorter
        # A step less than twice too long still shows where an event shortens the next one.
        if shorter > 0.5 * SAFETY and not aimed:
            first, event = earliest(phase, history, h, scuff, 0)
            if event > 0 and first < 0.8 * shorter:
                retry_at_event(tile, lane, event, first, h)
        if h < 1e-13:
            return GIVEN_UP if error * 0.0 == 0.0 else LOST
        return 0

    for k in range(
        len(histories[0].turning)
    ):  # end a step where a control turns back, so that its work is exact
        turned = turning(tile, phase, history, lane, k)
        if not 0.02 < turned < 0.98 and tile.control[k, lane] != 0.0:
            turned = between_turns(history, phase.guards + k, h)
        if turned > 0.0:
            tile.next[lane] = h
            tile.h[lane] = turned * h
            return 0
    i = max(phase.strike - 1, 0)
    near = abs(history.after[i]) <= 2.0 * NEAR * h * abs(history.rate_after[i])
    near = near and phase.strike > 0
    if near and earliest(phase, history, h, scuff, phase.strike)[1] == 0:
        if move_to_impact(tiles, histories, phase, lane, options):
            return with_tangents(tiles, lane, accepted_event(tile, history, lane, phase.strike))
    first, event = earliest(phase, history, h, scuff, 0)
    if event < 0:  # end the step between two possible roots
        tile.next[lane] = h
        tile.h[lane] = first * h
        return 0
    if event > 0:
        tile.next[lane] = h
        retry_at_event(tile, lane, event, first, h)
        return 0
    following = min(h * tile.growth[lane], LONGEST_STEP)
    if following > tile.next[lane] or tile.growth[lane] < MUCH:
        tile.next[lane] = following
    accept(tiles, histories, phase, lane, 0.0, 0.0)
    if tile.time[lane] >= tile.end[lane] * (1.0 - 1e-15):
        return TIME_UP
    set_next_step(tile, lane)
    if 0.0 < tile.ahead[lane] < STRETCH * tile.h[lane]:
        tile.h[lane] = min(tile.ahead[lane], tile.end[lane] - tile.time[lane])
    return 0
