"""Cache of compiled code on disk, between processes.

The cache is optional. Code that cannot be read is compiled again. Code that cannot be written lasts
as long as the process. Either case gives one warning.
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
_SOURCES = (
    "models/equations/*",
    "models/expressions",
    "models/math",
    "engine/*",
    "gaits/look/forces",
    "gaits/find/newton",
    "gaits/terrain",
    "gaits/scenes/checks",
    "gaits/scenes/rules",
    "gaits/scenes/starts",
    "gaits/scenes/transition",
    "envs/task",
    "envs/disturbance_kernels",
    "envs/constraints",
    "envs/memory",
    "envs/ticks",
    "envs/rule",
    "envs/transitions",
    "envs/views",
)
"""Sources, without their ending ".py", on which compiled code depends."""
_DIGEST = hashlib.sha256().digest_size


@cache
def fingerprint() -> str:
    """Return a hash of the sources that compiled code depends on; it names the cache folder.

    Numba notices a change of a function's own file, but not of the functions that it calls.
    """
    digest = hashlib.sha256()
    for pattern in _SOURCES:
        for source in sorted(_ROOT.glob(f"{pattern}.py")):
            digest.update(source.name.encode() + source.read_bytes())
    return digest.hexdigest()[:16]


@cache
def cache_directory() -> Path | None:
    """Return the cache folder and create it if necessary; None if no folder can be used."""
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
        elif os.access(directory, os.W_OK) or any(directory.iterdir()):  # as an image has it
            return directory
        else:
            failures.append(f"{directory} is read-only")
    _warn(
        f"compiled code cannot be kept ({'; '.join(failures)}), so that every process compiles it "
        "again: set NUMBA_CACHE_DIR to a folder that can be written to"
    )
    return None


def _bases() -> Iterator[Path]:
    """Yield candidate locations of the cache folder, the preferred one first."""
    name = "gym_passive_walker"
    if chosen := os.environ.get("NUMBA_CACHE_DIR"):
        yield Path(chosen).absolute() / name  # the working directory may change
    with suppress(RuntimeError):  # a user without a home
        home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
        yield home.absolute() / name
    shared = name if _USER is None else f"{name}-{_USER}"
    with suppress(FileNotFoundError):  # nothing can be written to
        yield Path(tempfile.gettempdir()) / shared


_USER: int | None = getattr(os, "getuid", lambda: None)()
"""User id of this process; None on Windows, where users have separate folders."""


def _ours(status: os.stat_result) -> bool:
    """Return whether only this user, or the administrator, may write to a file or folder.

    The cache holds machine code, so write access to it permits running any code.
    """
    return _USER is None or (status.st_uid in (_USER, 0) and not status.st_mode & 0o022)


def _private(folder: Path) -> bool:
    """Return whether a path is a real folder, not a link, that only this user may write to."""
    try:
        found = folder.lstat()  # does not follow links
    except OSError:
        return False
    return stat.S_ISDIR(found.st_mode) and _ours(found)


def found(name: str) -> bytes | None:
    """Return the cached data of a name; None if there is none or its digest does not match."""
    directory = cache_directory()
    if directory is None:
        return None
    try:
        with (directory / name).open("rb") as file:
            if not _ours(os.fstat(file.fileno())):  # it may have changed since
                _warn(f"compiled code in {directory} is another user's, and is not used")
                return None
            kept = file.read()
    except FileNotFoundError:
        return None
    except OSError as error:
        _warn(f"compiled code cannot be read, and is made afresh: {error}")
        return None
    digest, data = kept[:_DIGEST], kept[_DIGEST:]
    if hashlib.sha256(data).digest() != digest:  # damaged machine code would crash the process
        _warn(f"compiled code in {directory} is damaged, and is made afresh")
        return None
    return data


def keep(name: str, data: bytes) -> None:
    """Write data and its digest to the cache, atomically."""
    directory = cache_directory()
    if directory is None:
        return
    aside = None
    try:
        # Only this user may read it, and no other thread or process has its name.
        descriptor, aside = tempfile.mkstemp(prefix=f"{name}.", dir=directory)
        with open(descriptor, "wb") as file:
            file.write(hashlib.sha256(data).digest() + data)
        os.replace(aside, directory / name)
    except OSError as error:
        if aside is not None:
            with suppress(OSError):
                os.unlink(aside)
        if os.name == "nt" and (directory / name).exists():
            return  # another process kept the same code, and Windows replaces no open file
        _warn(
            f"compiled code cannot be kept in {directory} ({error.strerror}), so that every "
            "process compiles it again: free some space, or set NUMBA_CACHE_DIR to another folder"
        )


@cache
def _warn(said: str) -> None:
    """Warn once for each message."""
    warnings.warn(said, RuntimeWarning, stacklevel=3)
