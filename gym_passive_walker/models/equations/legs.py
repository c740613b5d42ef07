"""Functions that all kinds of legs share: vectors, small linear systems, and positions.

Vectors that are fixed to a leg have components *along* it (from foot to hip) and *across* it
(backwards). Rotated by the leg's angle they have the components (back, up).
"""

from __future__ import annotations

from math import pi

from gym_passive_walker.models.equations.hybrid import Guard, Outcome, Phase, State, Step, Watch
from gym_passive_walker.models.equations.numbers import larger, sine_cosine


def turned(along, across, sine, cosine):
    """Components (back, up) of a vector fixed to a leg, given along and across the leg."""
    return along * sine + across * cosine, along * cosine - across * sine


def difference(along, across, start, end):
    """Change (back, up) of a vector fixed to a leg between two angles of the leg.

    It is computed with half angles, so that small differences keep their digits.
    """
    half, _ = sine_cosine(0.5 * (end - start))
    sine, cosine = sine_cosine(0.5 * (end + start))
    return turned(-2.0 * half * across, 2.0 * half * along, sine, cosine)


def gravity(body, state, ground):
    """Effective gravity (down, forward) at the contact point of the foot.

    The contact point of a rolling foot accelerates upwards by its radius times the squared angular
    velocity.
    """
    lift = body.foot_radius * (state.stance_rate * state.stance_rate)
    return ground.cosine + lift, ground.sine


def weight_moment(back, up, gravity):
    """Torque of gravity (down, forward) on a first moment (back, up), positive backwards."""
    down, forward = gravity
    return down * back - forward * up


def impulse(back, up, velocity_back, velocity_up):
    """Generalized momentum of a leg with first moment (back, up) when it is translated."""
    return velocity_back * up - velocity_up * back


def solve(m11, m12, m22, f1, f2):
    """Solve the symmetric 2x2 system m x = f."""
    scale = 1.0 / (m11 * m22 - m12 * m12)
    return (m22 * f1 - m12 * f2) * scale, (m11 * f2 - m12 * f1) * scale


def solve_hanging(mass, mobility, force):
    """Solve the symmetric 2x2 system m x = f, given m row by row and 1 / its last entry."""
    m11, m12, _ = mass
    f1, f2 = force
    a = m12 * mobility
    x1 = (f1 - a * f2) / (m11 - a * m12)
    return x1, f2 * mobility - a * x1


def solve_chain(mass, mobility, force):
    """Solve the symmetric 3x3 system m x = f, given m row by row and 1 / its last entry."""
    m11, m12, m13, m22, m23, _ = mass
    f1, f2, f3 = force
    a, b = m13 * mobility, m23 * mobility
    x1, x2 = solve(m11 - a * m13, m12 - a * m23, m22 - b * m23, f1 - a * f3, f2 - b * f3)
    return x1, x2, f3 * mobility - a * x1 - b * x2


def push_off(body, stance, swing):
    """Effect of a unit impulse of the ground along the stance leg on a walker with straight legs.

    The impulse acts at the contact; afterwards the foot may leave the ground at any velocity.

    Args:
        body: The walker.
        stance: Angle of the stance leg.
        swing: Angle of the swing leg.

    Returns:
        Changes of the hip's velocity (back, up) and of the angular velocities of stance and swing
        leg; and the foot's velocity along the leg, which is twice the work.
    """
    stance_sine, stance_cosine = sine_cosine(stance)
    push_back, push_up = stance_sine, stance_cosine
    hip_back, hip_up = body.leg * stance_sine, body.foot_radius + body.leg * stance_cosine
    old = turned(body.swing_along, body.swing_across, stance_sine, stance_cosine)
    new = turned(body.swing_along, body.swing_across, *sine_cosine(swing))
    mobility = body.swing_mobility
    # A leg that hangs from a hip with velocity v gets the angular velocity
    # (spin - back' v_up + up' v_back) mobility. Eliminating it reduces the hip's effective mass.
    spin = push_up * hip_back - push_back * hip_up
    velocity_back, velocity_up = solve(
        1.0 - mobility * (old[1] * old[1] + new[1] * new[1]),
        mobility * (old[0] * old[1] + new[0] * new[1]),
        1.0 - mobility * (old[0] * old[0] + new[0] * new[0]),
        push_back - mobility * spin * old[1],
        push_up + mobility * spin * old[0],
    )
    stance_rate = mobility * (spin - impulse(*old, velocity_back, velocity_up))
    swing_rate = -mobility * impulse(*new, velocity_back, velocity_up)
    foot_back, foot_up = velocity_back - stance_rate * hip_up, velocity_up + stance_rate * hip_back
    gained = push_back * foot_back + push_up * foot_up
    return (velocity_back, velocity_up), stance_rate, swing_rate, gained


# Springs and viscous friction at the joints; springs are relaxed if legs are parallel and straight.


def hip_torque(body, state, control):
    """Torque between stance leg and swing thigh, positive when it opens the legs."""
    opened, opening = state.thigh - state.stance, state.thigh_rate - state.stance_rate
    return control.hip - body.hip_stiffness * opened - body.hip_friction * opening


def knee_torque(body, state):
    """Torque between swing thigh and shank, positive when it straightens the leg."""
    return body.knee_stiffness * (state.thigh - state.shank)


def friction_power(body, state):
    """Power dissipated by friction / (m g l sqrt(g/l)), never negative."""
    opening = state.thigh_rate - state.stance_rate
    return body.hip_friction * (opening * opening)


def stretch_gain(start, end):
    """Change of half the square of a spring's angle, without loss of digits."""
    return 0.5 * ((end - start) * (end + start))


def hip_spring_gain(body, start, end):
    """Energy that the hip's spring gains between two states / (m g l)."""
    return body.hip_stiffness * stretch_gain(start.thigh - start.stance, end.thigh - end.stance)


def potential_gain(body, start, end, ground, *hanging):
    """Gain of potential energy / (m g l) of stance leg, masses at its hip, and hanging parts.

    Args:
        body: The walker.
        start: State at the start.
        end: State at the end, over the same contact.
        ground: Ground, for its slope.
        hanging: Change of the first moment (back, up) of each hanging part.
    """
    back, up = difference(body.stance_along, body.stance_across, start.stance, end.stance)
    back = back + body.foot_radius * (end.stance - start.stance)
    for part_back, part_up in hanging:
        back, up = back + part_back, up + part_up
    return ground.cosine * up + ground.sine * back


# Positions. `body` is that of any walker: foot_radius, and leg from foot centre to hip.


def hip(body, stance):
    """Position (back, up) of the hip relative to the contact point."""
    sine, cosine = sine_cosine(stance)
    return body.leg * sine, body.foot_radius + body.leg * cosine


def hip_travel(body, stance):
    """Distance of the hip from its place over the stance foot at stance angle 0."""
    sine, _ = sine_cosine(stance)
    return -(body.foot_radius * stance + body.leg * sine)


def step_length(body, start, end, landing=None, turn=0.0):
    """Distance between contact points, along the ground of the first one.

    Args:
        body: The walker.
        start: Stance angle at the start of the stride.
        end: Angle of the new stance leg at its end.
        landing: Angle of the old stance leg at its end; on smooth ground, minus that of the new
            one.
        turn: Slope change of the next foothold in rad. A foot touches it at the point where its
            normal passes through the foot's centre.
    """
    landing = -end if landing is None else landing
    (new, _), (old, _), (tilted, _) = sine_cosine(end), sine_cosine(landing), sine_cosine(turn)
    return body.leg * (new - old) + body.foot_radius * (start - landing - tilted)


def measure(system, body, start, before, after, ground):
    """Measures of the stride that a heelstrike has ended; see `hybrid.System`."""
    start = after._replace(stance=start[0], thigh=start[1], shank=start[2])
    old, new = after.thigh - ground.slope_change, after.stance - ground.slope_change
    end = after._replace(stance=old, thigh=new, shank=new)
    return Step(
        step_length(body, start.stance, new, old, ground.slope_change),
        hip_travel(body, old),
        -system.potential_gain(body, start, end, ground),
        -system.spring_gain(body, start, end) if system.spring_gain else 0.0,
    )


def place(body, state):
    """Distance of the hip from its place over the stance foot at stance angle 0."""
    return hip_travel(body, state.stance)


def standing(body, state, ground):
    """A state with straight legs and both feet on the ground, by a small correction.

    Consider legs with an angle 2 d between them, on footholds that differ in height by `rise`. The
    sine of their mean angle is rise / (2 leg sin d). One step of Newton's method solves this.
    """
    mean, half = 0.5 * (state.stance + state.thigh), 0.5 * (state.thigh - state.stance)
    sine, cosine = sine_cosine(mean)
    spread, _ = sine_cosine(half)
    apart = 2.0 * body.leg * spread + 1e-300  # legs side by side stand at one height
    mean = mean - (sine - ground.height_change / apart) / cosine
    return state._replace(stance=mean - half, thigh=mean + half, shank=mean + half)


def clearance(body, stance, swing):
    """Height of the swing foot over the ground, legs straight."""
    half_sum, _ = sine_cosine(0.5 * (stance + swing))
    half_difference, _ = sine_cosine(0.5 * (swing - stance))
    return 2.0 * body.leg * half_sum * half_difference


NARROWEST = 0.0202
"""Smallest angle in rad between legs that may stand on footholds of two heights."""


def in_front(state):
    """Whether the swing leg is in a position in which a heelstrike counts."""
    return (state.stance < 0.0) & (state.thigh > state.stance)


def lower(ground):
    """Height of the lower one of two footholds."""
    return 0.0 - larger(-ground.height_change, 0.0)


def striking_velocity(body, state, turn=0.0):
    """Velocity (back, up) of the landing foot, in the frame of the next foothold.

    This is Equation 4.10 in vector form: the old velocity of the hip minus that of rolling on the
    new foot. The part that both feet have in common is subtracted first.

    Args:
        body: The walker.
        state: State just before the impact, angles from the next foothold's normal.
        turn: Slope change of the next foothold in rad.
    """
    sine, cosine = sine_cosine(turn)
    old_sine, old_cosine = sine_cosine(state.stance)
    old_back = body.leg * old_sine + body.foot_radius * sine
    old_up = body.foot_radius * cosine + body.leg * old_cosine
    new_back, new_up = hip(body, state.thigh)
    return (
        new_up * (state.stance_rate - state.thigh_rate) + (old_up - new_up) * state.stance_rate,
        -old_back * (state.stance_rate + state.thigh_rate)
        + (old_back + new_back) * state.thigh_rate,
    )


def moment_of_push(body, stance, back, up):
    """Angular momentum about the contact of an impulse (back, up) on the hip.

    It is the only generalized momentum that a push changes: the hip moves with the stance leg
    alone.
    """
    hip_back, hip_up = hip(body, stance)
    return impulse(hip_back, hip_up, back, up)


def straight(stance, thigh, stance_rate, thigh_rate):
    """A state with a straight swing leg."""
    return State(stance, thigh, thigh, stance_rate, thigh_rate, thigh_rate)


# Guards of all walkers.

HEELSTRIKE = Guard(  # the swing foot comes down on the next foothold
    lambda body, state, ground: clearance(body, state.stance, state.thigh) - ground.height_change,
    Outcome.HEELSTRIKE,
    Watch.STRIKE,
    where=(
        lambda body, state, ground: -state.stance,
        lambda body, state, ground: state.thigh - state.stance - NARROWEST,
    ),
    bends=True,
)
SCUFF = Guard(  # a straight leg that meets the ground anywhere but in front
    lambda body, state, ground: clearance(body, state.stance, state.thigh) - lower(ground),
    Outcome.STUBBED_TOE,
    Watch.SCUFF,
    where=(lambda body, state, ground: larger(state.stance, state.stance - state.thigh),),
    bends=True,
)
STANCE_FALLS = (
    Guard(lambda body, state, ground: state.stance + 0.5 * pi, Outcome.FELL_FORWARD),
    Guard(lambda body, state, ground: 0.5 * pi - state.stance, Outcome.FELL_BACKWARD),
)
THIGH_OVER_THE_TOP = (
    Guard(lambda body, state, ground: pi - state.thigh, Outcome.SWING_OVERROTATION),
    Guard(lambda body, state, ground: state.thigh + pi, Outcome.SWING_OVERROTATION),
)

_ON_SMOOTH_GROUND = {
    HEELSTRIKE: (
        Guard(
            lambda body, state, ground: state.stance + state.thigh,  # the legs mirror each other
            Outcome.HEELSTRIKE,
            Watch.STRIKE,
            where=(lambda body, state, ground: -state.stance,),
        ),
    ),
    SCUFF: tuple(
        Guard(falls, Outcome.STUBBED_TOE, Watch.SCUFF)
        for falls in (
            lambda body, state, ground: state.thigh - state.stance,
            lambda body, state, ground: state.stance - state.thigh,
            lambda body, state, ground: -state.stance - state.thigh,
        )
    ),
}


def on_smooth_ground(phase: Phase) -> Phase:
    """A phase on smooth ground: the guards of heelstrike and toe stub are linear in the angles.

    They seldom fall and rise again within a step, so they are checked at its ends alone.
    """
    each = (_ON_SMOOTH_GROUND.get(guard, (guard,)) for guard in phase.guards)
    guards = (guard._replace(bends=False) for guards in each for guard in guards)
    return phase._replace(guards=tuple(guards))
