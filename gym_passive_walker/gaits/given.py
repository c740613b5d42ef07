"""A walk as analyses take it: a walker, its slope, state and motors, or a gait that has them."""

from __future__ import annotations

from typing import Any, NamedTuple, Protocol, TypeAlias, runtime_checkable

from numpy.typing import ArrayLike, NDArray

from gym_passive_walker.gaits.drive import PASSIVE, Drive
from gym_passive_walker.walkers import Walker, WalkerLike, as_walker


@runtime_checkable
class Periodic(Protocol):
    """What a `Gait` has that analyses of a walk need; a gait is made of strides, not they of it."""

    @property
    def walker(self) -> Walker:
        """The walker."""
        ...

    @property
    def slope(self) -> float:
        """Slope in rad."""
        ...

    @property
    def period(self) -> int:
        """Strides until it repeats."""
        ...

    @property
    def state(self) -> NDArray:
        """State just after heelstrike, shape (6,)."""
        ...

    @property
    def drive(self) -> Drive:
        """What its motors do in each stride."""
        ...


GaitLike: TypeAlias = Periodic | WalkerLike
"""What analyses of a walk take as their first argument."""


class Walk(NamedTuple):
    """A walk, not checked but for its walker.

    Attributes:
        walker: The walker.
        slope: Its slope in rad.
        state: Its state just after heelstrike, shape (6,) or (n, 6).
        drive: Its motors.
        period: Strides until it repeats; 1 where that is not known.
    """

    walker: Walker
    slope: Any
    state: ArrayLike
    drive: Drive
    period: int


def walk_of(
    walker: GaitLike,
    slope: ArrayLike | None,
    state: ArrayLike | None,
    *motors: ArrayLike | None,
) -> Walk:
    """Return a walk; what is None is the gait's own, and motors are 0 where there is no gait.

    Args:
        walker: A gait, or a walker in a form that `as_walker` takes.
        slope: Slope in rad.
        state: State just after heelstrike.
        *motors: Hip torque, ankle torque and push-off, or the first of them, as in `Drive`.

    Raises:
        WalkerError: if this is no walker.
    """
    drive, period = PASSIVE, 1
    # A protocol takes long to look for, and walkers are followed in small steps.
    if not isinstance(walker, Walker | str) and isinstance(walker, Periodic):
        slope = walker.slope if slope is None else slope
        state = walker.state if state is None else state
        walker, drive, period = walker.walker, walker.drive, walker.period
    given = [own if part is None else part for part, own in zip(motors, drive, strict=False)]
    drive = Drive(*given, *drive[len(given) :])
    return Walk(as_walker(walker), slope, state, drive, period)  # type: ignore[arg-type]
