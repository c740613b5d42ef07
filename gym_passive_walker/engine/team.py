"""Threads that share work in pieces, a step of a batch after the other.

To wake a thread of Python takes some 50 µs, and to take over Python's lock as long: that is a step
of hundreds of walkers. So a thread that has helped waits in compiled code for the next step, for a
while, and sleeps only then. The thread that steps takes pieces too. It never waits for another one
to begin, so a step takes no longer than alone.
"""

from __future__ import annotations

import atexit
import ctypes
import os
import threading
import weakref
from collections.abc import Callable
from contextlib import suppress

import numpy as np

from gym_passive_walker.engine.jit import add_at, call, jitted, put_at, view, word_at

_LOOKS = 200_000  # for another step, before a thread lets others run between looks: some 100 µs
_TURNS = 4_000  # of others, before a thread sleeps: some 2 ms where there are none
_LINE = 64  # bytes that the cores of a CPU exchange at once
_NAMES = ("waiting", "left", "helping", "leave", "give_way")
BOARD = np.dtype({"names": _NAMES, "formats": ["i8"] * len(_NAMES),
                  "offsets": [_LINE * i for i in range(len(_NAMES))],
                  "itemsize": _LINE * len(_NAMES)})  # fmt: skip
"""Words that threads share: numbers of pieces that wait, of pieces that are not finished, and of
helping threads; whether these are to leave. The last one is the address of a function that lets
other threads run."""

_WAITING, _LEFT, _HELPING, _LEAVE = (_LINE * i for i in range(4))
_GIVE_WAY = ctypes.windll.kernel32.SwitchToThread if os.name == "nt" else (  # type: ignore[attr-defined]
    ctypes.CDLL(None).sched_yield)  # fmt: skip


@jitted
def offer(board, pieces):
    """Offer the pieces of a step; what they need must be written before."""
    put_at(board + _LEFT, pieces)
    put_at(board + _WAITING, pieces)


@jitted
def helping(board):
    """Return the number of threads that help."""
    return word_at(board + _HELPING)


@jitted
def arrive(board):
    """Note that a thread helps."""
    add_at(board + _HELPING, 1)


@jitted
def take(board, helps):
    """Return the number of a piece to do, or -1 when there is nothing more to do.

    One word counts the waiting pieces down and numbers them: steps differ in their number of
    pieces, and a thread that is late may meet the next step. The thread that steps leaves when all
    pieces are finished, a helping one when it has waited for long, or is to leave.
    """
    given, looks = view(board, (1,), BOARD)[0], 0
    while True:
        if word_at(board + _WAITING) > 0:
            piece = add_at(board + _WAITING, -1) - 1
            if piece >= 0:
                return piece
        looks += 1
        if looks > _LOOKS:
            call(given.give_way, 0, 0, 0, 0, 0.0, 0.0)
        if not helps:
            if word_at(board + _LEFT) == 0:
                return -1
        elif looks > _LOOKS + _TURNS or word_at(board + _LEAVE) != 0:
            add_at(board + _HELPING, -1)
            if word_at(board + _WAITING) <= 0:
                return -1
            add_at(board + _HELPING, 1)  # a step that may have counted on this thread
            looks = 0


@jitted
def finish(board):
    """Note that a piece is finished."""
    add_at(board + _LEFT, -1)


class Board:
    """Where threads share the steps of one batch.

    Attributes:
        address: Address that compiled code takes.
    """

    def __init__(self) -> None:
        self._words = np.zeros(1, BOARD)
        self._words["give_way"] = ctypes.cast(_GIVE_WAY, ctypes.c_void_p).value
        self._helping = self._words["helping"]
        self.address: int = self._words.ctypes.data
        self._team = _TEAM

    def ask(self, most: int, work: Callable[[], object]) -> None:
        """Ask for help with the step that comes.

        Args:
            most: Largest number of threads that help.
            work: Helps in the thread that calls it, until `take` returns -1.
        """
        if self._team is not _TEAM:  # this process is a copy of another one, without its threads
            self._team, self._helping[0] = _TEAM, 0
        if _TEAM.board() is not self or self._helping[0] < most:
            _TEAM.gather(self, most, work)

    def leave(self, now: bool) -> None:
        """Say whether helping threads are to leave."""
        self._words["leave"] = now


class _Helper(threading.Thread):
    """A thread that waits for work."""

    def __init__(self) -> None:
        super().__init__(name="walkers", daemon=True)
        self._bell = threading.Lock()
        self._work: Callable[[], object] | None = _nothing
        self._bell.acquire()
        self.start()

    def run(self) -> None:
        """Work whenever there is work, until there is to be none."""
        while True:
            self._bell.acquire()
            work, self._work = self._work, _nothing
            if work is None:
                return
            work()
            del work  # which may refer to much memory

    def ask(self, work: Callable[[], object] | None) -> None:
        """Ask for work, after what it does now; None ends the thread."""
        self._work = work
        if self._bell.locked():
            self._bell.release()


def _nothing() -> None:
    """Do nothing."""


class _Team:
    """All helping threads of this process; they are at one board at a time."""

    def __init__(self) -> None:
        self.board: Callable[[], Board | None] = lambda: None
        self._helpers: list[_Helper] = []
        self._lock, self._ended = threading.Lock(), False

    def gather(self, board: Board, most: int, work: Callable[[], object]) -> None:
        """Call threads to a board, until `most` are on their way or there."""
        with self._lock:
            if self._ended:
                return
            if (before := self.board()) is not board:
                if before:
                    before.leave(True)
                self.board = weakref.ref(board)
            board.leave(False)
            with suppress(RuntimeError):  # the system may allow no more threads
                while len(self._helpers) < most:
                    self._helpers.append(_Helper())
            for helper in self._helpers[:most]:
                helper.ask(work)

    def end(self) -> None:
        """End all threads, before the interpreter does; other ones may step on, without help."""
        with self._lock:
            self._ended = True
        if board := self.board():
            board.leave(True)
        for helper in self._helpers:
            helper.ask(None)
            helper.join()


def _renew() -> None:
    global _TEAM
    _TEAM = _Team()


_renew()
atexit.register(lambda: _TEAM.end())
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_renew)
