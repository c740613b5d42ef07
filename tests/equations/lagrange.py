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
def equations(*, locked: bool):
    """Function of coordinates, rates, slope, torques and parameters.

    Returns the lower triangle of the mass matrix, and the forces, in directions that ground and
    knee allow.
    """
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
    mass = sp.Matrix([[momentum.diff(rate) for rate in v] for momentum in momenta])
    bias = sp.Matrix(
        [
            sum(momentum.diff(coordinate) * rate for coordinate, rate in zip(q, v, strict=True))
            - kinetic.diff(own)
            + potential.diff(own)
            for momentum, own in zip(momenta, q, strict=True)
        ]
    )
    hip_torque, ankle_torque = sp.symbols("hip_torque ankle_torque")
    push = sp.Matrix([0, 0, -hip_torque - ankle_torque, hip_torque, 0])
    free = sp.zeros(5, 2 if locked else 3)  # velocities that ground and knee allow
    free[0, 0], free[2, 0], free[3, 1], free[4, -1] = -p["foot_radius"], 1, 1, 1
    reduced, force = free.T * mass * free, free.T * (push - bias)
    given = [*q, *v, slope, kink, hip_torque, ankle_torque, *p.values()]
    return sp.lambdify(given, [*reduced.vech(), *force], modules="math", cse=True)


@cache
def solution(size: int):
    """Function of the lower triangle of a mass matrix and of the forces: the accelerations."""
    mass, force = sp.symbols(f"m:{size * (size + 1) // 2}"), sp.symbols(f"f:{size}")
    columns = iter(mass)
    lower = sp.zeros(size)
    for j in range(size):
        for i in range(j, size):
            lower[i, j] = lower[j, i] = next(columns)
    return sp.lambdify(
        [*mass, *force], list(lower.LUsolve(sp.Matrix(force))), modules="math", cse=True
    )


def motion(walker: Walker, slope: float, torque: float, ankle: float = 0.0, *, locked: bool):
    """Function of a state [angles, rates] that gives its three angular accelerations.

    Everything is in the walker's own units; a positive ankle torque tips the stance leg forward.
    """
    function, solve = equations(locked=locked), solution(2 if locked else 3)
    radius = walker.foot_radius
    kink = np.arcsin(
        walker.thigh_length * np.sin(walker.foot_angle) / (walker.shank_length - radius)
    )
    given = [slope, float(kink), torque, ankle, *(getattr(walker, name) for name in PARAMETERS)]

    def accelerations(state) -> list[float]:
        stance, thigh, shank, w_stance, w_thigh, w_shank = map(float, state)
        found = solve(
            *function(
                0.0, radius, stance, thigh, shank,
                -radius * w_stance, 0.0, w_stance, w_thigh, w_shank, *given,
            )
        )  # fmt: skip
        return [*found, found[1]] if locked else found

    return accelerations
