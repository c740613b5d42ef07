"""Gaits: fixed points of the stride map, found without a guess, or a sentence on why not."""

from __future__ import annotations

from numpy.typing import ArrayLike

from gym_passive_walker.arguments import gait_kind, one_slope, whole
from gym_passive_walker.gaits.drive import PASSIVE, Drive, one_drive
from gym_passive_walker.gaits.gait import Gait, GaitKind, GaitNotFound
from gym_passive_walker.gaits.remedies import remedies
from gym_passive_walker.gaits.search import ACCURACY, begin, search, seek
from gym_passive_walker.gaits.stride_map import StrideMap
from gym_passive_walker.walkers import WalkerLike, as_walker, describe


def find_gaits(
    walker: WalkerLike,
    slope: float,
    *,
    period: int = 1,
    guess: ArrayLike | None = None,
    drive: Drive = PASSIVE,
) -> list[Gait]:
    """Every gait of a period that is found at a slope, longest step first.

    Args:
        walker: The walker, in a form that `as_walker` takes.
        slope: Slope in rad.
        period: Strides until the motion repeats; 1 for an ordinary gait.
        guess: A section state or several to start from, instead of the search's own starts.
        drive: What motors do in each stride.

    Returns:
        Zero, one or two gaits for walkers like the published ones; up to four under a push-off
        uphill.
    """
    walker = as_walker(walker)
    stride_map = StrideMap.of(walker, tolerance=ACCURACY, drive=one_drive(walker, drive))
    slope, period = one_slope(slope), whole(period, "period")
    starts = begin(stride_map, slope, period, guess)
    # Uphill, a push-off makes up for the losses of steps of two sizes, each long and short.
    most = 4 if stride_map.drive.push_off else 2
    return search(stride_map, slope, starts, period, lambda gaits: len(gaits) >= most)[0]


def find_gait(
    walker: WalkerLike,
    slope: float,
    kind: GaitKind = "long",
    *,
    period: int = 1,
    guess: ArrayLike | None = None,
    drive: Drive = PASSIVE,
) -> Gait:
    """Find the long-step or the short-step gait of a walker at a slope.

    Args:
        walker: The walker, in a form that `as_walker` takes.
        slope: Slope in rad.
        kind: "long" or "short", as `Gait.kind` has it. Of an untuned walker's two long-step gaits
            at the lowest slopes, the one with the longer step.
        period: Strides until the motion repeats.
        guess: A section state to start from, instead of the search's own starts; the gait found
            from it is returned whatever its kind.
        drive: What motors do in each stride.

    Returns:
        The gait, its state exact to about 1e-12 relative.

    Raises:
        GaitNotFound: if there is none. The message says what was tried, how it ended and what would
            help: the nearest slope with such a gait, or a walker alike that has one here; and the
            exception has both as `slope` and `walker`. To look for them may take some seconds.
    """
    walker, slope = as_walker(walker), one_slope(slope)
    kind, period = gait_kind(kind), whole(period, "period")
    drive = one_drive(walker, drive)
    gait, gaits, ends = seek(walker, slope, kind, period=period, guess=guess, drive=drive)
    if gait is not None:
        return gait
    tried = ", ".join(f"{count} {name}" for name, count in ends.most_common()) or "none"
    others = f"; only a {gaits[0].kind}-step gait was found" if gaits else ""
    if not drive.passive:
        raise GaitNotFound(
            f"no {kind}-step gait of period {period} for {describe(walker)} at slope {slope} rad "
            f"with {drive}{others}. First strides of the {sum(ends.values())} starts ended so: "
            f"{tried}. `gait_family(..., drive=...)` shows where its gaits begin and end."
        )
    remedy = remedies(walker, slope, kind, period, guessed=guess is not None)
    raise GaitNotFound(
        f"no {kind}-step gait of period {period} for {describe(walker)} at slope {slope} rad"
        f"{others}. First strides of the {sum(ends.values())} starts ended so: {tried}. "
        f"{remedy.sentence}",
        slope=remedy.slope,
        walker=remedy.walker,
    )
