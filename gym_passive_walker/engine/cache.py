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
_SOURCES = ("physics/*", "engine/*", "envs/task", "envs/fates", "envs/constraints", "envs/checks")
_SOURCES += (
    "envs/starts",
    "envs/ticks",
    "envs/custom",
    "envs/transitions",
    "gaits/forces",
    "gaits/terrain",
)
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
            base.parent.mkdir(parents=True, exist_ok=True)
            for folder in (base, directory):
                folder.mkdir(mode=0o700, exist_ok=True)
        except OSError as error:
            failures.append(str(error))
            continue
        if strange := [folder for folder in (base, directory) if not _private(folder)]:
            _warn(
                f"compiled code in {strange[0]} is not used, because another user owns that folder "
                "or may write to it: remove it, or set NUMBA_CACHE_DIR to a folder of your own"
            )
            failures.append(f"{strange[0]} is open to another user")
        elif os.access(directory, os.W_OK):
            return directory
        else:
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
    shared = name if _USER is None else f"{name}-{_USER}"
    yield Path(tempfile.gettempdir()) / shared


_USER: int | None = getattr(os, "getuid", lambda: None)()
"""Who runs this; None on Windows, where each user has folders of their own."""


def _ours(status: os.stat_result) -> bool:
    """Whether a file or folder is this user's, and no other user may write to it.

    What is kept holds pickles and machine code: whoever can write them decides what is run.
    """
    return _USER is None or (status.st_uid == _USER and not status.st_mode & 0o022)


def _private(folder: Path) -> bool:
    """Whether a folder is this user's alone, and no link to another one."""
    try:
        found = folder.lstat()  # of a link itself, not of where it leads
    except OSError:
        return False
    return stat.S_ISDIR(found.st_mode) and _ours(found)


def found(name: str) -> bytes | None:
    """What is kept by that name, if it is there and whole."""
    directory = cache_directory()
    if directory is None:
        return None
    try:
        with (directory / name).open("rb") as file:
            if not _ours(os.fstat(file.fileno())):  # whatever has become of the folder since
                _warn(f"compiled code in {directory} is another user's, and is not used")
                return None
            kept = file.read()
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
        with open(aside, "wb", opener=_open_private) as file:
            file.write(hashlib.sha256(data).digest() + data)
        os.replace(aside, directory / name)
    except OSError as error:
        with suppress(OSError):
            aside.unlink()
        _warn(
            f"compiled code cannot be kept in {directory} ({error.strerror}), so that every "
            "process compiles it anew: free some space, or set NUMBA_CACHE_DIR to another folder"
        )


def _open_private(path: str, flags: int) -> int:
    return os.open(path, flags, 0o600)


@cache
def _warn(said: str) -> None:
    """Say something once."""
    warnings.warn(said, RuntimeWarning, stacklevel=3)
