"""Reader of the safetensors format, which holds named tensors and no code.

A file holds the length of its header in 8 bytes, little-endian; the header in JSON; and the data.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gym_passive_walker._tools.loading import parse_json, reason

_DTYPES = {"F16": "<f2", "F32": "<f4", "F64": "<f8", "I32": "<i4", "I64": "<i8"}


class PolicyError(ValueError):
    """A policy does not exist, or its files are damaged."""


@contextmanager
def reading(path: Path, wrong: str = "is damaged", advice: str = "") -> Iterator[None]:
    """Turn any error while a policy is read into a `PolicyError` of one sentence.

    Args:
        path: The file or folder, which the message names.
        wrong: What the message says of it, before the reason.
        advice: End of the message.

    Raises:
        PolicyError: if the file is missing, or its content is invalid.
    """
    try:
        yield
    except (PolicyError, ImportError):
        raise
    except OSError as error:
        raise PolicyError(f"{path} cannot be read: {reason(error)}") from None
    except Exception as error:  # a damaged file may raise anything
        raise PolicyError(f"{path} {wrong}: {reason(error)}{advice}") from None


def read_tensors(path: Path) -> dict[str, NDArray]:
    """Return all tensors of a file by name.

    Raises:
        PolicyError: if the file is missing, cut short or otherwise damaged.
    """
    with reading(path):
        data = path.read_bytes()
        size = int.from_bytes(data[:8], "little")
        header: dict[str, Any] = parse_json(data[8 : 8 + size])
        header.pop("__metadata__", None)
        return {name: _tensor(data[8 + size :], **entry) for name, entry in header.items()}


def _tensor(numbers: bytes, dtype: str, shape: list[int], data_offsets: list[int]) -> NDArray:
    """Return one tensor from the data, by its entry in the header."""
    first, end = data_offsets
    kind = np.dtype(_DTYPES[dtype])
    if not 0 <= first <= end <= len(numbers) or end - first != math.prod(shape) * kind.itemsize:
        raise ValueError(
            f"a tensor of shape {shape} does not fit into bytes {first} to {end} of {len(numbers)}"
        )
    return np.frombuffer(numbers[first:end], kind).reshape(shape)
