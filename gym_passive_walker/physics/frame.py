"""How a walker's own units and the dimensionless ones convert."""

from __future__ import annotations

from typing import NamedTuple

from gym_passive_walker.walkers import Walker


class Frame(NamedTuple):
    """How a walker's own units and the dimensionless ones convert.

    Attributes:
        rate: 1 / time unit.
        time: sqrt(l/g).
        length: l.
        energy: m g l.
        torque: m g l; g l for the simplest walker, whose torque is per unit of foot mass.
    """

    rate: float
    time: float
    length: float
    energy: float
    torque: float


def frame_of(walker: Walker) -> Frame:
    """Unit conversions of a walker."""
    length, time = walker.leg_length, walker.time_unit
    energy = walker.total_mass * walker.gravity * length
    torque = walker.gravity * length if walker.massless_legs else energy
    return Frame(1.0 / time, time, length, energy, torque)
