"""Lock of a folder against other processes."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]


@contextmanager
def locked(path: Path) -> Iterator[None]:
    """Hold an exclusive lock on a file, which is created if necessary.

    The operating system releases the lock when a process ends.

    Raises:
        BlockingIOError: if another process holds the lock.
    """
    with path.open("a", encoding="utf-8") as file:
        if fcntl is not None:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        elif not _locked_on_windows(file.fileno()):
            raise BlockingIOError(f"another process holds {path}")
        yield


def _locked_on_windows(number: int) -> bool:
    """Lock the first byte of a file, which may be empty; return whether that succeeded."""
    import msvcrt

    try:
        msvcrt.locking(number, msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined]
    except PermissionError:
        return False
    return True
