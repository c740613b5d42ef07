"""What a posture tells: how feet stand and land, how heavy joints turn, what a heelstrike does."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from gym_passive_walker.gaits.section import Section
from gym_passive_walker.physics import legs
from gym_passive_walker.physics.hybrid import SMOOTH, Outcome, State
from gym_passive_walker.physics.systems import body_of, system_of
from gym_passive_walker.units import units_of
from gym_passive_walker.walkers import Walker

_INFINITESIMAL = 1e-100  # imaginary part that carries a derivative: its square is nothing


def foot_clearance(walker: Walker, states: NDArray) -> tuple[NDArray, NDArray]:
    """Height of the swing foot over the ground, and the height's rate, at states (n, 6).

    The foot is a whole circle here.
    """
    # Angles that move by infinitesimal rates move the height by as much of its own rate.
    angles, rates = states[:, :3] + 1j * _INFINITESIMAL * states[:, 3:], states[:, 3:]
    moving = State(*angles.T, *rates.T)
    clearance = system_of(walker).foot_clearance(body_of(walker), moving) * walker.leg_length
    return np.real(clearance), np.imag(clearance) / _INFINITESIMAL


def landing_velocity(walker: Walker, states: NDArray) -> NDArray[np.float64]:
    """Velocity (n, 2) of the foot that lands, uphill and away from the ground (Eq. 4.10).

    Args:
        walker: The walker.
        states: Just before heelstrike, (n, 6), in the walker's own units.
    """
    velocity = legs.striking_velocity(body_of(walker), State(*states.T))
    return np.stack(velocity, axis=-1) * walker.leg_length


def mass_matrix(walker: Walker, stance_angle: float) -> NDArray[np.float64]:
    """Mass matrix just after heelstrike: (3, 3) with knees, else (2, 2), in the walker's units.

    Raises:
        ValueError: for legs without mass.
    """
    system = system_of(walker)
    links = system.phases[0].links
    if system.mass_matrix is None:
        raise ValueError("legs without mass have no mass matrix")
    state = State(stance_angle, -stance_angle, -stance_angle, 0.0, 0.0, 0.0)
    matrix = np.zeros((links, links))
    matrix[np.triu_indices(links)] = system.mass_matrix(body_of(walker), state)
    matrix += np.triu(matrix, 1).T
    return matrix * walker.total_mass * units_of(walker).length ** 2


def heelstrike(
    section: Section,
    angles: NDArray,
    stance_rates: NDArray,
    swing_rates: NDArray,
    push_off: float = 0.0,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """What a heelstrike makes of straight legs with given rates just before it; dimensionless.

    Args:
        section: Of one walker.
        angles: Stance angles just after it, (n,).
        stance_rates: Of the old stance leg, (n,).
        swing_rates: Of the old swing leg, (n,).
        push_off: Impulse just before it.

    Returns:
        Points after it, (n, m); the energy lost and the push-off's work, (n,) each.
    """
    reset = system_of(section.walker).phases[-1].resets[Outcome.HEELSTRIKE]
    before = legs.straight(-angles, angles, stance_rates, swing_rates)
    struck = reset.strike(body_of(section.walker), before, push_off, SMOOTH)
    work = np.broadcast_to(struck.work, struck.lost.shape)
    return section.point(np.stack(struck.after, axis=-1)), struck.lost, work


def step_lengths(walker: Walker, angles: NDArray) -> NDArray[np.float64]:
    """Lengths over l of steps from and to a stance angle, (n,)."""
    return legs.step_length(body_of(walker), angles, angles)


def half_swing(walker: Walker) -> float:
    """Half a period over sqrt(l/g) of the straight leg as it hangs from a resting hip."""
    if walker.massless_legs:
        return math.pi
    body = body_of(walker)
    weight = math.hypot(body.swing_along, body.swing_across)
    return math.pi * (math.sqrt(body.swing_inertia / weight) if weight > 0.0 else 1.0)
