"""Infos of a step of many walkers, made when they are first read."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import Any


class Infos(dict[str, Any]):
    """A dictionary that is filled when it is first read or written.

    Most loops read infos seldom, and to make them takes a fifth of a tick of 64 walkers.

    Args:
        make: Makes the content, of numbers that nobody changes; None where `first` is all of it, as
            where Gymnasium's wrappers make a converted one.
        **first: Its first entries, which are there from the beginning: what is written in C, as
            `json` is, may ask a dictionary for its size before it asks for its items.
    """

    __slots__ = ("__weakref__", "_make")

    def __init__(self, make: Callable[[], dict[str, Any]] | None = None, /, **first: Any) -> None:
        super().__init__(first)
        self._make = make

    def __reduce__(self) -> tuple[Any, ...]:
        """Copies and pickles are plain dictionaries."""
        return dict, (dict(self),)

    def copy(self) -> dict[str, Any]:
        """A plain dictionary of the same."""
        return dict(self)


def _looking(method: Callable[..., Any]) -> Callable[..., Any]:
    """A dictionary's method, before which the dictionary is filled."""

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
