"""Representations of result objects: text, notebook cell, plot and table.

Objects provide facts and columns; this module lays them out. `pictures` registers the plots in
`picture`, so that modules of computation do not depend on matplotlib.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Mapping, Sequence
from functools import singledispatch
from html import escape
from importlib import import_module
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from gym_passive_walker._tools.arguments import unknown
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


_Columns = Mapping[str, NDArray]


class Table(Shown):
    """An object that is also a table."""

    __slots__ = ()

    def columns(self) -> _Columns:
        """Columns of the table by name, each (rows,), in the units of the attributes."""
        raise NotImplementedError

    def column_units(self) -> dict[str, str]:
        """Units of the columns that have one, by name."""
        return {}

    def to_dataframe(self, columns: Sequence[str] | None = None) -> Any:
        """Return the table as a pandas data frame; its `attrs` have the units.

        Args:
            columns: Names of columns, in order; all when None.

        Raises:
            ImportError: if pandas is not installed.
            ValueError: if there is no such column.
        """
        chosen = self._chosen(columns)
        with extra("tables"):
            import pandas  # type: ignore[import-not-found]
        frame = pandas.DataFrame(dict(chosen))
        frame.attrs["units"] = self._units_of(chosen)
        return frame

    def to_csv(self, path: str | PathLike[str], columns: Sequence[str] | None = None) -> None:
        """Write the table to a CSV file, with all digits of the numbers.

        Units follow the names in the first line, as in "speed (m/s)".

        Args:
            path: The file.
            columns: Names of columns, in order; all when None.

        Raises:
            OSError: if the file cannot be written; an existing file is then unchanged.
            ValueError: if there is no such column.
        """
        self._write(path, columns, _csv)

    def save(self, path: str | PathLike[str], columns: Sequence[str] | None = None) -> None:
        """Write the table to a file in the format of its ending.

        Args:
            path: The file, with the ending .csv, .mat (MATLAB), .npz (NumPy) or .parquet. Missing
                entries are "" or NaN in .mat and .npz.
            columns: Names of columns, in order; all when None.

        Raises:
            ImportError: if the ending is .parquet and pyarrow is not installed.
            OSError: if the file cannot be written; an existing file is then unchanged.
            ValueError: if the path has another ending, or there is no such column.
        """
        self._write(path, columns, WRITERS[table_ending(path)])

    def _chosen(self, names: Sequence[str] | None) -> _Columns:
        table = self.columns()
        if names is None:
            return table
        names = [names] if isinstance(names, str) else [*names]
        if not names:
            raise ValueError("columns must name one column or more, or be None for all")
        if strange := unknown(names, [*table], "this table"):
            raise ValueError(strange)
        return {name: table[name] for name in names}

    def _units_of(self, columns: _Columns) -> dict[str, str]:
        units = self.column_units()
        return {name: units[name] for name in columns if name in units}

    def _write(
        self, path: str | PathLike[str], columns: Sequence[str] | None, write: Writer
    ) -> None:
        chosen = self._chosen(columns)
        with replacing(path) as aside:
            write(aside, chosen, self._units_of(chosen))


Writer = Callable[[Path, _Columns, Mapping[str, str]], object]


def _csv(path: Path, columns: _Columns, units: Mapping[str, str]) -> None:
    rows = zip(*(np.asarray(column).tolist() for column in columns.values()), strict=True)
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(f"{name} ({units[name]})" if name in units else name for name in columns)
        writer.writerows(rows)


def _typed(column: NDArray) -> NDArray:
    """Return a column of Python objects as numbers or as text; None becomes NaN or ""."""
    if column.dtype.kind != "O":
        return column
    known = [value for value in column.tolist() if value is not None]
    if known and all(isinstance(value, bool | int | float) for value in known):
        return column.astype(float)
    return np.array(["" if value is None else str(value) for value in column.tolist()])


def _npz(path: Path, columns: _Columns, units: Mapping[str, str]) -> None:
    with path.open("wb") as file:  # to a name, NumPy may add ".npz"
        np.savez_compressed(file, **{name: _typed(x) for name, x in columns.items()})  # type: ignore[arg-type]


def _parquet(path: Path, columns: _Columns, units: Mapping[str, str]) -> None:
    with extra("sweep"):
        import pyarrow
        from pyarrow import parquet
    table = pyarrow.table(dict(columns))
    fields = [
        field.with_metadata({"unit": units[field.name]} if field.name in units else None)
        for field in table.schema
    ]
    parquet.write_table(table.cast(pyarrow.schema(fields)), path)


def _mat(path: Path, columns: _Columns, units: Mapping[str, str]) -> None:
    from scipy.io import savemat

    typed = {name: _typed(x) for name, x in columns.items()}
    texts = {name: x.astype(object) for name, x in typed.items() if x.dtype.kind == "U"}
    with path.open("wb") as file:
        savemat(file, {**typed, **texts, "units": dict(units)}, long_field_names=True,
                oned_as="column")  # fmt: skip


WRITERS: dict[str, Writer] = {".csv": _csv, ".mat": _mat, ".npz": _npz, ".parquet": _parquet}
"""Functions that write a table, by the ending of its file."""


def table_ending(path: str | PathLike[str]) -> str:
    """Return the ending of a file for a table, in lower case.

    Raises:
        ValueError: if no table is written to such a file.
    """
    ending = Path(path).suffix.lower()
    if ending not in WRITERS:
        *most, last = WRITERS
        raise ValueError(
            f"a table is written to a file that ends in {', '.join(most)} or {last}, "
            f"not {str(path)!r}"
        )
    return ending
