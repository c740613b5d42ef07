"""Version of the code that computes a sweep; results depend on it and on the description."""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Iterable
from pathlib import Path

from gym_passive_walker._tools.loading import found_at
from gym_passive_walker._version import __version__
from gym_passive_walker.apps.sweeps.tasks import ANALYSES, function

_SOURCES = ("_tools/arguments", "models/**/*", "engine/**/*", "gaits/**/*", "envs/**/*")
_SOURCES += ("apps/sweeps/tasks",)


def version(analysis: str, outside: Iterable[str] = ()) -> str:
    """Return the package's version and a hash of the sources that the results depend on.

    For functions and systems of your own, the hash includes their modules.

    Args:
        analysis: Name of the analysis.
        outside: "module:name" of what stands outside the package besides.

    Raises:
        ValueError: if there is no such analysis or module.
    """
    root = Path(__file__).parents[2]
    sources = [path for part in _SOURCES for path in sorted(root.glob(f"{part}.py"))
               if path.stem != "pictures"]  # fmt: skip
    function(analysis)  # imports its module
    for address in outside:
        found_at(address, "the name")
    modules = {address.partition(":")[0] for address in ({analysis} - ANALYSES.keys()) | {*outside}}
    files = (getattr(sys.modules[name], "__file__", None) for name in sorted(modules))
    sources += [Path(named) for named in files if named is not None]  # built-in modules have none
    digest = hashlib.sha256()
    for path in sources:
        digest.update(path.name.encode() + path.read_bytes())
    return f"{__version__}+{digest.hexdigest()[:16]}"
