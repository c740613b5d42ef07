"""Exact passive walkers for reinforcement learning and gait analysis."""

from gym_passive_walker.envs.registration import register as _register
from gym_passive_walker.gaits.family import GaitFamily, gait_family, parameter_family
from gym_passive_walker.gaits.fixed_point import find_gait, find_gaits
from gym_passive_walker.gaits.gait import Gait, GaitNotFound
from gym_passive_walker.gaits.measures import (
    FootVelocity,
    Measures,
    collision_matrix,
    foot_velocity,
    measures,
)
from gym_passive_walker.gaits.phases import Impulse
from gym_passive_walker.gaits.reality import RealityCheck, reality_check
from gym_passive_walker.gaits.series import Extreme
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
    "Extreme",
    "FootVelocity",
    "Gait",
    "GaitFamily",
    "GaitNotFound",
    "Impulse",
    "Measures",
    "Outcome",
    "Part",
    "RealityCheck",
    "Stride",
    "TuningErrors",
    "Walker",
    "WalkerError",
    "assemble",
    "blend",
    "collision_matrix",
    "find_gait",
    "find_gaits",
    "foot_velocity",
    "gait_family",
    "lab_walker_from_parts",
    "measures",
    "parameter_family",
    "reality_check",
    "stride",
    "stride_jacobian",
    "tune",
    "tuning_errors",
]

_register()
