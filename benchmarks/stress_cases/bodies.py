"""Walkers as four rigid bodies and a hip, for momentum balances independent of the engine.

Points and velocities are complex numbers, forward plus i times up, with the stance foot's contact
as origin. A leg at angle 0 hangs along -i. Arrays run over walkers.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gym_passive_walker import Walker


class Body(NamedTuple):
    """A rigid body: mass, moment of inertia, centre of mass, its velocity, angular velocity."""

    mass: NDArray
    inertia: NDArray
    place: NDArray
    velocity: NDArray
    spin: NDArray

    def momentum(self, about: NDArray) -> NDArray:
        """Angular momentum about a point."""
        arm = self.place - about
        return self.mass * (arm.conjugate() * self.velocity).imag + self.inertia * self.spin


class Leg(NamedTuple):
    """A leg's two bodies, its knee and the lowest point of its foot."""

    thigh: Body
    shank: Body
    knee: NDArray
    contact: NDArray

    def momentum(self, about: NDArray) -> NDArray:
        """Angular momentum of the leg about a point."""
        return self.thigh.momentum(about) + self.shank.momentum(about)


class Bodies:
    """Walkers at dimensionless states (n, 6), with stance feet that roll on the ground."""

    def __init__(self, walkers: list[Walker], states: NDArray) -> None:
        """Compute positions and velocities of the bodies; the stance leg is straight."""
        self.size = np.array([w.leg_length for w in walkers])
        self.mass = np.array([w.total_mass for w in walkers])
        self.p = {
            name: np.array([getattr(w, name) for w in walkers])
            for name in vars(walkers[0])
            if name != "knees"
        }
        time = np.array([w.time_unit for w in walkers])
        angles, rates = states[:, :3].T, states[:, 3:].T / time
        self.hip, self.hip_velocity = 0j * self.size, 0j * self.size
        contact = self.leg(angles[0], angles[0], rates[0], rates[0]).contact
        self.hip, self.hip_velocity = -contact, -1j * rates[0] * contact
        self.stance = self.leg(angles[0], angles[0], rates[0], rates[0])
        self.swing = self.leg(angles[1], angles[2], rates[1], rates[2])
        self.fastest = np.abs(rates).max(axis=0)

    def leg(self, thigh: NDArray, shank: NDArray, thigh_rate: NDArray, shank_rate: NDArray) -> Leg:
        """A leg below the hip (Fig. 4.1), from angles in rad and angular velocities, (n,) each."""
        p = self.p
        reach = p["shank_length"] - p["foot_radius"]
        kink = np.arcsin(p["thigh_length"] * np.sin(p["foot_angle"]) / reach)
        down_thigh = np.exp(1j * (thigh - p["foot_angle"]))
        down_shank = np.exp(1j * (shank + kink))
        to_thigh = (-1j * p["thigh_com"] - p["thigh_offset"]) * down_thigh
        to_knee = -1j * p["thigh_length"] * down_thigh
        to_shank = (-1j * p["shank_com"] - p["shank_offset"]) * down_shank
        knee, knee_velocity = self.hip + to_knee, self.hip_velocity + 1j * thigh_rate * to_knee
        upper = Body(
            p["thigh_mass"],
            p["thigh_mass"] * p["thigh_gyration"] ** 2,
            self.hip + to_thigh,
            self.hip_velocity + 1j * thigh_rate * to_thigh,
            thigh_rate,
        )
        lower = Body(
            p["shank_mass"],
            p["shank_mass"] * p["shank_gyration"] ** 2,
            knee + to_shank,
            knee_velocity + 1j * shank_rate * to_shank,
            shank_rate,
        )
        return Leg(upper, lower, knee, knee - 1j * (reach * down_shank + p["foot_radius"]))

    def momentum(self, about: NDArray) -> NDArray:
        """Angular momentum of the whole walker about a point."""
        hip = self.p["hip_mass"] * ((self.hip - about).conjugate() * self.hip_velocity).imag
        return self.stance.momentum(about) + self.swing.momentum(about) + hip

    def scale(self) -> NDArray:
        """Scale of the whole walker's angular momentum, (n,)."""
        return self.mass * self.size**2 * self.fastest
