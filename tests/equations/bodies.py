"""A walker as rigid bodies with three degrees of freedom each, joined by constraints.

Nothing is reduced to a stance and a swing angle beforehand: energies are sums over bodies. A
collision is the smallest change of all velocities, in the metric of the masses, that satisfies
every joint and the new contact.

Points and velocities are complex numbers, forward plus i times up from the ground; a leg at angle 0
hangs along -i.
"""

from __future__ import annotations

import cmath
import math
from typing import NamedTuple

import numpy as np
from scipy.linalg import null_space

from gym_passive_walker import Walker


class Leg(NamedTuple):
    """Points of a leg, as seen from its hip."""

    thigh: complex
    knee: complex
    shank: complex
    foot: complex


def leg(walker: Walker, thigh_angle: float, shank_angle: float) -> Leg:
    """Centres of mass, knee and foot centre of a leg, from its hip (Fig. 4.1)."""
    reach = walker.shank_length - walker.foot_radius
    kink = math.asin(walker.thigh_length * math.sin(walker.foot_angle) / reach)
    along_thigh = cmath.exp(1j * (thigh_angle - walker.foot_angle))
    along_shank = cmath.exp(1j * (shank_angle + kink))
    knee = -1j * walker.thigh_length * along_thigh
    return Leg(
        thigh=(-1j * walker.thigh_com - walker.thigh_offset) * along_thigh,
        knee=knee,
        shank=knee + (-1j * walker.shank_com - walker.shank_offset) * along_shank,
        foot=knee - 1j * reach * along_shank,
    )


STANCE_THIGH, STANCE_SHANK, THIGH, SHANK, HIP = range(5)


class Bodies:
    """All bodies of a walker: stance thigh and shank, swing thigh and shank, and the hip's mass.

    The hip is the origin of all positions. The stance leg is straight.
    """

    def __init__(self, walker: Walker, angles) -> None:
        """Place the bodies at the angles of the stance leg, the swing thigh and the swing shank."""
        stance, thigh, shank = angles
        self.walker = walker
        self.legs = leg(walker, stance, stance), leg(walker, thigh, shank)
        (a, b) = self.legs
        self.centres = [a.thigh, a.shank, b.thigh, b.shank, 0j]
        thigh_spin = walker.thigh_mass * walker.thigh_gyration**2
        shank_spin = walker.shank_mass * walker.shank_gyration**2
        self.masses = [walker.thigh_mass, walker.shank_mass] * 2 + [walker.hip_mass]
        self.spins = [thigh_spin, shank_spin] * 2 + [0.0]

    @property
    def mass_matrix(self) -> np.ndarray:
        """Diagonal matrix of forward, upward and rotational inertia of each body in turn."""
        return np.diag([v for m, s in zip(self.masses, self.spins, strict=True) for v in (m, m, s)])

    def point(self, body: int, where: complex) -> np.ndarray:
        """Two rows that give the velocity of a body's point from the velocities of the bodies."""
        arm = where - self.centres[body]
        rows = np.zeros((2, 15))
        rows[:, 3 * body : 3 * body + 3] = [[1.0, 0.0, -arm.imag], [0.0, 1.0, arm.real]]
        return rows

    def spin(self, body: int) -> np.ndarray:
        """One row that gives a body's angular velocity."""
        row = np.zeros((1, 15))
        row[0, 3 * body + 2] = 1.0
        return row

    def joints(self) -> np.ndarray:
        """Rows that vanish while both hips and both knees hold together."""
        a, b = self.legs
        hip = self.point(HIP, 0j)
        return np.vstack(
            [
                self.point(STANCE_THIGH, 0j) - hip,
                self.point(THIGH, 0j) - hip,
                self.point(STANCE_THIGH, a.knee) - self.point(STANCE_SHANK, a.knee),
                self.point(THIGH, b.knee) - self.point(SHANK, b.knee),
                self.spin(HIP),
            ]
        )

    def stance_knee_locked(self) -> np.ndarray:
        """The row that vanishes while the stance knee does not bend."""
        return self.spin(STANCE_THIGH) - self.spin(STANCE_SHANK)

    def swing_knee_locked(self) -> np.ndarray:
        """The row that vanishes while the swing knee does not bend."""
        return self.spin(THIGH) - self.spin(SHANK)

    def stance_contact(self) -> np.ndarray:
        """Rows for the velocity of the stance foot's point on the ground."""
        return self.point(STANCE_SHANK, self.legs[0].foot - 1j * self.walker.foot_radius)

    def swing_contact(self) -> np.ndarray:
        """Rows for the velocity of the swing foot's lowest point."""
        return self.point(SHANK, self.legs[1].foot - 1j * self.walker.foot_radius)

    def velocities(self, rates) -> np.ndarray:
        """Velocities of all bodies (15,) while the stance foot rolls on the ground."""
        stance, thigh, shank = rates
        a, b = self.legs
        contact = a.foot - 1j * self.walker.foot_radius
        hip = -1j * stance * contact
        knee = hip + 1j * thigh * b.knee
        velocities = [
            (hip + 1j * stance * a.thigh, stance),
            (hip + 1j * stance * a.shank, stance),
            (hip + 1j * thigh * b.thigh, thigh),
            (knee + 1j * shank * (b.shank - b.knee), shank),
            (hip, 0.0),
        ]
        return np.array([part for v, w in velocities for part in (v.real, v.imag, w)])

    def kinetic_energy(self, rates) -> float:
        """Kinetic energy of all bodies while the stance foot rolls on the ground."""
        v = self.velocities(rates)
        return 0.5 * float(v @ self.mass_matrix @ v)

    def angular_momentum(self, velocities: np.ndarray, about: complex, members) -> float:
        """Angular momentum of some of the bodies about a point."""
        total = 0.0
        for body in members:
            x, y, spin = velocities[3 * body : 3 * body + 3]
            arm = self.centres[body] - about
            total += self.masses[body] * (arm.real * y - arm.imag * x) + self.spins[body] * spin
        return total

    def collide(self, before: np.ndarray, constraints: np.ndarray) -> tuple[np.ndarray, float]:
        """Velocities after impulses of these constraints alone, and the energy that they took."""
        free = null_space(constraints)
        mass = self.mass_matrix
        after = free @ np.linalg.solve(free.T @ mass @ free, free.T @ mass @ before)
        change = after - before
        return after, 0.5 * float(change @ mass @ change)


def kinetic_energy(walker: Walker, state) -> float:
    """Kinetic energy of a walker at a state [angles, rates], in its own units."""
    return Bodies(walker, state[:3]).kinetic_energy(state[3:])


def potential_energy(walker: Walker, slope: float, angles) -> float:
    """Potential energy over a contact that starts under the foot centre at stance angle 0."""
    bodies = Bodies(walker, angles)
    hip = -walker.foot_radius * angles[0] + 1j * walker.foot_radius - bodies.legs[0].foot
    uphill = cmath.exp(-1j * slope)  # the ground's normal and direction, seen from the vertical
    moment = sum(m * (hip + z) for m, z in zip(bodies.masses, bodies.centres, strict=True))
    return walker.gravity * (moment * uphill).imag


class Struck(NamedTuple):
    """A collision: angular velocities of all links after it, and the lost energy."""

    rates: np.ndarray
    loss: float
    bodies: Bodies
    before: np.ndarray
    after: np.ndarray


def kneestrike(walker: Walker, stance: float, swing: float, rates) -> Struck:
    """The swing knee locks while the stance foot stays on the ground."""
    bodies = Bodies(walker, (stance, swing, swing))
    before = bodies.velocities(rates)
    constraints = np.vstack(
        [
            bodies.joints(),
            bodies.stance_knee_locked(),
            bodies.swing_knee_locked(),
            bodies.stance_contact(),
        ]
    )
    after, loss = bodies.collide(before, constraints)
    spins = after[2::3]
    return Struck(spins[[STANCE_THIGH, THIGH, SHANK]], loss, bodies, before, after)


def heelstrike(walker: Walker, stance: float, rates) -> Struck:
    """The swing foot sticks to the ground; the old foot and its knee are free afterwards.

    The angular velocities returned are those after the exchange of roles; bodies keep their old
    names.
    """
    bodies = Bodies(walker, (stance, -stance, -stance))
    before = bodies.velocities(rates)
    constraints = [bodies.joints(), bodies.swing_knee_locked(), bodies.swing_contact()]
    if not walker.knees:
        constraints.append(bodies.stance_knee_locked())
    after, loss = bodies.collide(before, np.vstack(constraints))
    spins = after[2::3]
    return Struck(spins[[THIGH, STANCE_THIGH, STANCE_SHANK]], loss, bodies, before, after)
