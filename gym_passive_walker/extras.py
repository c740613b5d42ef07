"""What is needed beyond the package's own requirements, and what to say where it is missing."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec


@contextmanager
def extra(name: str) -> Iterator[None]:
    """Around an import: names the extra that brings the module, if it is missing.

    Raises:
        ImportError: if the module is not installed.
    """
    try:
        yield
    except ImportError as error:
        raise ImportError(
            f"this needs {error.name or 'a module'}, which is not installed: "
            f'pip install "gym-passive-walker[{name}]"',
            name=error.name,
        ) from error


def need(module: str, name: str) -> None:
    """Say that a module is missing before the work that it is for, rather than after it.

    Args:
        module: What will be imported.
        name: The extra that brings it.

    Raises:
        ImportError: if the module is not installed.
    """
    with extra(name):
        if (sys.modules[module] if module in sys.modules else find_spec(module)) is None:
            raise ModuleNotFoundError(name=module)
