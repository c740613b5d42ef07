"""Infos of a step, computed at the first access."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import wraps
from typing import Any


def lane_values(values: Any, lane: int) -> Any:
    """Return the entry of one walker in an array (count, ...), or in dictionaries of arrays."""
    if isinstance(values, Mapping):
        return {name: lane_values(x, lane) for name, x in values.items()}
    return values[lane]


class Infos(dict[str, Any]):
    """A dictionary that is filled when it is first read or written.

    Most loops rarely read infos, and computing them takes a fifth of a control step. An entry is
    present from the beginning: C code such as `json` can read the size of a dictionary before its
    items.

    Attributes:
        make: Returns the content, which does not change later; None after that, and in the
            converted dictionaries of Gymnasium's wrappers.
    """

    __slots__ = ("__weakref__", "make")

    make: Callable[[], dict[str, Any]] | None

    def __getitem__(self, name: str) -> Any:
        """Return an entry; those that are present are read without filling the dictionary."""
        return dict.__getitem__(self if dict.__contains__(self, name) else self._filled(), name)

    def get(self, name: str, default: Any = None) -> Any:
        """Return an entry, or the default if there is none."""
        return dict.get(self if dict.__contains__(self, name) else self._filled(), name, default)

    def _filled(self) -> Infos:
        """Fill the dictionary and return it."""
        if self.make is not None:
            make, self.make = self.make, None
            dict.update(self, make())
        return self

    def __getattr__(self, name: str) -> None:
        """Return None for `make` before it is set."""
        if name != "make":
            raise AttributeError(name)

    def __reduce__(self) -> tuple[Any, ...]:
        """Return a plain dictionary for copies and pickles."""
        return dict, (dict(self),)


def _looking(method: Callable[..., Any]) -> Callable[..., Any]:
    """Wrap a method of dictionaries: it fills the dictionary first."""

    @wraps(method)
    def looked(self: Infos, *arguments: Any, **named: Any) -> Any:
        return method(self._filled(), *arguments, **named)

    return looked


_APART = {
    "__new__", "__init__", "__getattribute__", "__class_getitem__", "__sizeof__", "fromkeys",
}  # fmt: skip
for _name, _method in vars(dict).items():
    if callable(_method) and _name not in _APART | vars(Infos).keys():
        setattr(Infos, _name, _looking(_method))
