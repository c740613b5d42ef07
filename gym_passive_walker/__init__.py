"""Exact passive walkers for reinforcement learning and gait analysis."""

from gym_passive_walker.physics.events import Outcome
from gym_passive_walker.physics.stride import Stride, stride
from gym_passive_walker.walkers import (
    WALKERS,
    Part,
    TuningErrors,
    Walker,
    WalkerError,
    assemble,
    blend,
    lab_walker_from_parts,
    tune,
    tuning_errors,
)

__all__ = [
    "WALKERS",
    "Outcome",
    "Part",
    "Stride",
    "TuningErrors",
    "Walker",
    "WalkerError",
    "assemble",
    "blend",
    "lab_walker_from_parts",
    "stride",
    "tune",
    "tuning_errors",
]
