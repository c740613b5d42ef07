"""Plots of sweeps."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from gym_passive_walker._tools.arguments import unknown
from gym_passive_walker._tools.shown import picture
from gym_passive_walker.apps.sweeps.quantities import label, sizes
from gym_passive_walker.apps.sweeps.run import SweepResult
from gym_passive_walker.apps.sweeps.store import DONE
from gym_passive_walker.apps.sweeps.tasks import check_trust
from gym_passive_walker.pictures.axes import BLUE, GREY, VERMILION, axes_for, figure_of, legend

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_MANY = 2000  # number of points from which on they are drawn smaller
_MARKER = 16.0  # size of points in the legend, in square points


@picture.register(SweepResult)
def _swept(swept: SweepResult, ax: Axes | None = None, *, x: str, y: str, by: str) -> Axes:
    """Draw a point for each task over two columns, marked or coloured by a third.

    A Boolean third column gives two kinds of markers, a numeric one gives colours. Failed tasks are
    crosses. Quantities in a walker's own units are made dimensionless with its leg length, mass and
    pendulum time.

    Args:
        swept: The sweep.
        ax: matplotlib's axes to draw on; a new figure when None.
        x: Column on the horizontal axis.
        y: Column on the vertical axis.
        by: Column that determines markers or colours.

    Raises:
        ValueError: if there is no such column, or the analysis is not trusted.
    """
    columns, described = swept.columns(), swept.description()
    check_trust(described.outside, swept.trust)  # its arguments determine the units
    if said := unknown((x, y, by), tuple(columns), "this sweep"):
        raise ValueError(said)
    ax = axes_for(ax)
    done = columns["status"] == DONE
    tasks = [described.tasks[number] for number in columns["task"]]

    def drawn(name: str) -> NDArray:
        return columns[name] / sizes(name, described.analysis, tasks)

    across, up, kinds = drawn(x), drawn(y), columns[by][done]
    size = 9.0 * min(1.0, _MANY / max(1, len(tasks)))  # small, so that many stay distinct
    if all(isinstance(value, bool | np.bool_) for value in kinds):
        no, yes = done.copy(), done.copy()
        no[done], yes[done] = ~kinds.astype(bool), kinds.astype(bool)
        for which, group, style in (
            (yes, by, {"c": BLUE, "linewidths": 0.0, "s": size}),
            (
                no,
                f"not {by}",
                {"c": VERMILION, "marker": "x", "linewidths": 0.3 * size**0.5, "s": 1.3 * size},
            ),
        ):  # fmt: skip
            ax.scatter(across[which], up[which], label=f"{group}: {which.sum()}", **style)
    else:
        points = ax.scatter(across[done], up[done], c=drawn(by)[done].astype(float), s=size)
        figure_of(ax).colorbar(points, ax=ax, label=label(by))
    if not done.all():
        group = f"failed: {np.sum(~done)}"
        ax.scatter(across[~done], up[~done], c=GREY, marker="+", s=12.0, label=group)
    ax.set(xlabel=label(x), ylabel=label(y))
    if ax.get_legend_handles_labels()[0]:
        legend(ax)
        shown: Any = ax.get_legend()
        for marker in shown.legend_handles:  # of equal size for many points and few
            marker.set_sizes([_MARKER])
    return ax
