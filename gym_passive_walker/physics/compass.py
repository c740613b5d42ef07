"""Two links: a straight stance leg that rolls on its foot and a straight swing leg.

These are also the equations of a kneed walker after kneestrike, and the ground on which the
three-link ones of `kneed` stand. All angles are absolute, so the equations are short: with r the
vector from the contact to the hip and m the swing leg's first moment about the hip, the inertia
that couples the legs is r . m, and what centripetal acceleration exerts is r x m.

Vectors have the parts (back, up): against the walking direction and away from the ground. All
numbers are dimensionless (see `constants`); `sin_slope` and `cos_slope` are gravity's parts.
"""

from __future__ import annotations

from gym_passive_walker.physics import constants as K
from gym_passive_walker.physics.lanes import inlined, reciprocal, sine_cosine


@inlined
def turned(along, across, sine, cosine):
    """A vector fixed to a leg, (along, across) it, as (back, up)."""
    return along * sine + across * cosine, along * cosine - across * sine


@inlined
def weight_moment(back, up, sin_slope, cos_slope):
    """Torque of gravity on a first moment: it tips backwards what lies behind."""
    return cos_slope * back - sin_slope * up


@inlined
def solve(m11, m12, m22, f1, f2):
    """Solve the symmetric 2x2 system m x = f."""
    scale = reciprocal(m11 * m22 - m12 * m12)
    return (m22 * f1 - m12 * f2) * scale, (m11 * f2 - m12 * f1) * scale


@inlined
def accelerations(
    stance, swing, stance_rate, swing_rate,
    foot_radius, leg, stance_along, stance_across, stance_inertia,
    swing_along, swing_across, swing_inertia,
    sin_slope, cos_slope, torque,
):  # fmt: skip
    """Angular accelerations of the stance and the swing leg (subsection 4.10.7)."""
    sine, cosine = sine_cosine(stance)
    stance_back, stance_up = turned(stance_along, stance_across, sine, cosine)
    hip_back, hip_rise = leg * sine, leg * cosine
    hip_up = foot_radius + hip_rise
    sine, cosine = sine_cosine(swing)
    swing_back, swing_up = turned(swing_along, swing_across, sine, cosine)

    stance_force = (
        foot_radius * stance_back * stance_rate * stance_rate
        + (hip_up * swing_back - hip_back * swing_up) * swing_rate * swing_rate
        + weight_moment(stance_back, foot_radius + stance_up, sin_slope, cos_slope)
        - torque
    )
    swing_force = (
        (hip_back * swing_up - hip_rise * swing_back) * stance_rate * stance_rate
        + weight_moment(swing_back, swing_up, sin_slope, cos_slope)
        + torque
    )
    return solve(
        stance_inertia + 2.0 * foot_radius * stance_up,
        hip_up * swing_up + hip_back * swing_back,
        swing_inertia,
        stance_force,
        swing_force,
    )


@inlined
def inertia(c, stance, swing):
    """Mass matrix (m11, m12, m22) at a configuration; c is the walker's row of constants."""
    sine, cosine = sine_cosine(stance)
    _, stance_up = turned(c[K.STANCE_ALONG], c[K.STANCE_ACROSS], sine, cosine)
    hip_back, hip_up = c[K.LEG] * sine, c[K.FOOT_RADIUS] + c[K.LEG] * cosine
    sine, cosine = sine_cosine(swing)
    swing_back, swing_up = turned(c[K.SWING_ALONG], c[K.SWING_ACROSS], sine, cosine)
    return (
        c[K.STANCE_INERTIA] + 2.0 * c[K.FOOT_RADIUS] * stance_up,
        hip_up * swing_up + hip_back * swing_back,
        c[K.SWING_INERTIA],
    )


@inlined
def kinetic_energy(c, stance, swing, stance_rate, swing_rate):
    """Kinetic energy / (m g l)."""
    m11, m12, m22 = inertia(c, stance, swing)
    return 0.5 * (m11 * stance_rate**2 + m22 * swing_rate**2) + m12 * stance_rate * swing_rate


@inlined
def difference(along, across, start, end):
    """How a vector fixed to a leg changes as the leg turns, as (back, up).

    By half angles, so that small differences keep their digits.
    """
    half, _ = sine_cosine(0.5 * (end - start))
    sine, cosine = sine_cosine(0.5 * (end + start))
    return turned(-2.0 * half * across, 2.0 * half * along, sine, cosine)


@inlined
def rolling_gain(c, start, end):
    """Height and distance gained by the stance leg with the rest at its hip, as (back, up)."""
    back, up = difference(c[K.STANCE_ALONG], c[K.STANCE_ACROSS], start, end)
    return back + c[K.FOOT_RADIUS] * (end - start), up


@inlined
def potential_gain(c, stance, swing, stance_end, swing_end, sin_slope, cos_slope):
    """Potential energy gained between two configurations over the same contact, / (m g l)."""
    back, up = rolling_gain(c, stance, stance_end)
    swing_back, swing_up = difference(c[K.SWING_ALONG], c[K.SWING_ACROSS], swing, swing_end)
    return cos_slope * (up + swing_up) + sin_slope * (back + swing_back)


@inlined
def striking_velocity(c, stance, stance_rate, swing_rate):
    """Velocity of the foot that lands, (back, up), where the legs stand at -stance and stance.

    Equation 4.10, without its misprint-prone signs: the old hip velocity less the new rolling.
    """
    sine, cosine = sine_cosine(stance)
    hip_up = c[K.FOOT_RADIUS] + c[K.LEG] * cosine
    return (
        hip_up * (stance_rate - swing_rate),
        -c[K.LEG] * sine * (stance_rate + swing_rate),
    )


@inlined
def stance_collision(c, stance, swing_rate, velocity_back, velocity_up):
    """What both kinds of heelstrike share: the new stance leg meets the ground.

    The walker before the collision moves as one that rolls on its new foot, plus a translation
    with the striking velocity. Most of that translation is a turn of the new stance leg about the
    contact; taking the turn out first leaves only small numbers to solve for, and the energy lost
    keeps its digits however small the step.

    Args:
        c: Constants of the walker.
        stance: Stance angle before the collision; the new one is its opposite.
        swing_rate: Rate before the collision of the leg that becomes the stance leg.
        velocity_back: Striking velocity against the walking direction.
        velocity_up: Striking velocity away from the ground.

    Returns:
        Provisional rate of the new stance leg; the velocity (back, up) of the hip in excess of it;
        the momentum left for the stance leg's equation; twice the energy in the excess motion.
    """
    sine, cosine = sine_cosine(-stance)
    hip_back, hip_up = c[K.LEG] * sine, c[K.FOOT_RADIUS] + c[K.LEG] * cosine
    square = hip_back * hip_back + hip_up * hip_up
    per_square = reciprocal(square)
    # A turn with unit rate moves a point at (back, up) from the contact with (up, -back).
    turn = (velocity_back * hip_up - velocity_up * hip_back) * per_square
    along_hip = (velocity_back * hip_back + velocity_up * hip_up) * per_square
    com_back, com_up = turned(c[K.LEG_COM_ALONG], c[K.LEG_COM_ACROSS], sine, cosine)
    com_up = com_up + c[K.FOOT_RADIUS]
    excess_back = velocity_back - turn * com_up
    excess_up = velocity_up + turn * com_back
    momentum = c[K.LEG_MASS] * (excess_back * com_up - excess_up * com_back) - c[K.LEG_SPIN] * turn
    energy = (
        c[K.LEG_MASS] * (excess_back * excess_back + excess_up * excess_up)
        + c[K.LEG_SPIN] * turn * turn
        + (1.0 - c[K.LEG_MASS]) * along_hip * along_hip * square
    )
    return swing_rate + turn, along_hip * hip_back, along_hip * hip_up, momentum, energy


@inlined
def impulse(back, up, velocity_back, velocity_up):
    """Generalised momentum of a leg with first moment (back, up) when it is translated."""
    return velocity_back * up - velocity_up * back


@inlined
def heelstrike(c, stance, stance_rate, swing_rate):
    """Plastic collision of the swing foot with both knees locked, and the legs change roles.

    Angular momentum of the whole walker about the new contact and of the new swing leg about the
    hip pass through it (subsection 4.10.8); the old foot feels no impulse.

    Args:
        c: Constants of the walker.
        stance: Stance angle before the collision (negative); the swing angle is its opposite.
        stance_rate: Rate of the old stance leg.
        swing_rate: Rate of the old swing leg.

    Returns:
        Rates of the new stance leg and the new swing leg, and the energy lost.
    """
    velocity_back, velocity_up = striking_velocity(c, stance, stance_rate, swing_rate)
    rate, hip_back, hip_up, momentum, energy = stance_collision(
        c, stance, swing_rate, velocity_back, velocity_up
    )
    sine, cosine = sine_cosine(stance)
    swing_back, swing_up = turned(c[K.SWING_ALONG], c[K.SWING_ACROSS], sine, cosine)
    swing_momentum = impulse(swing_back, swing_up, hip_back, hip_up)
    m11, m12, m22 = inertia(c, -stance, stance)
    new_stance, new_swing = solve(m11, m12, m22, momentum, swing_momentum)
    loss = 0.5 * (energy - momentum * new_stance - swing_momentum * new_swing)
    return rate + new_stance, stance_rate + new_swing, loss


@inlined
def foot_clearance(c, stance, swing):
    """Height of the swing foot over the ground, legs straight."""
    half_sum, _ = sine_cosine(0.5 * (stance + swing))
    half_difference, _ = sine_cosine(0.5 * (swing - stance))
    return 2.0 * c[K.LEG] * half_sum * half_difference
