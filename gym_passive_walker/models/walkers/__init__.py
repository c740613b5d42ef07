"""Walkers: McGeer's parameters, the walkers of Garcia (1999), and their tuning.

Lengths, masses and gravity are in any consistent set of units. A leg is a thigh and a shank with
a circular foot; both legs are alike. Fig. 4.1 of Garcia (1999) names the parameters; here they
are in words. Offsets across a leg (`thigh_offset`, `shank_offset`) are
positive backwards, uphill of the line that they are measured from.

References:
    M. Garcia, "Stability, scaling, and chaos in passive-dynamic gait models", PhD thesis, Cornell
    University (1999), chapter 4; all numbers of figures and tables are the chapter's.
    M. Garcia, A. Chatterjee, A. Ruina, "Efficiency, speed, and scaling of two-dimensional
    passive-dynamic walking", Dynamics and Stability of Systems 15 (2000) 75-99.
    T. McGeer, "Passive walking with knees", IEEE ICRA (1990) 1640-1645.
"""

from gym_passive_walker.models.units import varied
from gym_passive_walker.models.walkers.names import describe, name_of
from gym_passive_walker.models.walkers.parts import Part, assemble, combine, lab_walker_from_parts
from gym_passive_walker.models.walkers.presets import (
    ABOUT,
    WALKERS,
    WalkerLike,
    as_walker,
    is_walker,
)
from gym_passive_walker.models.walkers.tuning import TuningErrors, interpolate, tune, tuning_errors
from gym_passive_walker.models.walkers.walker import PARAMETERS, Walker, WalkerError

__all__ = [
    "ABOUT",
    "PARAMETERS",
    "WALKERS",
    "Part",
    "TuningErrors",
    "Walker",
    "WalkerError",
    "WalkerLike",
    "as_walker",
    "assemble",
    "combine",
    "describe",
    "interpolate",
    "is_walker",
    "lab_walker_from_parts",
    "name_of",
    "tune",
    "tuning_errors",
    "varied",
]
