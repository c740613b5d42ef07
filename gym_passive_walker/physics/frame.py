"""How a walker's own units and the dimensionless ones convert: see `units`."""

from __future__ import annotations

from gym_passive_walker.units import Units as Frame
from gym_passive_walker.units import units_of as frame_of

__all__ = ["Frame", "frame_of"]
