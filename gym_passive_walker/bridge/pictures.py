"""The plot of a comparison."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gym_passive_walker._tools.shown import picture
from gym_passive_walker.bridge.comparison import MEASURED, Comparison
from gym_passive_walker.models.walkers import name_of
from gym_passive_walker.pictures.axes import axes_for, legend, series

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@picture.register(Comparison)
def _comparison(found: Comparison, ax: Axes | None = None) -> Axes:
    """Draw the sizes of relative errors over the timestep, for the first softness."""
    ax = axes_for(ax, (6.4, 4.4))
    same = np.array([repr(soft) == repr(found.softness[0]) for soft in found.softness])
    steps = found.timestep[same]
    for i, name in enumerate(MEASURED):
        sizes = np.maximum(np.abs(found.error[name][same]), 1e-9)
        ax.loglog(steps, sizes, **series(i), label=name.replace("_", " "))
    ax.set(xlabel="timestep (s)", ylabel="relative error")
    walker = name_of(found.scene.walker)
    ax.set_title(f"{found.controller_name}, walker {walker}, in {found.simulator}")
    legend(ax)
    return ax
