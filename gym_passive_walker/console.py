"""How programs end and print: the command line, train.py, benchmarks and validation.

The package loads this module before anything that takes time, and the module needs nothing but
Python: so Ctrl-C ends a program in a line also while it is loading.
"""

from __future__ import annotations

import codecs
import io
import os
import signal
import sys
import threading
from collections.abc import Callable, Mapping
from typing import Any, NoReturn

INTERRUPTED = 130
"""The exit status after Ctrl-C, as shells have it."""

_PROGRAMS = ("passive-walker", "passive-walker.exe", "train.py", "-m")
# While Python imports the parent package of what `python -m` runs, that is the program's name.

_FILES = {OSError: 2}
_SHOWN = 200  # characters of a text
_ERRORS = "gym_passive_walker.plain"
_PLAIN = {
    "√": "sqrt", "γ": "slope", "θ": "angle", "—": "-", "–": "-", "−": "-", "×": "x", "·": "*",
    "±": "+-", "²": "^2", "³": "^3", "°": " deg", "≤": "<=", "≥": ">=", "…": "...", "’": "'",
    "ö": "oe",
}  # fmt: skip


def _plain(error: UnicodeError) -> tuple[str, int]:
    """Plain forms of the characters that an output's encoding lacks; "?" where there is none."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    lacking = error.object[error.start : error.end]
    return "".join(_PLAIN.get(character, "?") for character in lacking), error.end


codecs.register_error(_ERRORS, _plain)


def print_in_any_encoding() -> None:
    """Print plain forms of what standard output cannot encode, where that would be an error."""
    output = sys.stdout
    if isinstance(output, io.TextIOWrapper) and output.errors in ("strict", "surrogateescape"):
        output.reconfigure(errors=_ERRORS)


def forget_output() -> None:
    """Give up what cannot be printed, so that Python does not try again when it exits."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def cut(text: str) -> str:
    """A text as a message shows it: what is long loses its middle."""
    half = _SHOWN // 2
    return text if len(text) <= _SHOWN else f"{text[:half]} ... {text[-half:]}"


def sentence(error: BaseException) -> str:
    """What an error says; of a file, its name and the system's own words."""
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
        work: What it does; its exit status, or None for 0.
        name: Begins messages, such as "train.py: ".
        refusals: Errors that end the program in a sentence and not in a traceback, and the exit
            status of each.
        stopped: Said after Ctrl-C.

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
    except BrokenPipeError:  # the reader has read enough
        forget_output()
        return 0
    except tuple(refusals) as error:
        try:
            if sys.stdout is not None:
                sys.stdout.flush()  # first what was computed
        except OSError:
            forget_output()
        print(f"{name}error: {sentence(error)}", file=sys.stderr)
        return next(status for kind, status in refusals.items() if isinstance(error, kind))
    except KeyboardInterrupt:
        print(f"\n{name}{stopped}", file=sys.stderr)
        return INTERRUPTED


def _stop(number: int, frame: object) -> NoReturn:
    os.write(2, b"\nstopped\n")
    os._exit(INTERRUPTED)


# An exception would not do: what is being imported may catch it. Programs of others that import
# the package keep Python's own traceback, and a Ctrl-C that is ignored stays so.
if (
    sys.argv
    and os.path.basename(sys.argv[0]) in _PROGRAMS
    and threading.current_thread() is threading.main_thread()
    and signal.getsignal(signal.SIGINT) is signal.default_int_handler
):
    signal.signal(signal.SIGINT, _stop)
