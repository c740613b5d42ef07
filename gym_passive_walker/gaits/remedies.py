"""What would help where there is no gait: the nearest slope, and the nearest walker, with one.

A gait that exists elsewhere is followed towards what was asked for until it is lost. What lies
there is a fold, or an edge of the stride itself; where exactly, a `gait_family` tells.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from gym_passive_walker.gaits.gait import Gait, GaitKind
from gym_passive_walker.gaits.log_chart import logarithms
from gym_passive_walker.gaits.search import ACCURACY, glance, search
from gym_passive_walker.gaits.stride_map import StrideMap
from gym_passive_walker.progress import said
from gym_passive_walker.walkers import (
    WALKERS,
    Walker,
    WalkerError,
    blend,
    tune,
    tuning_errors,
)

_GENTLEST, _STEEPEST = 1e-4, 0.6  # slopes in rad looked at
_RATIO, _MOST_RATIO = 1.2, 30.0  # of slopes looked at, and how far from the one asked for
_FIRST, _LAST = 0.125, 1e-5  # share of the way in which a gait is followed at first, and at last
_TRIES = 60  # on the way, so that it ends
_TUNED = 1e-12  # tuning error of a tuned walker


class Remedies(NamedTuple):
    """What would help.

    Attributes:
        sentence: In words.
        slope: The nearest slope in rad at which this walker has such a gait, if one is known.
        walker: The nearest walker that has one at this slope, if one is known.
    """

    sentence: str
    slope: float | None = None
    walker: Walker | None = None


def remedies(
    walker: Walker, slope: float, kind: GaitKind, period: int, *, guessed: bool
) -> Remedies:
    """What would help a search that has found nothing.

    Args:
        walker: Whose gait was looked for.
        slope: Slope in rad.
        kind: "long" or "short".
        period: Strides until the gait repeats.
        guessed: Whether the search began at a guess instead of its own starts.
    """
    if guessed:
        return Remedies("Without `guess=` the search begins at starts of its own.")
    if period > 1:
        return Remedies(
            "Gaits of several strides branch off where the gait of one doubles its period: "
            "`doubling_cascade` locates where."
        )
    with said(f"no {kind}-step gait at slope {slope:g} rad: looking for what would help"):
        return _looked_for(walker, slope, kind)


def _looked_for(walker: Walker, slope: float, kind: GaitKind) -> Remedies:
    """What would help a search for a gait of one stride."""
    found: list[str] = []
    near = _nearest_slope(walker, slope, kind)
    if near is None:
        found.append("it has none at slopes near this one either")
    elif near == slope:
        found.append("a gait of slopes nearby can be followed to this one by `gait_family`")
    else:
        found.append(f"the nearest slope found that has one is {near:.5g} rad")
    alike = None
    if slope > 0.0:
        alike = _nearest_walker(walker, slope, kind)
        if max(abs(error) for error in tuning_errors(walker)) > _TUNED:
            has = "has one" if _tuned_walks(walker, slope, kind) else "has none either"
            found.append(f"tuned by `tune` it {has} at this slope")
    if alike is not None:
        name, share, other = alike
        fate = "keep" if _tuned_walks(other, slope, kind) else "lose"
        found.append(
            f"of the walkers between {name!r} in its size and this one, those up to "
            f"{100 * share:.0f} % of the way have one, and `tune` would {fate} it there"
        )
    sentence = "; ".join(found)
    return Remedies(f"{sentence[0].upper()}{sentence[1:]}.", near, alike and alike[2])


def _tuned_walks(walker: Walker, slope: float, kind: GaitKind) -> bool:
    """Whether the walker, tuned, has a gait."""
    try:
        return glance(tune(walker), slope, kind) is not None
    except WalkerError:  # it cannot be tuned
        return False


def _nearest_slope(walker: Walker, slope: float, kind: GaitKind) -> float | None:
    """The slope nearest by its logarithm with a gait; for walks on the level or uphill, a slope."""
    count = int(np.log(_MOST_RATIO) / np.log(_RATIO))
    ways = _RATIO ** np.arange(1, count + 1)
    if slope <= 0.0:
        candidates = np.geomspace(_GENTLEST, _STEEPEST, 2 * count)
    else:
        candidates = slope * np.stack([ways, 1.0 / ways], axis=1).ravel()
    for candidate in candidates[candidates < _STEEPEST].tolist():
        gait = glance(walker, candidate, kind)
        if gait is not None:
            if slope <= 0.0:
                return candidate
            share, _ = _followed(gait, lambda s, c=candidate: (walker, c * (slope / c) ** s))
            return slope if share == 1.0 else candidate * (slope / candidate) ** share
    return None


def _nearest_walker(
    walker: Walker, slope: float, kind: GaitKind
) -> tuple[str, float, Walker] | None:
    """The walker that gaits of presets are followed to on the way to this one, and how far it is.

    Returns:
        The preset, the share of the way, and the walker there; None if none of its kind walks.
    """
    best = None
    for name, preset in WALKERS.items():
        if preset.knees != walker.knees or preset.massless_legs != walker.massless_legs:
            continue
        scaled = _in_size(preset, walker)
        gait = glance(scaled, slope, kind)
        if gait is None:
            continue
        share, there = _followed(gait, lambda s, a=scaled: (blend(a, walker, s), slope))
        if best is None or share > best[1]:
            best = name, share, there.walker
    return best


def _in_size(preset: Walker, walker: Walker) -> Walker:
    """A preset with another walker's leg length, mass and gravity."""
    length = walker.leg_length / preset.leg_length
    mass = walker.total_mass / preset.total_mass
    units = {"gravity": walker.gravity / preset.gravity, "foot_angle": 1.0}
    values = {
        name: value * units.get(name, mass if name.endswith("mass") else length)
        for name, value in vars(preset).items()
        if name != "knees"
    }
    return replace(preset, **values)


def _followed(gait: Gait, place: Callable[[float], tuple[Walker, float]]) -> tuple[float, Gait]:
    """A gait followed towards where there is none, as far as it goes.

    Args:
        gait: Where it begins.
        place: Takes a share of the way, from 0 to 1, to a walker and a slope.

    Returns:
        The share of the way, and the gait there.
    """
    share, step = 0.0, _FIRST
    for _ in range(_TRIES):
        if share == 1.0 or step <= _LAST:
            break
        there = _beside(gait, *place(min(share + step, 1.0)))
        if there is None:
            step *= 0.5
        else:
            gait, share = there, min(share + step, 1.0)
    return share, gait


def _beside(gait: Gait, walker: Walker, slope: float) -> Gait | None:
    """What becomes of a gait in a place nearby, if it stays of its kind."""
    stride_map = StrideMap.of(walker, tolerance=ACCURACY)
    u = logarithms(StrideMap.of(gait.walker).points_at(gait.state))
    gaits, _ = search(stride_map, slope, u, 1, bool, (1,))
    return gaits[0] if gaits and gaits[0].kind == gait.kind else None
