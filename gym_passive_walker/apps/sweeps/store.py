"""Results of a sweep in a folder: a Parquet dataset that is valid at any moment.

Each finished row is written to a journal at once, as a line of JSON with a checksum. At intervals
the journal's rows become a Parquet file, which is written under another name and renamed. The
journal is then emptied. A continued sweep reads both. The name of a Parquet file holds a digest of
its bytes.
"""

from __future__ import annotations

import errno
import hashlib
import json
import os
import time
import zlib
from collections.abc import Collection, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gym_passive_walker._tools.extras import extra
from gym_passive_walker._tools.loading import parse_json, reason
from gym_passive_walker.apps.sweeps.description import Description
from gym_passive_walker.apps.sweeps.lock import locked

DONE, FAILED, TIMED_OUT = "done", "failed", "timed out"

_MANIFEST, _JOURNAL = "sweep.json", "journal.jsonl"
_SECONDS, _ROWS = 20.0, 50_000  # after which a Parquet file is written
_TYPES = {bool: "bool", int: "int64", float: "double", str: "string"}
_START = len('{"crc32": "01234567", ')
_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
_BEFORE = {"task": "int64", "sweep": "string", "version": "string", "seed": "int64"}
_AFTER = {"status": "string", "error": "string", "seconds": "double"}


class Store:
    """The folder of a sweep, locked against other processes.

    Args:
        folder: The folder, created if necessary.
        description: Description of the sweep.
        version: Version of the code that computes the sweep.
        retry: Whether to repeat failed tasks; their rows are removed.

    Raises:
        ValueError: if the folder holds another sweep, another version or other files; if a file of
            the sweep is damaged (it is not changed); or if another process uses the folder.
        OSError: if the folder cannot be written.
        ImportError: if pyarrow is not installed.
    """

    def __init__(
        self, folder: Path, description: Description, version: str, *, retry: bool = False
    ) -> None:
        with extra("sweep"):
            import pyarrow  # type: ignore[import-not-found]
            import pyarrow.parquet  # type: ignore[import-not-found]
        self._arrow, self._parquet = pyarrow, pyarrow.parquet
        self.folder, self._rows_folder = folder, folder / "rows"
        self._same = {"sweep": description.digest, "version": version}
        self._fixed = {**_BEFORE, **_parameters(description.tasks), **_AFTER}
        self.done: dict[int, str] = {}
        self._pending: list[dict[str, Any]] = []
        self._written = time.monotonic()
        self._held = ExitStack()
        _check(folder, description, version)
        try:
            self._open(description, retry)
        except BaseException:
            self._held.close()  # allows a retry in this process after a repair
            raise

    def _open(self, description: Description, retry: bool) -> None:
        """Lock the folder and read its content."""
        with self._writing():
            self._rows_folder.mkdir(parents=True, exist_ok=True)
            try:
                self._held.enter_context(locked(self.folder / "lock"))
            except BlockingIOError:
                raise ValueError(
                    f"another process uses the sweep in {self.folder}: wait until it ends"
                ) from None
        self._manifest = {"description": description.content, "columns": None, **self._same}
        if (self.folder / _MANIFEST).exists():
            self._manifest = read_manifest(self.folder)
        else:
            self._save_manifest()
        self._read(retry)

    def _read(self, retry: bool) -> None:
        """Read the rows of the folder; if a file is damaged, the folder is not changed."""
        failed: list[Path] = []
        for path in sorted(self._rows_folder.glob("*.parquet")):
            with _reading(path, "part"):
                self.done |= (found := self._statuses(path))
            if retry and {*found.values()} != {DONE}:
                failed.append(path)
        rows = self._journal_rows()
        with self._writing():
            for left in self.folder.glob("*.aside"):
                if not left.is_dir():
                    left.unlink()
        for row in rows:
            if row["task"] not in self.done and not (retry and row["status"] != DONE):
                self.done[row["task"]] = row["status"]
                self._pending.append(row)
        with self._writing():
            self._replace(self.folder / _JOURNAL, b"".join(map(_line, self._pending)))
            self._journal = (self.folder / _JOURNAL).open("ab")
        self.flush()
        for path in failed:  # its finished rows move to the journal, and to another file
            rows = [row for row in _table(path).to_pylist() if row["status"] == DONE]
            self._keep(*rows)
            with self._writing():
                path.unlink()
            self.flush()
        if retry:
            self.done = {task: status for task, status in self.done.items() if status == DONE}

    def _statuses(self, path: Path) -> dict[int, str]:
        """Return the status of each task of a file of the dataset.

        Raises:
            ValueError: if the file is damaged, or not of this sweep.
        """
        table = _table(path)
        if not table.schema.equals(self._schema):
            raise ValueError("it has columns that differ from the sweep's")
        if any(table[name].unique().to_pylist() != [said] for name, said in self._same.items()):
            raise ValueError("it has rows of another sweep, or of another version")
        return dict(zip(table["task"].to_pylist(), table["status"].to_pylist(), strict=True))

    def _journal_rows(self) -> list[dict[str, Any]]:
        """Return the rows of the journal; an incomplete last line is ignored.

        Raises:
            ValueError: if another line is not a row of this sweep.
        """
        journal, rows = self.folder / _JOURNAL, []
        if not journal.exists():
            return rows
        with _reading(journal, "journal"):
            lines = journal.read_bytes().split(b"\n")
        for number, line in enumerate(lines, 1):
            try:
                row = _checked_row(line)
                if any(row.get(name) != value for name, value in self._same.items()):
                    raise ValueError("it is of another sweep, or of another version")
                results = self._manifest["columns"]
                if row["status"] == DONE and (results is None or not row.keys() >= results.keys()):
                    raise ValueError(f"its results are not those that {_MANIFEST} names")
            except ValueError as error:
                if number == len(lines) or not line.strip():
                    continue
                raise ValueError(
                    f"line {number} of {journal} is not a row of this sweep ({error}): remove "
                    "that line to repeat its task; nothing was changed"
                ) from None
            rows.append(row)
        return rows

    @property
    def _kinds(self) -> dict[str, str]:
        """Types of the dataset's columns, by name."""
        return self._fixed | (self._manifest["columns"] or {})

    @property
    def _schema(self) -> Any:
        return self._arrow.schema(
            [(name, self._arrow.type_for_alias(kind)) for name, kind in self._kinds.items()]
        )

    def _keep(self, *rows: dict[str, Any]) -> None:
        """Write rows to the journal."""
        with self._writing():
            self._journal.write(b"".join(map(_line, rows)))
            self._journal.flush()
        self._pending += rows

    @contextmanager
    def _writing(self) -> Iterator[None]:
        """Add to an OSError of the enclosed code what the user can do."""
        try:
            yield
        except OSError as error:
            named = f": {error.filename}" if error.filename else ""
            remedy = "free some space" if error.errno in _FULL else "correct that"
            raise OSError(
                f"the sweep in {self.folder} cannot be written ({error.strerror or error}{named}): "
                f"computed rows are kept; {remedy}, and repeat the call to continue"
            ) from error

    def add(self, row: dict[str, Any], results: Mapping[str, Any]) -> None:
        """Store a finished task.

        Args:
            row: The task's number, arguments, status, error, and duration in seconds.
            results: The task's results by name; empty if it failed. If a name is that of a
                parameter or of a column of every sweep, "_found" is appended to it.

        Raises:
            OSError: if the folder cannot be written.
        """
        results = _renamed(results, self._fixed)
        if results:
            kinds = {name: _TYPES[type(value)] for name, value in results.items()}
            if self._manifest["columns"] is None:
                self._manifest["columns"] = kinds
                self._save_manifest()
            columns = self._manifest["columns"]
            if kinds != columns and not _fits(kinds, columns):
                said = f"it found {_said(kinds)}, where others found {_said(columns)}"
                row, results = row | {"status": FAILED, "error": said}, {}
        row = self._same | row | results
        self._keep(row)
        self.done[row["task"]] = row["status"]
        if len(self._pending) >= _ROWS or time.monotonic() - self._written > _SECONDS:
            self.flush()

    def flush(self, *, last: bool = False) -> None:
        """Move the journal's rows to a new file of the dataset.

        The columns are unknown until a task has results. Until then rows stay in the journal,
        unless `last` is True.

        Raises:
            OSError: if the folder cannot be written.
        """
        self._written = time.monotonic()
        columns = self._manifest["columns"]
        if self._pending and (columns is not None or last):
            rows = sorted(self._pending, key=lambda row: row["task"])
            parts = {n: [_as(row.get(n), kind) for row in rows] for n, kind in self._kinds.items()}
            table = self._arrow.Table.from_pydict(parts, schema=self._schema)
            sink = self._arrow.BufferOutputStream()
            self._parquet.write_table(table, sink, write_page_checksum=True)
            data = sink.getvalue()
            with self._writing():
                name = f"{rows[0]['task']:08d}-{_digest(data)}.parquet"
                self._replace(self._rows_folder / name, data)
                self._pending = []
                self._journal.truncate(0)

    def close(self) -> None:
        """Close the journal and release the lock."""
        with self._held, suppress(OSError):  # on a full disk, which was reported before
            self._journal.close()

    def _save_manifest(self) -> None:
        with self._writing():
            self._replace(self.folder / _MANIFEST, json.dumps(self._manifest, indent=1).encode())

    def _replace(self, path: Path, data: Any) -> None:
        """Write a file under another name, then rename it."""
        aside = self.folder / f"{path.name}.aside"
        aside.write_bytes(data)
        os.replace(aside, path)


_REMEDIES = {
    "manifest": "restore a whole copy, or give another folder; its rows can still be read",
    "journal": "restore a whole copy, or move it elsewhere to repeat its tasks",
    "part": "move it elsewhere, and repeat the call to repeat its tasks",
}
"""Advice for the user, by the kind of file that cannot be read."""


@contextmanager
def _reading(path: Path, what: str) -> Iterator[None]:
    """Turn any error while reading a damaged file into a ValueError.

    Raises:
        ValueError: if the file cannot be read, or its content is invalid.
    """
    try:
        yield
    except Exception as error:  # a damaged file may raise anything
        raise ValueError(f"{path} cannot be read ({reason(error)}): {_REMEDIES[what]}") from None


def _digest(data: Any) -> str:
    return hashlib.sha256(data).hexdigest()[:16]


def _table(path: Path) -> Any:
    """Return the table in a file of the dataset.

    Raises:
        ValueError: if the digest in the file's name is not that of its bytes.
    """
    import pyarrow.parquet  # type: ignore[import-not-found]

    data = path.read_bytes()
    if path.stem.rpartition("-")[2] != _digest(data):
        raise ValueError("its name does not have the digest of its bytes")
    return pyarrow.parquet.read_table(pyarrow.BufferReader(data))


def _line(row: dict[str, Any]) -> bytes:
    """Return a row as a line of the journal: JSON that begins with a checksum of the rest."""
    rest = json.dumps(row)[1:]
    return f'{{"crc32": "{zlib.crc32(rest.encode()):08x}", {rest}\n'.encode()


def _checked_row(line: bytes) -> dict[str, Any]:
    """Return the row in a line of the journal.

    Raises:
        ValueError: if its checksum is wrong.
    """
    start, rest = line[:_START], line[_START:]
    if start != f'{{"crc32": "{zlib.crc32(rest):08x}", '.encode():
        raise ValueError("its checksum is wrong")
    return json.loads(b"{" + rest)


def read_manifest(folder: Path) -> dict[str, Any]:
    """Return the manifest of a folder: description, digest, version and columns of the sweep.

    Raises:
        ValueError: if the folder holds no sweep, or its manifest is damaged.
    """
    path = folder / _MANIFEST
    if not path.exists():
        raise ValueError(
            f"{folder} does not contain a sweep, since it has no {_MANIFEST}: give another folder"
        )
    with _reading(path, "manifest"):
        found = parse_json(path.read_bytes())
        if not isinstance(found, dict):
            raise ValueError("it is not a mapping")
        for name, kind in (("description", dict), ("sweep", str), ("version", str)):
            if not isinstance(found.get(name), kind):
                raise ValueError(f"it has no {name}")
        columns = found.get("columns", ...)
        names = columns.items() if isinstance(columns, dict) else [("columns", columns)]
        if columns is not None and not all(kind in [*_TYPES.values()] for _, kind in names):
            raise ValueError("it has no columns")
    return found


def read_description(folder: Path) -> Description:
    """Return the description of the sweep in a folder.

    Raises:
        ValueError: if the folder holds no sweep, or its description cannot be read.
    """
    content = read_manifest(folder)["description"]
    with _reading(folder / _MANIFEST, "manifest"):
        return Description.of(content)


def read_columns(folder: Path) -> dict[str, NDArray]:
    """Return the columns of the dataset by name, each (tasks,), in the order of the tasks.

    Raises:
        ValueError: if the dataset is empty, or a file cannot be read.
        ImportError: if pyarrow is not installed.
    """
    with extra("sweep"):
        import pyarrow.parquet  # type: ignore[import-not-found]
    paths = sorted((folder / "rows").glob("*.parquet"))
    if not paths:
        raise ValueError(f"the sweep in {folder} has no results yet")
    tables: list[Any] = []
    for path in paths:
        with _reading(path, "part"):
            tables.append(_table(path))
            if not tables[-1].schema.equals(tables[0].schema):
                raise ValueError(f"it has other columns than {paths[0].name}")
    table = pyarrow.concat_tables(tables).sort_by("task")
    return {
        name: np.asarray(table[name].to_numpy(zero_copy_only=False)) for name in table.column_names
    }


def holds_another(folder: Path, description: Description) -> bool:
    """Return whether a folder holds a sweep with another description."""
    return (folder / _MANIFEST).exists() and read_manifest(folder)["sweep"] != description.digest


def _check(folder: Path, description: Description, version: str) -> None:
    """Raise a ValueError if a folder holds other files, another sweep or another version."""
    if not folder.exists():
        return
    if not folder.is_dir():
        raise ValueError(f"{folder} is a file: give a folder")
    try:
        empty = not any(folder.iterdir())
    except OSError as error:
        raise ValueError(f"{folder} cannot be read ({error.strerror}): give another one") from None
    if empty:
        return
    there = read_manifest(folder)
    if there["sweep"] != description.digest:
        ours, theirs = description.content, there["description"]
        changed = [name for name, value in ours.items() if theirs.get(name) != value]
        if not changed:
            with _reading(folder / _MANIFEST, "manifest"):
                raise ValueError("its description has another digest")
        raise ValueError(
            f"{folder} holds a sweep with another {' and '.join(changed)}: give another folder, or "
            "use a new folder beside it (branch=True, --branch)"
        )
    if there["version"] != version:
        raise ValueError(
            f"{folder} was computed by version {there['version']}, this is {version}: use that "
            "version, or give another folder"
        )


def _parameters(tasks: list[dict[str, Any]]) -> dict[str, str]:
    """Return the types of the parameters by name; values other than scalars become JSON text."""
    found: dict[str, str] = {}
    for name in tasks[0]:
        kinds = {_TYPES.get(type(given[name]), "string") for given in tasks}
        if kinds == {"int64", "double"}:
            kinds = {"double"}
        found[name] = kinds.pop() if len(kinds) == 1 else "string"
    found.pop("seed", None)
    return found


def _renamed(results: Mapping[str, Any], taken: Collection[str]) -> dict[str, Any]:
    """Return results under names that are not taken."""
    named: dict[str, Any] = {}
    for name, value in results.items():
        while name in taken or name in named:
            name += "_found"
        named[name] = value
    return named


def _fits(kinds: dict[str, str], columns: dict[str, str]) -> bool:
    """Return whether results fit the columns; an integer fits a column of floats."""
    return kinds.keys() == columns.keys() and all(
        kind == columns[name] or (kind, columns[name]) == ("int64", "double")
        for name, kind in kinds.items()
    )


def _as(value: Any, kind: str) -> Any:
    """Convert a value to the type of its column; NaN to None, which is null in the dataset."""
    if value is None or value != value:
        return None
    if kind == "string":
        text = value if isinstance(value, str) else json.dumps(value)
        return text.encode("utf-8", "backslashreplace").decode("utf-8")
    return float(value) if kind == "double" else value


def _said(kinds: dict[str, str]) -> str:
    return ", ".join(f"{name} ({kind})" for name, kind in kinds.items())
