"""Pictures: states in, pictures out.

`Screen` draws frames with pygame (the extra "render"); `strobe`, `strobe_of` and `phase_portrait`
draw figures with matplotlib (the extra "figures"). Neither library is loaded before it is needed.
"""

from gym_passive_walker.render.pose import Leg, Pose, level, pose
from gym_passive_walker.render.screen import Screen
from gym_passive_walker.render.strobe import phase_portrait, strobe, strobe_of

__all__ = ["Leg", "Pose", "Screen", "level", "phase_portrait", "pose", "strobe", "strobe_of"]
