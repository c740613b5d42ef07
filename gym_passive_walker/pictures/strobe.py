"""Stroboscopic pictures of a walk, as in Fig. 4.3."""

from __future__ import annotations

import math
from os import PathLike
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker._tools.arguments import check_state
from gym_passive_walker._tools.extras import need
from gym_passive_walker.gaits.given import GaitLike
from gym_passive_walker.gaits.look.trajectory import Trajectory, simulate
from gym_passive_walker.gaits.terrain import Terrain
from gym_passive_walker.models.walkers import WalkerLike, as_walker, name_of
from gym_passive_walker.pictures import colours
from gym_passive_walker.pictures.axes import (
    GREY,
    OWN,
    axes_for,
    figure_of,
    given,
    legend,
    picture_path,
    save,
)
from gym_passive_walker.pictures.ground import ground_under, height, part_between
from gym_passive_walker.pictures.pose import Leg, Pose, legs_by_identity, level, pose

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    Path = str | PathLike[str]

LEG_COLOURS = tuple(colours.unit(colour) for colour in colours.LEGS)
"""Colours of the stance leg of the first stride, and of the other leg."""

GROUND, LINE, HIP = (
    colours.unit(colour) for colour in (colours.GROUND, colours.GROUND_LINE, colours.HIP)
)
_FAINT = 0.3  # opacity of a stance leg between heelstrikes, so that the swing leg stands out


def strobe(
    walker: GaitLike,
    slope: float | None = None,
    state: ArrayLike | None = None,
    *,
    strides: int = 2,
    flashes: int = 7,
    hip_torque: ArrayLike | None = None,
    terrain: Terrain | None = None,
    terrain_seed: int = 0,
    ax: Axes | None = None,
    path: Path | None = None,
) -> Axes:
    """Draw a stroboscopic picture of a walk, like the lower part of Fig. 4.3, with its kneestrikes.

    Args:
        walker: The walker, in a form that `as_walker` takes; or a stride map or a `Gait`, which
            supplies the actuation, and the slope and state where they are not given.
        slope: Slope in rad, positive downhill.
        state: [stance, thigh, shank] angles in rad, then their angular velocities in rad per unit
            of time, just after heelstrike, shape (6,).
        strides: Number of strides.
        flashes: Postures of each stride, evenly spaced in time, both ends included.
        hip_torque: Torque held through each stride: a number, or shape (strides,).
        terrain: Terrain of the footholds; smooth ground when None.
        terrain_seed: Seed of a random terrain.
        ax: Axes to draw on; None is a new figure of pyplot, or one without pyplot if a file is
            written.
        path: File to write, in any format that matplotlib derives from its suffix.

    Returns:
        The axes.

    Raises:
        ValueError: if a number is not finite or out of its range.
        ImportError: if matplotlib is not installed.
    """
    need("matplotlib", "figures")
    path = None if path is None else picture_path(path)
    walk = simulate(
        walker, slope, state, strides=strides, samples=flashes, hip_torque=hip_torque,
        terrain=terrain, terrain_seed=terrain_seed,
    )  # fmt: skip
    # A walk has two states at a heelstrike, before and after, of one posture: draw it once.
    once = np.append(np.diff(walk.stride_index) == 0, True)
    return strobe_of(
        walk.walker,
        walk.states[once],
        walk.contact_x[once],
        walk.slope,
        contact_y=walk.contact_y[once],
        tilts=walk.tilts[once],
        surface=ground_under(walk, walk.walker.leg_length),
        strides=walk.stride_index[once],
        kneestrikes=_kneestrikes(walk) if walk.walker.knees else (),
        ax=ax,
        path=path,
    )


def _kneestrikes(walk: Trajectory) -> NDArray[np.float64]:
    """Hip, knee and foot of the swing leg at each kneestrike, shape (k, 3, 2)."""
    walker, times = walk.walker, walk.taken.kneestrike_time
    began = np.flatnonzero(np.diff(walk.stride_index, prepend=-1))
    struck = walk.units.to_own(walk.within(np.nan_to_num(times)[:, None]).states[:, 0])
    rolled = walker.foot_radius * (walk.states[began, 0] - struck[:, 0])
    tilts = walk.tilts[began]
    x = walk.contact_x[began] + rolled * np.cos(tilts)
    y = walk.contact_y[began] - rolled * np.sin(tilts)
    own = pose(walker, struck, x, y, tilts)
    knees = np.stack([own.hip, own.swing.knee, own.swing.tip], axis=1)
    return knees[np.isfinite(times)]


def strobe_of(
    walker: WalkerLike,
    states: ArrayLike,
    contact_x: ArrayLike,
    slope: float,
    *,
    contact_y: ArrayLike = 0.0,
    tilts: ArrayLike = 0.0,
    surface: ArrayLike | None = None,
    strides: ArrayLike = 0,
    kneestrikes: ArrayLike = (),
    ax: Axes | None = None,
    path: Path | None = None,
) -> Axes:
    """Draw a stroboscopic picture of a recorded walk, one posture for each state.

    Args:
        walker: The walker, in a form that `as_walker` takes.
        states: [stance, thigh, shank] angles in rad, then their angular velocities, shape (n, 6).
        contact_x: Contact point of the stance foot along the slope, in the walker's units of
            length, shape (n,).
        slope: Slope in rad, positive downhill.
        contact_y: Height of the contact point over the slope, in the walker's units of length; a
            number or shape (n,).
        tilts: Slope of the ground at each contact beyond the slope that is walked, in rad; a number
            or shape (n,). Angles are measured from the normal of that ground.
        surface: The ground as points (x, y) along and off the slope, shape (m, 2), with x
            increasing; the slope itself when None.
        strides: Number of heelstrikes before each state, shape (n,), so that a leg keeps its
            colour; a number if no heelstrike lies between the states.
        kneestrikes: Hip, knee and foot of the swing leg at each kneestrike, as (x, y) along and off
            the slope, shape (k, 3, 2).
        ax: Axes to draw on; None is a new figure of pyplot, or one without pyplot if a file is
            written.
        path: File to write, in any format that matplotlib derives from its suffix.

    Returns:
        The axes.

    Raises:
        ValueError: if the states' shape does not fit or a number is not finite.
        ImportError: if matplotlib is not installed.
    """
    walker = as_walker(walker)
    states = check_state(states, of=walker)
    if states.ndim != 2 or not len(states):
        size = walker.size
        raise ValueError(f"states must have shape (n, {size}) with n above 0, not {states.shape}")
    x, y, tilts = (
        np.broadcast_to(np.asarray(part, dtype=float), len(states))
        for part in (contact_x, contact_y, tilts)
    )
    strides = np.broadcast_to(np.asarray(strides, dtype=int), len(states))
    length = walker.leg_length
    lines: list[list[NDArray]] = []
    if "legs" not in walker.supports:
        system: Any = walker
        each = zip(strides.tolist(), states.tolist(), strict=True)
        lines = [[line + np.array([x[i], y[i]]) for line in system.in_stride(k).drawn(state)]
                 for i, (k, state) in enumerate(each)]  # fmt: skip
        everything = np.concatenate([line for drawn in lines for line in drawn])
    else:
        posture = pose(walker, states, x, y, tilts)
        everything = np.concatenate([posture.hip, posture.stance.foot, posture.swing.foot])
    span = everything[:, 0].min() - 0.3 * length, everything[:, 0].max() + 0.3 * length
    if not given(ax):
        ax = OWN if path is not None else ax
        across = (span[1] - span[0]) / length
        inches = min(2.6, 10.0 / across)  # to a leg length
        down = across * math.sin(abs(slope))
        if surface is not None:
            down += float(np.ptp(np.asarray(surface)[:, 1])) / length
        ax = axes_for(ax, (inches * across, inches * (1.45 + down)))
    ground(ax, span, slope, length, surface)
    struck = np.append(True, np.diff(strides) != 0)
    struck[-1] = True
    if lines:
        for drawn, heavy in zip(lines, struck, strict=True):
            width, alpha = (2.0, 1.0) if heavy else (1.0, _FAINT)
            for line in drawn:
                ax.plot(
                    *level(line, slope).T, color=LEG_COLOURS[0], solid_capstyle="round",
                    linewidth=width, alpha=alpha,
                )  # fmt: skip
    else:
        for index, heavy in enumerate(struck):
            own = pose(walker, states[index], x[index], y[index], tilts[index])
            legs = legs_by_identity(own, int(strides[index]))
            for leg, colour in zip(legs, LEG_COLOURS, strict=True):
                stands = leg is own.stance and not heavy
                width, alpha = (2.0, 1.0) if heavy else (1.0, _FAINT if stands else 0.9)
                _leg(ax, own, leg, slope, not stands, color=colour, linewidth=width, alpha=alpha)
        hips = level(posture.hip, slope)
        ax.plot(*hips.T, "-", color=HIP, linewidth=0.6, zorder=2.5)
        ax.plot(*hips.T, "o", color=HIP, markersize=3.0, zorder=3, label="hip")
        for colour, label in zip(LEG_COLOURS, ("leg that stands first", "other leg"), strict=True):
            ax.plot([], [], color=colour, linewidth=1.6, label=label)
    if len(kneestrikes := np.reshape(kneestrikes, (-1, 3, 2))):
        # Kneestrikes fall between flashes: without the leg, the mark would stand alone.
        for leg in kneestrikes:
            ax.plot(*level(leg, slope).T, color=HIP, linewidth=0.8, linestyle=":", zorder=3.5)
        style = {"color": "white", "markeredgecolor": HIP, "markersize": 6.0, "zorder": 4}
        knees = level(kneestrikes[:, 1], slope)
        ax.plot(*knees.T, "D", linestyle="", label="leg at kneestrike", **style)
    ax.plot([], [], color=GREY, linewidth=2.0, label="heavy: at heelstrike")
    ax.set_aspect("equal")
    ax.set_axis_off()
    ax.set_title(f"walker {name_of(walker)}, slope {slope:.4g} rad", fontsize="medium")
    legend(ax, gap=4.0)
    save(figure_of(ax), path)
    return ax


def _leg(ax: Axes, own: Pose, leg: Leg, slope: float, shod: bool, **style: Any) -> None:
    """Draw one leg as in Fig. 4.1: lines down to the sole, and the sole."""
    style |= {"solid_capstyle": "round", "solid_joinstyle": "round"}
    ax.plot(*level(np.vstack([own.hip, leg.knee, leg.tip]), slope).T, **style)
    if shod:
        ax.plot(*level(leg.sole, slope).T, **(style | {"linewidth": 0.7 * style["linewidth"]}))


def ground(
    ax: Axes,
    span: tuple[float, float],
    slope: float,
    length: float,
    surface: ArrayLike | None = None,
) -> None:
    """Draw the ground, with a numbered mark every half leg length."""
    flat = np.column_stack([span, np.zeros(2)])
    line = flat if surface is None else part_between(np.asarray(surface), *span)
    shown = level(line, slope)
    floor = shown[:, 1].min() - 0.2 * length
    ax.fill_between(shown[:, 0], shown[:, 1], floor, color=GROUND, linewidth=0.0)
    ax.plot(*shown.T, color=LINE, linewidth=1.0)
    pitch = 0.5 * length
    for index in range(math.ceil(span[0] / pitch), math.floor(span[1] / pitch) + 1):
        high = float(height(line, index * pitch))
        top, bottom = level([(index * pitch, high), (index * pitch, high - 0.05 * length)], slope)
        ax.plot(*np.transpose([top, bottom]), color=LINE, linewidth=1.0)
        label = {"fontsize": "small", "color": LINE, "ha": "center", "va": "top"}
        ax.text(bottom[0], bottom[1] - 0.02 * length, f"${index / 2:g}\\,l$", **label)
