"""Exact passive walkers for reinforcement learning and gait analysis."""

from gym_passive_walker.envs.registration import register as _register
from gym_passive_walker.gaits.family import GaitFamily, gait_family, parameter_family
from gym_passive_walker.gaits.fixed_point import find_gait, find_gaits
from gym_passive_walker.gaits.gait import Gait, GaitNotFound
from gym_passive_walker.gaits.stability import stride_jacobian
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
    "Gait",
    "GaitFamily",
    "GaitNotFound",
    "Outcome",
    "Part",
    "Stride",
    "TuningErrors",
    "Walker",
    "WalkerError",
    "assemble",
    "blend",
    "find_gait",
    "find_gaits",
    "gait_family",
    "lab_walker_from_parts",
    "parameter_family",
    "stride",
    "stride_jacobian",
    "tune",
    "tuning_errors",
]

_register()
