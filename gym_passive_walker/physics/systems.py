"""Every kind of walker, and which of them a walker is."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gym_passive_walker.physics import kneed, simplest, straight
from gym_passive_walker.physics.bodies import body_from
from gym_passive_walker.physics.hybrid import System
from gym_passive_walker.walkers import Walker

SYSTEMS = {system.name: system for system in (kneed.SYSTEM, straight.SYSTEM, simplest.SYSTEM)}
"""By name."""


def system_of(walker: Walker) -> System:
    """Which equations this walker obeys."""
    if walker.massless_legs:
        return simplest.SYSTEM
    return kneed.SYSTEM if walker.knees else straight.SYSTEM


def body_of(walker: Walker) -> Any:
    """The constants of a walker."""
    return body_from(walker, system_of(walker).Body)


@lru_cache(maxsize=4096)
def _row(walker: Walker) -> NDArray[np.float64]:
    return np.array(body_of(walker), dtype=float)[None, None]


def bodies(*walkers: Walker) -> NDArray[np.float64]:
    """Constants of walkers of one kind as the engine reads them, (walkers, 1, constants)."""
    return np.concatenate([_row(walker) for walker in walkers])
