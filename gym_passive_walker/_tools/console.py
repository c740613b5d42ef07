"""Output and exit of programs: the command line, train.py, benchmarks and validation.

The package imports this module before all slow modules, and it needs only the standard library.
So Ctrl-C ends a program with one line also during imports.
"""

from __future__ import annotations

import codecs
import errno
import io
import os
import signal
import sys
import threading
from collections.abc import Callable, Container, Mapping, Sequence
from typing import Any, NoReturn

INTERRUPTED = 130
"""Exit status after Ctrl-C, as in shells."""

_PROGRAMS = ("passive-walker", "passive-walker.exe", "train.py", "-m")
# "-m" is the program's name while `python -m` imports the parent package.

_FILES = {OSError: 2}
_SHOWN = 200  # characters of a text in a message
_ERRORS = "gym_passive_walker.plain"
_PLAIN = {
    "√": "sqrt", "γ": "slope", "θ": "angle", "—": "-", "–": "-", "−": "-", "×": "x", "·": "*",
    "±": "+-", "²": "^2", "³": "^3", "°": " deg", "≤": "<=", "≥": ">=", "…": "...", "’": "'",
    "ö": "oe",
}  # fmt: skip


def _plain(error: UnicodeError) -> tuple[str, int]:
    """Replace characters that an encoding lacks by plain ones, or by "?"."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    lacking = error.object[error.start : error.end]
    return "".join(_PLAIN.get(character, "?") for character in lacking), error.end


codecs.register_error(_ERRORS, _plain)


def print_in_any_encoding() -> None:
    """Make standard output replace characters that it cannot encode, instead of raising errors."""
    output = sys.stdout
    if isinstance(output, io.TextIOWrapper) and output.errors in ("strict", "surrogateescape"):
        output.reconfigure(errors=_ERRORS)


def forget_output() -> None:
    """Discard output that cannot be printed, so that Python does not flush it again at exit."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def cut(text: str) -> str:
    """Return a text for a message; the middle of a long text is omitted."""
    half = _SHOWN // 2
    return text if len(text) <= _SHOWN else f"{text[:half]} ... {text[-half:]}"


def in_columns(rows: Sequence[Sequence[str]], left: Container[int] = ()) -> list[str]:
    """Return the rows of a table as lines; numbers of the columns in `left` are aligned left."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        "  ".join(
            cell.ljust(width) if i in left else cell.rjust(width)
            for i, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in rows
    ]


def sentence(error: BaseException) -> str:
    """Return the message of an error; for a file, its name and the system's message."""
    if not isinstance(error, OSError) or not error.strerror:
        return str(error)
    if error.filename is None:
        return error.strerror
    return f"{cut(os.fsdecode(error.filename))}: {error.strerror}"


def run(
    work: Callable[[], int | None],
    *,
    name: str = "",
    refusals: Mapping[Any, int] = _FILES,
    stopped: str = "stopped",
) -> int:
    """Run a program.

    Args:
        work: The program, a function that returns an exit status, or None for 0.
        name: Prefix of messages, such as "train.py: ".
        refusals: Errors that end the program with a message instead of a traceback, and the exit
            status of each.
        stopped: Message after Ctrl-C.

    Returns:
        The exit status.
    """
    print_in_any_encoding()
    if signal.getsignal(signal.SIGINT) is _stop:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        status = work() or 0
        if sys.stdout is not None:
            sys.stdout.flush()
        return status
    except (BrokenPipeError, *refusals) as error:
        if _is_closed_pipe(error):
            forget_output()
            return 0
        try:
            if sys.stdout is not None:
                sys.stdout.flush()  # results before the message
        except OSError:
            forget_output()
        print(f"{name}error: {sentence(error)}", file=sys.stderr)
        return next(status for kind, status in refusals.items() if isinstance(error, kind))
    except KeyboardInterrupt:
        print(f"\n{name}{stopped}", file=sys.stderr)
        return INTERRUPTED


def _is_closed_pipe(error: BaseException) -> bool:
    """Return whether the reader closed the pipe of the output, which on Windows is EINVAL too."""
    if isinstance(error, BrokenPipeError):
        return True
    unnamed = isinstance(error, OSError) and error.filename is None
    return unnamed and os.name == "nt" and error.errno == errno.EINVAL


def _stop(number: int, frame: object) -> NoReturn:
    os.write(2, b"\nstopped\n")
    os._exit(INTERRUPTED)


# A handler that exits, since imported modules may catch an exception. Other programs that import
# the package keep Python's traceback; if SIGINT is ignored, it stays ignored.
if (
    sys.argv
    and os.path.basename(sys.argv[0]) in _PROGRAMS
    and threading.current_thread() is threading.main_thread()
    and signal.getsignal(signal.SIGINT) is signal.default_int_handler
):
    signal.signal(signal.SIGINT, _stop)
