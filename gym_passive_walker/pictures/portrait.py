"""Angles of a walk over time, as in the upper part of Fig. 4.3, and its phase portrait."""

from __future__ import annotations

from collections.abc import Sequence
from os import PathLike
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker.gaits.given import GaitLike
from gym_passive_walker.gaits.look.trajectory import Trajectory, simulate
from gym_passive_walker.models.walkers import name_of
from gym_passive_walker.pictures.axes import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    OWN,
    VERMILION,
    broken,
    figure_of,
    legend,
    panels,
    picture_path,
    save,
)
from gym_passive_walker.pictures.strobe import LEG_COLOURS

if TYPE_CHECKING:
    from matplotlib.axes import Axes

TIME, ANGLES, RATES = "time t / √(l/g)", "angle θ (rad)", "rate dθ/dt / √(g/l)"

_DASHES = "-", (0, (5, 1.5)), (0, (1, 1))


def parts_of(names: Sequence[str]) -> list[tuple[str, str, Any]]:
    """Name, colour and dash of each coordinate or control of a walker."""
    colours = BLUE, VERMILION, GREEN
    return [
        (name.replace("_", " "), colours[i % 3], _DASHES[(i + i // 3) % 3])
        for i, name in enumerate(names)
    ]


def _by_leg(walk: Trajectory) -> NDArray[np.float64]:
    """Angles in rad of both legs' thigh and shank, shape (n, 2, 2).

    The first leg is the stance leg of stride 0; it keeps its index when the roles change.
    """
    stance, thigh, shank = walk.states[:, :3].T - walk.tilts  # from the slope's normal
    standing = np.stack([stance, stance], axis=-1)
    swinging = np.stack([thigh, shank], axis=-1)
    odd = (walk.stride_index % 2 == 1)[:, None]
    return np.stack([np.where(odd, swinging, standing), np.where(odd, standing, swinging)], axis=1)


def angles_over_time(ax: Axes, walk: Trajectory) -> None:
    """Draw each leg's angles over time, through both its roles; vertical lines are impacts."""
    times = walk.times / walk.walker.units.time
    heels = np.flatnonzero(np.diff(walk.stride_index)) + 1
    if "legs" not in walk.walker.supports:
        for (name, colour, dash), angle in zip(
            parts_of(walk.walker.parts), walk.states.T, strict=False
        ):
            lines = broken(times, heels), broken(angle, heels)
            ax.plot(*lines, label=name, color=colour, linestyle=dash, linewidth=1.5)
    else:
        angles = _by_leg(walk)
        segments = (", thigh", ", shank") if walk.walker.knees else ("",)
        for leg, name in enumerate(("first stance leg", "other leg")):
            for segment, part in enumerate(segments):
                ax.plot(
                    times, angles[:, leg, segment], label=name + part, color=LEG_COLOURS[leg],
                    linewidth=(1.8, 1.1)[leg], linestyle=("-", (0, (4.0, 1.2)))[segment],
                )  # fmt: skip
    impacts(ax, walk)
    ax.set(xlabel=TIME, ylabel=ANGLES)


def impacts(ax: Axes, walk: Trajectory) -> None:
    """Draw a vertical line at the time of each impact of a walk, if it has few."""
    times = walk.times / walk.walker.units.time
    heels = np.flatnonzero(np.diff(walk.stride_index)) + 1
    knees = np.setdiff1d(walk.struck, heels)
    few = len(walk.outcomes) <= 12  # more lines would hide the curves
    for label, dash, at in (("heelstrike", "-", heels), ("kneestrike", ":", knees)):
        for index, time in enumerate(times[at] if few else ()):
            ax.axvline(time, color=GREY, linewidth=0.8, linestyle=dash, label=label * (not index))


def portrait_of(ax: Axes, walk: Trajectory) -> None:
    """Draw the phase portrait of a walk: angular velocities over angles of its coordinates."""
    states, struck = walk.walker.units.to_dimensionless(walk.states), walk.struck
    half = states.shape[1] // 2
    for part, (name, colour, dash) in reversed(list(enumerate(parts_of(walk.walker.parts)))):
        angle, rate = states[:, part], states[:, half + part]
        style: dict[str, Any] = {"color": colour, "linewidth": 1.5}
        moves = broken(angle, struck), broken(rate, struck)
        ax.plot(*moves, linestyle=dash, label=name, **style)
        ax.plot(angle[0], rate[0], "o", color=colour, markersize=5.0)
        for after in struck:
            jump = slice(after - 1, after + 1)
            ax.plot(angle[jump], rate[jump], ":", color=colour, linewidth=0.7)
    ax.plot([], [], "o", color=BLACK, markersize=5.0, label="just after heelstrike")
    ax.plot([], [], ":", color=BLACK, linewidth=0.7, label="impact")
    ax.axhline(0.0, color=GREY, linewidth=0.4)
    ax.set(xlabel=ANGLES, ylabel=RATES)


def phase_portrait(
    walker: GaitLike,
    slope: float | None = None,
    state: ArrayLike | None = None,
    *,
    strides: int = 2,
    samples: int = 400,
    hip_torque: ArrayLike | None = None,
    path: str | PathLike[str] | None = None,
) -> NDArray:
    """Draw both legs' angles over time, like the upper part of Fig. 4.3, and the phase portrait.

    A dotted line bridges each jump of the angular velocities at an impact.

    Args:
        walker: The walker, in a form that `as_walker` takes; or a stride map or a `Gait`, which
            supplies the actuation, and the slope and state where they are not given.
        slope: Slope in rad, positive downhill.
        state: [stance, thigh, shank] angles in rad, then their angular velocities in rad per unit
            of time, just after heelstrike, shape (6,).
        strides: Number of strides.
        samples: Samples of each stride.
        hip_torque: Torque held through each stride: a number, or shape (strides,).
        path: File to write, in any format that matplotlib derives from its suffix.

    Returns:
        Two axes, shape (2,): each leg's angles over time, and angular velocities over angles of the
        stance leg and the swing leg. They are in a new figure of pyplot; if a file is
        written, in one without pyplot.

    Raises:
        ValueError: if a number is not finite or out of its range.
        ImportError: if matplotlib is not installed.
    """
    path = None if path is None else picture_path(path)
    walk = simulate(walker, slope, state, strides=strides, samples=samples, hip_torque=hip_torque)
    axes = both(walk, None if path is None else OWN)
    save(figure_of(axes), path)
    return axes


def both(walk: Trajectory, ax: Axes | None) -> NDArray:
    """Draw two panels of a walk: angles over time, and angular velocities over angles."""
    figure, (over_time, portrait) = panels(1, 2, (9.2, 4.4), ax)
    angles_over_time(over_time, walk)
    portrait_of(portrait, walk)
    figure.suptitle(
        f"walker {name_of(walk.walker)}, slope {walk.slope:.4g} rad, strides: {len(walk.outcomes)}",
        fontsize="medium",
    )
    legend(over_time, columns=2)
    legend(portrait, columns=2)
    return np.array([over_time, portrait])
