"""What the ground and the knees must carry: contact force and knee torques.

The equations of motion never name these forces; they follow from the accelerations by Newton's and
Euler's laws, for the whole walker and for what hangs on either side of a knee. A collision obeys
the same laws with jumps of velocity for accelerations, and yields impulses. Nothing here is
computed unless it is asked for.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker.physics import compass, kneed, simplest
from gym_passive_walker.physics import constants as K
from gym_passive_walker.physics import events as E
from gym_passive_walker.physics.compass import impulse, turned
from gym_passive_walker.physics.constants import Kind
from gym_passive_walker.physics.frame import frame_of
from gym_passive_walker.physics.lanes import inlined, kernel, sine_cosine
from gym_passive_walker.walkers import Walker


@inlined
def swung(vector, rate, acceleration):
    """Second derivative of a vector (back, up) fixed to a turning leg."""
    back, up = vector
    square = rate * rate
    return acceleration * up - square * back, -acceleration * back - square * up


@inlined
def torque_about(joint, moment, inertia, acceleration):
    """Torque that a body needs about a joint.

    Args:
        joint: Acceleration of the joint beyond free fall, (back, up).
        moment: First moment of the body from the joint, (back, up).
        inertia: Second moment of the body about the joint.
        acceleration: Angular acceleration of the body.
    """
    return inertia * acceleration + impulse(moment[0], moment[1], joint[0], joint[1])


@inlined
def reactions(c, angles, rates, accelerations, lift, torque):
    """Force on the stance foot, and torque on the stops of both knees.

    Across a collision, accelerations and lift are jumps of velocity, rates and torque are zero, and
    the results are impulses.

    Args:
        c: A row of constants from `chain`.
        angles: Of stance leg, thigh and shank.
        rates: Likewise.
        accelerations: Likewise.
        lift: Acceleration of the foot besides its rolling and beyond free fall, (back, up): only
            gravity's (sin(slope), cos(slope)) while it rolls.
        torque: Hip torque.

    Returns:
        Force of the ground backwards and upwards; torque on the stance knee's and on the swing
        knee's stop, positive when the stop is pressed.
    """
    thigh_part = c[K.THIGH_ALONG], c[K.THIGH_ACROSS]
    knee_at = c[K.KNEE_ALONG], c[K.KNEE_ACROSS]
    # Above the stance knee: the thigh with the shank's mass at the knee, and the rest at the hip.
    above = thigh_part[0] - knee_at[0], thigh_part[1] - knee_at[1]
    above_inertia = (
        c[K.THIGH_INERTIA]
        - knee_at[0] * (above[0] + thigh_part[0])
        - knee_at[1] * (above[1] + thigh_part[1])
    )

    rate, acceleration = rates[0], accelerations[0]
    sine, cosine = sine_cosine(angles[0])
    foot = lift[0] + c[K.FOOT_RADIUS] * acceleration, lift[1]
    back, up = swung(turned(c[K.LEG], 0.0, sine, cosine), rate, acceleration)
    hip = foot[0] + back, foot[1] + up
    body = swung(turned(c[K.STANCE_ALONG], c[K.STANCE_ACROSS], sine, cosine), rate, acceleration)
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
    below = turned(c[K.SHANK_ALONG], c[K.SHANK_ACROSS], sine, cosine)
    shank = swung(below, rates[2], accelerations[2])
    swing_torque = -torque_about(
        (hip[0] + back, hip[1] + up), below, c[K.SHANK_INERTIA], accelerations[2]
    )

    swing = thigh[0] + shank[0], thigh[1] + shank[1]
    stance_torque += impulse(-knee[0], -knee[1], swing[0], swing[1])  # it pulls at the hip
    return foot[0] + body[0] + swing[0], foot[1] + body[1] + swing[1], stance_torque, swing_torque


@kernel
def _reactions_along(c, phases, states, sin_slope, cos_slope, torque, out):
    """Accelerations and reactions (n, 7) of states (n, 6) within their phases."""
    for i in range(len(states)):
        q0, q1, q2, w0, w1, w2 = states[i]
        if phases[i] == E.FREE:
            a0, a1, a2 = kneed.accelerations(
                q0, q1, q2, w0, w1, w2, c[K.FOOT_RADIUS], c[K.LEG],
                c[K.STANCE_ALONG], c[K.STANCE_ACROSS], c[K.STANCE_INERTIA],
                c[K.THIGH_ALONG], c[K.THIGH_ACROSS], c[K.THIGH_INERTIA],
                c[K.SHANK_ALONG], c[K.SHANK_ACROSS], c[K.SHANK_MOBILITY],
                c[K.KNEE_COSINE], c[K.KNEE_SINE], sin_slope, cos_slope, torque,
            )  # fmt: skip
        elif phases[i] == E.LOCKED:
            a0, a1 = compass.accelerations(
                q0, q1, w0, w1, c[K.FOOT_RADIUS], c[K.LEG],
                c[K.STANCE_ALONG], c[K.STANCE_ACROSS], c[K.STANCE_INERTIA],
                c[K.SWING_ALONG], c[K.SWING_ACROSS], c[K.SWING_INERTIA],
                sin_slope, cos_slope, torque,
            )  # fmt: skip
            a2 = a1
        else:
            a0, a1 = simplest.accelerations(q0, q1, w0, w1, sin_slope, cos_slope, torque)
            a2 = a1
        out[i, 0], out[i, 1], out[i, 2] = a0, a1, a2
        out[i, 3], out[i, 4], out[i, 5], out[i, 6] = reactions(
            c, (q0, q1, q2), (w0, w1, w2), (a0, a1, a2), (sin_slope, cos_slope), torque
        )


@kernel
def _impulses(c, angles, jumps, lift_back, lift_up, out):
    """Impulses (n, 4) that make rates jump (n, 3) and the foot change its velocity."""
    zero = (0.0, 0.0, 0.0)
    for i in range(len(jumps)):
        q, jump = angles[i], jumps[i]
        out[i, 0], out[i, 1], out[i, 2], out[i, 3] = reactions(
            c, (q[0], q[1], q[2]), zero, (jump[0], jump[1], jump[2]),
            (lift_back[i], lift_up[i]), 0.0,
        )  # fmt: skip


def chain(walker: Walker) -> NDArray[np.float64]:
    """Constants of a walker as a chain: a straight leg is a thigh with no shank below it."""
    c = K.constants(walker)
    kind = K.kind_of(walker)
    if kind == Kind.SIMPLEST:
        c[K.STANCE_ALONG] = c[K.LEG]  # all mass is at the hip
    if kind != Kind.KNEED:
        c[K.THIGH_ALONG], c[K.THIGH_ACROSS] = c[K.SWING_ALONG], c[K.SWING_ACROSS]
    return c


class Reactions(NamedTuple):
    """Accelerations, and what carries the walker, in its own units; each of shape (n,) or so.

    For impulses, read: change of rate, impulse, angular impulse.

    Attributes:
        accelerations: Angular, of stance leg, thigh and shank, (n, 3).
        normal: Force of the ground away from it.
        tangential: Force of the ground along the slope, positive downhill.
        stance_knee: Torque on the stance knee's stop, positive when it is pressed: a negative one
            would flex the knee. NaN for a walker without knees.
        swing_knee: Torque on the swing knee's stop, likewise; zero while the knee is free.
    """

    accelerations: NDArray[np.float64]
    normal: NDArray[np.float64]
    tangential: NDArray[np.float64]
    stance_knee: NDArray[np.float64]
    swing_knee: NDArray[np.float64]


def _in_own_units(walker: Walker, columns: NDArray, time: float) -> Reactions:
    """Reactions from dimensionless columns (n, 7); `time` is 1, or the time unit of impulses."""
    frame = frame_of(walker)
    force, torque = frame.energy / frame.length * time, frame.energy * time
    knees = columns[:, 5:] * torque if walker.knees else np.full((len(columns), 2), np.nan)
    return Reactions(
        accelerations=columns[:, :3] * frame.rate**2 * time,
        normal=columns[:, 4] * force,
        tangential=-columns[:, 3] * force,
        stance_knee=knees[:, 0],
        swing_knee=knees[:, 1],
    )


def forces(
    walker: Walker,
    slope: float,
    states: ArrayLike,
    phases: ArrayLike,
    *,
    hip_torque: float = 0.0,
) -> Reactions:
    """Forces at states of a walk.

    Args:
        walker: The walker.
        slope: Slope in rad.
        states: Angles and rates, shape (n, 6).
        phases: `events.FREE`, `LOCKED` or `SIMPLEST`, shape (n,).
        hip_torque: Torque, as for `stride`.
    """
    frame = frame_of(walker)
    states = np.array(states, dtype=float)
    states[:, 3:] *= frame.time
    columns = np.empty((len(states), 7))
    _reactions_along(
        chain(walker), np.asarray(phases), states,
        np.sin(slope), np.cos(slope), hip_torque / frame.torque, columns,
    )  # fmt: skip
    return _in_own_units(walker, columns, 1.0)


def impulses(
    walker: Walker, angles: ArrayLike, jumps: ArrayLike, foot_jump: ArrayLike = (0.0, 0.0)
) -> Reactions:
    """Impulses of collisions.

    Args:
        walker: The walker.
        angles: Of stance leg, thigh and shank, with the roles that they have afterwards, (n, 3).
        jumps: Change of their rates, (n, 3).
        foot_jump: Change of the velocity of the point of the stance foot that touches the ground,
            downhill and upwards, (2,) or (n, 2).
    """
    frame = frame_of(walker)
    angles, jumps = np.array(angles, dtype=float), np.array(jumps, dtype=float) * frame.time
    foot = np.broadcast_to(foot_jump, (len(jumps), 2)) * frame.time / frame.length
    columns = np.empty((len(jumps), 7))
    columns[:, :3] = jumps
    _impulses(chain(walker), angles, jumps, -foot[:, 0], foot[:, 1].copy(), columns[:, 3:])
    return _in_own_units(walker, columns, frame.time)
