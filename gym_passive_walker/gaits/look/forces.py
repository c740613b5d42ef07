"""Contact force of the ground, and torques on the stops of the knees.

The equations of motion never name these forces; they follow from the accelerations by Newton's and
Euler's laws, for the whole walker and for what hangs on either side of a knee. A collision obeys
the same laws with jumps of velocity for accelerations, and yields impulses. Nothing here is
computed unless it is asked for.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker.gaits.flow import accelerations_at
from gym_passive_walker.models.equations import legs, straight
from gym_passive_walker.models.equations.bodies import KneedBody, SimplestBody
from gym_passive_walker.models.equations.hybrid import Control, Ground
from gym_passive_walker.models.equations.legs import hip_torque as torque_at_hip
from gym_passive_walker.models.equations.legs import impulse, turned
from gym_passive_walker.models.equations.legs import knee_torque as torque_at_knee
from gym_passive_walker.models.equations.numbers import sine_cosine
from gym_passive_walker.models.model import bodies


def swung(vector, rate, acceleration):
    """Second derivative of a vector (back, up) fixed to a turning leg."""
    back, up = vector
    square = rate * rate
    return acceleration * up - square * back, -acceleration * back - square * up


def torque_about(joint, moment, inertia, acceleration):
    """Torque that a body needs about a joint.

    Args:
        joint: Acceleration of the joint beyond free fall, (back, up).
        moment: First moment of the body from the joint, (back, up).
        inertia: Second moment of the body about the joint.
        acceleration: Angular acceleration of the body.
    """
    return inertia * acceleration + impulse(moment[0], moment[1], joint[0], joint[1])


def reactions(body, angles, rates, accelerations, lift, torque, knee_torque=0.0):
    """Force on the stance foot, and torque on the stops of both knees.

    Across a collision, accelerations and lift are jumps of velocity, rates and torque are zero, and
    the results are impulses.

    Args:
        body: Constants of a chain of links, from `linked`.
        angles: Angles of stance leg, thigh and shank.
        rates: Angular velocities of the three.
        accelerations: Angular accelerations of the three.
        lift: Acceleration of the foot besides its rolling and beyond free fall, (back, up): only
            gravity's (sin(slope), cos(slope)) while it rolls.
        torque: Hip torque.
        knee_torque: Torque of a spring at the swing knee.

    Returns:
        Force of the ground backwards and upwards; torque on the stance knee's and on the swing
        knee's stop, positive when the stop is pressed.
    """
    thigh_part = body.thigh_along, body.thigh_across
    knee_at = body.knee_along, body.knee_across
    # Above the stance knee: the thigh with the shank's mass at the knee, and the rest at the hip.
    above = thigh_part[0] - knee_at[0], thigh_part[1] - knee_at[1]
    above_inertia = (
        body.thigh_inertia
        - knee_at[0] * (above[0] + thigh_part[0])
        - knee_at[1] * (above[1] + thigh_part[1])
    )

    rate, acceleration = rates[0], accelerations[0]
    sine, cosine = sine_cosine(angles[0])
    foot = lift[0] + body.foot_radius * acceleration, lift[1]
    back, up = swung(turned(body.leg, 0.0, sine, cosine), rate, acceleration)
    hip = foot[0] + back, foot[1] + up
    stance = swung(turned(body.stance_along, body.stance_across, sine, cosine), rate, acceleration)
    knee = turned(knee_at[0], knee_at[1], sine, cosine)
    above = turned(above[0], above[1], sine, cosine)
    back, up = swung(knee, rate, acceleration)
    stance_torque = torque + torque_about(
        (hip[0] + back, hip[1] + up), above, above_inertia, acceleration
    )

    sine, cosine = sine_cosine(angles[1])
    thigh = swung(turned(thigh_part[0], thigh_part[1], sine, cosine), rates[1], accelerations[1])
    back, up = swung(turned(knee_at[0], knee_at[1], sine, cosine), rates[1], accelerations[1])
    sine, cosine = sine_cosine(angles[2])
    below = turned(body.shank_along, body.shank_across, sine, cosine)
    shank = swung(below, rates[2], accelerations[2])
    swing_torque = knee_torque - torque_about(
        (hip[0] + back, hip[1] + up), below, body.shank_inertia, accelerations[2]
    )

    swing = thigh[0] + shank[0], thigh[1] + shank[1]
    stance_torque += impulse(-knee[0], -knee[1], swing[0], swing[1])  # it pulls at the hip
    return (
        foot[0] + stance[0] + swing[0],
        foot[1] + stance[1] + swing[1],
        stance_torque,
        swing_torque,
    )


def linked(body):
    """A body as a chain: a straight leg is a thigh with no shank below it."""
    if isinstance(body, KneedBody):
        return body
    chained = KneedBody(**dict.fromkeys(KneedBody._fields, 0.0) | body._asdict())
    if isinstance(body, SimplestBody):
        return chained._replace(stance_along=body.leg)  # all mass is at the hip
    return chained._replace(
        thigh_along=body.swing_along,
        thigh_across=body.swing_across,
        thigh_inertia=body.swing_inertia,
    )


def borne(body, state, turns, control, ground):
    """Forces and torques while a walker moves: `reactions` to its accelerations.

    Args:
        body: The walker.
        state: State of the walker.
        turns: Angular accelerations of stance leg, thigh and shank.
        control: Torques of the actuators.
        ground: The ground.
    """
    body = linked(body)
    return reactions(
        body, state[:3], state[3:], turns, (ground.sine, ground.cosine),
        torque_at_hip(body, state, control), torque_at_knee(body, state),
    )  # fmt: skip


def struck(body, angles, jumps, foot_jump):
    """Impulses of a collision: `reactions` to jumps of velocities.

    Args:
        body: The walker.
        angles: Angles of stance leg, thigh and shank, in their roles after the collision.
        jumps: Jumps of their angular velocities.
        foot_jump: Jump of the velocity of the stance foot's contact point, (back, up).
    """
    still = (0.0, 0.0, 0.0)
    return reactions(linked(body), angles, still, jumps, foot_jump, 0.0)


def landing(body, state, push_off, ground):
    """The state just before a heelstrike, push-off done.

    Args:
        body: The walker.
        state: State as the swing foot lands.
        push_off: Impulse along the stance leg; a number 0.0 if there is none.
        ground: Ground on which it lands.

    Returns:
        That state, with straight legs and angles from the next foothold's normal; and the velocity
        (back, up) there of the foot that lands.
    """
    if not isinstance(body, SimplestBody):
        return straight.strike_with(body, state, push_off, ground)[:2]
    # A leg without mass takes the swing foot along as the hip is pushed.
    state = legs.standing(body, state, ground)
    old, new = state.stance + ground.slope_change, state.thigh + ground.slope_change
    state = state._replace(stance=old, thigh=new)
    back, up = legs.striking_velocity(body, state, ground.slope_change)
    sine, cosine = sine_cosine(old)
    return state, (back + push_off * sine, up + push_off * cosine)


def pushed_off(body, state, push_off, ground):
    """Impulses on the foot that leaves and on both knees' stops: `reactions` to a push-off.

    The arguments are those of `landing`.
    """
    state = legs.standing(body, state, ground)
    if isinstance(body, SimplestBody):
        sine, cosine = sine_cosine(state.stance)
        return push_off * sine, push_off * cosine, 0.0, 0.0
    (back, up), stance, swing, _ = legs.push_off(body, state.stance, state.thigh)
    hip_back, hip_up = legs.hip(body, state.stance)
    foot = push_off * (back - stance * hip_up), push_off * (up + stance * hip_back)
    jumps = push_off * stance, push_off * swing, push_off * swing
    return struck(body, (state.stance, state.thigh, state.thigh), jumps, foot)


def centre_of_mass(walker: Any, states: NDArray) -> NDArray[Any]:
    """Return positions (x, y) of the centre of mass from the contact point, (n, 2), in its units.

    Args:
        walker: The model.
        states: States (n, 2 m), real or complex; only coordinates matter.
    """
    if "McGeer's parameters" not in walker.supports:
        return walker.centre_of_mass(states)
    body, (stance, thigh, shank) = linked(walker.body), states.T[:3]
    back, up = turned(body.stance_along, body.stance_across, *sine_cosine(stance))
    for along, across, angle in (
        (body.thigh_along, body.thigh_across, thigh),
        (body.shank_along, body.shank_across, shank),
    ):
        part = turned(along, across, *sine_cosine(angle))
        back, up = back + part[0], up + part[1]
    return np.stack([-back, body.foot_radius + up], axis=-1) * walker.leg_length


class Reactions(NamedTuple):
    """Accelerations, forces and torques in the walker's own units, (n,) unless stated.

    Attributes:
        accelerations: Angular, of stance leg, thigh and shank, (n, 3).
        normal: Force of the ground away from it.
        tangential: Force of the ground along the slope, positive downhill.
        stance_knee: Torque on the stance knee's stop, positive when it is pressed: a negative one
            would flex the knee. NaN for a walker without knees.
        swing_knee: Torque on the swing knee's stop, positive when it is pressed; zero while the
            knee is free.
        hip: Torque between the legs at the hip, of actuator, spring and friction, positive when it
            opens them; NaN for a system.
    """

    accelerations: NDArray[np.float64]
    normal: NDArray[np.float64]
    tangential: NDArray[np.float64]
    stance_knee: NDArray[np.float64]
    swing_knee: NDArray[np.float64]
    hip: NDArray[np.float64]


def forces(
    walker: Any,
    slope: ArrayLike,
    states: ArrayLike,
    phases: ArrayLike,
    controls: ArrayLike | None = None,
) -> Reactions:
    """Forces at states of a walk.

    Args:
        walker: The model; the force of the ground on it must be known.
        slope: Slope in rad, one for all or (n,).
        states: States, (n, 6), or (n, 2 m) of a system.
        phases: `Stage` of each, shape (n,).
        controls: Held controls in the walker's own units, such as torques of hip and ankle, one row
            for all or (n, controls); zero when None.
    """
    units, system, body = walker.units, walker.equations(), walker.body
    given = units.to_dimensionless(np.array(states, dtype=float))
    state, stages = system.State(*given.T), np.asarray(phases)
    count = len(system.works)
    control = np.zeros((len(given), count))
    if controls is not None:
        control[:] = np.asarray(controls, dtype=float)[..., :count] / walker.control_units[:count]
    ground = Ground(*(np.broadcast_to(f(slope), len(given)) for f in (np.sin, np.cos)))
    turns = np.zeros((len(given), system.coordinates))
    for phase in system.phases:
        here = stages == phase.stage
        there = Ground(ground.sine[here], ground.cosine[here])
        turns[here] = accelerations_at(
            system, phase, bodies(walker)[0], given[here], control[here], there
        )
    hip: Any = np.full(len(given), np.nan)
    if system.ground_force is not None:
        along, normal = system.ground_force(body, state, tuple(turns.T), ground)
        tangential, knees = -along, [0.0 * normal] * 2
    else:
        held = Control(*control.T)
        tangential, normal, *knees = borne(body, state, turns.T, held, ground)
        hip = torque_at_hip(body, state, held)
    torques = np.stack(np.broadcast_arrays(*knees)) * units.energy
    if not walker.knees:
        torques = np.full_like(torques, np.nan)
    return Reactions(
        accelerations=turns * units.rate**2,
        normal=normal * units.force,
        tangential=-tangential * units.force,
        stance_knee=torques[0],
        swing_knee=torques[1],
        hip=hip * units.torque,
    )
