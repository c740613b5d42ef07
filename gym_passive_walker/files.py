"""Files that a program writes: aside first, then renamed, so that none is ever left half."""

from __future__ import annotations

import errno
import glob
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def replacing(path: str | os.PathLike[str]) -> Iterator[Path]:
    """A path to write a file or a folder at, which then takes the place of `path` at once.

    A folder takes the place of none: its name has to be new. What killed writers of the same path
    left aside is removed. A link stays a link, and a device or a pipe is written as it is.

    Args:
        path: The file or the folder; folders above it are made.

    Yields:
        Where to write, with the same ending, by which writers choose formats.

    Raises:
        OSError: if it cannot be written; it names `path`, which is as it was.
    """
    try:
        target = Path(os.path.realpath(path))
        if target.exists() and not target.is_file() and not target.is_dir():
            yield Path(path)
            return
        target.parent.mkdir(parents=True, exist_ok=True)
        # The ending of what was asked for, which that of a link's target may not be.
        stem, suffix = target.stem, Path(path).suffix
        aside = target.with_name(f".{stem}.{os.getpid()}{suffix}")
        for left in target.parent.glob(f".{glob.escape(stem)}.*{glob.escape(suffix)}"):
            if _abandoned(left.name.removeprefix(f".{stem}.").removesuffix(suffix)):
                remove(left)
        try:
            yield aside
            os.replace(aside, target)
        finally:
            remove(aside)
    except OSError as error:
        raise OSError(error.errno, error.strerror or str(error), str(path)) from None


def prepare(path: str | os.PathLike[str]) -> Path:
    """Make the folders above a file that long work will write, and refuse what cannot be one.

    Args:
        path: The file.

    Returns:
        Its path.

    Raises:
        OSError: if it is a folder, or it or the folder that it is in cannot be written.
    """
    found = Path(path)
    try:
        found.parent.mkdir(parents=True, exist_ok=True)
        if found.is_dir():
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
        if not os.access(found if found.exists() else found.parent, os.W_OK):
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
    except OSError as error:
        raise OSError(error.errno, error.strerror or str(error), str(path)) from None
    return found


def _abandoned(writer: str) -> bool:
    """Whether a writer, by the number of its process, writes no more."""
    if not writer.isdecimal():
        return False  # a file of someone else's
    if int(writer) == os.getpid():
        return True
    if os.name == "nt":
        return False  # to ask would end it
    try:
        os.kill(int(writer), 0)
    except ProcessLookupError:
        return True
    except (OSError, OverflowError):  # someone else's, or no process's number
        return False
    return False


def remove(path: Path) -> None:
    """Remove a file or a folder, if it is there."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)
