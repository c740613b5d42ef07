"""A walker with straight legs: a stance leg that rolls on its foot, and a swing leg.

These are also the equations of a kneed walker after kneestrike, and the basis of the three-link
equations in `kneed`. All angles are absolute, so the equations are short. Let r be the vector from
the contact to the hip, and m the swing leg's first moment about the hip. The inertia that couples
the legs is r . m, and the torque of centripetal acceleration is r x m.
"""

from __future__ import annotations

from gym_passive_walker.models.equations import legs
from gym_passive_walker.models.equations.bodies import StraightBody
from gym_passive_walker.models.equations.hybrid import (
    SMOOTH,
    Outcome,
    Phase,
    Reset,
    Stage,
    Strike,
    System,
)
from gym_passive_walker.models.equations.legs import (
    difference,
    impulse,
    solve_hanging,
    turned,
    weight_moment,
)
from gym_passive_walker.models.equations.numbers import sine_cosine


def mass_matrix(body, state):
    """Mass matrix (m11, m12, m22)."""
    sine, cosine = sine_cosine(state.stance)
    _, stance_up = turned(body.stance_along, body.stance_across, sine, cosine)
    hip_back, hip_up = legs.hip(body, state.stance)
    swing_back, swing_up = turned(body.swing_along, body.swing_across, *sine_cosine(state.thigh))
    return (
        body.stance_inertia + body.foot_diameter * stance_up,
        hip_up * swing_up + hip_back * swing_back,
        body.swing_inertia,
    )


def forces(body, state, control, ground):
    """Generalized forces on stance and swing leg: from motion, gravity and controls."""
    sine, cosine = sine_cosine(state.stance)
    stance_back, stance_up = turned(body.stance_along, body.stance_across, sine, cosine)
    hip_back, hip_up = body.leg * sine, body.foot_radius + body.leg * cosine
    swing_back, swing_up = turned(body.swing_along, body.swing_across, *sine_cosine(state.thigh))
    swing_cross = hip_up * swing_back - hip_back * swing_up
    gravity = legs.gravity(body, state, ground)
    hip_torque = legs.hip_torque(body, state, control)
    return (
        weight_moment(stance_back, body.foot_radius + stance_up, gravity)
        + swing_cross * (state.thigh_rate * state.thigh_rate)
        - hip_torque
        - control.ankle,
        weight_moment(swing_back, swing_up, gravity)
        - swing_cross * (state.stance_rate * state.stance_rate)
        + hip_torque,
    )


def accelerations(body, state, control, ground):
    """Angular accelerations of the stance and the swing leg (subsection 4.10.7)."""
    mass, force = mass_matrix(body, state), forces(body, state, control, ground)
    return solve_hanging(mass, body.swing_mobility, force)


def push(body, state, back, up):
    """Changes of both angular velocities by an impulse (back, up) on the hip.

    Their product with the mass matrix is the generalized impulse.
    """
    moment = legs.moment_of_push(body, state.stance, back, up)
    return solve_hanging(mass_matrix(body, state), body.swing_mobility, (moment, 0.0))


def kinetic_energy(body, state):
    """Kinetic energy / (m g l)."""
    m11, m12, m22 = mass_matrix(body, state)
    stance_rate, swing_rate = state.stance_rate, state.thigh_rate
    return (
        0.5 * (m11 * stance_rate * stance_rate + m22 * swing_rate * swing_rate)
        + m12 * stance_rate * swing_rate
    )


def potential_gain(body, start, end, ground):
    """Potential energy gained between two states over the same contact, / (m g l)."""
    swing = difference(body.swing_along, body.swing_across, start.thigh, end.thigh)
    return legs.potential_gain(body, start, end, ground, swing)


def strike_with(body, before, push_off, ground):
    """The state just before a heelstrike, with both feet on the ground and after the push-off.

    Returns:
        The state, with angles from the next foothold's normal; the velocity (back, up) of the
        landing foot in that frame; and the work of the push-off.
    """
    before = legs.standing(body, before, ground)
    push, stance_rate, swing_rate, gained = legs.push_off(body, before.stance, before.thigh)
    stance, swing = before.stance + ground.slope_change, before.thigh + ground.slope_change
    before = before._replace(stance=stance, thigh=swing, shank=swing)
    velocity_back, velocity_up = legs.striking_velocity(body, before, ground.slope_change)
    push_back, push_up = turned(push[1], push[0], *sine_cosine(ground.slope_change))
    hip_back, hip_up = legs.hip(body, swing)
    velocity_back = velocity_back + push_off * (push_back - swing_rate * hip_up)
    velocity_up = velocity_up + push_off * (push_up + swing_rate * hip_back)
    before = before._replace(
        stance_rate=before.stance_rate + push_off * stance_rate,
        thigh_rate=before.thigh_rate + push_off * swing_rate,
    )
    return before, (velocity_back, velocity_up), 0.5 * gained * (push_off * push_off)


def stance_collision(body, before, velocity):
    """Collision of the new stance leg with the ground, common to both kinds of heelstrike.

    The velocities before the collision are those of a walker that rolls on its new foot, plus a
    translation with the striking velocity. Most of that translation is a rotation of the new stance
    leg about the contact. This rotation is subtracted first, which leaves small numbers to solve
    for. The energy lost then keeps its digits for steps of any size.

    Args:
        body: The walker.
        before: The state before the collision, angles from the new foothold's normal.
        velocity: Velocity (back, up) of the landing foot.

    Returns:
        Provisional angular velocity of the new stance leg; velocity (back, up) of the hip in excess
        of it; remaining momentum of the stance leg's equation; twice the energy of the excess
        motion.
    """
    velocity_back, velocity_up = velocity
    hip_back, hip_up = legs.hip(body, before.thigh)
    square = hip_back * hip_back + hip_up * hip_up
    per_square = 1.0 / square
    # A rotation with unit rate moves a point at (back, up) from the contact with (up, -back).
    turn = (velocity_back * hip_up - velocity_up * hip_back) * per_square
    along_hip = (velocity_back * hip_back + velocity_up * hip_up) * per_square
    com_back, com_up = turned(body.leg_com_along, body.leg_com_across, *sine_cosine(before.thigh))
    com_up = com_up + body.foot_radius
    excess_back = velocity_back - turn * com_up
    excess_up = velocity_up + turn * com_back
    momentum = body.leg_mass * (excess_back * com_up - excess_up * com_back) - body.leg_spin * turn
    energy = (
        body.leg_mass * (excess_back * excess_back + excess_up * excess_up)
        + body.leg_spin * turn * turn
        + (1.0 - body.leg_mass) * along_hip * along_hip * square
    )
    return before.thigh_rate + turn, along_hip * hip_back, along_hip * hip_up, momentum, energy


def heelstrike(body, before, push_off=0.0, ground=SMOOTH):
    """Plastic collision of the swing foot with both knees locked; the legs exchange roles.

    Two angular momenta are conserved: that of the whole walker about the new contact, and that of
    the new swing leg about the hip (subsection 4.10.8). No impulse acts on the old foot.
    """
    before, velocity, work = strike_with(body, before, push_off, ground)
    rate, hip_back, hip_up, momentum, energy = stance_collision(body, before, velocity)
    old = sine_cosine(before.stance)
    swing_back, swing_up = turned(body.swing_along, body.swing_across, *old)
    swing_momentum = impulse(swing_back, swing_up, hip_back, hip_up)
    after = legs.straight(before.thigh, before.stance, rate, before.stance_rate)
    new_stance, new_swing = solve_hanging(
        mass_matrix(body, after), body.swing_mobility, (momentum, swing_momentum)
    )
    loss = 0.5 * (energy - momentum * new_stance - swing_momentum * new_swing)
    rates = rate + new_stance, before.stance_rate + new_swing
    after = legs.straight(before.thigh, before.stance, *rates)
    return Strike(after, loss, work)


def foot_clearance(body, state):
    """Height of the swing foot over the ground."""
    return legs.clearance(body, state.stance, state.thigh)


SYSTEM = System(
    name="straight",
    Body=StraightBody,
    phases=(
        Phase(
            Stage.LOCKED,
            2,
            accelerations,
            guards=(legs.HEELSTRIKE, *legs.STANCE_FALLS, *legs.THIGH_OVER_THE_TOP),
            resets={Outcome.HEELSTRIKE: Reset(heelstrike)},
            push=push,
        ),
    ),
    measure=legs.measure,
    place=legs.place,
    kinetic_energy=kinetic_energy,
    potential_gain=potential_gain,
    spring_gain=legs.hip_spring_gain,
    friction_power=legs.friction_power,
    foot_clearance=foot_clearance,
    mass_matrix=mass_matrix,
)
