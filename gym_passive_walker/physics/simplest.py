"""The simplest walker: a mass at the hip, legs without mass, and feet of vanishing mass.

The limit of `compass` with point feet as the feet's mass goes to zero: the swing leg no longer
acts on the stance leg. A hip torque that the limit survives is one in proportion to the foot's
mass, so here `torque` is per unit of foot mass (times g l), and its work, like the foot's kinetic
energy, is nothing beside the hip's.

References:
    M. Garcia, A. Chatterjee, A. Ruina, M. Coleman, "The simplest walking model: stability,
    complexity, and scaling", J. Biomech. Eng. 120 (1998) 281-288.
"""

from __future__ import annotations

from gym_passive_walker.physics.lanes import inlined, sine_cosine


@inlined
def accelerations(stance, swing, stance_rate, swing_rate, sin_slope, cos_slope, torque):
    """Angular accelerations of the stance leg (an inverted pendulum) and the swing leg."""
    sine, cosine = sine_cosine(stance)
    swing_sine, swing_cosine = sine_cosine(swing)
    stance_acceleration = sine * cos_slope - cosine * sin_slope
    swing_acceleration = (
        (cosine * swing_cosine + sine * swing_sine) * stance_acceleration
        - (sine * swing_cosine - cosine * swing_sine) * stance_rate * stance_rate
        - (swing_sine * cos_slope - swing_cosine * sin_slope)
        + torque
    )
    return stance_acceleration, swing_acceleration


@inlined
def kinetic_energy(stance_rate):
    """Kinetic energy of the hip / (m g l)."""
    return 0.5 * stance_rate * stance_rate


@inlined
def potential_gain(stance, stance_end, sin_slope, cos_slope):
    """Potential energy gained by the hip / (m g l), by half angles to keep small differences."""
    half, _ = sine_cosine(0.5 * (stance_end - stance))
    sine, cosine = sine_cosine(0.5 * (stance_end + stance))
    return 2.0 * half * (sin_slope * cosine - cos_slope * sine)


@inlined
def heelstrike(stance, stance_rate):
    """Plastic collision of the swing foot: the hip keeps its velocity across the new leg.

    Returns:
        Rates of the new stance leg and the new swing leg, and the energy lost.
    """
    sine, cosine = sine_cosine(2.0 * stance)
    rate = cosine * stance_rate
    lost = sine * stance_rate
    return rate, cosine * rate, 0.5 * lost * lost
