"""What a design may be judged by: quantities of a gait and of its walker, with their gradients."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from gym_passive_walker.gaits.reality import reality_check
from gym_passive_walker.gaits.section import from_logarithms
from gym_passive_walker.gaits.sensitivity import SLOPE, Sensitivity, change_along
from gym_passive_walker.gaits.stride_map import StrideMap
from gym_passive_walker.physics.hybrid import State
from gym_passive_walker.units import growth, units_of
from gym_passive_walker.walkers import Walker

SPECTRAL_RADIUS = "spectral_radius"

Graded = tuple[float, NDArray[np.float64]]
"""A value and its gradient (k,) by what a sensitivity is by."""


def size_of(name: str, walker: Walker, slope: float) -> float:
    """What counts as a large change of a parameter or the slope."""
    units = units_of(walker)
    sizes = {
        SLOPE: abs(slope),
        "gravity": walker.gravity,
        "foot_angle": 1.0,
        "hip_stiffness": units.torque,
        "knee_stiffness": units.torque,
        "hip_friction": units.torque * units.time,
    }
    return sizes.get(name, walker.total_mass if name.endswith("mass") else walker.leg_length)


def _in_units(gait: Sensitivity, quantity: Graded, *, length: int = 0, time: int = 0) -> Graded:
    """A dimensionless quantity in powers of the walker's own units of length and time."""
    walker, (value, gradient) = gait.place.walker, quantity
    units = units_of(walker)
    own = units.length**length * units.time**time
    grown = np.zeros(len(gait.by))
    for i, name in enumerate(gait.by):
        if name != SLOPE:
            share = growth(walker, name)
            grown[i] = length * share.length + time * share.time
    return own * value, own * (gradient + value * grown)


def _quotient(gait: Sensitivity, above: str, below: str) -> Graded:
    top, bottom = (float(getattr(gait.passage, name)[0]) for name in (above, below))
    d_top, d_bottom = (getattr(gait.change, name)[0] for name in (above, below))
    return top / bottom, (d_top - top / bottom * d_bottom) / bottom


def _slope(gait: Sensitivity) -> Graded:
    return gait.place.slope, np.array([float(name == SLOPE) for name in gait.by])


def _cost_of_transport(gait: Sensitivity) -> Graded:
    return _quotient(gait, "lost", "lengths")


def _froude_speed(gait: Sensitivity) -> Graded:
    return _quotient(gait, "lengths", "durations")


def _speed(gait: Sensitivity) -> Graded:
    return _in_units(gait, _froude_speed(gait), length=1, time=-1)


def _step_length(gait: Sensitivity) -> Graded:
    step = float(gait.passage.lengths[0]), gait.change.lengths[0]
    return _in_units(gait, step, length=1)


def _step_period(gait: Sensitivity) -> Graded:
    period = float(gait.passage.durations[0]), gait.change.durations[0]
    return _in_units(gait, period, time=1)


def _stance_angle(gait: Sensitivity) -> Graded:
    angle = float(np.exp(gait.place.u[0]))
    return angle, angle * gait.coordinates[0]


def _knee_margin(gait: Sensitivity) -> Graded:
    share, gradient = _quotient(gait, "knee_times", "durations")
    return 1.0 - share, -gradient


def _leg_length(gait: Sensitivity) -> Graded:
    return _in_units(gait, (1.0, np.zeros(len(gait.by))), length=1)


def _total_mass(gait: Sensitivity) -> Graded:
    mass = gait.place.walker.total_mass
    both = {"thigh_mass": 2.0, "shank_mass": 2.0, "hip_mass": 1.0}
    return mass, np.array([both.get(name, 0.0) for name in gait.by])


def _clearance(gait: Sensitivity) -> Graded:
    stride_map, slope, u = gait.place
    walker, units = stride_map.walker, stride_map.units
    state = stride_map.states_at(from_logarithms(u[None]))[0]
    lowest = reality_check(stride_map, slope, state).clearance
    time = lowest.time / units.time
    knee = float(gait.passage.knee_times[0])
    # At its lowest the height does not change with time, so the gradient is that of the height at
    # this time; but the knee's stop may be what turns it up, and that moves.
    corner = abs(time - knee) < 1e-9

    def look(walkers: StrideMap, beside: NDArray, slopes: NDArray) -> NDArray:
        points = from_logarithms(beside)
        times = walkers.apply(points, slopes).knee_times if corner else np.full(len(points), time)
        states = walkers.sample(points, slopes, times[:, None]).states[:, 0]
        body = walkers.system.Body(*walkers.walkers.constants[:, 0].T)
        return walkers.system.foot_clearance(body, State(*states.T))

    sizes = [size_of(name, walker, slope) for name in gait.by]
    height = lowest.value / units.length, change_along(gait, sizes, look)
    return _in_units(gait, height, length=1)


QUANTITIES: dict[str, Callable[[Sensitivity], Graded]] = {
    "slope": _slope,
    "cost_of_transport": _cost_of_transport,
    "speed": _speed,
    "froude_speed": _froude_speed,
    "step_length": _step_length,
    "step_period": _step_period,
    "stance_angle": _stance_angle,
    "clearance": _clearance,
    "knee_margin": _knee_margin,
    "leg_length": _leg_length,
    "total_mass": _total_mass,
}
"""By name, in the walker's own units: those of `Gait` and `Walker`, and besides

- clearance: least height of the passing swing foot over the ground, as `RealityCheck.clearance`;
- knee_margin: time from kneestrike to heelstrike over the stride's, of a walker with knees.
"""
