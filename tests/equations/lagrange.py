"""Lagrange's equations of motion, by SymPy, for a floating walker with constraints.

The coordinates are the stance foot's centre (x forward, y up from the ground) and the angles of
stance leg, swing thigh and swing shank. Kinetic and potential energy are written from the positions
of the bodies. The ground holds the foot by y = R and x' = -R times the stance rate. A locked knee
makes both rates of the swing leg equal. These constraints are linear in the velocities with
constant coefficients, so the motion is projected on the directions that they permit.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import sympy as sp

from gym_passive_walker import Walker

PARAMETERS = (
    "thigh_length thigh_offset thigh_mass thigh_gyration thigh_com "
    "shank_length shank_offset shank_mass shank_gyration shank_com "
    "foot_radius foot_angle hip_mass gravity"
).split()


@cache
def equations():
    """Function of coordinates, rates, slope and parameters: mass matrix entries and bias forces."""
    p = dict(zip(PARAMETERS, sp.symbols(PARAMETERS), strict=True))
    q = sp.symbols("x y stance thigh shank")
    v = sp.symbols("vx vy w_stance w_thigh w_shank")
    slope, kink = sp.symbols("slope kink")
    x, y, stance, thigh, shank = q

    def down(angle):
        return sp.Matrix([sp.sin(angle), -sp.cos(angle)])

    def backward(angle):
        return sp.Matrix([-sp.cos(angle), -sp.sin(angle)])

    def knee_of(hip, thigh):
        return hip + p["thigh_length"] * down(thigh - p["foot_angle"])

    def thigh_centre(hip, thigh):
        at = thigh - p["foot_angle"]
        return hip + p["thigh_com"] * down(at) + p["thigh_offset"] * backward(at)

    def shank_centre(knee, shank):
        at = shank + kink
        return knee + p["shank_com"] * down(at) + p["shank_offset"] * backward(at)

    foot = sp.Matrix([x, y])
    stance_knee = foot - (p["shank_length"] - p["foot_radius"]) * down(stance + kink)
    hip = stance_knee - p["thigh_length"] * down(stance - p["foot_angle"])
    thigh_spin = p["thigh_mass"] * p["thigh_gyration"] ** 2
    shank_spin = p["shank_mass"] * p["shank_gyration"] ** 2
    bodies = [
        (p["thigh_mass"], thigh_centre(hip, stance), thigh_spin, v[2]),
        (p["shank_mass"], shank_centre(stance_knee, stance), shank_spin, v[2]),
        (p["hip_mass"], hip, 0, 0),
        (p["thigh_mass"], thigh_centre(hip, thigh), thigh_spin, v[3]),
        (p["shank_mass"], shank_centre(knee_of(hip, thigh), shank), shank_spin, v[4]),
    ]
    upward = sp.Matrix([-sp.sin(slope), sp.cos(slope)])
    rates = sp.Matrix(v)
    kinetic, potential = sp.Integer(0), sp.Integer(0)
    for mass, centre, spin, rate in bodies:
        velocity = centre.jacobian(q) * rates
        kinetic += (mass * velocity.dot(velocity) + spin * rate**2) / 2
        potential += mass * p["gravity"] * centre.dot(upward)

    momenta = [kinetic.diff(rate) for rate in v]
    mass = [[momentum.diff(rate) for rate in v] for momentum in momenta]
    bias = [
        sum(momentum.diff(coordinate) * rate for coordinate, rate in zip(q, v, strict=True))
        - kinetic.diff(own)
        + potential.diff(own)
        for momentum, own in zip(momenta, q, strict=True)
    ]
    entries = [mass[i][j] for i in range(5) for j in range(i, 5)]
    return sp.lambdify(
        [*q, *v, slope, kink, *p.values()], [*entries, *bias], modules="math", cse=True
    )


_UPPER = np.triu_indices(5)


def motion(walker: Walker, slope: float, torque: float, ankle: float = 0.0, *, locked: bool):
    """Function of a state [angles, rates] that gives its three angular accelerations.

    Everything is in the walker's own units; a positive ankle torque tips the stance leg forward.
    """
    function = equations()
    parameters = [getattr(walker, name) for name in PARAMETERS]
    radius = walker.foot_radius
    kink = np.arcsin(
        walker.thigh_length * np.sin(walker.foot_angle) / (walker.shank_length - radius)
    )
    free = np.zeros((5, 2 if locked else 3))  # velocities that ground and knee allow
    free[0, 0], free[2, 0], free[3, 1], free[4, -1] = -radius, 1.0, 1.0, 1.0
    push = np.array([0.0, 0.0, -torque - ankle, torque, 0.0])

    def accelerations(state) -> np.ndarray:
        stance, thigh, shank, w_stance, w_thigh, w_shank = map(float, state)
        values = function(
            0.0, radius, stance, thigh, shank, -radius * w_stance, 0.0, w_stance, w_thigh, w_shank,
            slope, kink, *parameters,
        )  # fmt: skip
        mass = np.empty((5, 5))
        mass[_UPPER] = values[:15]
        mass.T[_UPPER] = values[:15]
        force = push - np.array(values[15:])
        return (free @ np.linalg.solve(free.T @ mass @ free, free.T @ force))[2:]

    return accelerations
