"""What `plot` draws of a gait under a policy."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gym_passive_walker.control.closed_loop import ClosedLoopGait
from gym_passive_walker.control.optimum import OptimalGait
from gym_passive_walker.control.robustness import Robustness
from gym_passive_walker.render.axes import (
    ANGLE,
    BLACK,
    BLUE,
    GREY,
    VERMILION,
    given,
    legend,
    panels,
)
from gym_passive_walker.render.plots import multipliers
from gym_passive_walker.render.portrait import TIME, rates_over_angles
from gym_passive_walker.shown import picture
from gym_passive_walker.walkers import name_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_FARTHEST, _RESOLUTION = 1.35, 101  # angle in rad to which the basin is looked at


@picture.register(ClosedLoopGait)
def _closed_loop(
    gait: ClosedLoopGait, ax: Axes | None = None, optimum: OptimalGait | None = None
) -> Axes | NDArray:
    """Phase portrait, torque over the stride (beside an optimal gait's), multipliers and basin."""
    if given(ax):
        _portrait(ax, gait)
        return ax
    figure, axes = panels(2, 2, (9.2, 8.2), ax)
    phase, torque, circle, basin = axes
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
    return np.array(axes)


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


@picture.register(Robustness)
def _robustness(found: Robustness, ax: Axes | None = None) -> Axes | NDArray:
    """Survival on rough ground, answers to a step, pushes by phase, and what else was measured."""
    if given(ax):
        _pushes(ax, found)
        return ax
    figure, axes = panels(2, 2, (9.2, 8.2), ax)
    survival, answers, pushes, told = axes
    strides = np.arange(1, len(found.survivors) + 1)
    lasting = found.first_passage.mean
    survival.semilogy(strides, np.maximum(found.survivors, 1e-12), color=BLUE, label="walkers")
    if np.isfinite(lasting):
        began = min(10, len(strides) - 1)
        falling = found.survivors[began] * (1.0 - 1.0 / lasting) ** (strides - strides[began])
        survival.semilogy(strides, falling, "--", color=BLACK, label=f"1 in {lasting:.4g} falls")
    least = found.survivors[found.survivors > 0.0].min(initial=1.0)
    survival.set(
        xlabel=f"strides on ground whose heights differ by {found.roughness:.3g} l",
        ylabel="share that still walks", ylim=(0.7 * least, 1.3),
    )  # fmt: skip
    legend(survival, columns=2)
    shown = found.answers[:15]
    answers.bar(np.arange(1, len(shown) + 1), shown, color=BLUE)
    answers.axhline(0.0, color=BLACK, linewidth=0.6)
    answers.set(
        xlabel="stride after a step in the ground", ylabel="change of the period (√(l/g) per l)"
    )
    _pushes(pushes, found)
    told.axis("off")
    columns = zip(*found.facts().items(), strict=True)
    for place, column in zip((0.0, 0.42), columns, strict=True):
        style = {"va": "top", "fontsize": "small", "linespacing": 1.6}
        told.text(place, 1.0, "\n".join(column), transform=told.transAxes, **style)
    figure.suptitle(
        f"Walker {name_of(found.walker)} at slope {found.slope:.4g} rad, {found.who}",
        fontsize="medium",
    )
    return np.array(axes)


def _pushes(ax: Axes, found: Robustness) -> None:
    """The largest pushes both ways, over the stride."""
    share = found.phases * 100.0
    ax.plot(share, found.forward, "o-", color=BLUE, label="forward")
    ax.plot(share, found.backward, "s--", color=VERMILION, label="backward")
    ax.set(
        xlabel="time of the push (% of the period)",
        ylabel="largest impulse (m √(g l))",
        ylim=(0, None),
    )
    legend(ax, columns=2)
