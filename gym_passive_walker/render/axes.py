"""The one style of all figures: sizes, lines, labels, legends.

As in pyplot, a picture is drawn on the current axes unless others are given. `OWN` is for what is
written to a file: a figure made without pyplot, so that nothing stays behind. Lines differ in
colour (Okabe and Ito's, which the colour-blind distinguish) and in dash and marker besides, so that
a figure survives a grey printer.
"""

from __future__ import annotations

from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeGuard

import numpy as np
from numpy.typing import NDArray

from gym_passive_walker.extras import extra
from gym_passive_walker.files import prepare, replacing

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SLOPE, ANGLE, SPEED = "slope γ (rad)", "stance angle θ (rad)", "speed v / √(g l)"
"""Labels of axes. Angles are in rad; all else is over its dimensionless unit."""

BLACK, GREY = "#000000", "#808080"
BLUE, VERMILION, GREEN, PURPLE = "#0072B2", "#D55E00", "#009E73", "#CC79A7"
ORANGE, SKY_BLUE = "#E69F00", "#56B4E9"
_COLOURS = (BLUE, VERMILION, GREEN, BLACK, PURPLE, ORANGE, SKY_BLUE, GREY)
_DASHES = ("-", (0, (5, 1.5)), (0, (1, 1)), (0, (5, 1.5, 1, 1.5)), (0, (8, 2)))
_MARKERS = "osD^vPX*"

OWN: Any = object()
"""In place of axes: a figure of the picture's own, which pyplot does not know."""

HEAVY, LIGHT = 2.6, 0.9
"""Widths of lines: of what is stable, and of what is not."""

_DPI = 200
_COLUMN = 1.6  # of a legend, in inches


def series(index: int) -> dict[str, Any]:
    """Colour, dash and marker of the curve with this number."""
    return {
        "color": _COLOURS[index % len(_COLOURS)],
        "linestyle": _DASHES[index % len(_DASHES)],
        "marker": _MARKERS[index % len(_MARKERS)],
        "markersize": 4.0,
    }


def panels(
    rows: int = 1,
    columns: int = 1,
    size: tuple[float, float] = (5.6, 4.0),
    ax: Axes | None = OWN,
    **options: Any,
) -> tuple[Figure, list[Axes]]:
    """An empty figure with axes, row by row.

    Args:
        rows: Of axes.
        columns: Likewise.
        size: Width and height in inches.
        ax: `OWN`, or None for pyplot: its current figure if that is empty, else another.
        **options: As of matplotlib's `Figure.subplots`.

    Raises:
        ImportError: if matplotlib is not installed.
    """
    with extra("figures"):
        from matplotlib.figure import Figure
    if ax is OWN:
        figure = Figure(figsize=size)
    else:
        from matplotlib import pyplot

        empty = pyplot.get_fignums() and not pyplot.gcf().axes
        figure = pyplot.gcf() if empty else pyplot.figure(figsize=size)
    if figure.get_layout_engine() is None:
        figure.set_layout_engine("constrained")  # which leaves room for legends
    axes = list(figure.subplots(rows, columns, squeeze=False, **options).ravel())
    for each in axes:
        plain(each)
    return figure, axes


def plain(ax: Axes) -> None:
    """Take off what says nothing."""
    ax.spines[["top", "right"]].set_visible(False)
    ax.tick_params(labelsize="small")


def axes_for(ax: Axes | None, size: tuple[float, float] = (5.6, 4.0)) -> Axes:
    """The axes given, or pyplot's current ones: in a figure of this size, if there are none."""
    if given(ax):
        return ax
    if ax is None:
        with extra("figures"):
            from matplotlib import pyplot
        if pyplot.get_fignums() and pyplot.gcf().axes:
            return pyplot.gca()
    return panels(size=size, ax=ax)[1][0]


def given(ax: Axes | None) -> TypeGuard[Axes]:
    """Whether these are axes to draw on, not None or `OWN`."""
    return ax is not None and ax is not OWN


def figure_of(ax: Axes | NDArray) -> Figure:
    """The figure that axes belong to."""
    first: Any = ax.flat[0] if isinstance(ax, np.ndarray) else ax
    figure: Any = first.get_figure(root=True)
    return figure


def legend(ax: Axes, *, columns: int = 3, gap: float = 40.0) -> None:
    """Say what the lines are where it covers nothing: below the axes.

    Args:
        ax: The axes.
        columns: Of the legend, if the axes are wide enough.
        gap: Left for the label of the horizontal axis, in points.
    """
    from matplotlib.transforms import ScaledTranslation

    figure = figure_of(ax)
    down = ScaledTranslation(0.0, -gap / 72.0, figure.dpi_scale_trans)
    handles = dict(zip(*reversed(ax.get_legend_handles_labels()), strict=True))  # each label once
    room = int(ax.get_window_extent().width / figure.dpi / _COLUMN)
    ax.legend(
        handles.values(), handles.keys(), loc="upper center",
        bbox_to_anchor=(0.5, 0.0), bbox_transform=ax.transAxes + down,
        ncols=max(1, min(columns, room)), frameon=False, fontsize="small", borderaxespad=0.0,
    )  # fmt: skip


def picture_path(path: str | PathLike[str]) -> Path:
    """A path that a figure may be written to, in a folder that is made if need be.

    ".png" is added to a name without an ending.

    Raises:
        ValueError: if its ending is that of no picture.
        ImportError: if matplotlib is not installed.
        OSError: if no file can be written there.
    """
    with extra("figures"):
        from matplotlib.backend_bases import FigureCanvasBase
    path = Path(path)
    path = path if path.suffix else path.with_name(f"{path.name}.png")
    kinds = sorted(FigureCanvasBase.get_supported_filetypes())
    if path.suffix[1:].lower() not in kinds:
        raise ValueError(
            f"a picture's name must end in one of {', '.join(f'.{kind}' for kind in kinds)}, "
            f"not {str(path)!r}"
        )
    return prepare(path)


def save(figure: Figure, path: str | PathLike[str] | None, caption: str = "") -> Figure:
    """Write a figure to a file, if one is named, of the kind that its ending says.

    Args:
        figure: The figure.
        path: The file; None writes nothing.
        caption: What it shows, kept inside of PNG, SVG and PDF files.

    Raises:
        ValueError: if the ending is that of no picture.
        OSError: if the file cannot be written; what was there before stays.
    """
    if path is not None:
        path = picture_path(path)
        kind = path.suffix.lower()
        place = {".png": "Description", ".svg": "Description", ".pdf": "Subject"}.get(kind)
        metadata = {place: caption} if place and caption else None
        with replacing(path) as aside:
            figure.savefig(aside, format=kind[1:], dpi=_DPI, metadata=metadata)
    return figure


def broken(values: NDArray, at: NDArray) -> NDArray[np.float64]:
    """Values with a gap before each of some places, where a line is to be lifted."""
    return np.insert(np.asarray(values, dtype=float), at, np.nan)
