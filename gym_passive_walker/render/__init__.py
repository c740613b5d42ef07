"""Pictures: states in, pictures out.

`Screen` draws frames with pygame (the extra "render"); `strobe`, `strobe_of`, `phase_portrait` and
what objects `plot` are drawn with matplotlib (the extra "figures"). Neither library is loaded
before it is needed. `tiled` puts a vector environment's frames into one picture.
"""

# These two enter what objects plot.
import gym_passive_walker.render.plots
import gym_passive_walker.render.sketch  # noqa: F401
from gym_passive_walker.render.portrait import phase_portrait
from gym_passive_walker.render.pose import Leg, Pose, level, pose
from gym_passive_walker.render.screen import Screen
from gym_passive_walker.render.strobe import strobe, strobe_of
from gym_passive_walker.render.tiles import tiled

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
