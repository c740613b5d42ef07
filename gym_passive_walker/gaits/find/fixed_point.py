"""Find gaits: fixed points of the stride map, without an initial guess.

If there is no gait, one that exists elsewhere is followed towards the slope or walker asked for,
until it ends. The message of `GaitNotFound` reports the nearest slope, and the nearest walker,
with a gait. A gait ends at a fold, or where strides fail; `gait_family` locates such points.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from gym_passive_walker._tools.arguments import gait_kind, whole
from gym_passive_walker._tools.progress import said
from gym_passive_walker.gaits.find.search import ACCURACY, seek
from gym_passive_walker.gaits.gait import Gait, GaitKind, GaitNotFound
from gym_passive_walker.gaits.stride_map import MapLike, StrideMap, map_of
from gym_passive_walker.models.units import unit_of
from gym_passive_walker.models.walkers import (
    PARAMETERS,
    WALKERS,
    Walker,
    WalkerError,
    describe,
    interpolate,
    tune,
    tuning_errors,
)

_GENTLEST, _STEEPEST = 1e-4, 0.6  # slopes tried, in rad
_RATIO, _MOST_RATIO = 1.2, 30.0  # ratio of slopes tried, and the largest to the one asked for
_FIRST, _LAST = 0.125, 1e-5  # first and smallest step as a gait is followed, shares of the way
_TRIES = 60  # largest number of these steps
_TUNED = 1e-12  # tuning error of a tuned walker


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
        GaitNotFound: if there is none. The message reports what was tried and how it ended. For a
            passive walker it reports the nearest slope with such a gait, or a similar walker that
            has one at this slope; these are attributes `slope` and `walker` of the exception. The
            search for them may take some seconds.
    """
    stride_map = map_of(walker, tolerance=ACCURACY)
    slope, kind, period = stride_map.chosen(slope), gait_kind(kind), whole(period, "period")
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
    near, alike = None, None
    if stride_map.own:
        advice = "Give a guess near the gait, a state just after heelstrike."
    elif not stride_map.passive:
        advice = "Give a guess near the gait, or follow it from where there is one by gait_family."
    elif guess is not None:
        advice = "Without `guess=` the search begins at starts of its own."
    elif period > 1:
        advice = (
            "Gaits of several strides branch off where the gait of one doubles its period: "
            "`doubling_cascade` locates where."
        )
    else:
        with said(f"no {kind}-step gait at slope {slope:g} rad: looking for what would help"):
            advice, near, alike = _advice(stride_map.walker, slope, kind)
    raise GaitNotFound(f"{none} {advice}", slope=near, walker=alike)


def state_on(stride_map: StrideMap, slope: float, state: ArrayLike | None) -> ArrayLike:
    """Return a state on the Poincaré section; that of the long-step gait when None."""
    return find_gait(stride_map, slope).state if state is None else state


def _advice(
    walker: Walker, slope: float, kind: GaitKind
) -> tuple[str, float | None, Walker | None]:
    """Return suggestions after a search for a gait of one stride has found none.

    Returns:
        A sentence; the nearest slope in rad at which this walker has such a gait; and the nearest
        walker that has one at this slope. Each of the last two is None if not known.
    """
    near, alike = _nearest_slope(walker, slope, kind), None
    if near is None:
        found = ["it has none at slopes near this one either"]
    elif near == slope:
        found = ["a gait of slopes nearby can be followed to this one by `gait_family`"]
    else:
        found = [f"the nearest slope found that has one is {near:.5g} rad"]
    if slope > 0.0:
        nearest = _nearest_walker(walker, slope, kind)
        if max(abs(error) for error in tuning_errors(walker)) > _TUNED:
            has = "has one" if _tuned_walks(walker, slope, kind) else "has none either"
            found.append(f"tuned by `tune` it {has} at this slope")
        if nearest is not None:
            name, share, alike = nearest
            effect = "keep" if _tuned_walks(alike, slope, kind) else "lose"
            found.append(
                f"of the walkers between {name!r} in its size and this one, those up to "
                f"{100 * share:.0f} % of the way have one, and `tune` would {effect} it there"
            )
    sentence = "; ".join(found)
    return f"{sentence[0].upper()}{sentence[1:]}.", near, alike


def _tuned_walks(walker: Walker, slope: float, kind: GaitKind) -> bool:
    """Return whether the walker has a gait once it is tuned."""
    try:
        return seek(tune(walker), slope, kind, quick=True).gait is not None
    except WalkerError:  # it cannot be tuned
        return False


def _nearest_slope(walker: Walker, slope: float, kind: GaitKind) -> float | None:
    """Return the nearest slope with a gait, by its logarithm; any such slope if slope <= 0."""
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
                return candidate
            share, _ = _followed(gait, lambda s, c=candidate: (walker, c * (slope / c) ** s))
            return slope if share == 1.0 else candidate * (slope / candidate) ** share
    return None


def _nearest_walker(
    walker: Walker, slope: float, kind: GaitKind
) -> tuple[str, float, Walker] | None:
    """Follow gaits of presets towards this walker, and return the walker nearest to it.

    Returns:
        The preset's name, the share of the way, and the walker there; None if no preset of this
        kind has a gait at this slope.
    """
    best = None
    for name, preset in WALKERS.items():
        if preset.knees != walker.knees or preset.massless_legs != walker.massless_legs:
            continue
        scaled = _in_size(preset, walker)
        gait = seek(scaled, slope, kind, quick=True).gait
        if gait is None:
            continue
        share, there = _followed(gait, lambda s, a=scaled: (interpolate(a, walker, s), slope))
        if best is None or share > best[1]:
            best = name, share, there.walker
    return best


def _in_size(preset: Walker, walker: Walker) -> Walker:
    """Return a preset scaled to another walker's leg length, mass and gravity."""
    values = {
        name: getattr(preset, name) * unit_of(walker, name) / unit_of(preset, name)
        for name in PARAMETERS
    }
    return replace(preset, **values)


def _followed(gait: Gait, place: Callable[[float], tuple[Walker, float]]) -> tuple[float, Gait]:
    """Follow a gait as far as possible towards a walker and slope without one.

    Args:
        gait: The gait at the beginning.
        place: Function from a share of the way, 0 to 1, to a walker and a slope in rad.

    Returns:
        The share of the way, and the gait there.
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
