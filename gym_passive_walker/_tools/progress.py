"""Progress of long work, on standard error.

Compilation is always reported, since a minute without output looks like a fault. On a terminal and
in a notebook, work of more than two seconds has a bar of tqdm, if tqdm is installed. Elsewhere, as
in a log, long work writes a line every minute.
"""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from importlib.util import find_spec
from typing import Any

_UNSAID = 1.0  # seconds of work before a notice
_UNSEEN = 2.0  # seconds of work before a bar
_PACE = 0.1  # seconds between two updates of a bar
_REPORT = 60.0  # seconds between two lines where there are no bars


_LOCK = threading.RLock()  # of all bars; tqdm's own is a semaphore of the system


class _Work:
    """Progress of one piece of work."""

    def __init__(self, what: str, total: float | None) -> None:
        self.what, self.total, self.done, self.note = what, total, 0.0, ""
        self.began, self.bar = time.monotonic(), _bar(what, total)

    def advance(self, amount: float = 1.0, *, note: str = "") -> None:
        """Add an amount of finished work; the note appears behind the bar."""
        self.done, self.note = self.done + amount, note
        show()

    def __str__(self) -> str:
        of = "" if self.total is None else f"/{self.total:g}"
        return f"{self.what} {self.done:g}{of}{self.note and f', {self.note}'}"


class _State:
    """Progress of all present work in this process."""

    def __init__(self) -> None:
        self.works: list[_Work] = []  # the outermost first
        self.hushed = self.silent = False
        self.compilations = 0  # that have begun, one within another
        self.reported = -_REPORT

    @property
    def bars(self) -> list[Any]:
        return [work.bar for work in self.works if work.bar is not None]


_STATE = _State()


def _bar(what: str, total: float | None) -> Any:
    """Return a bar; None if it cannot be seen or shows nothing, and without tqdm."""
    if _STATE.hushed or sys.stderr is None or total == 1:
        return None
    notebook = "ipykernel.zmqshell" in sys.modules and find_spec("ipywidgets") is not None
    if not (notebook or sys.stderr.isatty()):
        return None
    try:
        from tqdm.auto import tqdm
    except ImportError:
        return None
    # No thread that monitors bars: it would make a later fork of the process unsafe.
    bars: Any = type("Bar", (tqdm,), {"monitor_interval": 0})
    bars.set_lock(_LOCK)
    count = "{n:g}" if total is None else f"|{{bar}}| {{n:g}}/{total:g}"
    shown = {"bar_format": f"{{desc}}: {count} [{{elapsed}}{{postfix}}]", "dynamic_ncols": True}
    due = {"delay": _UNSEEN, "mininterval": _PACE, "miniters": 0}
    return bars(desc=what, total=total, file=sys.stderr, leave=False, **shown, **due)


def show() -> None:
    """Update progress, also while this process waits for others."""
    works = [work for work in _STATE.works if work.total != 1]  # one part shows no progress
    for work in works:
        if work.bar is not None:
            work.bar.n = work.done
            work.bar.set_postfix_str(work.note, refresh=False)
            work.bar.update(0)
    if not works or _STATE.bars or _STATE.hushed:
        return
    began, now = _STATE.works[0].began, time.monotonic()
    if now - max(began, _STATE.reported) >= _REPORT:
        _STATE.reported = now
        _tell(f"{', '.join(map(str, works))}, {now - began:.0f} s\n")


def disable_progress(*, notices: bool = False) -> None:
    """Disable progress bars in this process; its terminal belongs to another process.

    Args:
        notices: Whether to disable notices of compilation too.
    """
    _STATE.hushed, _STATE.silent = True, notices


@contextmanager
def progress(what: str, total: float | None = None) -> Iterator[Callable[..., None]]:
    """Show a progress bar for the enclosed work; a line every minute where there are no bars.

    Args:
        what: Name of the work.
        total: Amount of work; None if it is unknown.

    Yields:
        A function that adds an amount of finished work, 1 by default. Its argument `note` is text
        behind the bar.
    """
    work = _Work(what, total)
    _STATE.works.append(work)
    try:
        yield work.advance
    finally:
        _STATE.works.remove(work)
        if work.bar is not None:
            work.bar.total = None  # in a notebook, a bar that ends early stays, in red
            work.bar.close()


@contextmanager
def said(what: str) -> Iterator[None]:
    """Write a notice and the duration of the enclosed work, if it takes longer than a second.

    Args:
        what: The notice, a sentence without its full stop.
    """
    began, heard = time.monotonic(), threading.Event()

    def say() -> None:
        heard.set()
        for bar in _STATE.bars:
            bar.clear()
        _tell(f"{what} ...")

    timer = threading.Timer(_UNSAID, say)
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()
        timer.join()
        if heard.is_set():
            _tell(f" {time.monotonic() - began:.1f} s\n")


@contextmanager
def compiling(what: str) -> Iterator[None]:
    """Write a notice of a compilation, if it takes longer than a second.

    Args:
        what: Name of what is compiled.
    """
    notice = f"gym_passive_walker compiles {what}, this once"
    with nullcontext() if _STATE.silent else said(notice):
        _STATE.compilations += 1
        _report_compilation(1)
        try:
            yield
        finally:
            _STATE.compilations -= 1
            _report_compilation(0)


def _report_compilation(outermost: int) -> None:
    """Call what waits for compilations, when the outermost of them begins or has ended."""
    if _STATE.compilations == outermost:
        for called in COMPILING:
            called(bool(outermost))


COMPILING: list[Callable[[bool], object]] = []
"""Functions that are called with True before each compilation, and with False after it."""


def _tell(text: str) -> None:
    """Write to standard error, if it exists."""
    if sys.stderr is not None:
        sys.stderr.write(text)
        sys.stderr.flush()
