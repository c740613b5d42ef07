"""What all legs share: vectors, small linear systems, and where things are.

A leg's own vectors are given *along* it (from foot to hip) and *across* it (backwards); turned by
its angle they have the parts (back, up).
"""

from __future__ import annotations

from math import pi

from gym_passive_walker.physics.hybrid import Guard, Outcome, Phase, State, Step, Watch
from gym_passive_walker.physics.numbers import larger, sine_cosine


def turned(along, across, sine, cosine):
    """A vector fixed to a leg, (along, across) it, as (back, up)."""
    return along * sine + across * cosine, along * cosine - across * sine


def difference(along, across, start, end):
    """How a vector fixed to a leg changes as the leg turns, as (back, up).

    By half angles, so that small differences keep their digits.
    """
    half, _ = sine_cosine(0.5 * (end - start))
    sine, cosine = sine_cosine(0.5 * (end + start))
    return turned(-2.0 * half * across, 2.0 * half * along, sine, cosine)


def gravity(body, state, ground):
    """Gravity (down, forward) as it is felt on the point of the foot that touches the ground.

    A foot that rolls throws that point up, with its radius times the square of its rate.
    """
    lift = body.foot_radius * (state.stance_rate * state.stance_rate)
    return ground.cosine + lift, ground.sine


def weight_moment(back, up, gravity):
    """Torque of gravity (down, forward) on a first moment: it tips backwards what lies behind."""
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
    """What a unit impulse of the ground along the stance leg does to a walker with straight legs.

    It acts at the contact, and the foot leaves the ground as fast as it may.

    Args:
        body: The walker.
        stance: Angle of the stance leg.
        swing: Angle of the swing leg.

    Returns:
        Change of the hip's velocity (back, up); of the stance and the swing leg's rates; and the
        velocity that the foot gets along the leg, of which half is the work.
    """
    stance_sine, stance_cosine = sine_cosine(stance)
    push_back, push_up = stance_sine, stance_cosine
    hip_back, hip_up = body.leg * stance_sine, body.foot_radius + body.leg * stance_cosine
    old = turned(body.swing_along, body.swing_across, stance_sine, stance_cosine)
    new = turned(body.swing_along, body.swing_across, *sine_cosine(swing))
    mobility = body.swing_mobility
    # A leg that hangs from a hip moving by v turns by (spin - back' v_up + up' v_back) mobility,
    # which leaves the hip with the mass of the whole less what the legs yield.
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


# What is fitted to the joints: springs that are relaxed where legs are parallel and straight, and
# viscous friction.


def hip_torque(body, state, control):
    """Torque between stance leg and swing thigh, positive when it opens the legs."""
    opened, opening = state.thigh - state.stance, state.thigh_rate - state.stance_rate
    return control.hip - body.hip_stiffness * opened - body.hip_friction * opening


def knee_torque(body, state):
    """Torque between swing thigh and shank, positive when it straightens the leg."""
    return body.knee_stiffness * (state.thigh - state.shank)


def friction_power(body, state):
    """What friction takes / (m g l sqrt(g/l)), always positive."""
    opening = state.thigh_rate - state.stance_rate
    return body.hip_friction * (opening * opening)


def stretch_gain(start, end):
    """What half the square of a spring's angle gains, without loss of digits."""
    return 0.5 * ((end - start) * (end + start))


def hip_spring_gain(body, start, end):
    """Energy that the hip's spring gains between two states / (m g l)."""
    return body.hip_stiffness * stretch_gain(start.thigh - start.stance, end.thigh - end.stance)


def potential_gain(body, start, end, ground, *hanging):
    """Energy gained in gravity's field by stance leg, the rest at its hip, and what hangs there.

    Args:
        body: The walker.
        start: State.
        end: Another one over the same contact.
        ground: The slope.
        hanging: By how much the first moment of each part changes, (back, up).
    """
    back, up = difference(body.stance_along, body.stance_across, start.stance, end.stance)
    back = back + body.foot_radius * (end.stance - start.stance)
    for part_back, part_up in hanging:
        back, up = back + part_back, up + part_up
    return ground.cosine * up + ground.sine * back


# Where things are. `body` is any walker's: foot_radius and leg, from foot centre to hip.


def hip(body, stance):
    """The hip from the point of contact, as (back, up)."""
    sine, cosine = sine_cosine(stance)
    return body.leg * sine, body.foot_radius + body.leg * cosine


def progress(body, stance):
    """How far the hip is ahead of the point that the foot stands on at stance angle 0."""
    sine, _ = sine_cosine(stance)
    return -(body.foot_radius * stance + body.leg * sine)


def step_length(body, start, end, landing=None, turn=0.0):
    """From one contact point to the next, along the ground of the first.

    Args:
        body: The walker.
        start: Stance angle where the stride began.
        end: Angle of the new stance leg where it ends.
        landing: That of the old one then; on smooth ground minus the new one's.
        turn: By how much the next foothold slopes more steeply: a foot touches it where its normal
            leads from the foot's centre.
    """
    landing = -end if landing is None else landing
    (new, _), (old, _), (tilted, _) = sine_cosine(end), sine_cosine(landing), sine_cosine(turn)
    return body.leg * (new - old) + body.foot_radius * (start - landing - tilted)


def measure(system, body, start, before, after, ground):
    """The stride that a heelstrike has ended; see `hybrid.System`."""
    start = after._replace(stance=start[0], thigh=start[1], shank=start[2])
    old, new = after.thigh - ground.slope_change, after.stance - ground.slope_change
    end = after._replace(stance=old, thigh=new, shank=new)
    return Step(
        step_length(body, start.stance, new, old, ground.slope_change),
        progress(body, old),
        -system.potential_gain(body, start, end, ground),
        -system.spring_gain(body, start, end) if system.spring_gain else 0.0,
    )


def place(body, state):
    """How far the hip is ahead of where its foot stands at stance angle 0."""
    return progress(body, state.stance)


def standing(body, state, ground):
    """The state with straight legs and both feet on the ground, by a small correction.

    Legs with an angle 2 d between them stand on footholds that differ in height by `rise` where the
    sine of their mean angle is rise / (2 leg sin d): one step of Newton's method from there.
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
    """Whether the swing leg is where a heelstrike may come."""
    return (state.stance < 0.0) & (state.thigh > state.stance)


def lower(ground):
    """Height of the lower one of two footholds."""
    return 0.0 - larger(-ground.height_change, 0.0)


def striking_velocity(body, state, turn=0.0):
    """Velocity of the foot that lands on the next foothold, (back, up) there.

    Equation 4.10, without its misprint-prone signs: the old hip velocity less the new rolling.
    What is alike of both feet is taken out first.

    Args:
        body: The walker.
        state: Just before the strike, angles from the next foothold's normal.
        turn: By how much it slopes more steeply than the old one.
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
    """Angular momentum about the contact that an impulse (back, up) on the hip brings.

    That is all a push does to the angles' momenta: the hip moves with the stance leg alone.
    """
    hip_back, hip_up = hip(body, stance)
    return impulse(hip_back, hip_up, back, up)


def straight(stance, thigh, stance_rate, thigh_rate):
    """A state with a straight swing leg."""
    return State(stance, thigh, thigh, stance_rate, thigh_rate, thigh_rate)


# What ends a phase of any walker.

HEELSTRIKE = Guard(  # the swing foot comes down on the next foothold
    lambda body, state, ground: clearance(body, state.stance, state.thigh) - ground.height_change,
    Outcome.HEELSTRIKE,
    Watch.STRIKE,
    where=(
        lambda body, state, ground: -state.stance,
        lambda body, state, ground: state.thigh - state.stance - NARROWEST,
    ),
    between=7,
)
SCUFF = Guard(  # a straight leg that meets the ground anywhere but in front
    lambda body, state, ground: clearance(body, state.stance, state.thigh) - lower(ground),
    Outcome.STUBBED_TOE,
    Watch.SCUFF,
    where=(lambda body, state, ground: larger(state.stance, state.stance - state.thigh),),
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
    """A phase on ground without steps: its guards fall where they do anywhere, and are linear.

    So they seldom fall and rise again within a step, and are checked at its ends alone.
    """
    each = (_ON_SMOOTH_GROUND.get(guard, (guard,)) for guard in phase.guards)
    guards = (guard._replace(between=0) for guards in each for guard in guards)
    return phase._replace(guards=tuple(guards))
