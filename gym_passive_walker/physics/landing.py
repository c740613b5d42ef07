"""What happens within a step: events found, landed on, or ruled out, one lane at a time.

To land on an event, the step is repeated from its start with Newton's method on its *length*, so
the state at an event is as exact as any other and no interpolation enters it. A quintic through
both ends of the step says where to begin.
"""

from __future__ import annotations

import numpy as np

from gym_passive_walker.physics import events as E
from gym_passive_walker.physics import tile as T
from gym_passive_walker.physics.lanes import get, inlined, jitted, put, reciprocal
from gym_passive_walker.physics.tile import go_on, larger, settle

_DOUBT = 0.05
"""Share of what an event function changes by in a step within which its quintic cannot tell on
which side of zero it turns: the quintic is of lower order than the step."""

_BRINK = 1e-6
"""Share of a step beside its ends in which a turn hides nothing: it reaches no deeper than
rounding."""

_TOGETHER = 1e-14
"""How near to zero an event's function must be before it is told which of two events comes first;
where both are as near, either may."""

LONGEST_STEP = 1.0
"""A leg swings to and fro within six of these: longer steps, however exact, could jump over both a
heelstrike and the foot's return."""

MOST_STEPS = 20_000
"""Integration steps a walker may take in one phase; no gait needs a hundredth of them."""


@inlined
def growth(error):
    """Factor to the next step length, from the error of this one over its tolerance."""
    factor = 0.85 / np.sqrt(np.sqrt(np.sqrt(error + 1e-30)))  # the estimate's order is 8
    factor = factor if factor < 6.0 else 6.0
    return factor if factor > 0.2 else 0.2


@inlined
def proposal(h, error):
    """Length of the next step after an accepted one."""
    following = h * growth(error)
    return following if following.real < LONGEST_STEP else 0.0 * following + LONGEST_STEP


@inlined
def along(event, tile, lane, row):
    """An event function without its constant, of the three entries from `row` on."""
    return E.linear(event, get(tile, row, lane), get(tile, row + 1, lane), get(tile, row + 2, lane))


@inlined
def course(event, tile, lane):
    """An event function over the step, as a quintic of the fraction of the step."""
    h = get(tile, T.H, lane).real
    constant = E.FUNCTIONS[event, 3]
    return E.quintic(
        along(event, tile, lane, T.ANGLE).real + constant,
        along(event, tile, lane, T.RATE).real * h,
        along(event, tile, lane, T.STAGE).real * h * h,
        along(event, tile, lane, T.NEW_ANGLE).real + constant,
        along(event, tile, lane, T.NEW_RATE).real * h,
        along(event, tile, lane, T.NEW_STAGE).real * h * h,
    )


@inlined
def watched(event, phase, stub):
    """Whether a phase can end by this event."""
    if event == E.HEELSTRIKE:
        return phase != E.FREE
    if event == E.KNEESTRIKE:
        return phase == E.FREE
    if event >= E.FIRST_STUB:
        return stub and phase == E.LOCKED
    return event < E.FIRST_BOUND + 4 or phase == E.FREE


@inlined
def after(event, tile, lane, ahead):
    """An event function a little beyond the step's end, where a correction of its length leads."""
    rate, acceleration = along(event, tile, lane, T.NEW_RATE), along(event, tile, lane, T.NEW_STAGE)
    g = along(event, tile, lane, T.NEW_ANGLE).real + E.FUNCTIONS[event, 3]
    return g + ahead * (rate.real + 0.5 * ahead * acceleration.real)


@inlined
def candidates(tile, lane, phase, stub, ahead):
    """One past the last event that can have happened in the step: most need no look."""
    s0, t0 = get(tile, T.ANGLE, lane).real, get(tile, T.ANGLE + 1, lane).real
    s1 = get(tile, T.NEW_ANGLE, lane).real + ahead * get(tile, T.NEW_RATE, lane).real
    t1 = get(tile, T.NEW_ANGLE + 1, lane).real + ahead * get(tile, T.NEW_RATE + 1, lane).real
    k1 = get(tile, T.NEW_ANGLE + 2, lane).real + ahead * get(tile, T.NEW_RATE + 2, lane).real
    if (
        stub
        and phase == E.LOCKED
        and ((t0 - s0) * (t1 - s1) <= 0.0 or (s0 + t0) * (s1 + t1) <= 0.0)
    ):
        return E.EVENTS
    if np.abs(s1) >= 0.5 * np.pi or np.abs(t1) >= np.pi:
        return E.FIRST_STUB
    if phase == E.FREE and np.abs(k1) >= np.pi:
        return E.FIRST_STUB
    return E.FIRST_BOUND


@inlined
def fell(event, tile, lane, ahead):
    """Whether an event function fell through zero over the step and a little beyond it."""
    before = along(event, tile, lane, T.ANGLE).real + E.FUNCTIONS[event, 3]
    in_front = event != E.HEELSTRIKE or get(tile, T.NEW_ANGLE, lane).real < 0.0
    return before > 0.0 and after(event, tile, lane, ahead) <= 0.0 and in_front


@inlined
def turning(tile, lane):
    """Where in the step the angle between the legs turns back: a fraction, or -1."""
    gap = E.FIRST_STUB  # thigh less stance
    before = along(gap, tile, lane, T.RATE).real
    after = along(gap, tile, lane, T.NEW_RATE).real
    if before * after >= 0.0 or get(tile, T.TORQUE, lane).real == 0.0:
        return -1.0
    return E.root(E.derivative(course(gap, tile, lane)))


@inlined
def hiding(event, tile, lane):
    """Where in the step an event function turns back so near zero that it may pass it twice.

    Returns:
        A fraction of the step; -1 if there is nothing to hide, or the step ends there already.
    """
    if along(event, tile, lane, T.RATE).real * along(event, tile, lane, T.NEW_RATE).real >= 0.0:
        return -1.0
    path = course(event, tile, lane)
    fraction = E.root(E.derivative(path))
    extreme = E.value(path, fraction)
    span = larger(np.abs(path[0] - extreme), np.abs(E.value(path, 1.0) - extreme))
    unsure = (extreme > 0.0) != (path[0] > 0.0) or np.abs(extreme) < _DOUBT * span
    return fraction if unsure and _BRINK < fraction < 1.0 - _BRINK else -1.0


@inlined
def commit(tile, lane, h):
    """Accept the step of length h: its end is the new start."""
    gap = E.FIRST_STUB
    before, after = along(gap, tile, lane, T.ANGLE), along(gap, tile, lane, T.NEW_ANGLE)
    turned = turning(tile, lane)
    if turned >= 0.0:
        extreme = E.value(course(gap, tile, lane), turned)
        change = np.abs(extreme - before.real) + np.abs(after.real - extreme)
    else:
        change = np.abs((after - before).real)
    put(tile, T.TURN, lane, get(tile, T.TURN, lane) + change)
    put(tile, T.TIME, lane, get(tile, T.TIME, lane) + h)
    for i in range(3):
        settle(tile, lane, i, True)
    put(tile, T.EVENT, lane, 0.0)


@inlined
def aim(event, fraction, tile, lane, high):
    """Repeat the step from its start, with the length that leads to an event's first estimate."""
    put(tile, T.EVENT, lane, float(event))
    put(tile, T.LOW, lane, 0.0)
    put(tile, T.HIGH, lane, high)
    put(tile, T.H, lane, fraction * high)


@inlined
def rival(event, tile, lane, phase, stub, ahead):
    """Another event that has happened where a correction of the step's length leads; 0 if none."""
    for other in range(1, candidates(tile, lane, phase, stub, ahead)):
        if other != event and watched(other, phase, stub) and fell(other, tile, lane, ahead):
            return other
    return 0


@jitted
def land(tile, lane, phase, stub, landing):
    """A Newton step on the length of the step that leads to the lane's event.

    Returns:
        The event, if the step ends on it; 0 to try again.
    """
    event = int(get(tile, T.EVENT, lane).real)
    h = get(tile, T.H, lane)
    low, high = get(tile, T.LOW, lane).real, get(tile, T.HIGH, lane).real
    g = along(event, tile, lane, T.NEW_ANGLE) + E.FUNCTIONS[event, 3]
    speed = along(event, tile, lane, T.NEW_RATE)
    if g.real > 0.0:
        low = h.real
    else:
        high = h.real
    correction = -g * reciprocal(speed) if speed.real != 0.0 else 0.0 * g
    close = np.abs(correction.real) <= landing * larger(h.real, 1e-3)
    narrow = high - low <= 4e-16 * high
    # Where the function rises, or touches zero, Newton leads to the way out or nowhere.
    inside = speed.real < 0.0 and (low <= h.real + correction.real <= high or close)
    close = close and speed.real < 0.0
    other = 0
    if close or narrow:
        if narrow and not close:
            correction = 0.0 * g  # the slope here may be too small to divide by
        other = rival(event, tile, lane, phase, stub, correction.real)
    in_doubt = other != 0 and np.abs(g.real) > _TOGETHER and not narrow
    if not (close or narrow) or in_doubt:
        put(tile, T.LOW, lane, low)
        put(tile, T.HIGH, lane, high)
        new = h + correction if inside else 0.0 * h + 0.5 * (low + high)
        put(tile, T.H, lane, new)
        return 0
    if other != 0 and after(other, tile, lane, 0.0) < -_TOGETHER:
        aim(other, E.root(course(other, tile, lane)), tile, lane, h.real)
        return 0
    for i in range(3):
        rate, acceleration = get(tile, T.NEW_RATE + i, lane), get(tile, T.NEW_STAGE + i, lane)
        shift = correction * (rate + 0.5 * correction * acceleration)
        put(tile, T.NEW_ANGLE + i, lane, get(tile, T.NEW_ANGLE + i, lane) + shift)
        put(tile, T.NEW_RATE + i, lane, rate + correction * acceleration)
    commit(tile, lane, h + correction)
    if event == E.HEELSTRIKE and get(tile, T.ANGLE, lane).real >= 0.0:
        go_on(tile, lane)
        return 0
    return event


@jitted
def earliest(tile, lane, phase, stub):
    """What comes first within a lane's step.

    Returns:
        A fraction of the step, and the event that falls there; or -1 for a turn there that may
        hide one; or 0 for nothing.
    """
    first, event = 2.0, 0
    for candidate in range(1, candidates(tile, lane, phase, stub, 0.0)):
        if watched(candidate, phase, stub) and fell(candidate, tile, lane, 0.0):
            fraction = E.root(course(candidate, tile, lane))
            if fraction < first:
                first, event = fraction, candidate
    for candidate in range(1, E.FIRST_STUB):
        if watched(candidate, phase, stub) and not fell(candidate, tile, lane, 0.0):
            fraction = hiding(candidate, tile, lane)
            if 0.0 < fraction < first:
                first, event = fraction, -1
    return first, event


@jitted
def attend(tile, lane, phase, stub, landing):
    """Look at one lane after its step: reject it, shorten it, land on an event, or accept it.

    Returns:
        The event that ends the phase; -1 if the time is up, -2 if the motion cannot be followed;
        0 to go on.
    """
    h = get(tile, T.H, lane)
    error = get(tile, T.ERROR, lane).real
    if not h.real * 0.0 == 0.0 or get(tile, T.STEPS, lane).real > MOST_STEPS:
        return -2
    aimed = get(tile, T.EVENT, lane).real != 0.0
    if aimed and error <= 1.0:
        return land(tile, lane, phase, stub, landing)

    if not error <= 1.0:
        put(tile, T.EVENT, lane, 0.0)  # where a step is not to be trusted, neither is its event
        shorter = growth(error) if error > 1.0 else 0.1
        put(tile, T.NEXT, lane, h * shorter)
        put(tile, T.H, lane, h * shorter)
        if error < 1e3 and not aimed:  # near enough to tell where an event cuts the next step short
            first, event = earliest(tile, lane, phase, stub)
            if event > 0 and first < 0.8 * shorter:
                aim(event, first, tile, lane, h.real)
        return -2 if h.real < 1e-13 else 0

    turned = turning(tile, lane)
    if 0.02 < turned < 0.98:  # end a step where the hip turns, so that its work is exact
        put(tile, T.NEXT, lane, h)
        put(tile, T.H, lane, turned * h)
        return 0
    first, event = earliest(tile, lane, phase, stub)
    if event < 0:  # stop where a pair of roots may hide, between them
        put(tile, T.NEXT, lane, h)
        put(tile, T.H, lane, first * h)
        return 0
    if event > 0:
        put(tile, T.NEXT, lane, h)
        aim(event, first, tile, lane, h.real)
        return 0
    following = proposal(h, error)
    if following.real > get(tile, T.NEXT, lane).real or error > 0.1:
        put(tile, T.NEXT, lane, following)
    commit(tile, lane, h)
    if get(tile, T.TIME, lane).real >= get(tile, T.END, lane).real * (1.0 - 1e-15):
        return -1
    go_on(tile, lane)
    return 0
