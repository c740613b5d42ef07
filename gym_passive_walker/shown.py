"""How objects show themselves: in a line, in a notebook's cell, as a picture and as a table.

An object says what is worth saying of it; how that is laid out stands here, once. Pictures are
drawn far above, in `render`, which enters them in `picture`: so nothing below knows how to draw.
"""

from __future__ import annotations

import csv
from collections.abc import Mapping
from functools import singledispatch
from html import escape
from os import PathLike
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from gym_passive_walker.extras import extra
from gym_passive_walker.files import replacing

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@singledispatch
def picture(shown: Any, ax: Axes | None = None, **options: Any) -> Axes | NDArray:
    """Draw an object; a function for each class is entered with `picture.register`.

    What is drawn on is as in `Shown.plot`, or `render.axes.OWN`.

    Raises:
        TypeError: if there is no picture of such an object.
    """
    raise TypeError(f"there is no picture of a {type(shown).__name__}")


class Shown:
    """An object with something to say of itself."""

    __slots__ = ()

    def facts(self) -> dict[str, str]:
        """What is worth knowing of it in a line or two: values with their units, by name."""
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
        """Draw it with matplotlib, on pyplot's current axes unless others are given.

        Args:
            ax: Axes to draw on: the picture, or its main part. None is `plt.gca()`; a picture of
                several panels takes the current figure if that is empty, else another.
            **options: What the picture of this object can be asked for; see
                `gym_passive_walker.render.plots`.

        Returns:
            The axes, or an array of them where the picture has several panels.

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
    """An object that is a table besides."""

    __slots__ = ()

    def columns(self) -> Mapping[str, NDArray]:
        """Its columns by name, each of shape (rows,); units are those of the attributes."""
        raise NotImplementedError

    def to_dataframe(self) -> Any:
        """The table for pandas.

        Raises:
            ImportError: if pandas is not installed.
        """
        with extra("tables"):
            import pandas  # type: ignore[import-not-found]
        return pandas.DataFrame(dict(self.columns()))

    def to_csv(self, path: str | PathLike[str]) -> None:
        """Write the table to a file; numbers are written so that they read back the same.

        Args:
            path: The file.

        Raises:
            OSError: if it cannot be written; what was there before stays.
        """
        columns = self.columns()
        rows = zip(*(np.asarray(column).tolist() for column in columns.values()), strict=True)
        with replacing(path) as aside, aside.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(columns)
            writer.writerows(rows)
