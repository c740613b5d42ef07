"""The one style of all figures: sizes, lines, labels, legends.

A picture is drawn in a new figure of pyplot unless axes are given. `OWN` makes a figure without
pyplot, for a picture that is written to a file: no open figure stays behind. Lines differ
in colour (Okabe and Ito's palette, which colour-blind people distinguish). They also differ in dash
and marker, so that a figure printed in grey stays readable.
"""

from __future__ import annotations

from io import BytesIO
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeGuard

import numpy as np
from numpy.typing import NDArray

from gym_passive_walker._tools.extras import extra
from gym_passive_walker._tools.files import prepare, replacing

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SLOPE, ANGLE, SPEED = "slope γ (rad)", "stance angle θ (rad)", "speed v / √(g l)"
"""Labels of axes. Angles are in rad; all other quantities are dimensionless."""

BLACK, GREY = "#000000", "#808080"
BLUE, VERMILION, GREEN, PURPLE = "#0072B2", "#D55E00", "#009E73", "#CC79A7"
ORANGE, SKY_BLUE = "#E69F00", "#56B4E9"
_COLOURS = (BLUE, VERMILION, GREEN, BLACK, PURPLE, ORANGE, SKY_BLUE, GREY)
_DASHES = ("-", (0, (5, 1.5)), (0, (1, 1)), (0, (5, 1.5, 1, 1.5)), (0, (8, 2)))
_MARKERS = "osD^vPX*"

OWN: Any = object()
"""Passed in place of axes: draw in a new figure that is not registered with pyplot."""

HEAVY, LIGHT = 2.6, 0.9
"""Line widths in points of stable and of unstable gaits."""

_DPI = 200
_COLUMN = 1.6  # width in inches of a legend's column


def series(index: int) -> dict[str, Any]:
    """Colour, dash and marker of the curve with this index, as matplotlib's keywords."""
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
    """An empty figure and its axes, row by row.

    Args:
        rows: Number of rows of axes.
        columns: Number of columns of axes.
        size: Width and height in inches.
        ax: `OWN`, or None for a new figure of pyplot.
        **options: Keywords of matplotlib's `Figure.subplots`.

    Raises:
        ImportError: if matplotlib is not installed.
    """
    with extra("figures"):
        from matplotlib.figure import Figure as Made
    new: Any = Made
    if ax is not OWN:
        from matplotlib import pyplot

        new = pyplot.figure
    figure = new(figsize=size, layout="constrained")  # this layout leaves room for legends
    axes = list(figure.subplots(rows, columns, squeeze=False, **options).ravel())
    for each in axes:
        each.spines[["top", "right"]].set_visible(False)
        each.tick_params(labelsize="small")
    return figure, axes


def axes_for(ax: Axes | None, size: tuple[float, float] = (5.6, 4.0)) -> Axes:
    """The axes given, else those of a new figure of this size (inches); see `panels`."""
    return ax if given(ax) else panels(size=size, ax=ax)[1][0]


def given(ax: Axes | None) -> TypeGuard[Axes]:
    """Whether these are axes to draw on, not None or `OWN`."""
    return ax is not None and ax is not OWN


def figure_of(ax: Axes | NDArray) -> Figure:
    """The figure that axes belong to."""
    first: Any = ax.flat[0] if isinstance(ax, np.ndarray) else ax
    figure: Any = first.get_figure(root=True)
    return figure


def legend(ax: Axes, *, columns: int = 3, gap: float = 40.0) -> None:
    """Put a legend below the axes, where it covers nothing.

    Args:
        ax: The axes.
        columns: Largest number of columns; there are fewer if the axes are narrow.
        gap: Room for the label of the horizontal axis, in points.
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


def legend_below(figure: Figure, ax: Axes, *, columns: int = 5) -> None:
    """Put the legend of one of its axes below a figure, in at most this number of columns."""
    handles, labels = ax.get_legend_handles_labels()
    style: Any = {"loc": "outside lower center", "frameon": False, "fontsize": "small"}
    for count in range(columns, 0, -1):
        made = figure.legend(handles, labels, ncols=count, **style)
        if made.get_window_extent().width <= figure.bbox.width or count == 1:
            return
        made.remove()


def resize(figure: Figure, size: tuple[float, float]) -> None:
    """Change the size of a figure (cm), and the columns of its legends to those that have room."""
    width, height = (length / 2.54 for length in size)
    figure.set_size_inches(width, height)
    for ax in figure.axes:
        if ax.get_legend():
            legend(ax)
    if figure.legends:
        figure.legends.clear()
        legend_below(figure, next(ax for ax in figure.axes if ax.get_legend_handles_labels()[1]))


def picture_path(path: str | PathLike[str]) -> Path:
    """Check a path that a figure is to be written to, and create its folder if needed.

    ".png" is added to a name without a suffix.

    Raises:
        ValueError: if matplotlib cannot write a picture with this suffix.
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
    """Write a figure to a file, if one is named; the suffix selects the format.

    Args:
        figure: The figure.
        path: The file; None writes nothing.
        caption: Description of the figure, stored in the metadata of PNG, SVG and PDF files.

    Raises:
        ValueError: if matplotlib cannot write a picture with this suffix.
        OSError: if the file cannot be written; an existing file stays unchanged.
    """
    if path is not None:
        path = picture_path(path)
        kind = path.suffix.lower()
        place = {".png": "Description", ".svg": "Description", ".pdf": "Subject"}.get(kind)
        metadata = {place: caption} if place and caption else None
        from matplotlib import rc_context

        # Type 42 embeds fonts as outlines that journals accept.
        drawn = BytesIO()  # matplotlib's writer of PDF loses the error of a full disk
        with rc_context({"pdf.fonttype": 42, "ps.fonttype": 42}):
            figure.savefig(drawn, format=kind[1:], dpi=_DPI, metadata=metadata)
        with replacing(path) as aside:
            aside.write_bytes(drawn.getvalue())
    return figure


def broken(values: NDArray, at: NDArray) -> NDArray[np.float64]:
    """Values with NaN inserted before each index in `at`, where a drawn line is interrupted."""
    return np.insert(np.asarray(values, dtype=float), at, np.nan)
