"""Kernels whose compilation by numba is told of."""

from __future__ import annotations

from contextlib import AbstractContextManager
from typing import Any

from numba.core.event import Event, Listener, register

from gym_passive_walker.progress import compiling


class _Announcer(Listener):
    """Hears of every compilation in the process, and tells of this package's kernels alone."""

    def __init__(self) -> None:
        self.names: dict[Any, str] = {}
        self._under_way: dict[Any, AbstractContextManager[None]] = {}

    def on_start(self, event: Event) -> None:
        """Numba begins to compile a function."""
        kernel = _compiled(event)
        if kernel in self.names and not self._under_way:  # a kernel that it calls belongs to it
            self._under_way[kernel] = compiling(self.names[kernel])
            self._under_way[kernel].__enter__()

    def on_end(self, event: Event) -> None:
        """Numba has compiled it, or failed to."""
        under_way = self._under_way.pop(_compiled(event), None)
        if under_way is not None:
            under_way.__exit__(None, None, None)


def _compiled(event: Any) -> Any:
    return event.data["dispatcher"]


_ANNOUNCER = _Announcer()
register("numba:compile", _ANNOUNCER)


def announce(kernel: Any, what: str) -> None:
    """Tell of a kernel's compilations from now on, if they take long.

    Args:
        kernel: What numba made of a function.
        what: What it is to be called.
    """
    _ANNOUNCER.names[kernel] = what
