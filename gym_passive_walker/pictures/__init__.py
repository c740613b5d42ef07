"""Pictures, frames and plots of walkers, drawn from their states.

`Screen` draws frames with pygame (the extra "render"). `strobe`, `strobe_of`, `phase_portrait` and
the `plot` methods of objects draw with matplotlib (the extra "figures"). Neither library is
imported before it is needed. `tiled` arranges a vector environment's frames in one picture.
"""

# Importing these two modules registers the `plot` methods of objects.
import gym_passive_walker.pictures.plots
import gym_passive_walker.pictures.sketch  # noqa: F401
from gym_passive_walker.pictures.portrait import phase_portrait
from gym_passive_walker.pictures.pose import Leg, Pose, level, pose
from gym_passive_walker.pictures.screen import Screen
from gym_passive_walker.pictures.strobe import strobe, strobe_of
from gym_passive_walker.pictures.tiles import tiled

__all__ = [
    "Leg",
    "Pose",
    "Screen",
    "level",
    "phase_portrait",
    "pose",
    "strobe",
    "strobe_of",
    "tiled",
]
