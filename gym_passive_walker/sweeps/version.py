"""What results depend on besides a description: the version of what computes."""

from __future__ import annotations

import hashlib
import sys
from pathlib import Path

import gym_passive_walker
from gym_passive_walker.sweeps.tasks import ANALYSES, function

_SOURCES = ("arguments", "units", "walkers/*", "physics/*", "engine/*", "gaits/*", "envs/*")
_SOURCES += ("control/*", "policies/*", "sweeps/tasks")


def version(analysis: str) -> str:
    """The package's version, and a hash of the sources of what computes.

    A function of one's own counts with the module in which it is named.

    Raises:
        ValueError: if there is no such analysis.
    """
    root = Path(gym_passive_walker.__file__).parent
    sources = [path for part in _SOURCES for path in sorted(root.glob(f"{part}.py"))]
    function(analysis)  # which loads its module
    if analysis not in ANALYSES:
        named = getattr(sys.modules[analysis.partition(":")[0]], "__file__", None)
        sources += [Path(named)] if named is not None else []  # the interpreter's own have none
    digest = hashlib.sha256()
    for path in sources:
        digest.update(path.name.encode() + path.read_bytes())
    return f"{gym_passive_walker.__version__}+{digest.hexdigest()[:16]}"
