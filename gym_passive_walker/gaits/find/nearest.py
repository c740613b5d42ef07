"""Find the nearest gait where a walker has none at a slope: at another slope, or of another walker.

A gait that exists elsewhere is followed towards the slope or walker asked for, until it ends. A
gait ends at a fold, or where strides fail; `gait_family` locates such points.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from operator import itemgetter
from typing import Literal

import numpy as np

from gym_passive_walker._tools.arguments import gait_kind, one_slope, shown
from gym_passive_walker._tools.progress import said
from gym_passive_walker.gaits.find.search import seek
from gym_passive_walker.gaits.gait import Gait, GaitKind, GaitNotFound
from gym_passive_walker.models.model import check_supports
from gym_passive_walker.models.units import unit_of
from gym_passive_walker.models.walkers import (
    PARAMETERS,
    WALKERS,
    Walker,
    WalkerLike,
    as_walker,
    describe,
    interpolate,
)

_GENTLEST, _STEEPEST = 1e-4, 0.6  # slopes tried, in rad
_RATIO, _MOST_RATIO = 1.2, 30.0  # ratio of slopes tried, and the largest to the one asked for
_FIRST, _LAST = 0.125, 1e-5  # first and smallest step as a gait is followed, shares of the way
_TRIES = 60  # largest number of these steps


def nearest_gait(
    walker: WalkerLike,
    slope: float,
    kind: GaitKind = "long",
    *,
    keep: Literal["walker", "slope"] | None = None,
) -> Gait:
    """Find the passive gait nearest to a walker and a slope for which `find_gait` finds none.

    Example:
        >>> import gym_passive_walker as gpw
        >>> round(gpw.nearest_gait("lab", 0.001).slope, 4)  # there is none at gentler slopes
        0.0191
        >>> tuned = gpw.tune("lab")  # it has no gait at 0.036 rad
        >>> gpw.nearest_gait(tuned, 0.036, keep="slope").walker == tuned
        False

    Args:
        walker: The walker, in a form that `as_walker` takes; or a `System`.
        slope: Slope in rad.
        kind: "long" or "short", as in `Gait.kind`.
        keep: "walker" to try other slopes only, "slope" to try other walkers only. When None, other
            walkers are tried if this one has no gait at any slope tried. Of a `System`, other
            slopes only are tried.

    Returns:
        The gait. Its `walker` and `slope` show what had to change: nothing if the walker has a gait
        at this slope. Distances of slopes are those of their logarithms; uphill and on level
        ground, the gentlest slope tried is the nearest. The nearest walker lies between a preset,
        scaled to the walker's size, and the walker. The search may take some seconds.

    Raises:
        GaitNotFound: if there is none either.
    """
    walker, slope, kind = as_walker(walker), one_slope(slope), gait_kind(kind)
    if keep is not None and (not isinstance(keep, str) or keep not in ("walker", "slope")):
        raise ValueError(f'keep must be "walker", "slope" or None, not {shown(keep)}')
    if keep == "slope":
        check_supports(walker, "McGeer's parameters")
    elif "McGeer's parameters" not in walker.supports:
        keep = "walker"  # no other systems are known
    with said(f"looking for the {kind}-step gait nearest to slope {slope:g} rad"):
        gait = seek(walker, slope, kind).gait
        if gait is None and keep != "slope":
            gait = at_nearest_slope(walker, slope, kind)
        if gait is None and keep != "walker":
            gait = _of_nearest_walker(walker, slope, kind)
    if gait is None:
        tried = {"walker": "at another slope", "slope": "of another walker"}
        raise GaitNotFound(
            f"no {kind}-step gait near {describe(walker)} at slope {slope:g} rad, and none "
            f"{tried[keep] if keep else ' or '.join(tried.values())} either"
        )
    return gait


def at_nearest_slope(walker: Walker, slope: float, kind: GaitKind) -> Gait | None:
    """Return the gait at the nearest slope, by its logarithm; at the gentlest if slope <= 0."""
    count = int(np.log(_MOST_RATIO) / np.log(_RATIO))
    ways = _RATIO ** np.arange(1, count + 1)
    if slope <= 0.0:
        candidates = np.geomspace(_GENTLEST, _STEEPEST, 2 * count)
    else:
        candidates = slope * np.stack([ways, 1.0 / ways], axis=1).ravel()
    for candidate in candidates[candidates < _STEEPEST].tolist():
        gait = seek(walker, candidate, kind, quick=True).gait
        if gait is not None:
            if slope <= 0.0:
                return gait
            return _followed(gait, lambda s, c=candidate: (walker, c * (slope / c) ** s))[1]
    return None


def _of_nearest_walker(walker: Walker, slope: float, kind: GaitKind) -> Gait | None:
    """Follow gaits of presets towards this walker, and return the gait of the nearest walker."""
    found = []
    for preset in WALKERS.values():
        alike = bool(preset.knees) == bool(walker.knees)
        if not alike or preset.massless_legs != walker.massless_legs:
            continue
        scaled = replace(_in_size(preset, walker), knees=walker.knees)
        gait = seek(scaled, slope, kind, quick=True).gait
        if gait is not None:
            found.append(_followed(gait, lambda s, a=scaled: (interpolate(a, walker, s), slope)))
    return max(found, key=itemgetter(0))[1] if found else None


def _in_size(preset: Walker, walker: Walker) -> Walker:
    """Return a preset scaled to another walker's leg length, mass and gravity."""
    values = {
        name: getattr(preset, name) * unit_of(walker, name) / unit_of(preset, name)
        for name in PARAMETERS
    }
    return replace(preset, **values)


def _followed(gait: Gait, place: Callable[[float], tuple[Walker, float]]) -> tuple[float, Gait]:
    """Follow a gait as far as possible towards a walker and slope without one.

    `place` gives walker and slope in rad at a share of the way, 0 to 1. Returned are the share
    reached, and the gait there.
    """
    share, step = 0.0, _FIRST
    for _ in range(_TRIES):
        if share == 1.0 or step <= _LAST:
            break
        further = min(share + step, 1.0)
        walker, slope = place(further)
        found = seek(walker, slope, guess=gait.state, quick=True).gait
        if found and found.kind == gait.kind:
            gait, share = found, further
        else:
            step *= 0.5
    return share, gait
