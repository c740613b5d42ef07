"""Carrying a tile of walkers through one phase, each with its own time and step, to its event.

A walker's record says where it stands; `advance` takes all records of one phase through it. Lanes
whose walker is done are filled from the records still waiting, so no lane waits for another.

Each sweep makes one Runge-Kutta step in every lane. What happens then is decided in two parts:
`judge` settles the ordinary case for all lanes at once (accept or reject, next step length); lanes
where something may have happened are looked at one by one by `attend`, which finds events. To land
on one, the last step is repeated from its start with Newton's method on its *length*, so the state
at an event is as exact as any other and no interpolation enters it.
"""

from __future__ import annotations

import numpy as np

from gym_passive_walker.physics import compass, kneed, runge_kutta, simplest
from gym_passive_walker.physics import constants as K
from gym_passive_walker.physics import events as E
from gym_passive_walker.physics.lanes import (
    GROUP,
    WIDTH,
    get,
    inlined,
    jitted,
    made_for,
    put,
    reciprocal,
)

# A walker's record.
ANGLES, RATES = 0, 3  # stance, thigh, shank
TIME, END, STEP = 6, 7, 8  # elapsed, when to stop, proposed length of the next integration step
PHASE, OUTCOME = 9, 10
SIN_SLOPE, COS_SLOPE, TORQUE = 11, 12, 13
HIP_NET, HIP_TURN = (
    14,
    15,
)  # change of the angle between the legs, net and absolute: work of a unit torque
KNEE_TIME, KNEE_LOSS, HEEL_LOSS = 16, 17, 18
STEPS = 19  # integration steps tried
FIELDS = 20

# A tile's rows. Stage accelerations: three rows for each of the stages, and for the step's end.
_ANGLE, _RATE, _NEW_ANGLE, _NEW_RATE, _STAGE = 0, 3, 6, 9, 12
_NEW_STAGE = _STAGE + 3 * runge_kutta.STAGES
_H = _NEW_STAGE + 3
_NEXT, _TIME, _END, _ERROR, _VERDICT, _EVENT, _LOW, _HIGH, _STEPS, _TURN = range(_H + 1, _H + 11)
_FRESH, _SIN, _COS, _TORQUE = range(_H + 11, _H + 15)
_CONSTANT = _H + 15
_TILE_CONSTANTS = K.KNEE_SINE + 1
ROWS = _CONSTANT + _TILE_CONSTANTS

# What `judge` makes of a lane's step: nothing of note; something may have happened; time is up.
_PLAIN, _ALERT, _UP = 0.0, 1.0, 2.0

_DOUBT = 0.05
"""Share of what an event function changes by in a step within which its quintic cannot tell on
which side of zero it turns: the quintic is of lower order than the step."""

_BRINK = 1e-6
"""Share of a step beside its ends in which a turn hides nothing: it reaches no deeper than
rounding."""

LONGEST_STEP = 1.0
"""A leg swings to and fro within six of these: longer steps, however exact, could jump over both a
heelstrike and the foot's return."""

MOST_STEPS = 20_000
"""Integration steps a walker may take in one phase; no gait needs a hundredth of them."""


@inlined
def accelerations(phase, tile, lane, q0, q1, q2, w0, w1, w2):
    """Accelerations of the phase, with the lane's own constants."""
    sin_slope, cos_slope = get(tile, _SIN, lane), get(tile, _COS, lane)
    torque = get(tile, _TORQUE, lane)
    if phase == E.SIMPLEST:
        a0, a1 = simplest.accelerations(q0, q1, w0, w1, sin_slope, cos_slope, torque)
        return a0, a1, a1
    foot_radius, leg = (
        get(tile, _CONSTANT + K.FOOT_RADIUS, lane),
        get(tile, _CONSTANT + K.LEG, lane),
    )
    along, across = (
        get(tile, _CONSTANT + K.STANCE_ALONG, lane),
        get(tile, _CONSTANT + K.STANCE_ACROSS, lane),
    )
    stance_inertia = get(tile, _CONSTANT + K.STANCE_INERTIA, lane)
    if phase == E.LOCKED:
        a0, a1 = compass.accelerations(
            q0, q1, w0, w1, foot_radius, leg, along, across, stance_inertia,
            get(tile, _CONSTANT + K.SWING_ALONG, lane),
            get(tile, _CONSTANT + K.SWING_ACROSS, lane),
            get(tile, _CONSTANT + K.SWING_INERTIA, lane),
            sin_slope, cos_slope, torque,
        )  # fmt: skip
        return a0, a1, a1
    return kneed.accelerations(
        q0, q1, q2, w0, w1, w2, foot_radius, leg, along, across, stance_inertia,
        get(tile, _CONSTANT + K.THIGH_ALONG, lane),
        get(tile, _CONSTANT + K.THIGH_ACROSS, lane),
        get(tile, _CONSTANT + K.THIGH_INERTIA, lane),
        get(tile, _CONSTANT + K.SHANK_ALONG, lane),
        get(tile, _CONSTANT + K.SHANK_ACROSS, lane),
        get(tile, _CONSTANT + K.SHANK_MOBILITY, lane),
        get(tile, _CONSTANT + K.KNEE_COSINE, lane),
        get(tile, _CONSTANT + K.KNEE_SINE, lane),
        sin_slope, cos_slope, torque,
    )  # fmt: skip


def _stage(index: int, phase: int):  # type: ignore[no-untyped-def]
    """Compile one stage of the step in every lane."""
    trial = runge_kutta.STAGE[index]

    @inlined
    @made_for(phase, index)
    def stage(tile, groups):
        for lane in range(GROUP * groups):
            h = get(tile, _H, lane)
            q0, w0 = trial(tile, lane, _STAGE, h, get(tile, _ANGLE, lane), get(tile, _RATE, lane))
            q1, w1 = trial(
                tile, lane, _STAGE + 1, h, get(tile, _ANGLE + 1, lane), get(tile, _RATE + 1, lane)
            )
            q2, w2 = q1, w1
            if phase == E.FREE:
                q2, w2 = trial(
                    tile,
                    lane,
                    _STAGE + 2,
                    h,
                    get(tile, _ANGLE + 2, lane),
                    get(tile, _RATE + 2, lane),
                )
            a0, a1, a2 = accelerations(phase, tile, lane, q0, q1, q2, w0, w1, w2)
            put(tile, _STAGE + 3 * index, lane, a0)
            put(tile, _STAGE + 3 * index + 1, lane, a1)
            put(tile, _STAGE + 3 * index + 2, lane, a2)
            if index == runge_kutta.STAGES:
                put(tile, _NEW_ANGLE, lane, q0)
                put(tile, _NEW_ANGLE + 1, lane, q1)
                put(tile, _NEW_ANGLE + 2, lane, q2)
                put(tile, _NEW_RATE, lane, w0)
                put(tile, _NEW_RATE + 1, lane, w1)
                put(tile, _NEW_RATE + 2, lane, w2)

    return stage


def _begin(phase: int):  # type: ignore[no-untyped-def]
    """Compile the first stage of lanes that have just been filled; others have it from before."""

    @jitted
    @made_for(phase)
    def begin(tile, groups):
        for lane in range(GROUP * groups):
            a0, a1, a2 = accelerations(
                phase, tile, lane,
                get(tile, _ANGLE, lane), get(tile, _ANGLE + 1, lane), get(tile, _ANGLE + 2, lane),
                get(tile, _RATE, lane), get(tile, _RATE + 1, lane), get(tile, _RATE + 2, lane),
            )  # fmt: skip
            fresh = get(tile, _FRESH, lane).real != 0.0
            put(tile, _STAGE, lane, a0 if fresh else get(tile, _STAGE, lane))
            put(tile, _STAGE + 1, lane, a1 if fresh else get(tile, _STAGE + 1, lane))
            put(tile, _STAGE + 2, lane, a2 if fresh else get(tile, _STAGE + 2, lane))
            put(tile, _FRESH, lane, 0.0)

    return begin


@inlined
def larger(a, b):
    """The larger of two reals."""
    return a if a > b else b


@inlined
def size(tile, row, lane):
    """Absolute value of a tile's entry."""
    return np.abs(get(tile, row, lane).real)


@inlined
def extent(tile, lane, coordinate):
    """Largest size of a coordinate's angle and rate at both ends of the step."""
    return larger(
        larger(size(tile, _ANGLE + coordinate, lane), size(tile, _RATE + coordinate, lane)),
        larger(size(tile, _NEW_ANGLE + coordinate, lane), size(tile, _NEW_RATE + coordinate, lane)),
    )


@inlined
def estimate(phase, tile, lanes, tolerance):
    """Error of each lane's step over its tolerance, relative to the largest angle or rate.

    Relative to the motion as a whole, so that small motions are resolved as well as large ones.
    """
    for lane in range(lanes):
        h = get(tile, _H, lane).real
        scale = larger(extent(tile, lane, 0), extent(tile, lane, 1))
        if phase == E.FREE:
            scale = larger(scale, extent(tile, lane, 2))
        # Scale before squaring: the squares of tiny errors must not vanish.
        weight = h / (tolerance * scale + 1e-290)
        square = runge_kutta.error(tile, lane, _STAGE, h, weight)
        square += runge_kutta.error(tile, lane, _STAGE + 1, h, weight)
        if phase == E.FREE:
            square += runge_kutta.error(tile, lane, _STAGE + 2, h, weight)
        put(tile, _ERROR, lane, np.sqrt(square))


@inlined
def passed(before, rate_before, after, rate_after):
    """Whether a function may have fallen through zero within a step, even twice."""
    fell = (before > 0.0) & (after <= 0.0)
    dipped = (before > 0.0) & (rate_before < 0.0) & (rate_after > 0.0)
    bumped = (before <= 0.0) & (after <= 0.0) & (rate_before > 0.0) & (rate_after < 0.0)
    return fell | dipped | bumped


@inlined
def bulges(angle, rate_before, rate_after, h, bound):
    """Whether an angle may have been beyond a bound within a step, and turned back."""
    reach = np.abs(angle) + h * larger(np.abs(rate_before), np.abs(rate_after))
    return (rate_before * rate_after < 0.0) & (reach >= bound)


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
def judge(phase, tile, lanes, stub):
    """Settle the ordinary case in every lane; mark where `attend` must look, or time is up."""
    for lane in range(lanes):
        h, error = get(tile, _H, lane), get(tile, _ERROR, lane).real
        rest = get(tile, _END, lane) - get(tile, _TIME, lane)
        s0, t0 = get(tile, _ANGLE, lane).real, get(tile, _ANGLE + 1, lane).real
        u0, v0 = get(tile, _RATE, lane).real, get(tile, _RATE + 1, lane).real
        s1, t1 = get(tile, _NEW_ANGLE, lane).real, get(tile, _NEW_ANGLE + 1, lane).real
        u1, v1 = get(tile, _NEW_RATE, lane).real, get(tile, _NEW_RATE + 1, lane).real
        if phase == E.FREE:
            k0, k1 = get(tile, _ANGLE + 2, lane).real, get(tile, _NEW_ANGLE + 2, lane).real
            x0, x1 = get(tile, _RATE + 2, lane).real, get(tile, _NEW_RATE + 2, lane).real
            alert = passed(t0 - k0, v0 - x0, t1 - k1, v1 - x1) | (
                (np.abs(k1) >= np.pi) | bulges(k1, x0, x1, h.real, np.pi)
            )
        else:
            alert = passed(s0 + t0, u0 + v0, s1 + t1, u1 + v1)
        if phase == E.LOCKED:
            crossed = ((t0 - s0) * (t1 - s1) <= 0.0) | ((s0 + t0) * (s1 + t1) <= 0.0)
            alert = alert | (crossed & (stub != 0))
        turning = (v0 - u0) * (v1 - u1) < 0.0
        alert = (
            alert
            | (np.abs(s1) >= 0.5 * np.pi)
            | (np.abs(t1) >= np.pi)
            | bulges(s1, u0, u1, h.real, 0.5 * np.pi)
            | bulges(t1, v0, v1, h.real, np.pi)
            | (turning & (get(tile, _TORQUE, lane).real != 0.0))
            | (get(tile, _EVENT, lane).real != 0.0)
            | (not (error <= 1e30))
            | (h.real < 1e-12)
            | (get(tile, _STEPS, lane).real >= MOST_STEPS)
        )
        plain = (error <= 1.0) & (not alert)
        up = plain & (h.real >= rest.real)
        following, proposed = proposal(h, error), get(tile, _NEXT, lane)
        rest = rest - h if plain else rest
        put(tile, _VERDICT, lane, _UP if up else (_ALERT if alert else _PLAIN))
        put(tile, _STEPS, lane, get(tile, _STEPS, lane) + 1.0)
        # A step that the time cut short says little of the next one.
        kept = alert | (up & (following.real <= proposed.real) & (error <= 0.1))
        put(tile, _NEXT, lane, proposed if kept else following)
        next_h = following if 1.1 * following.real < rest.real else rest
        put(tile, _H, lane, h if alert else next_h)
        put(tile, _TIME, lane, get(tile, _TIME, lane) + (h if plain else 0.0 * h))
        turn = np.abs((t1 - s1) - (t0 - s0))
        put(tile, _TURN, lane, get(tile, _TURN, lane) + (turn if plain else 0.0))
        settle(tile, lane, 0, plain)
        settle(tile, lane, 1, plain)
        if phase == E.FREE:
            settle(tile, lane, 2, plain)


@inlined
def settle(tile, lane, i, plain):
    """Take the step's end as the new start, if it is plain that this is right."""
    angle, rate = get(tile, _ANGLE + i, lane), get(tile, _RATE + i, lane)
    first = get(tile, _STAGE + i, lane)
    put(tile, _ANGLE + i, lane, get(tile, _NEW_ANGLE + i, lane) if plain else angle)
    put(tile, _RATE + i, lane, get(tile, _NEW_RATE + i, lane) if plain else rate)
    put(tile, _STAGE + i, lane, get(tile, _NEW_STAGE + i, lane) if plain else first)


def _sweep(phase: int):  # type: ignore[no-untyped-def]
    """Compile one step in every lane of a phase, with its judgement."""
    s1, s2, s3, s4, s5, s6, s7, s8, s9, s10, s11, s12, s13, s14, s15, s16 = (
        _stage(index, phase) for index in range(1, runge_kutta.STAGES + 1)
    )

    @jitted
    @made_for(phase)
    def sweep(tile, groups, tolerance, stub):
        s1(tile, groups)
        s2(tile, groups)
        s3(tile, groups)
        s4(tile, groups)
        s5(tile, groups)
        s6(tile, groups)
        s7(tile, groups)
        s8(tile, groups)
        s9(tile, groups)
        s10(tile, groups)
        s11(tile, groups)
        s12(tile, groups)
        s13(tile, groups)
        s14(tile, groups)
        s15(tile, groups)
        s16(tile, groups)
        estimate(phase, tile, GROUP * groups, tolerance)
        judge(phase, tile, GROUP * groups, stub)

    return sweep


@inlined
def along(event, tile, lane, row):
    """An event function without its constant, of the three entries from `row` on."""
    return E.linear(event, get(tile, row, lane), get(tile, row + 1, lane), get(tile, row + 2, lane))


@inlined
def course(event, tile, lane):
    """An event function over the step, as a quintic of the fraction of the step."""
    h = get(tile, _H, lane).real
    constant = E.FUNCTIONS[event, 3]
    return E.quintic(
        along(event, tile, lane, _ANGLE).real + constant,
        along(event, tile, lane, _RATE).real * h,
        along(event, tile, lane, _STAGE).real * h * h,
        along(event, tile, lane, _NEW_ANGLE).real + constant,
        along(event, tile, lane, _NEW_RATE).real * h,
        along(event, tile, lane, _NEW_STAGE).real * h * h,
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
def candidates(tile, lane, phase, stub):
    """One past the last event that can have happened in the step: most need no look."""
    s0, s1 = get(tile, _ANGLE, lane).real, get(tile, _NEW_ANGLE, lane).real
    t0, t1 = get(tile, _ANGLE + 1, lane).real, get(tile, _NEW_ANGLE + 1, lane).real
    if (
        stub
        and phase == E.LOCKED
        and ((t0 - s0) * (t1 - s1) <= 0.0 or (s0 + t0) * (s1 + t1) <= 0.0)
    ):
        return E.EVENTS
    if np.abs(s1) >= 0.5 * np.pi or np.abs(t1) >= np.pi:
        return E.FIRST_STUB
    if phase == E.FREE and np.abs(get(tile, _NEW_ANGLE + 2, lane).real) >= np.pi:
        return E.FIRST_STUB
    return E.FIRST_BOUND


@inlined
def fell(event, tile, lane):
    """Whether an event function fell through zero over the step."""
    constant = E.FUNCTIONS[event, 3]
    before = along(event, tile, lane, _ANGLE).real + constant
    after = along(event, tile, lane, _NEW_ANGLE).real + constant
    in_front = event != E.HEELSTRIKE or get(tile, _NEW_ANGLE, lane).real < 0.0
    return before > 0.0 and after <= 0.0 and in_front


@inlined
def turning(tile, lane):
    """Where in the step the angle between the legs turns back: a fraction, or -1."""
    gap = E.FIRST_STUB  # thigh less stance
    before = along(gap, tile, lane, _RATE).real
    after = along(gap, tile, lane, _NEW_RATE).real
    if before * after >= 0.0 or get(tile, _TORQUE, lane).real == 0.0:
        return -1.0
    return E.root(E.derivative(course(gap, tile, lane)))


@inlined
def hiding(event, tile, lane):
    """Where in the step an event function turns back so near zero that it may pass it twice.

    Returns:
        A fraction of the step; -1 if there is nothing to hide, or the step ends there already.
    """
    if along(event, tile, lane, _RATE).real * along(event, tile, lane, _NEW_RATE).real >= 0.0:
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
    before, after = along(gap, tile, lane, _ANGLE), along(gap, tile, lane, _NEW_ANGLE)
    turned = turning(tile, lane)
    if turned >= 0.0:
        extreme = E.value(course(gap, tile, lane), turned)
        change = np.abs(extreme - before.real) + np.abs(after.real - extreme)
    else:
        change = np.abs((after - before).real)
    put(tile, _TURN, lane, get(tile, _TURN, lane) + change)
    put(tile, _TIME, lane, get(tile, _TIME, lane) + h)
    for i in range(3):
        settle(tile, lane, i, True)
    put(tile, _EVENT, lane, 0.0)


@inlined
def go_on(tile, lane):
    """Next step: the proposed length, or what is left of the time."""
    rest = get(tile, _END, lane) - get(tile, _TIME, lane)
    following = get(tile, _NEXT, lane)
    put(tile, _H, lane, following if 1.1 * following.real < rest.real else rest)


@inlined
def aim(event, fraction, tile, lane, high):
    """Repeat the step from its start, with the length that leads to an event's first estimate."""
    put(tile, _EVENT, lane, float(event))
    put(tile, _LOW, lane, 0.0)
    put(tile, _HIGH, lane, high)
    put(tile, _H, lane, fraction * high)


@jitted
def land(tile, lane, phase, stub, landing):
    """A Newton step on the length of the step that leads to the lane's event.

    Returns:
        The event, if the step ends on it; 0 to try again.
    """
    event = int(get(tile, _EVENT, lane).real)
    h = get(tile, _H, lane)
    low, high = get(tile, _LOW, lane).real, get(tile, _HIGH, lane).real
    g = along(event, tile, lane, _NEW_ANGLE) + E.FUNCTIONS[event, 3]
    speed = along(event, tile, lane, _NEW_RATE)
    if g.real > 0.0:
        low = h.real
    else:
        high = h.real
    correction = -g * reciprocal(speed) if speed.real != 0.0 else 0.0 * g
    close = np.abs(correction.real) <= landing * larger(h.real, 1e-3)
    narrow = high - low <= 4e-16 * high
    # Where the function rises, or touches zero, Newton leads to the way out or nowhere.
    inside = speed.real < 0.0 and (low <= h.real + correction.real <= high or close)
    if not ((close and speed.real < 0.0) or narrow):
        put(tile, _LOW, lane, low)
        put(tile, _HIGH, lane, high)
        new = h + correction if inside else 0.0 * h + 0.5 * (low + high)
        put(tile, _H, lane, new)
        return 0
    if narrow and not close:
        correction = 0.0 * g  # the slope here may be too small to divide by
    for other in range(1, candidates(tile, lane, phase, stub)):  # does another one come first?
        if other != event and watched(other, phase, stub) and fell(other, tile, lane):
            if along(other, tile, lane, _NEW_ANGLE).real + E.FUNCTIONS[other, 3] < 0.0:
                aim(other, E.root(course(other, tile, lane)), tile, lane, h.real)
                return 0
    for i in range(3):
        rate, acceleration = get(tile, _NEW_RATE + i, lane), get(tile, _NEW_STAGE + i, lane)
        shift = correction * (rate + 0.5 * correction * acceleration)
        put(tile, _NEW_ANGLE + i, lane, get(tile, _NEW_ANGLE + i, lane) + shift)
        put(tile, _NEW_RATE + i, lane, rate + correction * acceleration)
    commit(tile, lane, h + correction)
    if event == E.HEELSTRIKE and get(tile, _ANGLE, lane).real >= 0.0:
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
    for candidate in range(1, candidates(tile, lane, phase, stub)):
        if watched(candidate, phase, stub) and fell(candidate, tile, lane):
            fraction = E.root(course(candidate, tile, lane))
            if fraction < first:
                first, event = fraction, candidate
    for candidate in range(1, E.FIRST_STUB):
        if watched(candidate, phase, stub) and not fell(candidate, tile, lane):
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
    h = get(tile, _H, lane)
    error = get(tile, _ERROR, lane).real
    if not h.real * 0.0 == 0.0 or get(tile, _STEPS, lane).real > MOST_STEPS:
        return -2
    if get(tile, _EVENT, lane).real != 0.0:
        return land(tile, lane, phase, stub, landing)

    if not error <= 1.0:
        shorter = growth(error) if error > 1.0 else 0.1
        put(tile, _NEXT, lane, h * shorter)
        put(tile, _H, lane, h * shorter)
        if error < 1e3:  # near enough to tell where an event cuts the next step short
            first, event = earliest(tile, lane, phase, stub)
            if event > 0 and first < 0.8 * shorter:
                aim(event, first, tile, lane, h.real)
        return -2 if h.real < 1e-13 else 0

    turned = turning(tile, lane)
    if 0.02 < turned < 0.98:  # end a step where the hip turns, so that its work is exact
        put(tile, _NEXT, lane, h)
        put(tile, _H, lane, turned * h)
        return 0
    first, event = earliest(tile, lane, phase, stub)
    if event < 0:  # stop where a pair of roots may hide, between them
        put(tile, _NEXT, lane, h)
        put(tile, _H, lane, first * h)
        return 0
    if event > 0:
        put(tile, _NEXT, lane, h)
        aim(event, first, tile, lane, h.real)
        return 0
    following = proposal(h, error)
    if following.real > get(tile, _NEXT, lane).real or error > 0.1:
        put(tile, _NEXT, lane, following)
    commit(tile, lane, h)
    if get(tile, _TIME, lane).real >= get(tile, _END, lane).real * (1.0 - 1e-15):
        return -1
    go_on(tile, lane)
    return 0


@inlined
def equip(tile, lane, c):
    """Give a lane its walker's constants."""
    for i in range(_TILE_CONSTANTS):
        put(tile, _CONSTANT + i, lane, c[i])


@jitted
def load(phase, tile, lane, records, constants, index, first_step):
    """Put a walker into a lane."""
    record = records[index]
    for i in range(3):
        put(tile, _ANGLE + i, lane, record[ANGLES + i])
        put(tile, _RATE + i, lane, record[RATES + i])
    put(tile, _TIME, lane, record[TIME])
    put(tile, _END, lane, record[END])
    put(tile, _SIN, lane, record[SIN_SLOPE])
    put(tile, _COS, lane, record[COS_SLOPE])
    put(tile, _TORQUE, lane, record[TORQUE])
    put(tile, _EVENT, lane, 0.0)
    put(tile, _STEPS, lane, 0.0)
    put(tile, _TURN, lane, 0.0)
    put(tile, _FRESH, lane, 1.0)
    if phase != E.SIMPLEST and len(constants) > 1:
        equip(tile, lane, constants[index])
    proposed = record[STEP]
    if proposed.real <= 0.0:
        proposed = 0.0 * proposed + first_step
    put(tile, _NEXT, lane, proposed)
    go_on(tile, lane)


@jitted
def unload(phase, tile, lane, record, event):
    """Take a walker that is done out of its lane."""
    record[HIP_NET] -= record[ANGLES + 1] - record[ANGLES]
    for i in range(3):
        record[ANGLES + i] = get(tile, _ANGLE + i, lane)
        record[RATES + i] = get(tile, _RATE + i, lane)
    if phase != E.FREE:
        record[ANGLES + 2] = record[ANGLES + 1]
        record[RATES + 2] = record[RATES + 1]
    record[HIP_NET] += record[ANGLES + 1] - record[ANGLES]
    record[TIME] = get(tile, _TIME, lane)
    record[STEP] = get(tile, _NEXT, lane)
    record[STEPS] += get(tile, _STEPS, lane)
    record[HIP_TURN] += get(tile, _TURN, lane)
    if event == -1:
        record[TIME] = record[END]
        record[OUTCOME] = -1.0
    elif event == -2:
        record[OUTCOME] = float(E.Outcome.DIVERGED.value)
    else:
        record[OUTCOME] = float(E.OUTCOMES[event])


@jitted
def move(tile, source, target):
    """Move a walker from one lane to another; the stages between a step's ends are spent."""
    for row in range(_STAGE + 3):
        put(tile, row, target, get(tile, row, source))
    for row in range(_NEW_STAGE, ROWS):
        put(tile, row, target, get(tile, row, source))


@inlined
def next_waiting(records, index, phase):
    """The first record from an index on that waits for a phase; their number if none does."""
    while index < len(records):
        if records[index, PHASE].real == phase and records[index, OUTCOME].real == 0.0:
            break
        index += 1
    return index


def _advance(phase: int):  # type: ignore[no-untyped-def]
    """Compile the engine of one phase.

    Returns:
        Function that takes every record in the phase through it: to its event, or to its time's
        end. Records with an outcome other than RUNNING are left alone; the outcome becomes an
        `Outcome`, or -1 where the time is up.
    """
    begin, sweep = _begin(phase), _sweep(phase)

    @jitted
    @made_for(phase)
    def advance(records, constants, tile, tolerance, landing, first_step, stub):
        owner = np.empty(WIDTH, np.int64)
        waiting, used, fresh = 0, 0, False
        if phase != E.SIMPLEST and len(constants) == 1:  # alike: they stay
            for lane in range(WIDTH):
                equip(tile, lane, constants[0])
        while True:
            while used < WIDTH:
                waiting = next_waiting(records, waiting, phase)
                if waiting == len(records):
                    break
                load(phase, tile, used, records, constants, waiting, first_step)
                owner[used] = waiting
                fresh = True
                used += 1
                waiting += 1
            if used == 0:
                return
            groups = (used + GROUP - 1) // GROUP  # idle lanes compute along, unread
            if fresh:
                begin(tile, groups)
                fresh = False
            sweep(tile, groups, tolerance, stub)
            lane = 0
            while lane < used:
                event, verdict = 0, get(tile, _VERDICT, lane).real
                if verdict == _ALERT:
                    event = attend(tile, lane, phase, stub, landing)
                elif verdict == _UP:
                    event = -1
                if event == 0:
                    lane += 1
                    continue
                unload(phase, tile, lane, records[owner[lane]], event)
                waiting = next_waiting(records, waiting, phase)
                if waiting < len(records):
                    load(phase, tile, lane, records, constants, waiting, first_step)
                    owner[lane] = waiting
                    fresh = True
                    waiting += 1
                    lane += 1
                    continue
                used -= 1
                if lane < used:
                    move(tile, used, lane)
                    owner[lane] = owner[used]

    return advance


advance_free = _advance(E.FREE)
advance_locked = _advance(E.LOCKED)
advance_simplest = _advance(E.SIMPLEST)
