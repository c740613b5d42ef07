"""Reader of JSON, YAML and TOML files, and what can be wrong with a file of any kind.

Every reader of the package takes its JSON from `parse_json` and its reasons from `reason`.
"""

from __future__ import annotations

import json
import linecache
import math
import os
import pickle
import re
import sys
import tomllib
import traceback
from collections.abc import Callable, Iterable
from importlib import import_module
from pathlib import Path
from typing import Any, TypeGuard

from gym_passive_walker._tools.console import cut

_YAML = (".yaml", ".yml")
SUFFIXES = (".json", *_YAML, ".toml")
"""Supported file name endings."""

_PACKAGE = str(Path(__file__).parents[1])

POLICIES: list[str] = []
"""Module that reads trained policies: controllers by name or path load it."""

WALKER_READERS: list[str] = []
"""Module that reads walkers from files of other simulators."""

HOLDS_CODE = "it holds code, or is damaged: do not load it unless you trust its source"

_FLOAT = re.compile(r"[-+]?(\d+(\.\d*)?|\.\d+)[eE][-+]?\d+$")
_FLOAT_TAG = "tag:yaml.org,2002:float"
_DEEPEST = 100  # levels of lists and mappings
_NESTED = f"it nests deeper than {_DEEPEST} levels"
# Parts of messages with which numpy, torch and pyyaml refuse a file that would run code.
_CODE = re.compile("allow_pickle|weights_only|2002:python/")


def is_file(value: Any) -> TypeGuard[str | os.PathLike[str]]:
    """Return whether a value names a file: a path object, or text with one of `SUFFIXES`."""
    if isinstance(value, str):
        return Path(value).suffix.lower() in SUFFIXES
    return isinstance(value, os.PathLike)


def has_address(name: Any) -> TypeGuard[str]:
    """Return whether a name is "module:name", of a function or a system of the user's own.

    A path of Windows has a colon too.
    """
    return isinstance(name, str) and ":" in name and not {"/", "\\"} & {*name}


def untrusted(what: str) -> str:
    """Return the sentence that refuses code of a module that is not trusted."""
    return (
        f"{what} is code that is not the package's, and could do anything: if you trust it, add "
        "--trust, or in Python trust=True where the file is read, as make_scene(file, trust=True)"
    )


def found_at(address: str, what: str) -> Any:
    """Return what stands at "module:name"; modules of the present folder are found too.

    The module is imported without a check of trust.

    Raises:
        ValueError: if there is nothing; the message begins with `what`.
    """
    module, _, name = address.partition(":")
    folder = os.getcwd()
    sys.path.append(folder)
    try:
        return getattr(import_module(module), name)
    except Exception as error:  # the module's own code runs, and may raise anything
        raise ValueError(f"{what} {address!r} cannot be found: {reason(error)}") from None
    finally:
        # The module may have changed the list, and may have added an equal entry.
        sys.path[:] = [each for each in sys.path if each is not folder]


def function_at(address: str, what: str) -> Callable[..., Any]:
    """Return the function at "module:function", as `found_at` does.

    Raises:
        ValueError: if there is none, or it is no function.
    """
    found = found_at(address, what)
    if not callable(found):
        raise ValueError(f"{what} {address!r} is not a function")
    return found


def reason(error: Exception) -> str:
    """Return in one line why a file cannot be read, by the error that its reader raised.

    Libraries that refuse a file because it holds code name the option with which it would run. Such
    a message is replaced by `HOLDS_CODE`.
    """
    said = (isinstance(error, OSError) and error.strerror) or str(error)
    said = " ".join(said.split()) or type(error).__name__
    if isinstance(error, pickle.UnpicklingError) or _CODE.search(said):
        return HOLDS_CODE
    if isinstance(error, RecursionError):
        return _NESTED
    return f"{said} is missing" if isinstance(error, KeyError) else said


def once(pairs: Iterable[tuple[Any, Any]]) -> dict[Any, Any]:
    """Return a mapping of keys to values, each given once.

    Raises:
        ValueError: if a key is repeated, since only its last value would count.
    """
    found: dict[Any, Any] = {}
    for key, value in pairs:
        if key in found:
            raise ValueError(f"{key!r} is given twice: give it once")
        found[key] = value
    return found


def parse_json(text: str | bytes) -> Any:
    """Return the content of a JSON text, or of its bytes in UTF-8.

    Raises:
        ValueError: if it is not JSON, nests too deeply, repeats a key, or has a number beyond all
            floats.
    """
    try:
        text = text if isinstance(text, str) else text.decode("utf-8")
        return _checked(json.loads(text, parse_float=_float, object_pairs_hook=once))
    except RecursionError:
        raise ValueError(_NESTED) from None


def read_content(path: str | os.PathLike[str]) -> Any:
    """Return the content of a JSON, YAML or TOML file; its ending determines the format.

    Raises:
        ValueError: if the file has another ending or cannot be read.
        ImportError: if the file is YAML and pyyaml is not installed.
    """
    name, suffix = cut(os.fsdecode(path)), Path(path).suffix.lower()
    if suffix not in SUFFIXES:
        raise ValueError(f"{name} cannot be read: its name must end in {', '.join(SUFFIXES)}")
    try:
        content = Path(path).read_text(encoding="utf-8")
        if suffix in _YAML:
            return _checked(_yaml(name, content))
        if suffix == ".toml":
            return _checked(tomllib.loads(content, parse_float=_float))
        return parse_json(content)
    except ImportError:
        raise
    except Exception as error:  # a damaged file may raise anything
        raise ValueError(f"{name} cannot be read: {reason(error)}") from None


def _float(text: str) -> float:
    """Return the float that a text writes; infinity has to be written as such."""
    return _written(float(text), text)


def _written(found: float, text: str) -> float:
    if math.isinf(found) and "inf" not in text.lower():
        raise ValueError(f"{cut(text)} is too large for a number")
    return found


def _checked(content: Any) -> Any:
    """Return content after a check of its depth, and that floats can hold its integers."""
    level = [content]
    for _ in range(_DEEPEST + 1):
        for value in level:
            if isinstance(value, int) and abs(value) > sys.float_info.max:
                raise ValueError(f"a number of {value.bit_length()} bits is too large")
        inside = (
            value.values() if isinstance(value, dict) else value
            for value in level
            if isinstance(value, dict | list)
        )
        # YAML's aliases may repeat an object; it is checked once.
        level = [*{id(value): value for values in inside for value in values}.values()]
        if not level:
            return content
    raise ValueError(_NESTED)


def _yaml(name: str, content: str) -> Any:
    try:
        import yaml
    except ModuleNotFoundError:
        raise ImportError(
            f"{name} needs pyyaml, which is not installed: pip install pyyaml, or write it as JSON"
        ) from None

    class Loader(yaml.SafeLoader):
        """Loader of YAML 1.1 that also reads floats as YAML 1.2 writes them: 2e-1, 1e6."""

        def compose_mapping_node(self, anchor: Any) -> Any:
            """Return the node of a mapping after a check for repeated keys."""
            node = super().compose_mapping_node(anchor)
            once((key.value, None) for key, _ in node.value if isinstance(key.value, str))
            return node

        def construct_float(self, node: Any) -> float:
            """Return a float; see `_float`."""
            return _written(self.construct_yaml_float(node), node.value)

    Loader.add_implicit_resolver(_FLOAT_TAG, _FLOAT, list("-+0123456789."))
    Loader.add_constructor(_FLOAT_TAG, Loader.construct_float)
    return yaml.load(content, Loader)


def cause_of(error: BaseException) -> str:
    """Return what an error of a user's function says, and the line of their file."""
    frames = [
        (frame.f_code.co_filename, line)
        for frame, line in traceback.walk_tb(error.__traceback__)
        if not frame.f_code.co_filename.startswith(_PACKAGE)
    ]
    lines = [line for file, line in frames if file == frames[0][0]]  # libraries are called from it
    if not lines:
        return str(error)
    text = linecache.getline(frames[0][0], lines[-1]).strip()
    return f"line {lines[-1]}{f', `{text}`' * bool(text)}: {error}"
