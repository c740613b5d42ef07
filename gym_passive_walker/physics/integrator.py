"""Carrying a tile of walkers through one phase, each with its own time and step, to its event.

`advance` takes all records of one phase through it. Lanes whose walker is done are filled from the
records still waiting, so no lane waits for another.

Each sweep makes one Runge-Kutta step in every lane. What happens then is decided in two parts:
`judge` settles the ordinary case for all lanes at once (accept or reject, next step length); lanes
where something may have happened are looked at one by one by `landing.attend`.
"""

from __future__ import annotations

import numpy as np

from gym_passive_walker.physics import compass, kneed, runge_kutta, simplest
from gym_passive_walker.physics import constants as K
from gym_passive_walker.physics import events as E
from gym_passive_walker.physics import tile as T
from gym_passive_walker.physics.landing import MOST_STEPS, attend, proposal
from gym_passive_walker.physics.lanes import (
    GROUP,
    WIDTH,
    align_stack,
    get,
    inlined,
    jitted,
    made_for,
    put,
)
from gym_passive_walker.physics.tile import equip, larger, load, move, next_waiting, settle, unload

# What `judge` makes of a lane's step: nothing of note; something may have happened; time is up.
_PLAIN, _ALERT, _UP = 0.0, 1.0, 2.0


@inlined
def accelerations(phase, tile, lane, q0, q1, q2, w0, w1, w2):
    """Accelerations of the phase, with the lane's own constants."""
    sin_slope, cos_slope = get(tile, T.SIN, lane), get(tile, T.COS, lane)
    torque = get(tile, T.TORQUE, lane)
    if phase == E.SIMPLEST:
        a0, a1 = simplest.accelerations(q0, q1, w0, w1, sin_slope, cos_slope, torque)
        return a0, a1, a1
    foot_radius, leg = (
        get(tile, T.CONSTANT + K.FOOT_RADIUS, lane),
        get(tile, T.CONSTANT + K.LEG, lane),
    )
    along, across = (
        get(tile, T.CONSTANT + K.STANCE_ALONG, lane),
        get(tile, T.CONSTANT + K.STANCE_ACROSS, lane),
    )
    stance_inertia = get(tile, T.CONSTANT + K.STANCE_INERTIA, lane)
    if phase == E.LOCKED:
        a0, a1 = compass.accelerations(
            q0, q1, w0, w1, foot_radius, leg, along, across, stance_inertia,
            get(tile, T.CONSTANT + K.SWING_ALONG, lane),
            get(tile, T.CONSTANT + K.SWING_ACROSS, lane),
            get(tile, T.CONSTANT + K.SWING_INERTIA, lane),
            sin_slope, cos_slope, torque,
        )  # fmt: skip
        return a0, a1, a1
    return kneed.accelerations(
        q0, q1, q2, w0, w1, w2, foot_radius, leg, along, across, stance_inertia,
        get(tile, T.CONSTANT + K.THIGH_ALONG, lane),
        get(tile, T.CONSTANT + K.THIGH_ACROSS, lane),
        get(tile, T.CONSTANT + K.THIGH_INERTIA, lane),
        get(tile, T.CONSTANT + K.SHANK_ALONG, lane),
        get(tile, T.CONSTANT + K.SHANK_ACROSS, lane),
        get(tile, T.CONSTANT + K.SHANK_MOBILITY, lane),
        get(tile, T.CONSTANT + K.KNEE_COSINE, lane),
        get(tile, T.CONSTANT + K.KNEE_SINE, lane),
        sin_slope, cos_slope, torque,
    )  # fmt: skip


def _stage(index: int, phase: int):  # type: ignore[no-untyped-def]
    """Compile one stage of the step in every lane."""
    trial = runge_kutta.STAGE[index]

    @inlined
    @made_for(phase, index)
    def stage(tile, groups):
        for lane in range(GROUP * groups):
            h = get(tile, T.H, lane)
            angle, rate = get(tile, T.ANGLE, lane), get(tile, T.RATE, lane)
            q0, w0 = trial(tile, lane, T.STAGE, h, angle, rate)
            angle, rate = get(tile, T.ANGLE + 1, lane), get(tile, T.RATE + 1, lane)
            q1, w1 = trial(tile, lane, T.STAGE + 1, h, angle, rate)
            q2, w2 = q1, w1
            if phase == E.FREE:
                angle, rate = get(tile, T.ANGLE + 2, lane), get(tile, T.RATE + 2, lane)
                q2, w2 = trial(tile, lane, T.STAGE + 2, h, angle, rate)
            a0, a1, a2 = accelerations(phase, tile, lane, q0, q1, q2, w0, w1, w2)
            put(tile, T.STAGE + 3 * index, lane, a0)
            put(tile, T.STAGE + 3 * index + 1, lane, a1)
            put(tile, T.STAGE + 3 * index + 2, lane, a2)
            if index == runge_kutta.STAGES:
                put(tile, T.NEW_ANGLE, lane, q0)
                put(tile, T.NEW_ANGLE + 1, lane, q1)
                put(tile, T.NEW_ANGLE + 2, lane, q2)
                put(tile, T.NEW_RATE, lane, w0)
                put(tile, T.NEW_RATE + 1, lane, w1)
                put(tile, T.NEW_RATE + 2, lane, w2)

    return stage


def _begin(phase: int):  # type: ignore[no-untyped-def]
    """Compile the first stage of lanes that have just been filled; others have it from before."""

    @jitted
    @made_for(phase)
    def begin(tile, groups):
        align_stack()
        for lane in range(GROUP * groups):
            q0, w0 = get(tile, T.ANGLE, lane), get(tile, T.RATE, lane)
            q1, w1 = get(tile, T.ANGLE + 1, lane), get(tile, T.RATE + 1, lane)
            q2, w2 = get(tile, T.ANGLE + 2, lane), get(tile, T.RATE + 2, lane)
            a0, a1, a2 = accelerations(phase, tile, lane, q0, q1, q2, w0, w1, w2)
            fresh = get(tile, T.FRESH, lane).real != 0.0
            put(tile, T.STAGE, lane, a0 if fresh else get(tile, T.STAGE, lane))
            put(tile, T.STAGE + 1, lane, a1 if fresh else get(tile, T.STAGE + 1, lane))
            put(tile, T.STAGE + 2, lane, a2 if fresh else get(tile, T.STAGE + 2, lane))
            put(tile, T.FRESH, lane, 0.0)

    return begin


@inlined
def size(tile, row, lane):
    """Absolute value of a tile's entry."""
    return np.abs(get(tile, row, lane).real)


@inlined
def extent(tile, lane, coordinate):
    """Largest size of a coordinate's angle and rate at both ends of the step."""
    before = larger(size(tile, T.ANGLE + coordinate, lane), size(tile, T.RATE + coordinate, lane))
    angle = size(tile, T.NEW_ANGLE + coordinate, lane)
    return larger(before, larger(angle, size(tile, T.NEW_RATE + coordinate, lane)))


@inlined
def estimate(phase, tile, lanes, tolerance):
    """Error of each lane's step over its tolerance, relative to the largest angle or rate.

    Relative to the motion as a whole, so that small motions are resolved as well as large ones.
    """
    for lane in range(lanes):
        h = get(tile, T.H, lane).real
        scale = larger(extent(tile, lane, 0), extent(tile, lane, 1))
        if phase == E.FREE:
            scale = larger(scale, extent(tile, lane, 2))
        # Scale before squaring: the squares of tiny errors must not vanish.
        weight = h / (tolerance * scale + 1e-290)
        square = runge_kutta.error(tile, lane, T.STAGE, h, weight)
        square += runge_kutta.error(tile, lane, T.STAGE + 1, h, weight)
        if phase == E.FREE:
            square += runge_kutta.error(tile, lane, T.STAGE + 2, h, weight)
        put(tile, T.ERROR, lane, np.sqrt(square))


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
def judge(phase, tile, lanes, stub):
    """Settle the ordinary case in every lane; mark where `attend` must look, or time is up."""
    for lane in range(lanes):
        h, error = get(tile, T.H, lane), get(tile, T.ERROR, lane).real
        rest = get(tile, T.END, lane) - get(tile, T.TIME, lane)
        s0, t0 = get(tile, T.ANGLE, lane).real, get(tile, T.ANGLE + 1, lane).real
        u0, v0 = get(tile, T.RATE, lane).real, get(tile, T.RATE + 1, lane).real
        s1, t1 = get(tile, T.NEW_ANGLE, lane).real, get(tile, T.NEW_ANGLE + 1, lane).real
        u1, v1 = get(tile, T.NEW_RATE, lane).real, get(tile, T.NEW_RATE + 1, lane).real
        if phase == E.FREE:
            k0, k1 = get(tile, T.ANGLE + 2, lane).real, get(tile, T.NEW_ANGLE + 2, lane).real
            x0, x1 = get(tile, T.RATE + 2, lane).real, get(tile, T.NEW_RATE + 2, lane).real
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
            | (turning & (get(tile, T.TORQUE, lane).real != 0.0))
            | (get(tile, T.EVENT, lane).real != 0.0)
            | (not (error <= 1e30))
            | (h.real < 1e-12)
            | (get(tile, T.STEPS, lane).real >= MOST_STEPS)
        )
        plain = (error <= 1.0) & (not alert)
        up = plain & (h.real >= rest.real)
        following, proposed = proposal(h, error), get(tile, T.NEXT, lane)
        rest = rest - h if plain else rest
        put(tile, T.VERDICT, lane, _UP if up else (_ALERT if alert else _PLAIN))
        put(tile, T.STEPS, lane, get(tile, T.STEPS, lane) + 1.0)
        # A step that the time cut short says little of the next one.
        kept = alert | (up & (following.real <= proposed.real) & (error <= 0.1))
        put(tile, T.NEXT, lane, proposed if kept else following)
        next_h = following if 1.1 * following.real < rest.real else rest
        put(tile, T.H, lane, h if alert else next_h)
        put(tile, T.TIME, lane, get(tile, T.TIME, lane) + (h if plain else 0.0 * h))
        turn = np.abs((t1 - s1) - (t0 - s0))
        put(tile, T.TURN, lane, get(tile, T.TURN, lane) + (turn if plain else 0.0))
        settle(tile, lane, 0, plain)
        settle(tile, lane, 1, plain)
        if phase == E.FREE:
            settle(tile, lane, 2, plain)


def _sweep(phase: int):  # type: ignore[no-untyped-def]
    """Compile one step in every lane of a phase, with its judgement."""
    s1, s2, s3, s4, s5, s6, s7, s8, s9, s10, s11, s12, s13, s14, s15, s16 = (
        _stage(index, phase) for index in range(1, runge_kutta.STAGES + 1)
    )

    @jitted
    @made_for(phase)
    def sweep(tile, groups, tolerance, stub):
        align_stack()
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
                event, verdict = 0, get(tile, T.VERDICT, lane).real
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
