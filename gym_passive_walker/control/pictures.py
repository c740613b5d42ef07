"""What `plot` draws of a gait under a policy."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gym_passive_walker.control.closed_loop import ClosedLoopGait
from gym_passive_walker.control.optimum import OptimalGait
from gym_passive_walker.render.axes import ANGLE, BLACK, BLUE, GREY, figure_of, legend, panels
from gym_passive_walker.render.plots import multipliers
from gym_passive_walker.render.portrait import TIME, rates_over_angles
from gym_passive_walker.shown import picture
from gym_passive_walker.walkers import name_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_FARTHEST, _RESOLUTION = 1.35, 101  # angle in rad to which the basin is looked at


@picture.register(ClosedLoopGait)
def _closed_loop(
    gait: ClosedLoopGait, ax: Axes | None = None, optimum: OptimalGait | None = None
) -> Figure:
    """Phase portrait, torque over the stride (beside an optimal gait's), multipliers and basin."""
    if ax is not None:
        _portrait(ax, gait)
        return figure_of(ax)
    figure, (phase, torque, circle, basin) = panels(2, 2, (9.2, 8.2))
    _portrait(phase, gait)
    _torque(torque, gait, optimum)
    multipliers(circle, gait.multipliers)
    _basin(basin, gait)
    figure.suptitle(
        f"{gait.agent}: walker {name_of(gait.scene.walker)}, slope {gait.slope:.4g} rad, speed "
        f"{gait.speed:.3f} √(g l), cost of transport {gait.cost_of_transport:.4f}, "
        f"{'stable' if gait.stable else 'unstable'}",
        fontsize="medium",
    )
    return figure


def _portrait(ax: Axes, gait: ClosedLoopGait) -> None:
    knees = gait.scene.walker.knees
    locked = (gait.states[:, [1, 4]] == gait.states[:, [2, 5]]).all(axis=1) & knees
    rates_over_angles(ax, gait.states, np.flatnonzero(locked)[:1], knees)
    legend(ax, columns=2)


def _torque(ax: Axes, gait: ClosedLoopGait, optimum: OptimalGait | None) -> None:
    ax.step(gait.times, gait.torques, where="pre", color=BLUE, label=gait.agent)
    if optimum is not None:
        held = np.append(optimum.torques, optimum.torques[-1])
        tick = gait.scene.tick if gait.scene.control == "tick" else optimum.step_period
        edges = np.minimum(tick * np.arange(len(held)), optimum.step_period)
        label = f"optimal at speed {optimum.speed:.3f} √(g l)"
        ax.step(edges, held, where="post", color=BLACK, linestyle="--", label=label)
    ax.axhline(0.0, color=GREY, linewidth=0.4)
    ax.set(xlabel=TIME, ylabel="hip torque τ / (m g l)")
    legend(ax, columns=2)


def _basin(ax: Axes, gait: ClosedLoopGait) -> None:
    from matplotlib.colors import ListedColormap

    reach = max(2.0, _FARTHEST / gait.point[0])
    found = gait.basin(resolution=_RESOLUTION, reach=reach)
    ax.pcolormesh(
        found.stance_angles, found.stance_rates, found.survived,
        cmap=ListedColormap(["#f2f2f2", BLUE]), vmin=0, vmax=1, rasterized=True,
    )  # fmt: skip
    for colour, label in (("#f2f2f2", "falls"), (BLUE, "makes 20 strides")):
        swatch = {"color": colour, "markeredgecolor": GREY, "markersize": 9.0}
        ax.plot([], [], "s", linestyle="", label=label, **swatch)
    star = {"color": "white", "markeredgecolor": BLACK, "markersize": 11.0}
    ax.plot(*gait.point[:2], "*", linestyle="", label="the gait", **star)
    ax.set(xlabel=ANGLE, ylabel="stance rate dθ/dt / √(g/l)")
    legend(ax)
