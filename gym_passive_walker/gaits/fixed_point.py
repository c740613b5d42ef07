"""Gaits: fixed points of the stride map, found without a guess, or a sentence on why not."""

from __future__ import annotations

from numpy.typing import ArrayLike

from gym_passive_walker.arguments import gait_kind, whole
from gym_passive_walker.gaits.gait import Gait, GaitKind, GaitNotFound
from gym_passive_walker.gaits.remedies import remedies
from gym_passive_walker.gaits.search import ACCURACY, begin, search, seek
from gym_passive_walker.gaits.stride_map import MapLike, StrideMap, map_of
from gym_passive_walker.walkers import describe


def find_gaits(
    walker: MapLike,
    slope: float | None = None,
    *,
    period: int = 1,
    guess: ArrayLike | None = None,
) -> list[Gait]:
    """Every gait of a period that is found at a slope, longest step first.

    Args:
        walker: The walker, in a form that `as_walker` takes; or a map of `stride_map`, whose
            controller then works its motors.
        slope: Slope in rad; the map's own when None.
        period: Strides until the motion repeats; 1 for an ordinary gait.
        guess: A section state or several to start from, instead of the search's own starts.

    Returns:
        Zero, one or two gaits for walkers like the published ones; up to four under a push-off
        uphill. Under a controller, those that walks near the passive gait lead to.
    """
    stride_map, slope = _asked(walker, slope)
    period = whole(period, "period")
    starts = begin(stride_map, slope, period, guess)
    # Uphill, a push-off makes up for the losses of steps of two sizes, each long and short.
    most = 4 if stride_map.actuation.push_off else 2
    return search(stride_map, slope, starts, period, lambda gaits: len(gaits) >= most)[0]


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
        walker: The walker, in a form that `as_walker` takes; or a map of `stride_map`, whose
            controller then works its motors.
        slope: Slope in rad; the map's own when None.
        kind: "long" or "short", as `Gait.kind` has it. Of an untuned walker's two long-step gaits
            at the lowest slopes, the one with the longer step. Of a feedback or a policy, the gait
            found is returned whatever its kind.
        period: Strides until the motion repeats.
        guess: A section state to start from, instead of the search's own starts; the gait found
            from it is returned whatever its kind.

    Returns:
        The gait, its state exact to about 1e-12 relative; `violation` says how nearly it closes
        where a controller has no derivative.

    Raises:
        GaitNotFound: if there is none. The message says what was tried, how it ended and what would
            help: of a passive walker the nearest slope with such a gait, or a walker alike that has
            one here; and the exception has both as `slope` and `walker`. To look for them may take
            some seconds.
    """
    stride_map, slope = _asked(walker, slope)
    kind, period = gait_kind(kind), whole(period, "period")
    gait, gaits, ends = seek(stride_map, slope, kind, period=period, guess=guess)
    if gait is not None:
        return gait
    tried = ", ".join(f"{count} {name}" for name, count in ends.most_common()) or "none"
    others = f"; only a {gaits[0].kind}-step gait was found" if gaits else ""
    name = stride_map.controller_name
    none = (
        f"no {'' if stride_map.controlled else f'{kind}-step '}gait of period {period} for "
        f"{describe(stride_map.walker)} at slope {slope} rad{f' under {name}' if name else ''}"
        f"{others}. First strides of the {sum(ends.values())} starts ended so: {tried}."
    )
    if not stride_map.passive:
        raise GaitNotFound(
            f"{none} Give a guess near the gait, or follow it from where there is one by "
            "gait_family."
        )
    remedy = remedies(stride_map.walker, slope, kind, period, guessed=guess is not None)
    raise GaitNotFound(f"{none} {remedy.sentence}", slope=remedy.slope, walker=remedy.walker)


def _asked(walker: MapLike, slope: float | None) -> tuple[StrideMap, float]:
    """The map, and the slope, of which a gait is asked for."""
    stride_map = map_of(walker, tolerance=ACCURACY)
    return stride_map, stride_map.chosen(slope)
