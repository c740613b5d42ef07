"""The `plot` method of a walker: a sketch like Fig. 4.1, with masses drawn to scale."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from gym_passive_walker._tools.shown import picture
from gym_passive_walker.models.walkers import Walker, name_of
from gym_passive_walker.pictures.axes import BLACK, GREY, axes_for, legend
from gym_passive_walker.pictures.diagram import centre_of
from gym_passive_walker.pictures.pose import pose
from gym_passive_walker.pictures.strobe import LEG_COLOURS, ground

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from numpy.typing import NDArray

_POSTURE = np.array([-0.15, 0.5, 0.05, 0.0, 0.0, 0.0])  # no part hides another
_LARGEST = 16.0  # diameter in points of a disc for the total mass; area is proportional to mass


@picture.register(Walker)
def _walker(walker: Walker, ax: Axes | None = None) -> Axes:
    """Draw the walker to scale, with its masses as discs."""
    length = walker.leg_length
    posture = pose(walker, _POSTURE)
    ax = axes_for(ax, (4.6, 4.8))
    ground(ax, (-0.6 * length, 0.9 * length), 0.0, length)
    for leg, colour, name in (
        (posture.swing, LEG_COLOURS[1], "swing leg"), (posture.stance, LEG_COLOURS[0], "stance leg")
    ):  # fmt: skip
        line = np.vstack([posture.hip, leg.knee, leg.tip])
        ax.plot(*line.T, color=colour, linewidth=2.5, solid_capstyle="round", label=name)
        ax.plot(*leg.sole.T, color=colour, linewidth=2.0)
        if walker.knees:
            ax.plot(*leg.knee, "o", color="white", markeredgecolor=colour, markersize=6.0)
        for top, bottom, part in ((posture.hip, leg.knee, "thigh"), (leg.knee, leg.tip, "shank")):
            _, centre = centre_of(walker, top, bottom, part)
            mass, gyration = (getattr(walker, f"{part}_{what}") for what in ("mass", "gyration"))
            _mass(ax, walker, mass, centre)
            if mass and leg is posture.swing:
                turn = gyration * np.exp(1j * np.linspace(0.0, 2.0 * np.pi, 100))
                ax.plot(centre[0] + turn.real, centre[1] + turn.imag, "--", color=GREY, lw=0.8)
        if walker.massless_legs:
            ax.plot(*leg.tip, "o", fillstyle="none", color=BLACK, markersize=5.0)
    _mass(ax, walker, walker.hip_mass, posture.hip)
    ax.plot([], [], "o", color=BLACK, linestyle="", label="mass, by its area")
    if walker.massless_legs:
        ax.plot([], [], "o", fillstyle="none", color=BLACK, linestyle="", label="vanishing mass")
    if walker.thigh_gyration or walker.shank_gyration:
        ax.plot([], [], "--", color=GREY, linewidth=0.8, label="radius of gyration")
    ax.set_aspect("equal")
    ax.set_axis_off()
    ax.set_title(
        f"walker {name_of(walker)}: l = {length:.4g}, m = {walker.total_mass:.4g}",
        fontsize="medium",
    )
    legend(ax, columns=2, gap=4.0)
    return ax


def _mass(ax: Axes, walker: Walker, mass: float, centre: NDArray) -> None:
    """Draw a disc with an area proportional to the mass."""
    if mass:
        size = _LARGEST * math.sqrt(mass / walker.total_mass)
        ax.plot(*centre, "o", color=BLACK, markersize=size, zorder=3)
