"""Version of the code that computes a sweep; results depend on it and on the description."""

from __future__ import annotations

import hashlib
import sys
from pathlib import Path

from gym_passive_walker._version import __version__
from gym_passive_walker.apps.sweeps.tasks import ANALYSES, function

_SOURCES = ("_tools/arguments", "models/**/*", "engine/*", "gaits/**/*", "envs/*")
_SOURCES += ("envs/policies/*", "apps/sweeps/tasks")


def version(analysis: str) -> str:
    """Return the package's version and a hash of the sources that the results depend on.

    For a function of your own, the hash includes its module.

    Raises:
        ValueError: if there is no such analysis.
    """
    root = Path(__file__).parents[2]
    sources = [path for part in _SOURCES for path in sorted(root.glob(f"{part}.py"))]
    function(analysis)  # imports its module
    if analysis not in ANALYSES:
        named = getattr(sys.modules[analysis.partition(":")[0]], "__file__", None)
        sources += [Path(named)] if named is not None else []  # built-in modules have none
    digest = hashlib.sha256()
    for path in sources:
        digest.update(path.name.encode() + path.read_bytes())
    return f"{__version__}+{digest.hexdigest()[:16]}"
