"""What a sweep has found so far, in a folder: a Parquet dataset that is whole at any moment.

A row that is finished goes into a journal at once, a line of JSON. Every so often the journal's
rows become a Parquet file, written aside and renamed; the journal begins anew. Whoever goes on with
the sweep reads both.
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any, TextIO

import numpy as np
from numpy.typing import NDArray

from gym_passive_walker.extras import extra
from gym_passive_walker.sweeps.description import Description
from gym_passive_walker.sweeps.node import locked

DONE, FAILED, TIMED_OUT = "done", "failed", "timed out"

_MANIFEST, _JOURNAL = "sweep.json", "journal.jsonl"
_SECONDS, _ROWS = 20.0, 50_000  # between two files
_TYPES = {bool: "bool", int: "int64", float: "double", str: "string"}
_BEFORE = {"task": "int64", "sweep": "string", "version": "string", "seed": "int64"}
_AFTER = {"status": "string", "error": "string", "seconds": "double"}


class Store:
    """The folder of a sweep, with nobody else in it.

    Args:
        folder: Made if it is not there.
        description: What is swept.
        version: Of what computes.
        retry: Whether tasks that failed are to be done again: their rows are taken out.

    Raises:
        ValueError: if the folder holds another sweep, one of another version, or anything else; or
            if another process is at it.
        ImportError: if pyarrow is not installed.
    """

    def __init__(
        self, folder: Path, description: Description, version: str, *, retry: bool = False
    ) -> None:
        with extra("sweep"):
            import pyarrow  # type: ignore[import-not-found]
            import pyarrow.compute  # type: ignore[import-not-found]
            import pyarrow.parquet  # type: ignore[import-not-found]
        self._arrow, self._parquet = pyarrow, pyarrow.parquet
        self.folder, self._rows_folder = folder, folder / "rows"
        self._same = {"sweep": description.digest, "version": version}
        self._parameters = _columns(description.tasks)
        self.done: dict[int, str] = {}
        self._pending: list[dict[str, Any]] = []
        self._written = time.monotonic()
        self._held = ExitStack()
        _check(folder, description, version)
        self._rows_folder.mkdir(parents=True, exist_ok=True)
        try:
            self._held.enter_context(locked(folder / "lock", wait=False))
        except BlockingIOError:
            raise ValueError(f"another process is at the sweep in {folder}: wait for it") from None
        self._manifest = {"description": description.content, "columns": None, **self._same}
        if (folder / _MANIFEST).exists():
            self._manifest = read_manifest(folder)
        else:
            self._save_manifest()
        self._read(retry)
        with self._writing():
            self._journal = self._new_journal()
        self.flush()

    def _read(self, retry: bool) -> None:
        """Take up what stands in the folder; a torn line at the journal's end is forgotten."""
        for left in self.folder.glob("*.aside"):
            left.unlink()
        for path in sorted(self._rows_folder.glob("*.parquet")):
            if retry:
                self._take_failed_out(path)
        for path in sorted(self._rows_folder.glob("*.parquet")):
            table = self._parquet.read_table(path, columns=["task", "status"])
            self.done |= dict(zip(*(column.to_pylist() for column in table.columns), strict=True))
        journal = self.folder / _JOURNAL
        for line in journal.read_text(encoding="utf-8").splitlines() if journal.exists() else ():
            try:
                row = json.loads(line)
            except ValueError:
                continue
            if row["task"] not in self.done and not (retry and row["status"] != DONE):
                self.done[row["task"]] = row["status"]
                self._pending.append(row)

    def _take_failed_out(self, path: Path) -> None:
        """Leave in a file of the dataset what was done."""
        table = self._parquet.read_table(path)
        done = table.filter(self._arrow.compute.equal(table["status"], DONE))
        if not len(done):
            path.unlink()
        elif len(done) < len(table):
            with self._writing():
                self._put(done, path.name)

    def _put(self, table: Any, name: str) -> None:
        """Write a file of the dataset, in place of one of that name."""
        aside = self.folder / f"{name}.aside"
        self._parquet.write_table(table, aside)
        os.replace(aside, self._rows_folder / name)

    def _new_journal(self) -> TextIO:
        """A journal of the rows that are no part of the dataset yet."""
        aside = self.folder / f"{_JOURNAL}.aside"
        aside.write_text("".join(f"{json.dumps(row)}\n" for row in self._pending), "utf-8")
        os.replace(aside, self.folder / _JOURNAL)
        return (self.folder / _JOURNAL).open("a", encoding="utf-8")

    @contextmanager
    def _writing(self) -> Iterator[None]:
        """Around what writes: says what to do where that fails."""
        try:
            yield
        except OSError as error:
            raise OSError(
                f"the sweep in {self.folder} cannot be written ({error.strerror or error}): what "
                "was computed is kept; make room, and the same call goes on"
            ) from error

    def add(self, row: dict[str, Any], results: Mapping[str, Any]) -> None:
        """Keep a finished task.

        Args:
            row: Its number, what it was given, how it ended, and in how many seconds.
            results: What it found; nothing if it failed.

        Raises:
            OSError: if it cannot be written.
        """
        if results:
            kinds = {name: _TYPES[type(value)] for name, value in results.items()}
            if self._manifest["columns"] is None:
                self._manifest["columns"] = kinds
                with self._writing():
                    self._save_manifest()
            columns = self._manifest["columns"]
            if kinds != columns and not _fits(kinds, columns):
                said = f"it found {_said(kinds)}, where others found {_said(columns)}"
                row, results = row | {"status": FAILED, "error": said}, {}
        row = self._same | row | dict(results)
        with self._writing():
            self._journal.write(json.dumps(row) + "\n")
            self._journal.flush()
        self.done[row["task"]] = row["status"]
        self._pending.append(row)
        if len(self._pending) >= _ROWS or time.monotonic() - self._written > _SECONDS:
            self.flush()

    def flush(self, *, last: bool = False) -> None:
        """Make the journal's rows a file of the dataset.

        As long as no task has found anything, nobody knows the columns: then rows stay where they
        are, unless these are the last.

        Raises:
            OSError: if it cannot be written.
        """
        self._written = time.monotonic()
        columns = self._manifest["columns"]
        if self._pending and (columns is not None or last):
            kinds = {**_BEFORE, **self._parameters, **_AFTER, **(columns or {})}
            schema = self._arrow.schema(
                [(name, self._arrow.type_for_alias(kind)) for name, kind in kinds.items()]
            )
            rows = sorted(self._pending, key=lambda row: row["task"])
            parts = {n: [_as(row.get(n), kind) for row in rows] for n, kind in kinds.items()}
            table = self._arrow.Table.from_pydict(parts, schema=schema)
            last_one = max((path.stem for path in self._rows_folder.glob("*.parquet")), default="0")
            with self._writing():
                self._put(table, f"{int(last_one) + 1:06d}.parquet")
                self._pending = []
                self._journal.truncate(0)

    def close(self) -> None:
        """Leave the folder to others."""
        with self._held, suppress(OSError):  # on a full disk; what was said of it is said
            self._journal.close()

    def _save_manifest(self) -> None:
        aside = self.folder / f"{_MANIFEST}.aside"
        aside.write_text(json.dumps(self._manifest, indent=1), encoding="utf-8")
        os.replace(aside, self.folder / _MANIFEST)


def read_manifest(folder: Path) -> dict[str, Any]:
    """What a folder says it holds: the description, its digest, the version, the columns.

    Raises:
        ValueError: if it holds no sweep.
    """
    try:
        return json.loads((folder / _MANIFEST).read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ValueError(f"{folder} holds no sweep: {error}") from None


def read_columns(folder: Path) -> dict[str, NDArray]:
    """The dataset in the order of its tasks, each column of shape (tasks,).

    Raises:
        ValueError: if there is nothing yet.
        ImportError: if pyarrow is not installed.
    """
    with extra("sweep"):
        import pyarrow.parquet  # type: ignore[import-not-found]
    paths = sorted((folder / "rows").glob("*.parquet"))
    if not paths:
        raise ValueError(f"the sweep in {folder} has found nothing yet")
    tables = [pyarrow.parquet.read_table(path) for path in paths]
    table = pyarrow.concat_tables(tables).sort_by("task")
    return {
        name: np.asarray(table[name].to_numpy(zero_copy_only=False)) for name in table.column_names
    }


def holds_another(folder: Path, description: Description) -> bool:
    """Whether a folder holds a sweep by another description."""
    return (folder / _MANIFEST).exists() and read_manifest(folder)["sweep"] != description.digest


def _check(folder: Path, description: Description, version: str) -> None:
    """Refuse a folder of something else."""
    if not folder.exists() or not any(folder.iterdir()):
        return
    there = read_manifest(folder)
    if there["sweep"] != description.digest:
        ours, theirs = description.content, there["description"]
        changed = [name for name, value in ours.items() if theirs.get(name) != value]
        raise ValueError(
            f"{folder} holds a sweep with another {' and '.join(changed)}: give another folder, or "
            "let it branch into one of its own (branch=True, --branch)"
        )
    if there["version"] != version:
        raise ValueError(
            f"{folder} was computed by version {there['version']}, this is {version}: go on with "
            "that version, or give another folder"
        )


def _columns(tasks: list[dict[str, Any]]) -> dict[str, str]:
    """Types of the parameters; what is neither number, word nor truth is written as JSON."""
    found: dict[str, str] = {}
    for name in tasks[0]:
        kinds = {_TYPES.get(type(given[name]), "string") for given in tasks}
        found[name] = kinds.pop() if len(kinds) == 1 else "string"
        if kinds and {found[name], *kinds} <= {"int64", "double"}:
            found[name] = "double"
    return {name: kind for name, kind in found.items() if name != "seed"}


def _fits(kinds: dict[str, str], columns: dict[str, str]) -> bool:
    """Whether results have these columns; a whole number may stand among others."""
    return kinds.keys() == columns.keys() and all(
        kind == columns[name] or (kind, columns[name]) == ("int64", "double")
        for name, kind in kinds.items()
    )


def _as(value: Any, kind: str) -> Any:
    """A value as its column has it."""
    if value is None:
        return None
    if kind == "string":
        return value if isinstance(value, str) else json.dumps(value)
    return float(value) if kind == "double" else value


def _said(kinds: dict[str, str]) -> str:
    return ", ".join(f"{name} ({kind})" for name, kind in kinds.items())
