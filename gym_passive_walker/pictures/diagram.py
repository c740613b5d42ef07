"""A labelled sketch, like Fig. 4.1, of a walker's parameters and of the angles of its state."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker.models.walkers import Walker
from gym_passive_walker.pictures.axes import BLACK, GREY, OWN, VERMILION, panels
from gym_passive_walker.pictures.pose import level, pose
from gym_passive_walker.pictures.strobe import LEG_COLOURS, ground

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SHOWN = Walker(
    thigh_length=0.45, thigh_offset=0.06, thigh_mass=0.2, thigh_gyration=0.1, thigh_com=0.2,
    shank_length=0.55, shank_offset=0.06, shank_mass=0.1, shank_gyration=0.1, shank_com=0.2,
    foot_radius=0.22, foot_angle=0.16, hip_mass=0.4,
)  # fmt: skip
"""A walker with every parameter large enough to be seen."""

_SLOPE, _STANCE, _THIGH, _SHANK = 0.1, -0.28, 0.78, 0.36
_THIN = {"color": GREY, "linewidth": 0.7}


def walker_diagram() -> Figure:
    """Draw a walker with a name at each length, mass and angle."""
    figure, (ax,) = panels(size=(8.2, 7.6), ax=OWN)
    posture = pose(SHOWN, [_STANCE, _THIGH, _SHANK, 0.0, 0.0, 0.0])
    ground(ax, (-0.5, 1.15), _SLOPE, 1.0)
    hip = level(posture.hip, _SLOPE)
    for leg, colour in ((posture.stance, LEG_COLOURS[0]), (posture.swing, LEG_COLOURS[1])):
        knee, tip, sole = (level(part, _SLOPE) for part in (leg.knee, leg.tip, leg.sole))
        ax.plot(*np.array([hip, knee, tip]).T, color=colour, linewidth=2.5)
        ax.plot(*sole.T, color=colour, linewidth=2.0)
        ax.plot(*knee, "o", color="white", markeredgecolor=colour, markersize=7.0)
    ax.plot(*hip, "o", color=BLACK, markersize=13.0)
    _note(ax, hip, (0.05, 0.07), "hip_mass")
    knee, foot, tip = (
        level(part, _SLOPE) for part in (posture.swing.knee, posture.swing.foot, posture.swing.tip)
    )
    for top, bottom, part, side in ((hip, knee, "thigh", 1.0), (knee, tip, "shank", 1.0)):
        _segment(ax, top, bottom, part, side)
    ax.plot(*np.array([foot, tip]).T, "--", **_THIN)
    _note(ax, 0.5 * (foot + level(posture.swing.sole[-1], _SLOPE)), (0.1, 0.02), "foot_radius")
    ax.plot(*np.array([foot, level(posture.swing.sole[-1], _SLOPE)]).T, **_THIN)
    stance = level(posture.stance.foot, _SLOPE)
    upright = np.array([math.sin(_SLOPE), math.cos(_SLOPE)])  # the ground's normal
    _angle(ax, stance, upright, hip - stance, 0.26, "stance angle\n(negative here)", (-0.36, 0.04))
    line = _down(_THIGH)
    _angle(ax, hip, -upright, line, 0.78, "thigh angle", (-0.12, -0.1))
    _angle(ax, hip, line, knee - hip, 0.36, "foot_angle", (0.12, 0.0))
    _angle(ax, knee, -upright, _down(_SHANK), 0.42, "shank angle", (-0.06, -0.08))
    contact = level(posture.contact, _SLOPE)
    _angle(ax, contact, [1.0, 0.0], [upright[1], -upright[0]], 0.95, "slope", (0.03, 0.04))
    ax.set_aspect("equal")
    ax.set_axis_off()
    return figure


def _down(angle: float) -> NDArray[np.float64]:
    """The direction down a leg's line, for an angle from the ground's normal."""
    return level([math.sin(angle), -math.cos(angle)], _SLOPE)


def _segment(ax: Axes, top: NDArray, bottom: NDArray, name: str, side: float) -> None:
    """Draw the length, centre of mass, offset and radius of gyration of a thigh or a shank."""
    length, com, offset, gyration = (
        getattr(SHOWN, f"{name}_{what}") for what in ("length", "com", "offset", "gyration")
    )
    down = (bottom - top) / math.dist(top, bottom)
    back = np.array([down[1], -down[0]])
    foot_point = top + com * down
    centre = foot_point + offset * back
    ax.plot(*centre, "o", color=BLACK, markersize=8.0, zorder=4)
    _note(ax, centre, (-0.33, -0.02), f"{name}_mass")
    turn = np.linspace(0.0, 2.0 * np.pi, 100)
    circle = centre[:, None] + gyration * np.array([np.cos(turn), np.sin(turn)])
    ax.plot(*circle, "--", **_THIN)
    edge = centre + gyration * np.array([-0.8, 0.6])
    ax.plot(*np.array([centre, edge]).T, **_THIN)
    _note(ax, edge, (-0.3, 0.05), f"{name}_gyration")
    _measure(ax, foot_point, centre, 0.0, back)
    _note(ax, 0.5 * (foot_point + centre), (-0.34, -0.12), f"{name}_offset")
    _measure(ax, top, top + com * down, -0.1 * side, back)
    _note(ax, top + 0.5 * com * down - 0.1 * side * back, (0.06, 0.03), f"{name}_com")
    _measure(ax, top, bottom, -0.3 * side, back)
    _note(ax, top + 0.6 * length * down - 0.3 * side * back, (0.05, 0.02), f"{name}_length")


def _measure(ax: Axes, start: NDArray, end: NDArray, aside: float, back: NDArray) -> None:
    """Draw a double arrow beside a distance, and lines to its ends."""
    one, other = start + aside * back, end + aside * back
    for point, shifted in ((start, one), (end, other)):
        ax.plot(*np.array([point, shifted]).T, **_THIN)
    style = {"arrowstyle": "<->", "color": VERMILION, "shrinkA": 0.0, "shrinkB": 0.0}
    ax.annotate("", _pair(other), _pair(one), arrowprops=style)


def _note(ax: Axes, at: NDArray, away: tuple[float, float], text: str) -> None:
    """Write a name beside a point, with a line to it."""
    ax.annotate(
        text, _pair(at), _pair(at + np.array(away)), fontsize="small", va="center",
        arrowprops={"arrowstyle": "-", "color": GREY, "linewidth": 0.5, "shrinkB": 0.0},
    )  # fmt: skip


def _pair(point: NDArray) -> tuple[float, float]:
    return float(point[0]), float(point[1])


def _angle(
    ax: Axes, at: NDArray, first: ArrayLike, second: ArrayLike, reach: float, text: str,
    away: tuple[float, float],
) -> None:  # fmt: skip
    """Draw an arc between two directions from a point, with both drawn as dashed lines."""
    ends = [math.atan2(ray[1], ray[0]) for ray in np.array([first, second])]
    for end in ends:
        ray = at + 1.15 * reach * np.array([math.cos(end), math.sin(end)])
        ax.plot(*np.array([at, ray]).T, "--", **_THIN)
    turn = np.linspace(ends[0], ends[1], 40)
    arc = at[:, None] + reach * np.array([np.cos(turn), np.sin(turn)])
    ax.plot(*arc, color=VERMILION, linewidth=1.0)
    middle = arc[:, 20]
    _note(ax, middle, away, text)
