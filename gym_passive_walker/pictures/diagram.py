"""Labelled sketches, like Figs. 4.1, 4.4 and 4.7: a walker's parameters, heelstrike, standing."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker.gaits.find.fixed_point import find_gait
from gym_passive_walker.gaits.look.trajectory import Trajectory, simulate
from gym_passive_walker.models.walkers import Walker, tune
from gym_passive_walker.pictures.axes import BLACK, GREY, OWN, VERMILION, panels
from gym_passive_walker.pictures.pose import Pose, level, pose
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
    _legs(ax, posture, SHOWN, _SLOPE)
    hip = level(posture.hip, _SLOPE)
    _note(ax, hip, (0.05, 0.07), "hip_mass")
    knee, foot, tip = (
        level(part, _SLOPE) for part in (posture.swing.knee, posture.swing.foot, posture.swing.tip)
    )
    _segment(ax, hip, knee, "thigh")
    _segment(ax, knee, tip, "shank")
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


class Approach(NamedTuple):
    """The foot's way to its landing.

    Attributes:
        walk: The stride up to heelstrike.
        x: How far the point of the foot that will touch the ground is down the slope from the
            point where it will land, in the walker's units, shape (n,).
        y: How far it is off the ground, shape (n,).
    """

    walk: Trajectory
    x: NDArray[np.float64]
    y: NDArray[np.float64]

    def columns(self) -> dict[str, NDArray]:
        """One row for each instant."""
        return {**self.walk.columns(), "foot_x": self.x, "foot_y": self.y}


def approach() -> Approach:
    """A stride of the laboratory's walker with locked knees; its foot lands obliquely."""
    walk = simulate(find_gait("lab-straight", 0.05))
    foot = pose(walk.walker, walk.states, walk.contact_x).swing.foot
    turned = walk.states[:, 1] - walk.states[-1, 1]  # of the foot, up to heelstrike
    fixed = walk.walker.foot_radius * np.array([np.sin(turned), -np.cos(turned)])
    return Approach(walk, *(foot - [foot[-1, 0], 0.0] + fixed.T).T)


def heelstrike_diagram(found: Approach) -> Figure:
    """Draw the coordinates x and y of a foot close to heelstrike, like Fig. 4.4."""
    figure, (ax,) = panels(size=(6.4, 5.4), ax=OWN)
    walk, slope, length = found.walk, found.walk.slope, found.walk.walker.leg_length
    now = int(np.argmax((found.x > 0.0) & (found.y < 0.1 * length)))
    soon, lands = (
        pose(walk.walker, walk.states[i], walk.contact_x[i]) for i in (now, len(walk) - 1)
    )
    target = lands.swing.foot[0]
    ground(ax, (soon.contact[0] - 0.3 * length, target + 0.4 * length), slope, length)
    _legs(ax, lands, walk.walker, slope, alpha=0.2)
    _legs(ax, soon, walk.walker, slope)
    place, corner, point = (
        level([target + x, y], slope)
        for x, y in ((0.0, 0.0), (found.x[now], 0.0), (found.x[now], found.y[now]))
    )
    path = np.stack([target + found.x, found.y], axis=-1)[now:]
    ax.plot(*level(path, slope).T, ":", color=BLACK, linewidth=1.5)
    ax.plot(*place, "x", color=BLACK, markersize=9.0, zorder=4)
    ax.plot(*point, "o", color=BLACK, markersize=6.0, zorder=4)
    away = (0.0, -0.08), (0.07, 0.02)
    for start, end, text, aside in zip((place, corner), (corner, point), "xy", away, strict=True):
        style = {"arrowstyle": "->", "color": VERMILION, "shrinkA": 0.0, "shrinkB": 0.0}
        ax.annotate("", _pair(end), _pair(start), arrowprops=style)
        _note(ax, 0.5 * (start + end), aside, text)
    foot, hip = (level(part, slope) for part in (soon.swing.foot, soon.hip))
    ax.plot(*foot, "+", color=BLACK, markersize=8.0)
    _measure(ax, hip, foot, -0.08, _along(hip, foot)[1])
    _note(ax, 0.5 * (hip + foot) + [0.08, 0.0], (0.06, 0.03), "hip to\nfoot centre")
    upright = np.array([math.sin(slope), math.cos(slope)])
    stance, top = (level(part, slope) for part in (lands.stance.foot, lands.hip))
    _angle(ax, stance, upright, top - stance, 0.3, "stance angle θ* at heelstrike", (-0.5, 0.05))
    ax.set_aspect("equal")
    ax.set_axis_off()
    return figure


def standing_diagram() -> Figure:
    """Draw the conditions for gaits at arbitrarily small slopes, like Fig. 4.7."""
    figure, axes = panels(1, 2, (6.4, 5.6), ax=OWN)
    kneed = tune(SHOWN)
    for ax, walker in zip(axes, (replace(kneed, knees=False), kneed), strict=True):
        posture = pose(walker, np.zeros(walker.size))
        ground(ax, (-0.45, 0.45), 0.0, 1.0)
        leg, top = posture.stance, posture.hip
        ax.plot(*np.array([[0.0, 0.0], [0.0, 1.1 * top[1]]]).T, "--", **_THIN)
        _legs(ax, posture, walker, 0.0)
        ax.plot(*leg.foot, "+", color=BLACK, markersize=8.0)
        _note(ax, leg.foot, (0.1, 0.05), "foot centre")
        thigh, shank = (
            centre_of(walker, *ends, name)[1]
            for name, ends in (("thigh", (top, leg.knee)), ("shank", (leg.knee, leg.tip)))
        )
        masses = np.array([walker.hip_mass, 2.0 * walker.thigh_mass, 2.0 * walker.shank_mass])
        whole = masses @ np.array([top, thigh, shank]) / walker.total_mass
        ax.plot(*whole, "D", color=VERMILION, markersize=8.0, zorder=4)
        _note(ax, whole, (0.1, 0.05), "centre of mass\nof the body")
        title = "(a) straight legs"
        if walker.knees:
            title = "(b) knees"
            ax.plot(*np.array([leg.knee, [leg.knee[0], 0.0]]).T, "--", **_THIN)
            ax.plot(*shank, "o", color=BLACK, markersize=8.0, zorder=4)
            _note(ax, shank, (-0.4, 0.0), "centre of mass\nof the shank")
        ax.set_title(title, fontsize="medium")
        ax.set_aspect("equal")
        ax.set_axis_off()
    return figure


def _legs(
    ax: Axes, posture: Pose, walker: Walker, slope: float, alpha: float | None = None
) -> None:
    """Draw both legs and the hip."""
    hip = level(posture.hip, slope)
    for leg, colour in ((posture.stance, LEG_COLOURS[0]), (posture.swing, LEG_COLOURS[1])):
        knee, tip, sole = (level(part, slope) for part in (leg.knee, leg.tip, leg.sole))
        ax.plot(*np.array([hip, knee, tip]).T, color=colour, linewidth=2.5, alpha=alpha)
        ax.plot(*sole.T, color=colour, linewidth=2.0, alpha=alpha)
        if walker.knees:
            ax.plot(*knee, "o", color="white", markeredgecolor=colour, markersize=7.0)
    ax.plot(*hip, "o", color=BLACK, markersize=13.0, alpha=alpha)


def _down(angle: float) -> NDArray[np.float64]:
    """The direction down a leg's line, for an angle from the ground's normal."""
    return level([math.sin(angle), -math.cos(angle)], _SLOPE)


def _segment(ax: Axes, top: NDArray, bottom: NDArray, name: str) -> None:
    """Draw the length, centre of mass, offset and radius of gyration of a thigh or a shank."""
    length, com, gyration = (
        getattr(SHOWN, f"{name}_{what}") for what in ("length", "com", "gyration")
    )
    foot_point, centre = centre_of(SHOWN, top, bottom, name)
    down, back = _along(top, bottom)
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
    _measure(ax, top, top + com * down, -0.1, back)
    _note(ax, top + 0.5 * com * down - 0.1 * back, (0.06, 0.03), f"{name}_com")
    _measure(ax, top, bottom, -0.3, back)
    _note(ax, top + 0.6 * length * down - 0.3 * back, (0.05, 0.02), f"{name}_length")


def _along(top: NDArray, bottom: NDArray) -> tuple[NDArray, NDArray]:
    """The direction down a segment, and that to its back."""
    down = (bottom - top) / math.dist(top, bottom)
    return down, np.array([down[1], -down[0]])


def centre_of(walker: Walker, top: NDArray, bottom: NDArray, name: str) -> tuple[NDArray, NDArray]:
    """Centre of mass of a thigh or a shank, after the point of its line beside it."""
    down, back = _along(top, bottom)
    beside = top + getattr(walker, f"{name}_com") * down
    return beside, beside + getattr(walker, f"{name}_offset") * back


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
