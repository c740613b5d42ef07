"""Arguments of scenes from files, and scenes, walkers and functions of one's own: "module:name"."""

from __future__ import annotations

import inspect
import sys
from ast import parse, unparse
from collections.abc import Collection, Mapping
from itertools import zip_longest
from types import ModuleType
from typing import Any
from weakref import WeakKeyDictionary

from gym_passive_walker._tools.arguments import shown
from gym_passive_walker._tools.loading import (
    found_at,
    function_at,
    has_address,
    is_file,
    read_content,
    untrusted,
)
from gym_passive_walker.gaits.scenes.checks import SceneError, checked
from gym_passive_walker.gaits.scenes.rewards import FUNCTIONS, as_row
from gym_passive_walker.models.model import Model
from gym_passive_walker.models.walkers import Walker, WalkerError, as_walker


def task_arguments(name: Any) -> Any:
    """Return the arguments of a scene that a JSON, YAML or TOML file has; other names as they are.

    Raises:
        SceneError: if the file cannot be read, or has no arguments of a scene.
        ImportError: if the file is YAML and pyyaml is not installed.
    """
    if not is_file(name):
        return name
    content = checked(read_content, name)
    if not isinstance(content, dict):
        raise SceneError(
            f"{name} must map arguments of a scene to values, as in slope: 0.02, not "
            f"{shown(content)}"
        )
    return content


def outside(name: Any, arguments: Mapping[str, Any] | None = None) -> dict[str, str]:
    """Return what a scene names outside the package, by "module:name".

    Args:
        name: The scene: a name, a file, or a mapping of arguments.
        arguments: Further arguments of the scene.
    """
    name = task_arguments(name)
    found = {name: "scene"} if has_address(name) else {}
    for part in (name, arguments or {}):
        if isinstance(part, Mapping):
            for each in _CODE:
                row = [part.get(each)]
                if each == "observation" and isinstance(row[0], Mapping):
                    row = [part for parts in row[0].values() for part in as_row(parts)]
                found |= {value: each for value in row if has_address(value)}
    return found


def resolved(scene: Any, changes: Mapping[str, Any], trust: bool | None) -> tuple[Any, dict]:
    """Return a scene of a file or of a user's module, and changes, with what they name in modules.

    Args:
        scene: A scene in a form that `make_scene` takes.
        changes: Arguments that replace the scene's own.
        trust: As in `make_scene`.

    Raises:
        SceneError: if a file or a function does not give a scene, or code is not trusted.
        WalkerError: if there is no such system.
        ImportError: if the file is YAML and pyyaml is not installed.
    """
    given = task_arguments(scene)
    for address, what in outside(given, changes).items() if not trust else ():
        if trust is False or what != "scene":
            raise SceneError(untrusted(f"the {what} {address!r}"))
    if has_address(given):
        given = _returned(given)
    return (_with_code(given) if isinstance(given, Mapping) else given), _with_code(changes)


_CODE = ("walker", "system", *FUNCTIONS)
"""Arguments of a scene that can be code of the user's."""


def _returned(address: str) -> Any:
    """Return what the function at "module:function" returns, a scene or its arguments."""
    try:
        found = function_at(address, "the scene")()
    except ValueError as error:
        raise SceneError(str(error)) from None
    except Exception as error:
        raise SceneError(f"the scene {address!r} fails: {type(error).__name__}: {error}") from error
    if has_address(found):
        raise SceneError(
            f"the scene {address!r} must return a Scene, its arguments or the name of one of the "
            f"package, not {found!r}"
        )
    return found


def _with_code(arguments: Mapping[str, Any]) -> dict[str, Any]:
    """Return arguments of a scene with what they name in modules; these are imported."""
    found = dict(arguments)
    if isinstance(groups := found.get("observation"), Mapping):
        found["observation"] = {
            group: [_coded("observation", part) for part in as_row(parts)]
            for group, parts in groups.items()
        }
    for name in _CODE:
        if has_address(part := found.get(name)):
            found[name] = _coded(name, part) if name in FUNCTIONS else named_walker(part)
    return found


def _coded(name: str, part: Any) -> Any:
    """Return the function that a text names, or another value as it is."""
    return checked(function_at, part, f"the {name}") if has_address(part) else part


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


def source_of(*names: str) -> str | None:
    """Return the sources of the modules of "module:name", one after another; None without any.

    Raises:
        SceneError: if there is no such function, or its module has no source.
    """
    if not names:
        return None
    found: dict[str, str] = {}
    for name in sorted(names):
        found_at(name, "the scene")
        module = sys.modules[name.partition(":")[0]]
        try:
            if module not in _SOURCES:
                _SOURCES[module] = inspect.getsource(module)
            found[module.__name__] = _SOURCES[module]
        except (OSError, TypeError):
            raise SceneError(
                f"the scene {name!r} has no source: write its module as a file"
            ) from None
    return "\n".join(found.values())


def check_source(names: Collection[str], kept: str | None) -> None:
    """Check that the modules of a scene have the code that they had before.

    Comments and line breaks may differ; both texts are compared as Python reads them.

    Args:
        names: What the scene names outside the package, as in `outside`.
        kept: What `source_of` returned before.

    Raises:
        SceneError: if the code differs; the message quotes the first line that does.
    """
    now = source_of(*names)
    if now is None or kept is None or now == kept:
        return
    lines = (unparse(parse(text)).splitlines() for text in (now, kept))
    for here, there in zip_longest(*lines, fillvalue=""):
        if here != there:
            raise SceneError(
                f"the scene {', '.join(names)!r} has changed: its module has the line "
                f"{here.strip()!r} where it had {there.strip()!r}; put it back, or give the new "
                "scene another name"
            )
