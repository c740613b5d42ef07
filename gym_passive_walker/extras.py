"""What is needed beyond the package's own requirements, and what to say where it is missing."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager


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
