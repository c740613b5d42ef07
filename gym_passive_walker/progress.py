"""What long work says while it lasts, on standard error.

That something compiles is said wherever standard error goes, since a silent minute looks like a
fault. A bar is for eyes: it is drawn on a terminal alone, and only of work that takes a while.
Elsewhere, in a log or a notebook, long work writes a line every minute.
"""

from __future__ import annotations

import shutil
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager

_UNSAID = 1.0  # seconds that pass without a word
_UNSEEN = 2.0  # seconds of work that pass without a bar
_PACE = 0.1  # seconds between two looks of a bar
_REPORT = 60.0  # seconds between two lines where there is no terminal
_CELLS = 20


class _Bar:
    """One piece of work, and how much of it is done."""

    def __init__(self, what: str, total: float | None) -> None:
        self.what, self.total, self.done, self.note = what, total, 0.0, ""
        self.began = time.monotonic()

    def advance(self, amount: float = 1.0, *, note: str = "") -> None:
        """So much more is done; a note says how it goes."""
        self.done, self.note = self.done + amount, note
        _LINE.show()

    def __str__(self) -> str:
        if self.total is None:
            return f"{self.what} {self.done:g}"
        full = round(_CELLS * min(self.done / self.total, 1.0))
        bar = f"{self.what} [{'#' * full:-<{_CELLS}}] {self.done:g}/{self.total:g}"
        return f"{bar}, {self.note}" if self.note else bar


class _Line:
    """The terminal's last line: what is under way, the outermost work first."""

    def __init__(self) -> None:
        self.bars: list[_Bar] = []
        self.hushed = False
        self._drawn = False
        self._shown = self._reported = -_REPORT

    def show(self) -> None:
        """Draw it, or write it where there is no terminal, if it is time to."""
        bars, now = tuple(self.bars), time.monotonic()
        if not bars or now - bars[0].began < _UNSEEN or now - self._shown < _PACE:
            return
        self._shown = now
        parts = [str(bar) for bar in bars if bar.total != 1]  # else it has no parts to show
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
        """Leave nothing of it."""
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
    """Show how far the work is, while it waits for others to do more of it."""
    _LINE.show()


def hush() -> None:
    """Draw no bar in this process, whose terminal is another's."""
    _LINE.hushed = True


@contextmanager
def progress(what: str, total: float | None = None) -> Iterator[Callable[..., None]]:
    """Show a bar while something long is done; a line a minute where there is no terminal.

    Work within the work is shown behind it, on the same line.

    Args:
        what: What is done.
        total: How much there is to do; None if nobody knows.

    Yields:
        A function to call whenever one more is done, or a given amount, with a `note` if there is
        something to say of it.
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
    """Say once what is done, and how long it took, unless that is over in a second.

    Args:
        what: What is done, a sentence without its full stop.
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


def compiling(what: str) -> AbstractContextManager[None]:
    """Say once what is compiled, as `said`.

    Args:
        what: What is compiled.
    """
    return said(f"gym_passive_walker compiles {what}, this once")


def _tell(text: str) -> None:
    """Write to standard error, where there is one."""
    if sys.stderr is not None:
        sys.stderr.write(text)
        sys.stderr.flush()
