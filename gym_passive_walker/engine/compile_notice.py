"""Notices on standard error while numba compiles this package's kernels."""

from __future__ import annotations

from contextlib import AbstractContextManager
from typing import Any

from numba.core.event import Event, Listener, register

from gym_passive_walker._tools.progress import compiling


class _Announcer(Listener):
    """Listens to all compilations in the process; reports those of registered kernels."""

    def __init__(self) -> None:
        self.names: dict[Any, str] = {}
        self._under_way: dict[Any, AbstractContextManager[None]] = {}

    def on_start(self, event: Event) -> None:
        """Begin a notice when numba begins to compile a registered kernel."""
        kernel = _compiled(event)
        if kernel in self.names and not self._under_way:  # one notice covers nested kernels
            self._under_way[kernel] = compiling(self.names[kernel])
            self._under_way[kernel].__enter__()

    def on_end(self, event: Event) -> None:
        """End the notice when numba has compiled the kernel, or failed to."""
        under_way = self._under_way.pop(_compiled(event), None)
        if under_way is not None:
            under_way.__exit__(None, None, None)


def _compiled(event: Any) -> Any:
    return event.data["dispatcher"]


_ANNOUNCER = _Announcer()
register("numba:compile", _ANNOUNCER)


def announce(kernel: Any, what: str) -> None:
    """Report compilations of a kernel from now on, if they take long.

    Args:
        kernel: Numba's dispatcher of the kernel.
        what: Name of the kernel in the notice.
    """
    _ANNOUNCER.names[kernel] = what
