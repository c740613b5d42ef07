"""Where compiled code is kept between processes.

It is a convenience, never a condition: code that cannot be read is made afresh, code that cannot be
written lives as long as the process, and one warning says so.
"""

from __future__ import annotations

import hashlib
import os
import stat
import tempfile
import warnings
from collections.abc import Iterator
from contextlib import suppress
from functools import cache
from pathlib import Path

_ROOT = Path(__file__).parent.parent
_SOURCES = ("physics/*", "engine/*", "envs/task", "envs/fates", "envs/reality", "envs/checks")
_SOURCES += ("envs/starts", "envs/ticks", "gaits/forces", "gaits/terrain")
"""What is compiled, and what it is made of."""
_DIGEST = hashlib.sha256().digest_size


@cache
def fingerprint() -> str:
    """A hash of the sources that compiled code depends on: a stale kernel is impossible.

    Numba notices when a function's own file changes, but not when a function that it calls does.
    """
    digest = hashlib.sha256()
    for pattern in _SOURCES:
        for source in sorted(_ROOT.glob(f"{pattern}.py")):
            digest.update(source.name.encode() + source.read_bytes())
    return digest.hexdigest()[:16]


@cache
def cache_directory() -> Path | None:
    """The folder for compiled code, made when it is first asked for; None if there can be none."""
    failures = []
    for base in _bases():
        directory = base / fingerprint()
        try:
            directory.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            failures.append(str(error))
            continue
        if os.access(directory, os.W_OK):
            return directory
        failures.append(f"{directory} is read-only")
    _warn(
        f"compiled code cannot be kept ({'; '.join(failures)}), so that every process compiles it "
        "anew: set NUMBA_CACHE_DIR to a folder that can be written to"
    )
    return None


def _bases() -> Iterator[Path]:
    """Where the folder may be, the best place first."""
    name = "gym_passive_walker"
    if chosen := os.environ.get("NUMBA_CACHE_DIR"):
        yield Path(chosen).absolute() / name  # wherever the program goes from here
    with suppress(RuntimeError):  # a user without a home
        home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
        yield home.absolute() / name
    user = getattr(os, "getuid", lambda: None)()  # Windows has none, and a folder for each user
    shared = Path(tempfile.gettempdir()) / (name if user is None else f"{name}-{user}")
    if user is None or _private(shared, user):
        yield shared


def _private(folder: Path, user: int) -> bool:
    """Whether a folder where others write too is this user's alone; made so if it is not there.

    What is kept holds pickles and machine code: whoever can write them decides what is run.
    """
    with suppress(OSError):
        folder.mkdir(mode=0o700)
    try:
        found = folder.lstat()  # of a link itself, not of where it leads
    except OSError:
        return False
    return stat.S_ISDIR(found.st_mode) and found.st_uid == user and not found.st_mode & 0o077


def found(name: str) -> bytes | None:
    """What is kept by that name, if it is there and whole."""
    directory = cache_directory()
    if directory is None:
        return None
    try:
        kept = (directory / name).read_bytes()
    except FileNotFoundError:
        return None
    except OSError as error:
        _warn(f"compiled code cannot be read, and is made afresh: {error}")
        return None
    digest, data = kept[:_DIGEST], kept[_DIGEST:]
    if hashlib.sha256(data).digest() != digest:  # it would take the process with it
        _warn(f"compiled code in {directory} is damaged, and is made afresh")
        return None
    return data


def keep(name: str, data: bytes) -> None:
    """Keep something by a name, behind a digest; it is there whole or not at all."""
    directory = cache_directory()
    if directory is None:
        return
    aside = directory / f"{name}.{os.getpid()}"
    try:
        aside.write_bytes(hashlib.sha256(data).digest() + data)
        os.replace(aside, directory / name)
    except OSError as error:
        with suppress(OSError):
            aside.unlink()
        _warn(
            f"compiled code cannot be kept in {directory} ({error.strerror}), so that every "
            "process compiles it anew: free some space, or set NUMBA_CACHE_DIR to another folder"
        )


@cache
def _warn(said: str) -> None:
    """Say something once."""
    warnings.warn(said, RuntimeWarning, stacklevel=3)
