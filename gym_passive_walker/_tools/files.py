"""Atomic writing of files: under a temporary name first, then renamed."""

from __future__ import annotations

import errno
import glob
import os
import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from secrets import token_hex

_WRITER = re.compile("([0-9]+)-[0-9a-f]{16}")
"""What a temporary file is named by: the id of its process, and a random part."""

_WRITTEN: set[Path] = set()
"""Temporary files that this process writes."""


@contextmanager
def replacing(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Provide a temporary path, and rename it to `path` after the enclosed code.

    An existing file is replaced, an existing folder is not. Temporary files that killed writers of
    `path` left are removed. A link stays a link; a device or a pipe is written directly.

    Args:
        path: The file or the folder; its parent folders are created.

    Yields:
        The temporary path, with the ending of `path`, by which writers choose formats.

    Raises:
        OSError: if `path` cannot be written; it is then unchanged. Errors of other files that the
            enclosed code uses keep their names.
    """
    target, suffix = Path(os.path.realpath(path)), Path(path).suffix
    # The ending is that of `path`, not of a link's target.
    aside = target.with_name(f".{target.stem}.{os.getpid()}-{token_hex(8)}{suffix}")
    try:
        if _is_device(target):
            yield Path(path)
            return
        target.parent.mkdir(parents=True, exist_ok=True)
        for left in target.parent.glob(f".{glob.escape(target.stem)}.*{glob.escape(suffix)}"):
            writer = left.name.removeprefix(f".{target.stem}.").removesuffix(suffix)
            if left not in _WRITTEN and _abandoned(writer):
                remove(left)
        _WRITTEN.add(aside)
        try:
            yield aside
            os.replace(aside, target)
        finally:
            remove(aside)
            _WRITTEN.discard(aside)
    except OSError as error:
        if _is_of(error, aside, Path(path), target):
            raise OSError(error.errno, error.strerror or str(error), str(path)) from None
        raise


def prepare(path: str | os.PathLike[str]) -> Path:
    """Create the parent folders of a file, and check before long work that it can be written.

    Args:
        path: The file.

    Returns:
        The path of the file.

    Raises:
        OSError: if the path is a folder, or the file cannot be replaced in its folder.
    """
    target = Path(os.path.realpath(path))
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        if target.is_dir():
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
        if not os.access(target if _is_device(target) else target.parent, os.W_OK):
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
    except OSError as error:
        raise OSError(error.errno, error.strerror or str(error), str(path)) from None
    return Path(path)


def _is_of(error: OSError, aside: Path, *others: Path) -> bool:
    """Return whether an error names no file, or a temporary path, one in or above it or others."""
    if error.filename is None:
        return True
    named = Path(os.fsdecode(error.filename))
    return named in (*others, *aside.parents) or aside in (named, *named.parents)


def _is_device(target: Path) -> bool:
    """Return whether something exists at a path that is no file and no folder, as a pipe."""
    return target.exists() and not target.is_file() and not target.is_dir()


def _abandoned(writer: str) -> bool:
    """Return whether the process of a writer, by its id, has ended or is this one."""
    known = _WRITER.fullmatch(writer)
    if known is None:
        return False  # not a temporary file of this module
    number = int(known[1])
    if number == os.getpid():
        return True
    if os.name == "nt":
        return False  # on Windows `os.kill` would end the process
    try:
        os.kill(number, 0)
    except (OSError, OverflowError) as error:  # or another user's process, or an invalid id
        return isinstance(error, ProcessLookupError)
    return False


def remove(path: Path) -> None:
    """Remove a file or a folder if it exists."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)
