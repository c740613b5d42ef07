"""Representations of result objects: text, notebook cell, plot and table.

Objects provide facts and columns; this module lays them out. `pictures` registers the plots in
`picture`, so that modules of computation do not depend on matplotlib.
"""

from __future__ import annotations

import csv
from collections.abc import Mapping
from functools import singledispatch
from html import escape
from importlib import import_module
from os import PathLike
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from gym_passive_walker._tools.extras import extra
from gym_passive_walker._tools.files import replacing

if TYPE_CHECKING:
    from matplotlib.axes import Axes


DRAWERS: list[str] = []
"""Modules that register pictures: the first picture of a kind not yet known loads them."""


@singledispatch
def picture(shown: Any, ax: Axes | None = None, **options: Any) -> Axes | NDArray:
    """Draw an object; `picture.register` adds the function for a class.

    Args:
        shown: The object.
        ax: Axes to draw on, as in `Shown.plot`, or `pictures.axes.OWN`.
        **options: Options of the object's picture.

    Raises:
        TypeError: if there is no picture of such an object.
    """
    for drawer in DRAWERS:
        import_module(drawer)
    draw = picture.dispatch(type(shown))
    if draw is picture.dispatch(object):
        raise TypeError(f"there is no picture of a {type(shown).__name__}")
    return draw(shown, ax, **options)


class Shown:
    """An object with a text representation and a plot."""

    __slots__ = ()

    def facts(self) -> dict[str, str]:
        """Main properties of the object, by name: values with their units, as text."""
        raise NotImplementedError

    def __repr__(self) -> str:
        facts = ", ".join(f"{name} {value}".strip() for name, value in self.facts().items())
        return f"<{type(self).__name__}: {facts}>"

    def _repr_html_(self) -> str:
        rows = "".join(
            f"<tr><th style='text-align:left'>{escape(name)}</th>"
            f"<td style='text-align:left'>{escape(value)}</td></tr>"
            for name, value in self.facts().items()
        )
        return f"<table><caption>{type(self).__name__}</caption>{rows}</table>"

    def plot(self, ax: Axes | None = None, **options: Any) -> Axes | NDArray:
        """Draw the object with matplotlib.

        Args:
            ax: Axes of the plot, or of its main part. None makes a new figure of pyplot.
            **options: Options of the plot of this class; the reference has them at each class.

        Returns:
            The axes, or an array of axes for a plot of several panels.

        Example:
            >>> import matplotlib.pyplot as plt
            >>> import gym_passive_walker as gpw
            >>> ax = gpw.gait_family("C", 0.01, 0.05).plot()
            >>> plt.show()

        Raises:
            ImportError: if matplotlib is not installed.
        """
        return picture(self, ax, **options)


class Table(Shown):
    """An object that is also a table."""

    __slots__ = ()

    def columns(self) -> Mapping[str, NDArray]:
        """Columns of the table by name, each (rows,), in the units of the attributes."""
        raise NotImplementedError

    def to_dataframe(self) -> Any:
        """Return the table as a pandas data frame.

        Raises:
            ImportError: if pandas is not installed.
        """
        with extra("tables"):
            import pandas  # type: ignore[import-not-found]
        return pandas.DataFrame(dict(self.columns()))

    def to_csv(self, path: str | PathLike[str]) -> None:
        """Write the table to a CSV file, with all digits of the numbers.

        Args:
            path: The file.

        Raises:
            OSError: if the file cannot be written; an existing file is then unchanged.
        """
        columns = self.columns()
        rows = zip(*(np.asarray(column).tolist() for column in columns.values()), strict=True)
        with replacing(path) as aside, aside.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(columns)
            writer.writerows(rows)
