"""Restriction of a batch to one thread at a time.

Compiled steps run without Python's lock and write arrays of the batch: two threads in one batch
would corrupt the heap. A call therefore takes the batch's token and puts it back. A call raises an
error if another one has taken the token. The token is an entry of a list: `list.pop` is as atomic
as a lock and takes a fifth of the time.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import Any, NoReturn, TypeVar, cast

_Method = TypeVar("_Method", bound=Callable[..., Any])


class Token(list[None]):
    """A list with one entry while no call runs; `pop` takes it, `append(None)` puts it back.

    Copies and pickles have their entry, because no call runs in a copy.
    """

    __slots__ = ()

    def __init__(self) -> None:
        super().__init__((None,))

    def __reduce__(self) -> tuple[Any, ...]:
        return Token, ()


def refuse_second(shared: object) -> NoReturn:
    """Raise an error for a second thread.

    Raises:
        RuntimeError: always.
    """
    raise RuntimeError(
        f"another thread is using this {type(shared).__name__}: its walkers share memory, so that "
        "one thread at a time may call it; make one environment for each thread"
    )


def one_thread(method: _Method) -> _Method:
    """Wrap a method so that it raises while another call holds the `token` of its object.

    The step of a single environment contains the same code: a wrapper takes 0.1 µs longer.
    """

    @wraps(method)
    def guarded(self: Any, *arguments: Any, **named: Any) -> Any:
        token, mine = self.token, True
        try:  # `pop` is inside: Ctrl-C can be raised as it returns
            try:
                token.pop()
            except IndexError:
                mine = False
                refuse_second(self)
            return method(self, *arguments, **named)
        finally:
            if mine:
                token.append(None)

    return cast(_Method, guarded)
