"""Exact passive walkers for reinforcement learning and gait analysis.

`import gym_passive_walker` registers the environments. A public name loads its module when it is
first used; `__init__.pyi` lists the names and their modules.
"""

# Imported first, so that Ctrl-C ends the command line with one line even during later imports.
import gym_passive_walker._tools.console  # noqa: F401

# isort: split

import ast as _ast
from importlib import import_module as _import_module
from pathlib import Path as _Path
from typing import Any as _Any

from gym_passive_walker._tools.loading import POLICIES as _POLICIES
from gym_passive_walker._tools.loading import WALKER_READERS as _READERS
from gym_passive_walker._tools.shown import DRAWERS as _DRAWERS
from gym_passive_walker._version import __version__ as __version__
from gym_passive_walker.envs.registration import register as _register

_LISTED = _ast.parse(_Path(__file__).with_suffix(".pyi").read_text(encoding="utf-8")).body
_MODULES = {
    name.name: str(line.module)
    for line in _LISTED
    if isinstance(line, _ast.ImportFrom)
    for name in line.names
}
_FORMER = {"blend": "interpolate", "optimise_walker": "optimize_walker"}
"""Names of earlier commits, which keep working."""

__all__ = sorted(_MODULES.keys() - {"__version__"})  # pyright: ignore[reportUnsupportedDunderAll]

# These modules register plots, and read policies and walkers; the first use loads them.
_DRAWERS += [
    f"{__name__}.{_room}"
    for _room in ("pictures", "envs.evaluation.pictures", "apps.sweeps.pictures", "bridge.pictures")
]
_POLICIES.append(f"{__name__}.envs.policies")
_READERS.append(f"{__name__}.bridge.reading")


def __getattr__(name: str) -> _Any:
    known = _FORMER.get(name, name)
    if _MODULES.get(known, __name__) != __name__:
        value = getattr(_import_module(_MODULES[known]), known)
    elif name.startswith("_"):
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    else:  # a room or a public module
        try:
            value = _import_module(f"{__name__}.{name}")
        except ModuleNotFoundError as error:
            if error.name != f"{__name__}.{name}":
                raise
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}") from None
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


_register()
