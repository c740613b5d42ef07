"""Optional dependencies, and the errors where one is missing."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec


@contextmanager
def extra(name: str) -> Iterator[None]:
    """Name the extra to install if an enclosed import fails.

    A library that is installed and fails is reported with its own words.

    Args:
        name: The extra that installs the module.

    Raises:
        ImportError: if the module is not installed, or cannot be imported.
    """
    try:
        yield
    except ImportError as error:
        said, upgrade = "is not installed", ""
        if not isinstance(error, ModuleNotFoundError):
            said, upgrade = f"cannot be imported ({error}), and may be too old", "--upgrade "
        raise ImportError(
            f"this needs {error.name or 'a module'}, which {said}: "
            f'pip install {upgrade}"gym-passive-walker[{name}]"',
            name=error.name,
        ) from error


def need(module: str, name: str) -> None:
    """Check, before long work, that a module for its end is installed.

    Args:
        module: Name of the module.
        name: The extra that installs the module.

    Raises:
        ImportError: if the module is not installed.
    """
    with extra(name):
        if (sys.modules[module] if module in sys.modules else find_spec(module)) is None:
            raise ModuleNotFoundError(name=module)
