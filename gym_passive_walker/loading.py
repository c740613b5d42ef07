"""Reader of JSON, YAML and TOML files."""

from __future__ import annotations

import json
import os
import re
import tomllib
from pathlib import Path
from typing import Any, TypeGuard

from gym_passive_walker.console import cut

_YAML = (".yaml", ".yml")
SUFFIXES = (".json", *_YAML, ".toml")
"""Supported file name endings."""

_FLOAT = re.compile(r"[-+]?(\d+(\.\d*)?|\.\d+)[eE][-+]?\d+$")


def is_file(value: Any) -> TypeGuard[str | os.PathLike[str]]:
    """Return whether a value names a file: a path object, or text with one of `SUFFIXES`."""
    if isinstance(value, str):
        return Path(value).suffix.lower() in SUFFIXES
    return isinstance(value, os.PathLike)


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
            return _yaml(name, content)
        return tomllib.loads(content) if suffix == ".toml" else json.loads(content)
    except OSError as error:
        raise ValueError(f"{name} cannot be read: {error.strerror}") from None
    except (RecursionError, ValueError) as error:
        raise ValueError(f"{name} cannot be read: {error}") from None


def _yaml(name: str, content: str) -> Any:
    try:
        import yaml
    except ImportError:
        raise ImportError(
            f"{name} needs pyyaml, which is not installed: pip install pyyaml, or write it as JSON"
        ) from None
    try:

        class Loader(yaml.SafeLoader):
            """Loader of YAML 1.1 that also reads floats as YAML 1.2 writes them: 2e-1, 1e6."""

        Loader.add_implicit_resolver("tag:yaml.org,2002:float", _FLOAT, list("-+0123456789."))
        return yaml.load(content, Loader)
    except yaml.YAMLError as error:
        raise ValueError(" ".join(str(error).split())) from None
