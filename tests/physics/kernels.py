"""The engine's equations, one walker at a time, in the walker's own units.

The functions that kernels inline take dimensionless scalars; here they take what the oracles take.
"""

from __future__ import annotations

import numba
import numpy as np
from gym_passive_walker.physics.constants import Kind
from gym_passive_walker.physics.frame import frame_of

from gym_passive_walker import Walker
from gym_passive_walker.physics import compass, kneed, simplest
from gym_passive_walker.physics import constants as K


@numba.njit
def _free(c, s, sin_slope, cos_slope, torque):
    return kneed.accelerations(
        s[0], s[1], s[2], s[3], s[4], s[5],
        c[K.FOOT_RADIUS], c[K.LEG], c[K.STANCE_ALONG], c[K.STANCE_ACROSS], c[K.STANCE_INERTIA],
        c[K.THIGH_ALONG], c[K.THIGH_ACROSS], c[K.THIGH_INERTIA], c[K.SHANK_ALONG],
        c[K.SHANK_ACROSS], c[K.SHANK_MOBILITY], c[K.KNEE_COSINE], c[K.KNEE_SINE],
        sin_slope, cos_slope, torque,
    )  # fmt: skip


@numba.njit
def _locked(c, s, sin_slope, cos_slope, torque):
    a, b = compass.accelerations(
        s[0], s[1], s[3], s[4],
        c[K.FOOT_RADIUS], c[K.LEG], c[K.STANCE_ALONG], c[K.STANCE_ACROSS], c[K.STANCE_INERTIA],
        c[K.SWING_ALONG], c[K.SWING_ACROSS], c[K.SWING_INERTIA],
        sin_slope, cos_slope, torque,
    )  # fmt: skip
    return a, b, b


@numba.njit
def _simplest(c, s, sin_slope, cos_slope, torque):
    a, b = simplest.accelerations(s[0], s[1], s[3], s[4], sin_slope, cos_slope, torque)
    return a, b, b


@numba.njit
def _kneestrike(c, stance, swing, rates):
    return kneed.kneestrike(c, stance, swing, rates[0], rates[1], rates[2])


@numba.njit
def _heelstrike_free(c, stance, rates):
    return kneed.heelstrike(c, stance, rates[0], rates[1])


@numba.njit
def _heelstrike_locked(c, stance, rates):
    a, b, loss = compass.heelstrike(c, stance, rates[0], rates[1])
    return a, b, b, loss


@numba.njit
def _heelstrike_simplest(c, stance, rates):
    a, b, loss = simplest.heelstrike(stance, rates[0])
    return a, b, b, loss


@numba.njit
def _energy_free(c, s):
    return kneed.kinetic_energy(c, s[0], s[1], s[2], s[3], s[4], s[5])


@numba.njit
def _energy_locked(c, s):
    return compass.kinetic_energy(c, s[0], s[1], s[3], s[4])


@numba.njit
def _clearance_free(c, s):
    return kneed.foot_clearance(c, s[0], s[1], s[2])


@numba.njit
def _clearance_locked(c, s):
    return compass.foot_clearance(c, s[0], s[1])


def dimensionless(walker: Walker, state) -> np.ndarray:
    """A state with its rates in units of sqrt(g/l)."""
    return np.asarray(state, dtype=float) * ([1.0] * 3 + [walker.time_unit] * 3)


def accelerations(walker: Walker, slope: float, state, torque: float, *, locked: bool):
    """The engine's angular accelerations at a state [angles, rates]."""
    function = _locked if locked else _free
    if K.kind_of(walker) == Kind.SIMPLEST:
        function = _simplest
    s, frame = dimensionless(walker, state), frame_of(walker)
    a = function(K.constants(walker), s, np.sin(slope), np.cos(slope), torque / frame.torque)
    return np.array(a) / frame.time**2


def kinetic_energy(walker: Walker, state, *, locked: bool) -> float:
    """The engine's kinetic energy of a walker whose legs have mass."""
    function = _energy_locked if locked else _energy_free
    return function(K.constants(walker), dimensionless(walker, state)) * frame_of(walker).energy


def foot_clearance(walker: Walker, angles, *, locked: bool) -> float:
    """The engine's height of the swing foot over the ground."""
    function = _clearance_locked if locked else _clearance_free
    return function(K.constants(walker), np.asarray(angles, dtype=float)) * walker.leg_length


def kneestrike(walker: Walker, stance: float, swing: float, rates):
    """The engine's rates after kneestrike, and the energy lost."""
    frame = frame_of(walker)
    scaled = np.asarray(rates, dtype=float) * frame.time
    a, b, loss = _kneestrike(K.constants(walker), stance, swing, scaled)
    return np.array([a, b, b]) / frame.time, loss * frame.energy


def heelstrike(walker: Walker, stance: float, rates):
    """The engine's rates after heelstrike and the exchange of legs, and the energy lost."""
    function = {
        Kind.KNEED: _heelstrike_free,
        Kind.COMPASS: _heelstrike_locked,
        Kind.SIMPLEST: _heelstrike_simplest,
    }[K.kind_of(walker)]
    frame = frame_of(walker)
    scaled = np.asarray(rates, dtype=float) * frame.time
    *after, loss = function(K.constants(walker), stance, scaled)
    return np.array(after) / frame.time, loss * frame.energy
