"""One thread at a time in a batch.

Compiled steps run without Python's lock and write arrays that belong to the batch: two threads in
one batch would corrupt the heap. A call therefore takes the batch's token and puts it back, and a
call that finds the token taken raises an error. The token is an entry of a list, because `list.pop`
is as atomic as a lock and takes a fifth of the time.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import Any, NoReturn, TypeVar, cast

_Method = TypeVar("_Method", bound=Callable[..., Any])


class Token(list[None]):
    """Holds one entry while nobody is at work; `pop` takes it, `append(None)` puts it back.

    Copies and pickles of it are free: nobody is at work in a copy.
    """

    __slots__ = ()

    def __init__(self) -> None:
        super().__init__((None,))

    def __reduce__(self) -> tuple[Any, ...]:
        return Token, ()


def refuse_second(shared: object) -> NoReturn:
    """Say that another thread is at work.

    Raises:
        RuntimeError: always.
    """
    raise RuntimeError(
        f"another thread is using this {type(shared).__name__}: its walkers share memory, so that "
        "one thread at a time may call it; make one environment for each thread"
    )


def one_thread(method: _Method) -> _Method:
    """A method that raises while another call that shares its object's `token` is under way.

    Steps spell it out instead, since a wrapper costs a tenth of a microsecond more.
    """

    @wraps(method)
    def guarded(self: Any, *arguments: Any, **named: Any) -> Any:
        token, mine = self.token, True
        try:  # around `pop` as well: Ctrl-C may be raised as it returns
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
