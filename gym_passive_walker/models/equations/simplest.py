"""The simplest walker: a mass at the hip, legs without mass, and feet of vanishing mass.

It is the limit of `straight` with point feet as the mass of the feet goes to zero: the swing leg
does not act on the stance leg. A hip torque has an effect in this limit only if it is proportional
to the foot's mass. The torque is therefore per unit of foot mass (times g l). Its work and the
foot's kinetic energy vanish beside those of the hip. The same holds for a spring and friction at
the hip.

References:
    M. Garcia, A. Chatterjee, A. Ruina, M. Coleman, "The simplest walking model: stability,
    complexity, and scaling", J. Biomech. Eng. 120 (1998) 281-288.
"""

from __future__ import annotations

from gym_passive_walker.models.equations import legs
from gym_passive_walker.models.equations.bodies import SimplestBody
from gym_passive_walker.models.equations.hybrid import (
    SMOOTH,
    Control,
    Outcome,
    Phase,
    Reset,
    Stage,
    Strike,
    System,
)
from gym_passive_walker.models.equations.numbers import sine_cosine


def accelerations(body, state, control, ground):
    """Angular accelerations of the stance leg (an inverted pendulum) and the swing leg.

    The swing leg hangs from the hip. The hip is accelerated by the stance leg's force along the
    leg, and by the force of an ankle torque across it.
    """
    sine, cosine = sine_cosine(state.stance)
    swing_sine, swing_cosine = sine_cosine(state.thigh)
    along = cosine * ground.cosine + sine * ground.sine - state.stance_rate * state.stance_rate
    torque = legs.hip_torque(body, state, control)
    swing_torque = torque - (cosine * swing_cosine + sine * swing_sine) * control.ankle
    return (
        sine * ground.cosine - cosine * ground.sine - control.ankle,
        (sine * swing_cosine - cosine * swing_sine) * along + swing_torque,
    )


def push(body, state, back, up):
    """Changes of both angular velocities by an impulse (back, up) on the hip."""
    stance_change = legs.moment_of_push(body, state.stance, back, up)
    _, cosine = sine_cosine(state.thigh - state.stance)
    return stance_change, cosine * stance_change


def kinetic_energy(body, state):
    """Kinetic energy of the hip / (m g l)."""
    return 0.5 * state.stance_rate * state.stance_rate


def potential_gain(body, start, end, ground):
    """Potential energy gained by the hip / (m g l)."""
    back, up = legs.difference(1.0, 0.0, start.stance, end.stance)
    return ground.cosine * up + ground.sine * back


def heelstrike(body, before, push_off=0.0, ground=SMOOTH):
    """Plastic collision of the swing foot: the hip keeps its velocity across the new leg.

    A push-off changes the hip's velocity along the old leg.
    """
    before = legs.standing(body, before, ground)
    sine, cosine = sine_cosine(before.stance - before.thigh)
    rate = cosine * before.stance_rate + push_off * sine
    lost = sine * before.stance_rate - push_off * cosine
    stance, swing = before.thigh + ground.slope_change, before.stance + ground.slope_change
    after = legs.straight(stance, swing, rate, cosine * rate)
    return Strike(after, 0.5 * lost * lost, 0.5 * push_off * push_off)


def foot_clearance(body, state):
    """Height of the swing foot over the ground."""
    return legs.clearance(body, state.stance, state.thigh)


SYSTEM = System(
    name="simplest",
    Body=SimplestBody,
    phases=(
        Phase(
            Stage.SIMPLEST,
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
    foot_clearance=foot_clearance,
    works=Control(0.0, 1.0),
)
