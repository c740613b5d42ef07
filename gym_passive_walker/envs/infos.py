"""Infos of a step of many walkers, computed at the first access."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import Any


class Infos(dict[str, Any]):
    """A dictionary that is filled when it is first read or written.

    Most loops rarely read infos, and computing them takes a fifth of a control step of 64 walkers.

    Args:
        make: Returns the content, which does not change later. None if `first` is the whole
            content, as in the converted dictionaries of Gymnasium's wrappers.
        **first: Entries that are present from the beginning. C code such as `json` can read the
            size of a dictionary before its items.
    """

    __slots__ = ("__weakref__", "_make")

    def __init__(self, make: Callable[[], dict[str, Any]] | None = None, /, **first: Any) -> None:
        super().__init__(first)
        self._make = make

    def __reduce__(self) -> tuple[Any, ...]:
        """Return a plain dictionary for copies and pickles."""
        return dict, (dict(self),)

    def copy(self) -> dict[str, Any]:
        """Return a plain dictionary with equal entries."""
        return dict(self)


def _looking(method: Callable[..., Any]) -> Callable[..., Any]:
    """Wrap a method of dictionaries: it fills the dictionary first."""

    @wraps(method)
    def looked(self: Infos, *arguments: Any, **named: Any) -> Any:
        if self._make is not None:
            make, self._make = self._make, None
            dict.update(self, make())
        return method(self, *arguments, **named)

    return looked


_APART = {"__new__", "__getattribute__", "__class_getitem__", "__sizeof__", "fromkeys"}
for _name, _method in vars(dict).items():
    if callable(_method) and _name not in _APART | vars(Infos).keys():
        setattr(Infos, _name, _looking(_method))
