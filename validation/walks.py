"""Gaits and branches for the rows, cached so that each is computed once."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import lru_cache
from typing import Literal

import gym_passive_walker as gpw
from gym_passive_walker import Gait, GaitFamily, RealityCheck, Walker
from validation.scaling import local_exponents

Kind = Literal["long", "short"]
KINDS: tuple[Kind, Kind] = ("long", "short")

TUNED = {name: gpw.tune(walker) for name, walker in gpw.WALKERS.items()}
"""The package's walkers with exact tuning; the rounded digits of Table 4.1 are tuned roughly."""

# Reasons for the end of a branch, as in `GaitFamily.ends`.
KNEE_MEETS_HEEL = "kneestrike and heelstrike coincide"
STANCE_STOPS = "the stance leg barely passes the vertical"
TANGENTIAL = "heelstrike becomes tangential"
BOUND = "end of the range asked for"


@lru_cache(maxsize=512)
def gait(walker: Walker | str, slope: float, kind: Kind = "long") -> Gait:
    """A gait of a walker at a slope."""
    return gpw.find_gait(walker, slope, kind)


@lru_cache(maxsize=64)
def family(
    walker: Walker | str, low: float, high: float, kind: Kind = "long", resolution: float = 0.05
) -> GaitFamily:
    """A branch of gaits over slopes."""
    return gpw.gait_family(walker, low, high, kind, resolution=resolution)


def numbers_of_gaits(walkers: Iterable[Walker | str], slopes: Iterable[float]) -> list[int]:
    """Number of gaits at each slope, walker by walker."""
    slopes = list(slopes)
    return [len(gpw.find_gaits(walker, slope)) for walker in walkers for slope in slopes]


def exponents(walker: Walker | str, slope: float, kind: Kind = "long") -> tuple[float, float]:
    """Exact local exponents of stance angle and speed with slope, of the gait at a slope."""
    local = local_exponents(family(walker, slope, 1.01 * slope, kind))
    return float(local.stance_angle[0]), float(local.speed[0])


def checked(walker: Walker | str, slope: float, kind: Kind = "long") -> RealityCheck:
    """Feasibility of a gait: ground contact and knees."""
    return gpw.reality_check(walker, slope, gait(walker, slope, kind).state)


def sliding(walker: Walker | str, slope: float, kind: Kind) -> float:
    """Tangential over normal velocity of the landing foot."""
    velocity = gpw.foot_velocity(gait(walker, slope, kind))
    return abs(float(velocity.tangential / velocity.normal))


def boundary(
    low: float, high: float, below: Callable[[float], bool], accuracy: float
) -> tuple[float, float]:
    """Bracket, by bisection, where a condition that holds at `low` ceases to hold before `high`."""
    while high - low > accuracy:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if below(middle) else (low, middle)
    return low, high
