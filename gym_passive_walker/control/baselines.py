"""Public names of `gaits.control.baselines`: controllers to compare with."""

from gym_passive_walker.gaits.control.baselines import (
    CONSTANT_TORQUE,
    ConstantTorque,
    Held,
    LinearFeedback,
    Optimal,
    Passive,
    Schedule,
    StrideFeedback,
)

__all__ = [
    "CONSTANT_TORQUE",
    "ConstantTorque",
    "Held",
    "LinearFeedback",
    "Optimal",
    "Passive",
    "Schedule",
    "StrideFeedback",
]
