"""States just before impacts, in walkers' own units."""

from gym_passive_walker.gaits.actuation import Actuation
from gym_passive_walker.gaits.stride_map import StrideMap


def just_before(walker, slope, state, strike, **motors):
    """The state (6,) just before an impact, at a time since the stride's start."""
    strides = StrideMap.of(walker, controller=Actuation(**motors))
    point, time = strides.points_at(state)[0], float(strike) / strides.units.time
    return strides.units.to_own(strides.before_strike(point, slope, time)[None])[0]
