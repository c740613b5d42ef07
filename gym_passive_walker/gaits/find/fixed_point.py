"""Find gaits: fixed points of the stride map, without an initial guess."""

from __future__ import annotations

from contextlib import suppress

from numpy.typing import ArrayLike

from gym_passive_walker._tools.arguments import gait_kind, whole
from gym_passive_walker.gaits.find.nearest import at_nearest_slope
from gym_passive_walker.gaits.find.search import ACCURACY, seek
from gym_passive_walker.gaits.gait import Gait, GaitKind, GaitNotFound
from gym_passive_walker.gaits.stride_map import MapLike, StrideMap, map_of
from gym_passive_walker.models.walkers import describe

_FOLDS = 0.1  # distance of a multiplier from 1 beside a fold


def find_gaits(
    walker: MapLike,
    slope: float | None = None,
    *,
    period: int = 1,
    guess: ArrayLike | None = None,
) -> list[Gait]:
    """Find every gait (limit cycle) of a period at a slope, longest step first.

    Args:
        walker: The walker, in a form that `as_walker` takes; or a map of `stride_map`, which may
            have a controller.
        slope: Slope in rad; the map's own when None.
        period: Strides until the motion repeats; 1 for an ordinary gait.
        guess: One or several states on the Poincaré section, (6,) or (n, 6), as initial guesses;
            the search uses its own when None.

    Returns:
        Zero, one or two gaits for walkers like the published ones; up to four with a push-off
        uphill. Under a controller, the gaits reached by walks near the passive gait.
    """
    stride_map = map_of(walker, tolerance=ACCURACY)
    slope, period = stride_map.chosen(slope), whole(period, "period")
    return seek(stride_map, slope, None, period=period, guess=guess).all


def find_gait(
    walker: MapLike,
    slope: float | None = None,
    kind: GaitKind = "long",
    *,
    period: int = 1,
    guess: ArrayLike | None = None,
) -> Gait:
    """Find the long-step or the short-step gait (limit cycle) of a walker at a slope.

    Example:
        >>> import gym_passive_walker as gpw
        >>> gpw.find_gait("lab", 0.036).stable  # passive
        True
        >>> pushed = gpw.stride_map("D", 0.0, controller=gpw.Actuation(push_off=0.05))
        >>> gpw.find_gait(pushed).push_off_cost > 0.0  # on level ground, by a push-off
        True

    Args:
        walker: The walker, in a form that `as_walker` takes; or a map of `stride_map`, which may
            have a controller.
        slope: Slope in rad; the map's own when None.
        kind: "long" or "short", as in `Gait.kind`. An untuned walker has two long-step gaits at the
            lowest slopes; "long" selects the one with the longer step. Under a feedback or a
            policy, `kind` is ignored.
        period: Strides until the motion repeats.
        guess: A state on the Poincaré section, (6,), as initial guess; the search uses its own
            when None. With a guess, `kind` is ignored.

    Returns:
        The gait. The relative error of its state is about 1e-12. If the controller has no
        derivative, `violation` reports how nearly the gait closes.

    Raises:
        GaitNotFound: if there is none. The message reports what was tried, how it ended, and what
            to do: for a passive walker, `nearest_gait` looks for another slope or walker.
    """
    stride_map = map_of(walker, tolerance=ACCURACY)
    slope, kind, period = stride_map.chosen(slope), gait_kind(kind), whole(period, "period")
    gait, gaits, ends = seek(stride_map, slope, kind, period=period, guess=guess)
    if gait is not None:
        return gait
    tried = ", ".join(f"{count} {name}" for name, count in ends.most_common()) or "none"
    others = f", only a {gaits[0].kind}-step gait was found" if gaits else ""
    name = stride_map.controller_name
    if "step kinds" not in stride_map.walker.supports:
        advice = "give a guess near the gait, a state just after heelstrike"
        if not (stride_map.walker.legs_alike or stride_map.controlled or stride_map.terrain):
            with suppress(ValueError):  # without a start of its own it is searched for nowhere
                advice += _elsewhere(at_nearest_slope(stride_map.walker, slope, kind))
    elif not stride_map.passive:
        advice = "give a guess near the gait, or follow it from where there is one by gait_family"
    elif guess is not None:
        advice = "without `guess=` the search begins at starts of its own"
    elif period > 1:
        advice = (
            "gaits of several strides branch off where the gait of one doubles its period: "
            "`doubling_cascade` locates where"
        )
    else:
        advice = "gpw.nearest_gait(walker, slope) looks for another slope or walker with one"
    raise GaitNotFound(
        f"no {'' if stride_map.controlled else f'{kind}-step '}gait of period {period} for "
        f"{describe(stride_map.walker)} at slope {slope} rad{f' under {name}' if name else ''}"
        f"{others} (first strides of the {sum(ends.values())} starts ended so: {tried}); {advice}"
    )


def _elsewhere(gait: Gait | None) -> str:
    """Return where the nearest gait is: legs that differ may have none on gentle slopes."""
    if gait is None:
        return "; at no other slope was one found either"
    near = f"; the nearest slope with one is {gait.slope:.5g} rad"
    return near + ", at a fold" * bool(abs(gait.multipliers - 1.0).min() < _FOLDS)


def state_on(stride_map: StrideMap, slope: float, state: ArrayLike | None) -> ArrayLike:
    """Return a state on the Poincaré section; that of the long-step gait when None."""
    return find_gait(stride_map, slope).state if state is None else state
