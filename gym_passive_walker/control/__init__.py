"""Public names of `gaits.control`: controllers, in steps or strides of actuated walkers."""

from gym_passive_walker.gaits.control.feedback import Method, gains
from gym_passive_walker.gaits.control.ticks import Walkers, ticked_strides
from gym_passive_walker.gaits.scenes.scene import SceneLike

__all__ = ["Method", "SceneLike", "Walkers", "gains", "ticked_strides"]
