"""Scenes and walkers by name: those of the package, and a user's own as "module:name"."""

from __future__ import annotations

import inspect
import sys
from ast import parse, unparse
from itertools import zip_longest
from types import ModuleType
from typing import Any
from weakref import WeakKeyDictionary

from gym_passive_walker._tools.arguments import shown
from gym_passive_walker._tools.loading import found_at, function_at, has_address, untrusted
from gym_passive_walker.gaits.scenes.scene import Scene, SceneError, make_scene
from gym_passive_walker.models.model import Model
from gym_passive_walker.models.walkers import Walker, WalkerError, as_walker


def named_scene(name: Any, *, trust: bool, **changes: Any) -> Scene:
    """Return a scene by its name, with changes.

    Args:
        name: A scene in a form that `make_scene` takes; or "module:function" for a function of the
            user's own without arguments, which returns such a scene.
        trust: Whether to import that module. A name that a user writes is trusted; one in a file
            can be another person's.
        **changes: Arguments of `Scene` that replace the scene's own.

    Raises:
        SceneError: if there is no such scene, or its function is not trusted.
    """
    if not has_address(name):
        return make_scene(name, **changes)
    if not trust:
        raise SceneError(untrusted(f"the scene {name!r}"))
    try:
        found = function_at(name, "the scene")()
    except ValueError as error:
        raise SceneError(str(error)) from None
    except Exception as error:
        raise SceneError(f"the scene {name!r} fails: {type(error).__name__}: {error}") from error
    if has_address(found):
        raise SceneError(
            f"the scene {name!r} must return a Scene, its arguments or the name of one of the "
            f"package, not {found!r}"
        )
    return make_scene(found, **changes)


def named_walker(name: Any) -> Walker:
    """Return a walker in a form that `as_walker` takes, or the system at "module:NAME".

    The module is imported without a check of trust.

    Raises:
        WalkerError: if there is no such walker, or the name is of something else.
    """
    if not has_address(name):
        return as_walker(name)
    try:
        found: Any = found_at(name, "the walker")
    except ValueError as error:
        raise WalkerError(str(error)) from None
    if isinstance(found, Model):
        return found  # type: ignore[return-value]
    raise WalkerError(f"the walker {name!r} must be a System, not {shown(found)}")


_SOURCES: WeakKeyDictionary[ModuleType, str] = WeakKeyDictionary()
"""Sources as they were when first asked for: a file may be edited while a training runs."""


def source_of(name: str) -> str | None:
    """Return the source of the module of a scene's function; None for one of the package."""
    if not has_address(name):
        return None
    function_at(name, "the scene")
    module = sys.modules[name.partition(":")[0]]
    try:
        if module not in _SOURCES:
            _SOURCES[module] = inspect.getsource(module)
        return _SOURCES[module]
    except (OSError, TypeError):
        raise SceneError(f"the scene {name!r} has no source: write its module as a file") from None


def check_source(name: str, kept: str | None) -> None:
    """Check that the module of a scene has the code that it had before.

    Comments and line breaks may differ; both texts are compared as Python reads them.

    Args:
        name: The scene's name.
        kept: What `source_of` returned before.

    Raises:
        SceneError: if the code differs; the message quotes the first line that does.
    """
    now = source_of(name)
    if now is None or kept is None or now == kept:
        return
    lines = (unparse(parse(text)).splitlines() for text in (now, kept))
    for here, there in zip_longest(*lines, fillvalue=""):
        if here != there:
            raise SceneError(
                f"the scene {name!r} has changed: its module has the line {here.strip()!r} where "
                f"it had {there.strip()!r}; put it back, or give the new scene another name"
            )
