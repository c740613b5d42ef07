"""Progress of long work, on standard error.

Compilation is always reported, since a minute without output looks like a fault. A progress bar is
drawn only on a terminal, and only after two seconds. Elsewhere, in a log or a notebook, long work
writes a line every minute.
"""

from __future__ import annotations

import shutil
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext

_UNSAID = 1.0  # seconds of work before a notice
_UNSEEN = 2.0  # seconds of work before a bar
_PACE = 0.1  # seconds between two updates of a bar
_REPORT = 60.0  # seconds between two lines where there is no terminal
_CELLS = 20


class _Bar:
    """Progress of one piece of work."""

    def __init__(self, what: str, total: float | None) -> None:
        self.what, self.total, self.done, self.note = what, total, 0.0, ""
        self.began = time.monotonic()

    def advance(self, amount: float = 1.0, *, note: str = "") -> None:
        """Add an amount of finished work; the note appears behind the bar."""
        self.done, self.note = self.done + amount, note
        _LINE.show()

    def __str__(self) -> str:
        if self.total is None:
            return f"{self.what} {self.done:g}"
        full = round(_CELLS * min(self.done / self.total, 1.0))
        bar = f"{self.what} [{'#' * full:-<{_CELLS}}] {self.done:g}/{self.total:g}"
        return f"{bar}, {self.note}" if self.note else bar


class _Line:
    """The terminal's last line: bars of all present work, the outermost first."""

    def __init__(self) -> None:
        self.bars: list[_Bar] = []
        self.hushed = self.silent = False
        self.compilations = 0  # that have begun, one within another
        self._drawn = False
        self._shown = self._reported = -_REPORT

    def show(self) -> None:
        """Draw the line, or write it where there is no terminal, if it is due."""
        bars, now = tuple(self.bars), time.monotonic()
        if not bars or now - bars[0].began < _UNSEEN or now - self._shown < _PACE:
            return
        self._shown = now
        parts = [str(bar) for bar in bars if bar.total != 1]  # work of one part shows no progress
        if not parts or self.hushed or sys.stderr is None:
            return
        text = f"{', '.join(parts)}, {now - bars[0].began:.0f} s"
        if sys.stderr.isatty():
            self._write(text)
            self._drawn = True
        elif now - max(bars[0].began, self._reported) >= _REPORT:
            self._reported = now
            _tell(f"{text}\n")

    def wipe(self) -> None:
        """Erase the line."""
        if self._drawn:
            self._write("")
            sys.stderr.write("\r")
            self._drawn = False

    def _write(self, text: str) -> None:
        columns = shutil.get_terminal_size().columns - 1
        sys.stderr.write("\r" + text[:columns].ljust(columns))
        sys.stderr.flush()


_LINE = _Line()


def show() -> None:
    """Update the progress line while this process waits for others."""
    _LINE.show()


def disable_progress(*, notices: bool = False) -> None:
    """Disable progress bars in this process; its terminal belongs to another process.

    Args:
        notices: Whether to disable notices of compilation too.
    """
    _LINE.hushed, _LINE.silent = True, notices


@contextmanager
def progress(what: str, total: float | None = None) -> Iterator[Callable[..., None]]:
    """Show a progress bar for the enclosed work; a line every minute where there is no terminal.

    Bars of nested work follow on the same line.

    Args:
        what: Name of the work.
        total: Amount of work; None if it is unknown.

    Yields:
        A function that adds an amount of finished work, 1 by default. Its argument `note` is text
        behind the bar.
    """
    bar = _Bar(what, total)
    _LINE.bars.append(bar)
    try:
        yield bar.advance
    finally:
        _LINE.bars.remove(bar)
        if not _LINE.bars:
            _LINE.wipe()


@contextmanager
def said(what: str) -> Iterator[None]:
    """Write a notice and the duration of the enclosed work, if it takes longer than a second.

    Args:
        what: The notice, a sentence without its full stop.
    """
    began, heard = time.monotonic(), threading.Event()

    def say() -> None:
        heard.set()
        _LINE.wipe()
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
    with nullcontext() if _LINE.silent else said(notice):
        _LINE.compilations += 1
        _report_compilation(1)
        try:
            yield
        finally:
            _LINE.compilations -= 1
            _report_compilation(0)


def _report_compilation(outermost: int) -> None:
    """Call what waits for compilations, when the outermost of them begins or has ended."""
    if _LINE.compilations == outermost:
        for called in COMPILING:
            called(bool(outermost))


COMPILING: list[Callable[[bool], object]] = []
"""Functions that are called with True before each compilation, and with False after it."""


def _tell(text: str) -> None:
    """Write to standard error, if it exists."""
    if sys.stderr is not None:
        sys.stderr.write(text)
        sys.stderr.flush()
