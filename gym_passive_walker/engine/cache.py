"""Where compiled code is kept between processes."""

from __future__ import annotations

import hashlib
import os
import tempfile
from functools import cache
from pathlib import Path

_ROOT = Path(__file__).parent.parent


@cache
def fingerprint() -> str:
    """A hash of the sources that compiled code depends on: a stale kernel is impossible.

    Numba notices when a function's own file changes, but not when a function that it calls does.
    """
    digest = hashlib.sha256()
    for room in ("physics", "engine"):
        for source in sorted((_ROOT / room).glob("*.py")):
            digest.update(source.name.encode() + source.read_bytes())
    return digest.hexdigest()[:16]


@cache
def cache_directory() -> Path:
    """The folder for compiled code, made when it is first asked for.

    Raises:
        OSError: if there is none that can be written to.
    """
    chosen = os.environ.get("NUMBA_CACHE_DIR") or None
    home = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    for base in (chosen, home, Path(tempfile.gettempdir())):
        if base is None:
            continue
        directory = Path(base) / "gym_passive_walker" / fingerprint()
        try:
            directory.mkdir(parents=True, exist_ok=True)
        except OSError:
            continue
        if os.access(directory, os.W_OK):
            return directory
    raise OSError("no writable folder for compiled kernels: set NUMBA_CACHE_DIR to one")
