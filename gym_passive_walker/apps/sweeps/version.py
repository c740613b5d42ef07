"""Version of the code that computes a sweep; results depend on it and on the description."""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Iterable
from pathlib import Path

from gym_passive_walker._tools.loading import found_at, has_address
from gym_passive_walker._version import __version__
from gym_passive_walker.apps.sweeps.tasks import ANALYSES, function
from gym_passive_walker.envs.policies import policy_files

_SOURCES = ("_tools/arguments.py", "models/**/*", "engine/**/*", "gaits/**/*", "envs/**/*")
_SOURCES += ("apps/sweeps/tasks.py",)
_SUFFIXES = (".py", ".json", ".safetensors")  # code, stored optima and policies


def version(analysis: str, outside: Iterable[str] = ()) -> str:
    """Return the package's version and a hash of the sources that the results depend on.

    For functions and systems of your own, the hash includes their modules; for policies of your
    own, their files.

    Args:
        analysis: Name of the analysis.
        outside: What stands outside the package besides, by "module:name", and paths of policies.

    Raises:
        ValueError: if there is no such analysis or module.
    """
    root = Path(__file__).parents[2]
    sources = [path for part in _SOURCES for path in sorted(root.glob(part))
               if path.suffix in _SUFFIXES and path.stem != "pictures"]  # fmt: skip
    function(analysis)  # imports its module
    addresses = {name for name in outside if has_address(name)}
    for address in addresses:
        found_at(address, "the name")
    sources += [path for name in sorted({*outside} - addresses) for path in policy_files(name)]
    modules = {address.partition(":")[0] for address in ({analysis} - ANALYSES.keys()) | addresses}
    files = (getattr(sys.modules[name], "__file__", None) for name in sorted(modules))
    sources += [Path(named) for named in files if named is not None]  # built-in modules have none
    digest = hashlib.sha256()
    for path in sources:
        digest.update(path.name.encode() + path.read_bytes())
    return f"{__version__}+{digest.hexdigest()[:16]}"
