"""The derivative of a stride, against variational equations integrated in extended precision.

Nothing of the engine's equations is used. The motion follows from a Lagrangian of point positions,
which heyoka differentiates and integrates by Taylor series. Collisions are those of rigid bodies.
Saltation matrices account for the times of events.
"""

import numpy as np
import pytest

from gym_passive_walker import WALKERS, stride, stride_jacobian
from tests.equations import bodies
from tests.equations.examples import LONG_GAITS

pytestmark = pytest.mark.slow

STENCIL = {1: 4 / 5, 2: -1 / 5, 3: 4 / 105, 4: -1 / 280}
"""Central differences of order eight."""

REAL = np.longdouble if np.finfo(np.longdouble).nmant >= 63 else np.float64


def lagrangian(hy, walker, slope, angles, rates):
    """Kinetic less potential energy of a walker that rolls on its stance foot."""
    stance, thigh, shank = angles
    reach = walker.shank_length - walker.foot_radius
    kink = np.arcsin(walker.thigh_length * np.sin(walker.foot_angle) / reach)

    def along(length, offset, angle):
        """Down a segment and back across it: forward and up."""
        return np.array(
            [
                length * hy.sin(angle) - offset * hy.cos(angle),
                -length * hy.cos(angle) - offset * hy.sin(angle),
            ]
        )

    def leg(hip, thigh, shank):
        thigh, shank = thigh - walker.foot_angle, shank + kink
        knee = hip + along(walker.thigh_length, 0.0, thigh)
        return (
            hip + along(walker.thigh_com, walker.thigh_offset, thigh),
            knee + along(walker.shank_com, walker.shank_offset, shank),
            knee + along(reach, 0.0, shank),
        )

    from_hip = leg(np.zeros(2), stance, stance)[2]
    hip = np.array([-walker.foot_radius * stance, walker.foot_radius]) - from_hip
    thigh_spin = walker.thigh_mass * walker.thigh_gyration**2
    shank_spin = walker.shank_mass * walker.shank_gyration**2
    stance_leg, swing_leg = leg(hip, stance, stance), leg(hip, thigh, shank)
    parts = [
        (walker.thigh_mass, stance_leg[0], thigh_spin, rates[0]),
        (walker.shank_mass, stance_leg[1], shank_spin, rates[0]),
        (walker.thigh_mass, swing_leg[0], thigh_spin, rates[1]),
        (walker.shank_mass, swing_leg[1], shank_spin, rates[2]),
        (walker.hip_mass, hip, 0.0, 0.0),
    ]
    moving = dict(zip(map(str, angles), zip(angles, rates, strict=True), strict=True))
    total = 0.0
    for mass, (forward, up), spin, rate in parts:
        velocity = [
            sum(hy.diff(x, angle) * rate_ for angle, rate_ in moving.values())
            for x in (forward, up)
        ]
        height = np.cos(slope) * up - np.sin(slope) * forward
        total += 0.5 * mass * (velocity[0] ** 2 + velocity[1] ** 2) + 0.5 * spin * rate**2
        total -= mass * walker.gravity * height
    return total


class Flow:
    """The motion of a phase with its derivative by the phase's first state."""

    def __init__(self, hy, walker, slope, *, locked):
        if locked:
            stance, swing, w_stance, w_swing = hy.make_vars("stance", "swing", "ws", "wl")
            angles, rates = (stance, swing, swing), (w_stance, w_swing, w_swing)
            q, v = [stance, swing], [w_stance, w_swing]
        else:
            *q, a, b, c = hy.make_vars("stance", "thigh", "shank", "ws", "wt", "wk")
            angles, rates, v = tuple(q), (a, b, c), [a, b, c]
        energy = lagrangian(hy, walker, slope, angles, rates)
        system = hy.lagrangian(energy, q, v)
        self.size = 2 * len(q)
        variational = hy.var_ode_sys(system, hy.var_args.vars, order=1)
        self.solver = hy.taylor_adaptive(
            variational, np.zeros(self.size, dtype=REAL), fp_type=REAL, compact_mode=True
        )
        self.derivative = hy.cfunc([right for _, right in system], [*q, *v], fp_type=REAL)

    def to_event(self, start, normal, guess):
        """State, its derivative by the start, and velocity where normal . state vanishes."""
        solver, n = self.solver, self.size
        solver.time = REAL(0)
        solver.state[:n] = start
        solver.state[n:] = np.eye(n, dtype=REAL).ravel()
        time = REAL(guess)
        for _ in range(4):
            solver.propagate_until(time)
            velocity = self.derivative(solver.state[:n])
            time = time - normal @ solver.state[:n] / (normal @ velocity)
        rows = [solver.state[solver.get_vslice(order=1, component=i)] for i in range(n)]
        return solver.state[:n].copy(), np.array(rows), velocity


def derivative(function, at):
    """Matrix of derivatives of a smooth function, by differences."""
    step, unit = 5e-3, np.eye(len(at))

    def change(by):
        return function(at + by) - function(at - by)

    columns = [sum(w * change(k * step * e) for k, w in STENCIL.items()) for e in unit]
    return np.array(columns, dtype=REAL).T / step


def reference(hy, walker, slope, state):
    """The stride map's derivative in the section's coordinates."""
    whole = stride(walker, slope, state, tolerance=1e-13)
    coordinates = 4 if walker.knees else 3
    onto = np.zeros((6 if walker.knees else 4, coordinates), dtype=REAL)
    if walker.knees:
        onto[:3, 0], onto[3:, 1:] = (1.0, -1.0, -1.0), np.eye(3)
        start, time = np.asarray(state, dtype=REAL), float(whole.kneestrike_time)
        normal = np.array([0.0, 1.0, -1.0, 0.0, 0.0, 0.0], dtype=REAL)
        end, total, before = Flow(hy, walker, slope, locked=False).to_event(start, normal, time)
        total = total @ onto

        def lock(x):
            rates = bodies.kneestrike(walker, x[0], x[1], x[3:]).rates
            return np.array([x[0], x[1], *rates[:2]])

        straight = Flow(hy, walker, slope, locked=True)
        struck, jump = lock(end.astype(float)), derivative(lock, end.astype(float))
        after = straight.derivative(struck.astype(REAL))
        saltation = jump + np.outer(after - jump @ before, normal) / (normal @ before)
        total, start = saltation @ total, struck.astype(REAL)
    else:
        onto[:2, 0], onto[2:, 1:] = (1.0, -1.0), np.eye(2)
        straight, total, time = Flow(hy, walker, slope, locked=True), onto, 0.0
        start = np.asarray(state, dtype=REAL)[[0, 1, 3, 4]]
    normal = np.array([1.0, 1.0, 0.0, 0.0], dtype=REAL)
    end, flow, before = straight.to_event(start, normal, float(whole.duration) - time)

    def exchange(x):
        angle = 0.5 * (x[1] - x[0])
        rates = bodies.heelstrike(walker, -angle, [x[2], x[3], x[3]]).rates
        return np.array([angle, *rates[: coordinates - 1]])

    section = exchange(end.astype(float))
    np.testing.assert_allclose(section, whole.state[[0, 3, 4, 5][:coordinates]], rtol=1e-11)
    jump = derivative(exchange, end.astype(float))
    # The map ends at the collision itself, whenever it comes: nothing flows on after it.
    landing = jump - np.outer(jump @ before, normal) / (normal @ before)
    return landing @ flow @ total


@pytest.mark.parametrize("name", ["lab", "E", "A"])
def test_the_derivative_is_that_of_the_variational_equations(name):
    hy = pytest.importorskip("heyoka")
    gait = LONG_GAITS[name]
    state = gait.state * np.array([1.01, 1.01, 1.01, 1.02, 0.99, 0.99])
    expected = reference(hy, WALKERS[name], gait.slope, state)
    found = stride_jacobian(name, gait.slope, state)
    np.testing.assert_allclose(
        found, expected.astype(float), rtol=0.0, atol=1e-10 * float(np.abs(expected).max())
    )
