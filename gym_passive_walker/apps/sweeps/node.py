"""Work that one process on each machine does for all: compilation, while the others wait."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from gym_passive_walker.apps.build import GROUPS
from gym_passive_walker.apps.build import pieces as group_pieces
from gym_passive_walker.engine.cache import cache_directory


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
    """Compile all equations and kernels, unless this machine has done so before."""
    folder = cache_directory()
    if folder is None or (folder / "swept").exists():
        return
    with locked(folder / "sweeping"):
        if not (folder / "swept").exists():
            for piece in pieces():
                piece()
            (folder / "swept").touch()


def pieces() -> Iterator[Callable[[], object]]:
    """Yield functions, each of which compiles a part of the package when called."""
    for group in GROUPS:
        yield from group_pieces(group)
