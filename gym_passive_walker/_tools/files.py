"""Atomic writing of files: under a temporary name first, then renamed."""

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
    """Provide a temporary path, and rename it to `path` after the enclosed code.

    An existing file is replaced, an existing folder is not. Temporary files that killed writers of
    `path` left are removed. A link stays a link; a device or a pipe is written directly.

    Args:
        path: The file or the folder; its parent folders are created.

    Yields:
        The temporary path, with the ending of `path`, by which writers choose formats.

    Raises:
        OSError: if `path` cannot be written; it is then unchanged.
    """
    try:
        target = Path(os.path.realpath(path))
        if target.exists() and not target.is_file() and not target.is_dir():
            yield Path(path)
            return
        target.parent.mkdir(parents=True, exist_ok=True)
        # The ending is that of `path`, not of a link's target.
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
    """Create the parent folders of a file, and check before long work that it can be written.

    Args:
        path: The file.

    Returns:
        The path of the file.

    Raises:
        OSError: if the path is a folder, or the file or its folder cannot be written.
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
    """Return whether the process of a writer, by its id, has ended or is this one."""
    if not writer.isdecimal():
        return False  # not a temporary file of this module
    if int(writer) == os.getpid():
        return True
    if os.name == "nt":
        return False  # on Windows `os.kill` would end the process
    try:
        os.kill(int(writer), 0)
    except ProcessLookupError:
        return True
    except (OSError, OverflowError):  # another user's process, or an invalid id
        return False
    return False


def remove(path: Path) -> None:
    """Remove a file or a folder if it exists."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)
