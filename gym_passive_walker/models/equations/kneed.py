"""A walker with knees: a stance leg that rolls on its foot, a swing thigh and a free shank.

The shank hangs from the thigh as the thigh hangs from the stance leg. McGeer's stride has two
phases: the knee is free until kneestrike, and locked until heelstrike. `straight` has the second
phase and the notation.
"""

from __future__ import annotations

from math import pi

from gym_passive_walker.models.equations import legs, straight
from gym_passive_walker.models.equations.bodies import KneedBody
from gym_passive_walker.models.equations.hybrid import (
    SMOOTH,
    Guard,
    Outcome,
    Phase,
    Refusal,
    Reset,
    Stage,
    State,
    Strike,
    System,
    Watch,
)
from gym_passive_walker.models.equations.legs import (
    difference,
    impulse,
    solve,
    solve_chain,
    turned,
    weight_moment,
)
from gym_passive_walker.models.equations.numbers import sine_cosine


def bend(state):
    """Sine and cosine of the angle by which the shank is ahead of the thigh."""
    thigh_sine, thigh_cosine = sine_cosine(state.thigh)
    shank_sine, shank_cosine = sine_cosine(state.shank)
    return (
        shank_sine * thigh_cosine - shank_cosine * thigh_sine,
        shank_cosine * thigh_cosine + shank_sine * thigh_sine,
    )


def mass_matrix(body, state):
    """Mass matrix (m11, m12, m13, m22, m23, m33)."""
    sine, cosine = sine_cosine(state.stance)
    _, stance_up = turned(body.stance_along, body.stance_across, sine, cosine)
    hip_back, hip_up = legs.hip(body, state.stance)
    thigh_back, thigh_up = turned(body.thigh_along, body.thigh_across, *sine_cosine(state.thigh))
    shank_back, shank_up = turned(body.shank_along, body.shank_across, *sine_cosine(state.shank))
    bend_sine, bend_cosine = bend(state)
    return (
        body.stance_inertia + body.foot_diameter * stance_up,
        hip_up * thigh_up + hip_back * thigh_back,
        hip_up * shank_up + hip_back * shank_back,
        body.thigh_inertia,
        body.knee_cosine * bend_cosine + body.knee_sine * bend_sine,
        body.shank_inertia,
    )


def forces(body, state, control, ground):
    """Generalized forces on stance leg, thigh and shank: from motion, gravity and controls."""
    sine, cosine = sine_cosine(state.stance)
    stance_back, stance_up = turned(body.stance_along, body.stance_across, sine, cosine)
    hip_back, hip_up = body.leg * sine, body.foot_radius + body.leg * cosine
    thigh_back, thigh_up = turned(body.thigh_along, body.thigh_across, *sine_cosine(state.thigh))
    shank_back, shank_up = turned(body.shank_along, body.shank_across, *sine_cosine(state.shank))
    bend_sine, bend_cosine = bend(state)
    thigh_cross = hip_up * thigh_back - hip_back * thigh_up
    shank_cross = hip_up * shank_back - hip_back * shank_up
    hip_torque = legs.hip_torque(body, state, control)
    knee_torque = legs.knee_torque(body, state)
    bend_slope = body.knee_sine * bend_cosine - body.knee_cosine * bend_sine
    stance_square = state.stance_rate * state.stance_rate
    thigh_square = state.thigh_rate * state.thigh_rate
    shank_square = state.shank_rate * state.shank_rate
    gravity = legs.gravity(body, state, ground)
    return (
        weight_moment(stance_back, body.foot_radius + stance_up, gravity)
        + thigh_cross * thigh_square
        + shank_cross * shank_square
        - hip_torque
        - control.ankle,
        weight_moment(thigh_back, thigh_up, gravity)
        - thigh_cross * stance_square
        - bend_slope * shank_square
        + hip_torque
        - knee_torque,
        weight_moment(shank_back, shank_up, gravity)
        - shank_cross * stance_square
        + bend_slope * thigh_square
        + knee_torque,
    )


def accelerations(body, state, control, ground):
    """Angular accelerations of the stance leg, the thigh and the shank (subsection 4.10.4)."""
    mass, force = mass_matrix(body, state), forces(body, state, control, ground)
    return solve_chain(mass, body.shank_mobility, force)


def push(body, state, back, up):
    """Changes of the three angular velocities by an impulse (back, up) on the hip, knee free."""
    momenta = legs.moment_of_push(body, state.stance, back, up), 0.0, 0.0
    return solve_chain(mass_matrix(body, state), body.shank_mobility, momenta)


def kinetic_energy(body, state):
    """Kinetic energy / (m g l)."""
    m11, m12, m13, m22, m23, m33 = mass_matrix(body, state)
    stance, thigh, shank = state.stance_rate, state.thigh_rate, state.shank_rate
    return (
        0.5 * (m11 * stance * stance + m22 * thigh * thigh + m33 * shank * shank)
        + m12 * stance * thigh
        + (m13 * stance + m23 * thigh) * shank
    )


def potential_gain(body, start, end, ground):
    """Potential energy gained between two states over the same contact, / (m g l)."""
    thigh = difference(body.thigh_along, body.thigh_across, start.thigh, end.thigh)
    shank = difference(body.shank_along, body.shank_across, start.shank, end.shank)
    return legs.potential_gain(body, start, end, ground, thigh, shank)


def spring_gain(body, start, end):
    """Energy that springs gain between two states / (m g l)."""
    knee = legs.stretch_gain(start.thigh - start.shank, end.thigh - end.shank)
    return legs.hip_spring_gain(body, start, end) + body.knee_stiffness * knee


def kneestrike(body, before, push_off=0.0, ground=SMOOTH):
    """Plastic collision of the shank with its stop, leg straight (subsection 4.10.6).

    Two angular momenta are conserved: that of the whole walker about the contact, and that of the
    swing leg about the hip. Push-off and the next foothold are ignored.
    """
    before = before._replace(shank=before.thigh)
    m11, m12, m13, m22, m23, m33 = mass_matrix(body, before)
    closing = before.shank_rate - before.thigh_rate
    stance_momentum, swing_momentum = m13 * closing, (m23 + m33) * closing
    stance_change, swing_change = solve(
        m11, m12 + m13, m22 + 2.0 * m23 + m33, stance_momentum, swing_momentum
    )
    loss = 0.5 * (
        m33 * closing * closing - stance_momentum * stance_change - swing_momentum * swing_change
    )
    after = legs.straight(
        before.stance,
        before.thigh,
        before.stance_rate + stance_change,
        before.thigh_rate + swing_change,
    )
    return Strike(after, loss)


def heelstrike(body, before, push_off=0.0, ground=SMOOTH):
    """Plastic collision of the swing foot; the old stance knee is free afterwards.

    The same momenta as with straight legs are conserved (`straight.heelstrike`), and the angular
    momentum of the new shank about its knee (subsection 4.10.8).
    """
    before, velocity, work = straight.strike_with(body, before, push_off, ground)
    rate, hip_back, hip_up, momentum, energy = straight.stance_collision(body, before, velocity)
    sine, cosine = sine_cosine(before.stance)
    thigh_back, thigh_up = turned(body.thigh_along, body.thigh_across, sine, cosine)
    shank_back, shank_up = turned(body.shank_along, body.shank_across, sine, cosine)
    thigh_momentum = impulse(thigh_back, thigh_up, hip_back, hip_up)
    shank_momentum = impulse(shank_back, shank_up, hip_back, hip_up)
    after = legs.straight(before.thigh, before.stance, rate, before.stance_rate)
    momenta = momentum, thigh_momentum, shank_momentum
    new_stance, new_thigh, new_shank = solve_chain(
        mass_matrix(body, after), body.shank_mobility, momenta
    )
    loss = 0.5 * (
        energy - momentum * new_stance - thigh_momentum * new_thigh - shank_momentum * new_shank
    )
    after = State(
        before.thigh,
        before.stance,
        before.stance,
        rate + new_stance,
        before.stance_rate + new_thigh,
        before.stance_rate + new_shank,
    )
    return Strike(after, loss, work)


def knee(body, thigh):
    """Position (back, up) of the swing knee from the hip."""
    return turned(body.knee_along, body.knee_across, *sine_cosine(thigh))


def foot_clearance(body, state):
    """Height of the swing foot over the ground."""
    _, cosine = sine_cosine(state.stance)
    _, knee_up = knee(body, state.thigh)
    _, foot_up = turned(-body.leg - body.knee_along, -body.knee_across, *sine_cosine(state.shank))
    return body.leg * cosine + knee_up + foot_up


def under_ground(body, state, ground):
    """Whether the foot of a straight leg is below both footholds."""
    return straight.foot_clearance(body, state) < legs.lower(ground)


def let_through(body, state, ground):
    """Whether the foot is below the ground in front and descends: the free knee let it pass."""
    return (
        legs.in_front(state)
        & (straight.foot_clearance(body, state) <= ground.height_change)
        & (state.stance_rate + state.thigh_rate <= 0.0)
    )


SYSTEM = System(
    name="kneed",
    Body=KneedBody,
    phases=(
        Phase(
            Stage.FREE,
            3,
            accelerations,
            guards=(
                Guard(  # the shank catches up with the thigh
                    lambda body, state, ground: state.thigh - state.shank,
                    Outcome.KNEESTRIKE,
                    Watch.STRIKE,
                    bends=True,
                ),
                *legs.STANCE_FALLS,
                *legs.THIGH_OVER_THE_TOP,
                Guard(lambda body, state, ground: pi - state.shank, Outcome.SWING_OVERROTATION),
                Guard(lambda body, state, ground: state.shank + pi, Outcome.SWING_OVERROTATION),
            ),
            resets={
                Outcome.KNEESTRIKE: Reset(
                    kneestrike,
                    into=1,
                    refuses=(
                        Refusal(under_ground, Outcome.STUBBED_TOE, scuff=True),
                        Refusal(let_through, Outcome.KNEE_NOT_LOCKED),
                    ),
                )
            },
            push=push,
        ),
        Phase(
            Stage.LOCKED,
            2,
            straight.accelerations,
            guards=(
                legs.HEELSTRIKE,
                *legs.STANCE_FALLS,
                *legs.THIGH_OVER_THE_TOP,
                legs.SCUFF,
            ),
            resets={Outcome.HEELSTRIKE: Reset(heelstrike)},
            push=straight.push,
        ),
    ),
    measure=legs.measure,
    place=legs.place,
    kinetic_energy=kinetic_energy,
    potential_gain=potential_gain,
    spring_gain=spring_gain,
    friction_power=legs.friction_power,
    foot_clearance=foot_clearance,
    mass_matrix=mass_matrix,
)
