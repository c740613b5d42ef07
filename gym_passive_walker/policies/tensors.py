"""Reader of the safetensors format, which holds named tensors and no code.

A file holds the length of its header in 8 bytes, little-endian; the header in JSON; and the data.
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

_DTYPES = {"F16": "<f2", "F32": "<f4", "F64": "<f8", "I32": "<i4", "I64": "<i8"}


class PolicyError(ValueError):
    """A policy does not exist, or its files are damaged."""


def read_tensors(path: Path) -> dict[str, NDArray]:
    """Return all tensors of a file by name.

    Raises:
        PolicyError: if the file is missing, cut short or otherwise damaged.
    """
    try:
        data = path.read_bytes()
        size = int.from_bytes(data[:8], "little")
        header: dict[str, Any] = json.loads(data[8 : 8 + size])
        header.pop("__metadata__", None)
        return {name: _tensor(data[8 + size :], **entry) for name, entry in header.items()}
    except OSError as error:
        raise PolicyError(f"{path} cannot be read: {error.strerror}") from None
    except (
        ValueError,
        TypeError,
        KeyError,
        AttributeError,
        OverflowError,
        RecursionError,
    ) as error:
        raise PolicyError(f"{path} is damaged: {error}") from None


def _tensor(numbers: bytes, dtype: str, shape: list[int], data_offsets: list[int]) -> NDArray:
    """Return one tensor from the data, by its entry in the header."""
    first, end = data_offsets
    kind = np.dtype(_DTYPES[dtype])
    if not 0 <= first <= end <= len(numbers) or end - first != math.prod(shape) * kind.itemsize:
        raise ValueError(
            f"a tensor of shape {shape} does not fit into bytes {first} to {end} of {len(numbers)}"
        )
    return np.frombuffer(numbers[first:end], kind).reshape(shape)
