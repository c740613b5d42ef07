"""Three links: a straight stance leg that rolls on its foot, a swing thigh and a free shank.

The shank hangs from the thigh as the thigh does from the stance leg; see `compass` for the
notation and for the phase after kneestrike.
"""

from __future__ import annotations

from gym_passive_walker.physics import compass
from gym_passive_walker.physics import constants as K
from gym_passive_walker.physics.compass import solve, turned, weight_moment
from gym_passive_walker.physics.lanes import inlined, sine_cosine


@inlined
def solve_hanging(m11, m12, m13, m22, m23, mobility, f1, f2, f3):
    """Solve the symmetric 3x3 system m x = f whose last diagonal entry is 1 / mobility."""
    a, b = m13 * mobility, m23 * mobility
    x1, x2 = solve(m11 - a * m13, m12 - a * m23, m22 - b * m23, f1 - a * f3, f2 - b * f3)
    return x1, x2, f3 * mobility - a * x1 - b * x2


@inlined
def accelerations(
    stance, thigh, shank, stance_rate, thigh_rate, shank_rate,
    foot_radius, leg, stance_along, stance_across, stance_inertia,
    thigh_along, thigh_across, thigh_inertia, shank_along, shank_across, shank_mobility,
    knee_cosine, knee_sine, sin_slope, cos_slope, torque,
):  # fmt: skip
    """Angular accelerations of the stance leg, the thigh and the shank (subsection 4.10.4)."""
    sine, cosine = sine_cosine(stance)
    stance_back, stance_up = turned(stance_along, stance_across, sine, cosine)
    hip_back, hip_rise = leg * sine, leg * cosine
    hip_up = foot_radius + hip_rise
    thigh_sine, thigh_cosine = sine_cosine(thigh)
    thigh_back, thigh_up = turned(thigh_along, thigh_across, thigh_sine, thigh_cosine)
    shank_sine, shank_cosine = sine_cosine(shank)
    shank_back, shank_up = turned(shank_along, shank_across, shank_sine, shank_cosine)
    bend_sine = shank_sine * thigh_cosine - shank_cosine * thigh_sine
    bend_cosine = shank_cosine * thigh_cosine + shank_sine * thigh_sine
    bend_slope = knee_sine * bend_cosine - knee_cosine * bend_sine

    stance_square = stance_rate * stance_rate
    thigh_square = thigh_rate * thigh_rate
    shank_square = shank_rate * shank_rate
    stance_force = (
        foot_radius * stance_back * stance_square
        + (hip_up * thigh_back - hip_back * thigh_up) * thigh_square
        + (hip_up * shank_back - hip_back * shank_up) * shank_square
        + weight_moment(stance_back, foot_radius + stance_up, sin_slope, cos_slope)
        - torque
    )
    thigh_force = (
        (hip_back * thigh_up - hip_rise * thigh_back) * stance_square
        - bend_slope * shank_square
        + weight_moment(thigh_back, thigh_up, sin_slope, cos_slope)
        + torque
    )
    shank_force = (
        (hip_back * shank_up - hip_rise * shank_back) * stance_square
        + bend_slope * thigh_square
        + weight_moment(shank_back, shank_up, sin_slope, cos_slope)
    )
    return solve_hanging(
        stance_inertia + 2.0 * foot_radius * stance_up,
        hip_up * thigh_up + hip_back * thigh_back,
        hip_up * shank_up + hip_back * shank_back,
        thigh_inertia,
        knee_cosine * bend_cosine + knee_sine * bend_sine,
        shank_mobility,
        stance_force,
        thigh_force,
        shank_force,
    )


@inlined
def inertia(c, stance, thigh, shank):
    """Mass matrix (m11, m12, m13, m22, m23, m33); c is the walker's row of constants."""
    sine, cosine = sine_cosine(stance)
    _, stance_up = turned(c[K.STANCE_ALONG], c[K.STANCE_ACROSS], sine, cosine)
    hip_back, hip_up = c[K.LEG] * sine, c[K.FOOT_RADIUS] + c[K.LEG] * cosine
    sine, cosine = sine_cosine(thigh)
    thigh_back, thigh_up = turned(c[K.THIGH_ALONG], c[K.THIGH_ACROSS], sine, cosine)
    sine, cosine = sine_cosine(shank)
    shank_back, shank_up = turned(c[K.SHANK_ALONG], c[K.SHANK_ACROSS], sine, cosine)
    bend_sine, bend_cosine = sine_cosine(shank - thigh)
    return (
        c[K.STANCE_INERTIA] + 2.0 * c[K.FOOT_RADIUS] * stance_up,
        hip_up * thigh_up + hip_back * thigh_back,
        hip_up * shank_up + hip_back * shank_back,
        c[K.THIGH_INERTIA],
        c[K.KNEE_COSINE] * bend_cosine + c[K.KNEE_SINE] * bend_sine,
        c[K.SHANK_INERTIA],
    )


@inlined
def kinetic_energy(c, stance, thigh, shank, stance_rate, thigh_rate, shank_rate):
    """Kinetic energy / (m g l)."""
    m11, m12, m13, m22, m23, m33 = inertia(c, stance, thigh, shank)
    return (
        0.5 * (m11 * stance_rate**2 + m22 * thigh_rate**2 + m33 * shank_rate**2)
        + m12 * stance_rate * thigh_rate
        + (m13 * stance_rate + m23 * thigh_rate) * shank_rate
    )


@inlined
def potential_gain(c, stance, thigh, shank, stance_end, thigh_end, shank_end, sin_slope, cos_slope):
    """Potential energy gained between two configurations over the same contact, / (m g l)."""
    back, up = compass.rolling_gain(c, stance, stance_end)
    thigh_back, thigh_up = compass.difference(c[K.THIGH_ALONG], c[K.THIGH_ACROSS], thigh, thigh_end)
    shank_back, shank_up = compass.difference(c[K.SHANK_ALONG], c[K.SHANK_ACROSS], shank, shank_end)
    return cos_slope * (up + thigh_up + shank_up) + sin_slope * (back + thigh_back + shank_back)


@inlined
def kneestrike(c, stance, thigh, stance_rate, thigh_rate, shank_rate):
    """Plastic collision of the shank with its stop, leg straight (subsection 4.10.6).

    Angular momentum of the whole walker about the contact and of the swing leg about the hip pass
    through it.

    Returns:
        Rates of the stance leg and of the straight swing leg, and the energy lost.
    """
    m11, m12, m13, m22, m23, m33 = inertia(c, stance, thigh, thigh)
    closing = shank_rate - thigh_rate
    stance_momentum, swing_momentum = m13 * closing, (m23 + m33) * closing
    stance_change, swing_change = solve(
        m11, m12 + m13, m22 + 2.0 * m23 + m33, stance_momentum, swing_momentum
    )
    loss = 0.5 * (
        m33 * closing * closing - stance_momentum * stance_change - swing_momentum * swing_change
    )
    return stance_rate + stance_change, thigh_rate + swing_change, loss


@inlined
def heelstrike(c, stance, stance_rate, swing_rate):
    """Plastic collision of the swing foot, upon which the old stance knee is free.

    As for straight legs (`compass.heelstrike`), and the angular momentum of the new shank about
    its knee passes through it as well (subsection 4.10.8).

    Returns:
        Rates of the new stance leg, thigh and shank, and the energy lost.
    """
    velocity_back, velocity_up = compass.striking_velocity(c, stance, stance_rate, swing_rate)
    rate, hip_back, hip_up, momentum, energy = compass.stance_collision(
        c, stance, swing_rate, velocity_back, velocity_up
    )
    sine, cosine = sine_cosine(stance)
    thigh_back, thigh_up = turned(c[K.THIGH_ALONG], c[K.THIGH_ACROSS], sine, cosine)
    shank_back, shank_up = turned(c[K.SHANK_ALONG], c[K.SHANK_ACROSS], sine, cosine)
    thigh_momentum = compass.impulse(thigh_back, thigh_up, hip_back, hip_up)
    shank_momentum = compass.impulse(shank_back, shank_up, hip_back, hip_up)
    m11, m12, m13, m22, m23, _ = inertia(c, -stance, stance, stance)
    new_stance, new_thigh, new_shank = solve_hanging(
        m11, m12, m13, m22, m23, c[K.SHANK_MOBILITY], momentum, thigh_momentum, shank_momentum
    )
    loss = 0.5 * (
        energy - momentum * new_stance - thigh_momentum * new_thigh - shank_momentum * new_shank
    )
    return rate + new_stance, stance_rate + new_thigh, stance_rate + new_shank, loss


@inlined
def foot_clearance(c, stance, thigh, shank):
    """Height of the swing foot over the ground."""
    _, cosine = sine_cosine(stance)
    thigh_sine, thigh_cosine = sine_cosine(thigh)
    shank_sine, shank_cosine = sine_cosine(shank)
    along, across = c[K.KNEE_ALONG], c[K.KNEE_ACROSS]
    _, knee_up = turned(along, across, thigh_sine, thigh_cosine)
    _, foot_up = turned(-c[K.LEG] - along, -across, shank_sine, shank_cosine)
    return c[K.LEG] * cosine + knee_up + foot_up
