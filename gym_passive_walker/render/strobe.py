"""Still pictures of a gait, as in Fig. 4.3: a strobe photograph, and the motion of its angles.

Figures are matplotlib's own objects, made without pyplot: no window, no display, and nothing stays
behind when they go out of scope.
"""

from __future__ import annotations

import math
from os import PathLike
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker.arguments import check_state
from gym_passive_walker.gaits.trajectory import Trajectory, trajectory
from gym_passive_walker.render import look
from gym_passive_walker.extras import extra
from gym_passive_walker.render.pose import Leg, legs_by_identity, level, pose
from gym_passive_walker.walkers import Walker, as_walker

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    Path = str | PathLike[str]

_LEGS = tuple(look.unit(colour) for colour in look.LEGS)
_GROUND, _LINE = look.unit(look.GROUND), look.unit(look.GROUND_LINE)


def _figure(size: tuple[float, float], columns: int = 1) -> tuple[Figure, list[Axes]]:
    """A figure of that size in inches, which belongs to nobody, and its axes side by side."""
    with extra("figures"):
        from matplotlib.figure import Figure
    figure = Figure(figsize=size, layout="constrained")
    return figure, list(figure.subplots(1, columns, squeeze=False)[0])


def _finished(axes: Axes, path: Path | None) -> Figure:
    """The figure that axes belong to, written to a file if one is named."""
    figure: Any = axes.get_figure(root=True)
    if path is not None:
        figure.savefig(path, dpi=200)
    return figure


def strobe(
    walker: Walker | str,
    slope: float,
    state: ArrayLike,
    *,
    strides: int = 2,
    flashes: int = 12,
    hip_torque: ArrayLike = 0.0,
    ax: Axes | None = None,
    path: Path | None = None,
) -> Figure:
    """A strobe picture of a walk, like the lower part of Fig. 4.3.

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
    walk = trajectory(walker, slope, state, strides=strides, samples=flashes, hip_torque=hip_torque)
    # A heelstrike is one posture, though the walk has it before and after.
    once = np.append(np.diff(walk.strides) == 0, True)
    return strobe_of(
        walker,
        walk.states[once],
        walk.contact_x[once],
        slope,
        strides=walk.strides[once],
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
    span = everything[:, 0].min() - 0.35 * length, everything[:, 0].max() + 0.35 * length
    if ax is None:
        across = (span[1] - span[0]) / length
        inches = min(2.5, 14.0 / across)  # to a leg length
        ax = _figure((inches * across, inches * (1.25 + across * math.sin(abs(slope)))))[1][0]
    _ground(ax, span, slope, length)
    for index in range(len(states)):
        own = pose(walker, states[index], contact_x[index])
        # Flashes fade into the past, so that the eye knows which way the walk goes.
        strength = 0.35 + 0.65 * (index + 1) / len(states)
        near, far = legs_by_identity(own, int(strides[index]))
        for leg, colour, width in ((far, _LEGS[1], 0.9), (near, _LEGS[0], 1.6)):
            _leg(ax, own.hip, leg, slope, color=colour, linewidth=width, alpha=strength)
    hips = level(posture.hip, slope)
    ax.plot(hips[:, 0], hips[:, 1], "o", color=look.unit(look.HIP), markersize=2.5, zorder=3)
    ax.set_aspect("equal")
    ax.set_axis_off()
    return _finished(ax, path)


def _leg(ax: Axes, hip: NDArray, leg: Leg, slope: float, **style: Any) -> None:
    """One leg, as Fig. 4.1 draws it: lines down to the sole, and the sole."""
    style |= {"solid_capstyle": "round", "solid_joinstyle": "round"}
    ax.plot(*level(np.vstack([hip, leg.knee, leg.tip]), slope).T, **style)
    ax.plot(*level(leg.sole, slope).T, **(style | {"linewidth": 0.6 * style["linewidth"]}))


def _ground(ax: Axes, span: tuple[float, float], slope: float, length: float) -> None:
    """The slope under a picture, with a mark each half leg length."""
    surface = level([(span[0], 0.0), (span[1], 0.0)], slope)
    ax.fill_between(
        surface[:, 0],
        surface[:, 1],
        surface[:, 1].min() - 0.12 * length,
        color=_GROUND,
        linewidth=0.0,
    )
    ax.plot(*surface.T, color=_LINE, linewidth=1.0)
    pitch = 0.5 * length
    for index in range(int(np.ceil(span[0] / pitch)), int(np.floor(span[1] / pitch)) + 1):
        mark = level([(index * pitch, 0.0), (index * pitch, -0.05 * length)], slope)
        ax.plot(*mark.T, color=_LINE, linewidth=1.0)


def _by_leg(walk: Trajectory, first: int) -> NDArray[np.float64]:
    """Angles (first=0) or rates (first=3) of both legs' thigh and shank, shape (n, 2, 2).

    The first leg is the one that stands in stride 0; it keeps its place when the roles change.
    """
    stance, thigh, shank = walk.states[:, first : first + 3].T
    standing = np.stack([stance, stance], axis=-1)
    swinging = np.stack([thigh, shank], axis=-1)
    odd = (walk.strides % 2 == 1)[:, None]
    return np.stack([np.where(odd, swinging, standing), np.where(odd, standing, swinging)], axis=1)


def phase_portrait(
    walker: Walker | str,
    slope: float,
    state: ArrayLike,
    *,
    strides: int = 2,
    samples: int = 400,
    hip_torque: ArrayLike = 0.0,
    path: Path | None = None,
) -> Figure:
    """Angles over time, like the upper part of Fig. 4.3, and rates over angles.

    Lines break where a collision changes the rates, which dots join. Two strides close a gait's
    curve, since each leg then stands and swings once.

    Args:
        walker: The walker, or a preset's name.
        slope: Slope in rad, positive downhill.
        state: [stance, thigh, shank] angles in rad, then their rates, just after heelstrike, (6,).
        strides: How many strides to follow.
        samples: Instants of each stride.
        hip_torque: Torque held through a stride: a number, or one for each.
        path: File to write, of any kind that matplotlib knows by its ending.

    Returns:
        The figure; its two axes show angles over time, and rates over angles.

    Raises:
        ValueError: if a number is not finite or out of its range.
        ImportError: if matplotlib is not installed.
    """
    walker = as_walker(walker)
    walk = trajectory(walker, slope, state, strides=strides, samples=samples, hip_torque=hip_torque)
    figure, (over_time, portrait) = _figure((9.0, 4.0), columns=2)
    angles, rates = _by_leg(walk, 0), _by_leg(walk, 3)
    struck = np.flatnonzero((np.diff(walk.strides) != 0) | (np.diff(walk.phases) != 0)) + 1
    segments = (", thigh", ", shank") if walker.knees else ("",)
    for leg, name in ((1, "other leg"), (0, "first leg")):
        for segment, part in reversed(list(enumerate(segments))):
            style: dict[str, Any] = {
                "color": _LEGS[leg],
                "linewidth": 1.9 if leg == 0 else 1.0,
                "linestyle": ("-", (0, (4.0, 1.2)))[segment],
            }
            angle, rate = angles[:, leg, segment], rates[:, leg, segment]
            over_time.plot(walk.times, angle, label=name + part, **style)
            portrait.plot(
                np.insert(angle, struck, np.nan), np.insert(rate, struck, np.nan), **style
            )
            for after in struck:
                jump = slice(after - 1, after + 1)
                portrait.plot(angle[jump], rate[jump], ":", color=_LEGS[leg], linewidth=0.8)
    for ends in walk.times[np.flatnonzero(np.diff(walk.strides)) + 1]:
        over_time.axvline(ends, color=_LINE, linewidth=0.6)
    over_time.set(xlabel="time", ylabel="angle [rad]")
    figure.legend(loc="outside lower center", ncols=4, frameon=False, reverse=True)
    portrait.set(xlabel="angle [rad]", ylabel="rate [rad / time]")
    for axes in (over_time, portrait):
        axes.spines[["top", "right"]].set_visible(False)
        axes.axhline(0.0, color=_LINE, linewidth=0.4)
    return _finished(over_time, path)
