"""What a posture tells: how a foot stands and lands, how heavy joints turn, what a heelstrike does.

Like `stride_map`, this is where analyses meet the engine: its constants and records stay in here.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from gym_passive_walker.gaits.section import Section
from gym_passive_walker.gaits.stride_map import INFINITESIMAL
from gym_passive_walker.physics import compass, kneed
from gym_passive_walker.physics import constants as column
from gym_passive_walker.physics.constants import constants, kind_of
from gym_passive_walker.physics.engine import strike_heels
from gym_passive_walker.physics.lanes import kernel
from gym_passive_walker.physics.record import HEEL_LOSS, new_records
from gym_passive_walker.units import units_of
from gym_passive_walker.walkers import Walker


@kernel
def _striking_velocities(c, states, velocity):
    for i in range(len(states)):
        velocity[i, 0], velocity[i, 1] = compass.striking_velocity(
            c, states[i, 0], states[i, 3], states[i, 4]
        )


@kernel
def _mass_matrix(c, stance, knees, matrix):
    """Upper triangle of the mass matrix just after heelstrike."""
    if knees:
        m11, m12, m13, m22, m23, m33 = kneed.inertia(c, stance, -stance, -stance)
        matrix[0, 2], matrix[1, 2], matrix[2, 2] = m13, m23, m33
    else:
        m11, m12, m22 = compass.inertia(c, stance, -stance)
    matrix[0, 0], matrix[0, 1], matrix[1, 1] = m11, m12, m22


@kernel
def _clearances(c, knees, angles, clearance):
    for i in range(len(angles)):
        if knees:
            clearance[i] = kneed.foot_clearance(c, angles[i, 0], angles[i, 1], angles[i, 2])
        else:
            clearance[i] = compass.foot_clearance(c, angles[i, 0], angles[i, 1])


def foot_clearance(walker: Walker, states: NDArray) -> tuple[NDArray, NDArray]:
    """Height of the swing foot over the ground, and the height's rate, at states (n, 6).

    The foot is a whole circle here.
    """
    # Angles that move by infinitesimal rates move the height by as much of its own rate.
    angles = states[:, :3] + 1j * INFINITESIMAL * states[:, 3:]
    clearance: NDArray[np.complex128] = np.empty(len(states), np.complex128)
    _clearances(constants(walker).astype(complex), walker.knees, angles, clearance)
    clearance *= walker.leg_length
    return np.real(clearance), np.imag(clearance) / INFINITESIMAL


def landing_velocity(walker: Walker, states: NDArray) -> NDArray[np.float64]:
    """Velocity (n, 2) of the foot that lands, uphill and away from the ground (Eq. 4.10).

    Args:
        walker: The walker.
        states: Just before heelstrike, (n, 6), in the walker's own units.
    """
    velocity = np.empty((len(states), 2))
    _striking_velocities(constants(walker), states, velocity)
    return velocity * walker.leg_length


def mass_matrix(walker: Walker, stance_angle: float) -> NDArray[np.float64]:
    """Mass matrix just after heelstrike: (3, 3) with knees, else (2, 2), in the walker's units."""
    count = 3 if walker.knees else 2
    matrix = np.zeros((count, count))
    _mass_matrix(constants(walker), stance_angle, walker.knees, matrix)
    units = units_of(walker)
    matrix = np.triu(matrix) + np.triu(matrix, 1).T
    return matrix * walker.total_mass * units.length**2


def heelstrike(
    section: Section, angles: NDArray, stance_rates: NDArray, swing_rates: NDArray
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """What a heelstrike makes of straight legs with given rates just before it; dimensionless.

    Args:
        section: Of one walker.
        angles: Stance angles just after it, (n,).
        stance_rates: Of the old stance leg, (n,).
        swing_rates: Of the old swing leg, (n,).

    Returns:
        Points after it, (n, m), and the energy lost, (n,).
    """
    walker = section.walker
    states = np.column_stack([-angles, angles, angles, stance_rates, swing_rates, swing_rates])
    records = new_records(states, np.zeros(len(states)))
    strike_heels(records, constants(walker)[None], int(kind_of(walker)))
    return section.point(records[:, :6]), records[:, HEEL_LOSS]


def step_lengths(walker: Walker, angles: NDArray) -> NDArray[np.float64]:
    """Lengths over l of steps from and to a stance angle, (n,)."""
    leg, radius = constants(walker)[[column.LEG, column.FOOT_RADIUS]]
    return 2.0 * (leg * np.sin(angles) + radius * angles)


def half_swing(walker: Walker) -> float:
    """Half a period over sqrt(l/g) of the straight leg as it hangs from a resting hip."""
    row = constants(walker)
    weight = math.hypot(row[column.SWING_ALONG], row[column.SWING_ACROSS])
    return math.pi * (math.sqrt(row[column.SWING_INERTIA] / weight) if weight > 0.0 else 1.0)
