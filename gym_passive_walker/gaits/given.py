"""A walk as analyses take it: a walker, its slope, state and motors, or a gait that has them."""

from __future__ import annotations

from typing import Any, Protocol, TypeAlias, runtime_checkable

from numpy.typing import ArrayLike, NDArray

from gym_passive_walker.gaits.actuation import PASSIVE, Actuation
from gym_passive_walker.gaits.section import Section
from gym_passive_walker.walkers import Walker, WalkerLike, as_walker


@runtime_checkable
class Periodic(Protocol):
    """What a `Gait` has that analyses of a walk need; a gait is made of strides, not they of it."""

    @property
    def stride_map(self) -> Any:
        """Its `StrideMap`."""
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


GaitLike: TypeAlias = Periodic | Section | WalkerLike
"""What analyses of a walk take as their first argument: a gait, a stride map, or a walker."""


def walk_of(
    walker: GaitLike,
    slope: ArrayLike | None,
    state: ArrayLike | None,
    *motors: ArrayLike | None,
) -> tuple[Walker, Any, ArrayLike, Actuation, int, Any]:
    """Return a walk, not checked but for its walker; what is None is the gait's or the map's own.

    Args:
        walker: A gait, a stride map, or a walker in a form that `as_walker` takes.
        slope: Slope in rad.
        state: State just after heelstrike.
        *motors: Hip torque, ankle torque and push-off, or the first of them, as in `Actuation`; 0
            where there is neither a gait nor a map.

    Returns:
        The walker, its slope in rad, its state just after heelstrike; its motors, in its own units,
        where they do the same in each stride; the strides until the walk repeats, 1 where that is
        not known; and its stride map, where a controller works the motors or the ground is uneven,
        None without either.

    Raises:
        WalkerError: if this is no walker.
        ValueError: if motors are given where a controller works them.
    """
    own, period = PASSIVE, 1
    strides: Any = None
    # A protocol takes long to look for, and walkers are followed in small steps.
    if not isinstance(walker, Walker | str):
        if isinstance(walker, Periodic):
            slope = walker.slope if slope is None else slope
            state = walker.state if state is None else state
            strides, period = walker.stride_map, walker.period
        elif isinstance(walker, Section):
            strides = walker
    if strides is not None:
        slope = strides.slope if slope is None else slope
        walker = strides.walker
        if strides.controlled or strides.terrain is not None:
            if any(part is not None for part in motors):
                raise ValueError(
                    f"{strides.controller_name or 'this map'} works these motors: leave hip_torque,"
                    " ankle_torque and push_off out"
                )
            return walker, slope, state, PASSIVE, period, strides  # type: ignore[return-value]
        own = strides.controller or PASSIVE
    given = [mine if part is None else part for part, mine in zip(motors, own, strict=False)]
    actuation = Actuation(*given, *own[len(given) :])
    return as_walker(walker), slope, state, actuation, period, None  # type: ignore[return-value]
