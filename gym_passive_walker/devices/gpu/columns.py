"""Arrays of a batch in the GPU's memory: a row for each number, a column for each walker.

The threads of a warp read one number of neighbouring walkers at once, which then lie one after the
other. A thread copies the column of its walker to its own memory, where the walker is a batch of
one with the arrays of `envs.memory`, and back after the step.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from math import prod
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gym_passive_walker.devices.gpu import device
from gym_passive_walker.envs import memory


class Own(NamedTuple):
    """An array of one walker in its column.

    Attributes:
        first: Row of its first word.
        shape: Shape for one walker.
        kind: Data type; of 8 bytes, or of fields of 8 bytes.
    """

    first: int
    shape: tuple[int, ...]
    kind: np.dtype

    @property
    def words(self) -> int:
        """Number of words."""
        return prod(self.shape) * self.kind.itemsize // 8


class Fields:
    """An array of structures in the GPU's memory, each field an array of its own.

    Args:
        words: Rows of the fields, (words, walkers).
        kind: Data type of a structure.

    `fields["name"]` is the array of a field on the GPU, (walkers,) or (numbers, walkers).
    """

    def __init__(self, words: Any, kind: np.dtype) -> None:
        self.words, self.kind = words, kind

    def __getitem__(self, name: str) -> Any:
        field, offset = self.kind.fields[name][:2]  # type: ignore[index]
        first, size = offset // 8, field.itemsize // 8
        found = self.words[first : first + size].view(field.base)
        return found if field.shape else found.reshape(found.shape[1])

    def to_host(self) -> NDArray:
        """Return a copy in the CPU's memory, an array of structures (walkers,)."""
        return np.ascontiguousarray(device.to_host(self.words).T).view(self.kind)[:, 0]


class WalkerColumns:
    """Arrays of a batch on a GPU.

    Args:
        count: Number of walkers.
        declared: Declarations of the arrays, by name.
        one: Arrays of a batch of one, by name; those that walkers share with content. An array
            with two names is one array.
        passed: Names of arrays that a step takes or returns, and that lie outside the columns.
        written: Names of arrays that a step only writes.

    Attributes:
        own: Arrays in the columns, by name; those that are only written come last.
        read: Words of a column that a step reads.
        size: Words of a column.
        words: The columns, (size, count).
        arrays: A named tuple of all arrays on the GPU; see `DeviceBatch`.
        ones: A named tuple of arrays as a thread finds them.
        steps: Bytes from a walker to the next, for each of `ones`.
    """

    def __init__(
        self,
        count: int,
        declared: Mapping[str, memory.BatchArray],
        one: Mapping[str, NDArray],
        passed: Collection[str],
        written: Collection[str],
    ) -> None:
        each = [name for name in one if declared[name].axes.startswith(("walkers", "rows"))]
        kept = [name for name in each if name not in passed]
        self.own: dict[str, Own] = {}
        self.size = self.read = 0
        for name in sorted(kept, key=lambda name: name in written):
            self.own[name] = Own(self.size, one[name].shape, one[name].dtype)
            self.size += self.own[name].words
            self.read += self.own[name].words if name not in written else 0
        self.words = device.upload(np.zeros((self.size, count)))
        arrays: dict[str, Any] = {}
        ones, self.steps, known = {"words": self.words}, [0], {}
        for name, array in one.items():
            step = 0
            if name in self.own:
                arrays[name] = self._column(self.own[name])
                ones[name] = device.typed(array)
            elif name not in each:
                arrays[name] = ones[name] = device.upload(array)
            else:
                if id(array) not in known:
                    known[id(array)] = _passed(array, count, rows="*" not in declared[name].axes)
                arrays[name], ones[name], step = known[id(array)]
            self.steps.append(step)
        self.arrays = memory.named_arrays(tuple(arrays))(**arrays)
        self.ones = memory.named_arrays(tuple(ones))(**ones)

    def _column(self, own: Own) -> Any:
        """Return an array of all walkers."""
        rows = self.words[own.first : own.first + own.words]
        if own.kind.fields:
            return Fields(rows, own.kind)
        shape = (*(length for length in own.shape if length != 1), rows.shape[1])
        if not own.words:
            return device.upload(np.zeros(shape, own.kind))
        return rows.view(own.kind).reshape(*shape)

    def of_one(self, i: int, column: NDArray[np.float64]) -> Any:
        """Return the arrays of walker i in the simulator, with its column in the CPU's memory."""
        found: dict[str, Any] = {}
        for name, array, step in zip(self.ones._fields, self.ones, self.steps, strict=True):
            found[name] = array
            if name in self.own:
                first, shape, kind = own = self.own[name]
                part = column[first : first + own.words]
                found[name] = part.view(device.kind(kind) if kind.fields else kind).reshape(shape)
            elif step:
                every = getattr(self.arrays, name)
                found[name] = every[i : i + 1] if every.ndim == array.ndim else every[:, i]
        return type(self.ones)(**found)

    def replace(self, **arrays: NDArray) -> None:
        """Replace arrays that all walkers share."""
        fresh = {name: device.upload(array) for name, array in arrays.items()}
        self.arrays, self.ones = self.arrays._replace(**fresh), self.ones._replace(**fresh)


def _passed(array: NDArray, count: int, *, rows: bool) -> tuple[Any, Any, int]:
    """Return an array of all walkers, that of the first walker, and the bytes to the next.

    With `rows`, each walker has a row, which compiled code finds by its address.
    """
    if rows:
        there = device.upload(np.zeros((count, *array.shape[1:]), array.dtype))
        return there, there[:1], there.strides[0]
    there = device.upload(np.zeros((len(array), count), array.dtype))
    return there, there[:, 0], array.itemsize
