"""Plots of robustness, of a gauntlet and of an evaluation."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gym_passive_walker._tools.shown import picture
from gym_passive_walker.envs.evaluation.comparison import Evaluation
from gym_passive_walker.envs.evaluation.gauntlet import Gauntlet
from gym_passive_walker.envs.evaluation.robustness import Robustness
from gym_passive_walker.models.walkers import name_of
from gym_passive_walker.pictures.axes import (
    BLACK,
    BLUE,
    VERMILION,
    axes_for,
    given,
    legend,
    panels,
    series,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@picture.register(Robustness)
def _robustness(found: Robustness, ax: Axes | None = None) -> Axes | NDArray:
    """Draw the largest pushes, and without `ax` survival on rough ground and response to a step."""
    if given(ax):
        _pushes(ax, found)
        return ax
    figure, axes = panels(2, 2, (9.2, 8.2), ax)
    survival, response, pushes, results = axes
    strides = np.arange(1, len(found.survivors) + 1)
    lasting = found.first_passage.mean
    survival.semilogy(strides, np.maximum(found.survivors, 1e-12), color=BLUE, label="walkers")
    if np.isfinite(lasting):
        began = min(10, len(strides) - 1)
        falling = found.survivors[began] * (1.0 - 1.0 / lasting) ** (strides - strides[began])
        survival.semilogy(strides, falling, "--", color=BLACK, label=f"rate 1/{lasting:.4g}")
    least = found.survivors[found.survivors > 0.0].min(initial=1.0)
    survival.set(
        xlabel=f"strides on footholds with height σ = {found.roughness:.3g} l",
        ylabel="fraction of walkers not fallen", ylim=(0.7 * least, 1.3),
    )  # fmt: skip
    legend(survival, columns=2)
    shown = found.period_response[:15]
    response.bar(np.arange(1, len(shown) + 1), shown, color=BLUE)
    response.axhline(0.0, color=BLACK, linewidth=0.6)
    response.set(
        xlabel="stride after a step in the ground", ylabel="change of the period (√(l/g) per l)"
    )
    _pushes(pushes, found)
    results.axis("off")
    columns = zip(*found.facts().items(), strict=True)
    for place, column in zip((0.0, 0.42), columns, strict=True):
        style = {"va": "top", "fontsize": "small", "linespacing": 1.6}
        results.text(place, 1.0, "\n".join(column), transform=results.transAxes, **style)
    figure.suptitle(
        f"Walker {name_of(found.walker)} at slope {found.slope:.4g} rad, {found.controller_name}",
        fontsize="medium",
    )
    return np.array(axes)


@picture.register(Gauntlet)
def _gauntlet(found: Gauntlet, ax: Axes | None = None) -> Axes:
    """Draw the share of walks that reach the time limit in each test, with its interval."""
    ax = axes_for(ax, (6.4, 4.8))
    columns = found.columns()
    rows, share = -np.arange(len(columns["test"])), 100.0 * columns["survival"]
    ax.hlines(rows, 100.0 * columns["low"], 100.0 * columns["high"], color=BLUE)
    ax.plot(share, rows, "o", color=BLUE, label="walks that reach the time limit")
    ax.axvline(100.0 * found.score, color=BLACK, linestyle="--", label="score: mean of the tests")
    ax.set_yticks(rows, columns["test"], fontsize="small")
    ax.set(xlabel="share of the walks (%), with 95 % interval", xlim=(0.0, 101.0))
    facts = found.facts()
    ax.set_title(f"{facts['controller']}, walker {facts['walker']}", fontsize="medium")
    legend(ax)
    return ax


@picture.register(Evaluation)
def _evaluation(found: Evaluation, ax: Axes | None = None) -> Axes:
    """Draw the shares of endings of each controller's walks, with their 95 % intervals."""
    ax = axes_for(ax, (6.4, 3.6))
    rows = -np.arange(len(found.walks))
    endings = list(dict.fromkeys(e for walks in found.walks.values() for e in walks.endings))
    for i, ending in enumerate(endings):
        shares = [walks.share(ending) for walks in found.walks.values()]
        values, low, high = 100.0 * np.transpose(shares)
        places = rows + 0.6 * ((len(endings) - 1) / 2 - i) / len(endings)
        style = series(i)
        ax.hlines(places, low, high, color=style["color"])
        ax.plot(values, places, **{**style, "linestyle": ""}, label=ending)
    ax.set_yticks(rows, list(found.walks))
    ax.set(xlabel="share of the walks (%), with 95 % interval", xlim=(-1.0, 101.0))
    ax.set_title(f"{found.controller_name}, walker {name_of(found.scene.walker)}")
    legend(ax)
    return ax


def _pushes(ax: Axes, found: Robustness) -> None:
    """The largest pushes both ways, over the stride."""
    share = found.push_phases * 100.0
    ax.plot(share, found.push_forward, "o-", color=BLUE, label="forward")
    ax.plot(share, found.push_backward, "s--", color=VERMILION, label="backward")
    ax.set(
        xlabel="time of the push (% of the period)",
        ylabel="largest impulse (m √(g l))",
        ylim=(0, None),
    )
    legend(ax, columns=2)
