"""Work that one process on each machine does for all: compilation, while the others wait."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from gym_passive_walker.apps.build import GROUPS, pieces
from gym_passive_walker.engine.cache import cache_directory
from gym_passive_walker.engine.machine import is_built


@contextmanager
def locked(path: Path, *, wait: bool = True) -> Iterator[None]:
    """Hold an exclusive lock on a file, which is created if necessary.

    The operating system releases the lock when a process ends. On Windows there is no lock.

    Raises:
        BlockingIOError: if another process holds the lock and `wait` is False.
    """
    with path.open("a", encoding="utf-8") as file:
        try:
            import fcntl
        except ImportError:  # Windows: no lock
            pass
        else:
            fcntl.flock(file, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
        yield


def compile_once() -> None:
    """Compile all that sweeps use, unless the package has it or this machine has done so before."""
    folder = None if is_built() else cache_directory()
    if folder is None or (folder / "swept").exists():
        return
    with locked(folder / "sweeping"):
        if not (folder / "swept").exists():
            for piece in pieces(GROUPS[:-1]):  # those of larger systems when one is used
                piece()
            (folder / "swept").touch()
