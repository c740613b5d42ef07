"""First arguments of analyses: a walker with slope, state and actuation, or a gait with all."""

from __future__ import annotations

from typing import Any, Protocol, TypeAlias

from numpy.typing import ArrayLike

from gym_passive_walker.gaits.actuation import PASSIVE, Actuation
from gym_passive_walker.gaits.section import Section
from gym_passive_walker.models.walkers import Walker, WalkerLike, as_walker


class Repeated(Protocol):
    """A walk that repeats after some strides, as a `Gait` does."""

    @property
    def stride_map(self) -> Any:
        """The stride map that it repeats under."""

    @property
    def slope(self) -> Any:
        """Slope in rad."""

    @property
    def state(self) -> Any:
        """State just after heelstrike."""

    @property
    def period(self) -> Any:
        """Number of strides after which it repeats."""


GaitLike: TypeAlias = Repeated | Section | WalkerLike
"""Type of the first argument of analyses of a walk: a gait, a stride map, or a walker."""


def walk_of(
    walker: GaitLike,
    slope: ArrayLike | None,
    state: ArrayLike | None,
    *motors: ArrayLike | None,
) -> tuple[Walker, Any, ArrayLike, Actuation, int, Any]:
    """Return a complete walk; a gait or map supplies what is None. Only the walker is checked.

    Args:
        walker: A gait, a stride map, or a walker in a form that `as_walker` takes.
        slope: Slope in rad.
        state: State just after heelstrike, (6,) or (n, 6).
        *motors: Hip torque, ankle torque and push-off, or the first of them, as in `Actuation`; 0
            without a gait or a map.

    Returns:
        The walker; its slope in rad; its state just after heelstrike; its actuation in its own
        units, if equal in each stride; the strides until the walk repeats, 1 if not known; and its
        stride map if it has a controller or uneven ground, else None.

    Raises:
        WalkerError: if `walker` is no walker.
        ValueError: if `motors` are given although the map has a controller or a terrain.
    """
    own, period = PASSIVE, 1
    strides: Any = None
    if isinstance(walker, Section):
        strides = walker
    elif hasattr(walker, "stride_map"):  # a gait
        gait: Any = walker
        slope = gait.slope if slope is None else slope
        state = gait.state if state is None else state
        strides, period = gait.stride_map, gait.period
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
