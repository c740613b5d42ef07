"""Still pictures of a walk and of a walker: a strobe photograph, as in Fig. 4.3, and a sketch."""

from __future__ import annotations

import math
from os import PathLike
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from gym_passive_walker.arguments import check_state
from gym_passive_walker.extras import need
from gym_passive_walker.gaits.samples import states_at
from gym_passive_walker.gaits.stride import stride
from gym_passive_walker.gaits.trajectory import simulate
from gym_passive_walker.render import look
from gym_passive_walker.render.axes import GREY, axes_for, figure_of, legend, save
from gym_passive_walker.render.pose import Leg, Pose, legs_by_identity, level, pose
from gym_passive_walker.walkers import Walker, as_walker, name_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    Path = str | PathLike[str]

LEGS = tuple(look.unit(colour) for colour in look.LEGS)
"""Colours of the leg that stands in the first stride, and of the other."""

GROUND, LINE, HIP = (look.unit(colour) for colour in (look.GROUND, look.GROUND_LINE, look.HIP))
_FAINT = 0.3  # of a leg that stands, between its strikes: the swing leg is what moves


def strobe(
    walker: Walker | str,
    slope: float,
    state: ArrayLike,
    *,
    strides: int = 2,
    flashes: int = 7,
    hip_torque: ArrayLike = 0.0,
    ax: Axes | None = None,
    path: Path | None = None,
) -> Figure:
    """A strobe picture of a walk, like the lower part of Fig. 4.3, its kneestrikes marked.

    Args:
        walker: The walker, or a preset's name.
        slope: Slope in rad, positive downhill.
        state: [stance, thigh, shank] angles in rad, then their rates, just after heelstrike, (6,).
        strides: How many strides to follow.
        flashes: Pictures of each stride, evenly spaced in time, both ends included.
        hip_torque: Torque held through a stride: a number, or one for each.
        ax: Axes to draw into; a figure of its own when None.
        path: File to write, of any kind that matplotlib knows by its ending.

    Returns:
        The figure.

    Raises:
        ValueError: if a number is not finite or out of its range.
        ImportError: if matplotlib is not installed.
    """
    need("matplotlib", "figures")
    walk = simulate(walker, slope, state, strides=strides, samples=flashes, hip_torque=hip_torque)
    # A heelstrike is one posture, though the walk has it before and after.
    once = np.append(np.diff(walk.strides) == 0, True)
    knees = []
    if walk.walker.knees:
        torques = np.broadcast_to(np.asarray(hip_torque, dtype=float), (strides,))
        for count, first in enumerate(range(0, len(walk), flashes)):
            start, torque = walk.states[first], torques[count]
            struck = stride(walk.walker, slope, start, hip_torque=torque).kneestrike_time
            if np.isfinite(struck):
                there, _ = states_at(walker, slope, start, [struck], hip_torque=torque)
                rolled = walk.walker.foot_radius * (start[0] - there[0, 0])
                posture = pose(walker, there[0], walk.contact_x[first] + rolled)
                knees.append(posture.swing.knee)
    return strobe_of(
        walker,
        walk.states[once],
        walk.contact_x[once],
        slope,
        strides=walk.strides[once],
        kneestrikes=np.reshape(knees, (-1, 2)),
        ax=ax,
        path=path,
    )


def strobe_of(
    walker: Walker | str,
    states: ArrayLike,
    contact_x: ArrayLike,
    slope: float,
    *,
    strides: ArrayLike = 0,
    kneestrikes: ArrayLike = (),
    ax: Axes | None = None,
    path: Path | None = None,
) -> Figure:
    """A strobe picture of a walk that was recorded, one posture for each state.

    Args:
        walker: The walker, or a preset's name.
        states: [stance, thigh, shank] angles in rad, then their rates, shape (n, 6).
        contact_x: Where the stance foot touches the ground, along the slope, shape (n,).
        slope: Slope in rad, positive downhill.
        strides: Heelstrikes before each state, shape (n,), so that a leg keeps its colour; a
            number if there were none between them.
        kneestrikes: Where a knee struck its stop, (x, y) along and off the slope, shape (k, 2).
        ax: Axes to draw into; a figure of its own when None.
        path: File to write, of any kind that matplotlib knows by its ending.

    Returns:
        The figure.

    Raises:
        ValueError: if the states' shape does not fit or a number is not finite.
        ImportError: if matplotlib is not installed.
    """
    walker, states = as_walker(walker), check_state(states)
    if states.ndim != 2 or not len(states):
        raise ValueError(f"states must have shape (n, 6) with n above 0, not {states.shape}")
    contact_x = np.broadcast_to(np.asarray(contact_x, dtype=float), len(states))
    strides = np.broadcast_to(np.asarray(strides, dtype=int), len(states))
    posture = pose(walker, states, contact_x)
    length = walker.leg_length
    everything = np.concatenate([posture.hip, posture.stance.foot, posture.swing.foot])
    span = everything[:, 0].min() - 0.3 * length, everything[:, 0].max() + 0.3 * length
    if ax is None:
        across = (span[1] - span[0]) / length
        inches = min(2.6, 10.0 / across)  # to a leg length
        ax = axes_for(None, (inches * across, inches * (1.45 + across * math.sin(abs(slope)))))
    ground(ax, span, slope, length)
    struck = np.append(True, np.diff(strides) != 0)
    struck[-1] = True
    for index in range(len(states)):
        own = pose(walker, states[index], contact_x[index])
        for leg, colour in zip(legs_by_identity(own, int(strides[index])), LEGS, strict=True):
            stands = leg is own.stance and not struck[index]
            width, alpha = (2.0, 1.0) if struck[index] else (1.0, _FAINT if stands else 0.9)
            _leg(ax, own, leg, slope, not stands, color=colour, linewidth=width, alpha=alpha)
    hips = level(posture.hip, slope)
    ax.plot(*hips.T, "-", color=HIP, linewidth=0.6, zorder=2.5)
    ax.plot(*hips.T, "o", color=HIP, markersize=3.0, zorder=3, label="hip")
    for colour, label in zip(LEGS, ("leg that stands first", "other leg"), strict=True):
        ax.plot([], [], color=colour, linewidth=1.6, label=label)
    if len(kneestrikes := np.reshape(kneestrikes, (-1, 2))):
        style = {"color": "white", "markeredgecolor": HIP, "markersize": 6.0, "zorder": 4}
        ax.plot(
            *level(kneestrikes, slope).T, "D", linestyle="", label="knee at kneestrike", **style
        )
    ax.plot([], [], color=GREY, linewidth=2.0, label="heavy: at heelstrike")
    ax.set_aspect("equal")
    ax.set_axis_off()
    ax.set_title(f"walker {name_of(walker)}, slope {slope:.4g} rad", fontsize="medium")
    legend(ax, gap=4.0)
    return save(figure_of(ax), path)


def _leg(ax: Axes, own: Pose, leg: Leg, slope: float, shod: bool, **style: Any) -> None:
    """One leg, as Fig. 4.1 draws it: lines down to the sole, and the sole."""
    style |= {"solid_capstyle": "round", "solid_joinstyle": "round"}
    ax.plot(*level(np.vstack([own.hip, leg.knee, leg.tip]), slope).T, **style)
    if shod:
        ax.plot(*level(leg.sole, slope).T, **(style | {"linewidth": 0.7 * style["linewidth"]}))


def ground(ax: Axes, span: tuple[float, float], slope: float, length: float) -> None:
    """The slope under a picture, with a mark each half leg length and a number each whole one."""
    surface = level([(span[0], 0.0), (span[1], 0.0)], slope)
    floor = surface[:, 1].min() - 0.2 * length
    ax.fill_between(surface[:, 0], surface[:, 1], floor, color=GROUND, linewidth=0.0)
    ax.plot(*surface.T, color=LINE, linewidth=1.0)
    pitch = 0.5 * length
    for index in range(math.ceil(span[0] / pitch), math.floor(span[1] / pitch) + 1):
        top, bottom = level([(index * pitch, 0.0), (index * pitch, -0.05 * length)], slope)
        ax.plot(*np.transpose([top, bottom]), color=LINE, linewidth=1.0)
        label = {"fontsize": "small", "color": LINE, "ha": "center", "va": "top"}
        ax.text(bottom[0], bottom[1] - 0.02 * length, f"${index / 2:g}\\,l$", **label)
