"""Walkers that are not described by McGeer's parameters, as far as analyses need them."""

from __future__ import annotations

from typing import Any

import numpy as np


class Mechanism:
    """A walker with equations of a user's own; see `gym_passive_walker.System`.

    Its parameters are the fields of `body`. It is dimensionless: length, mass, and gravity are 1.
    """

    knees = False
    massless_legs = False
    leg_length = gravity = time_unit = 1.0
    foot_radius = 0.0
    title: str
    body: Any
    State: type
    start: Any
    limits: Any
    controls: tuple[str, ...]
    coordinates: int
    total_mass: float
    hybrid: Any
    """Its hybrid system, a `physics.hybrid.System`."""
    uneven: Any
    """Its hybrid system on footholds of different heights."""
    falls: Any
    drawn: Any
    lines: Any
    standing: Any
    with_both_feet_down: Any
    struck: Any
    exchanged: Any
    with_body: Any
    vary: Any
    centre_of_mass: Any


def state_size(walker: Any) -> int:
    """Size of a walker's state: coordinates and their rates."""
    return 2 * walker.coordinates if isinstance(walker, Mechanism) else 6


def check_heights_only(walker: Any, slopes: Any) -> None:
    """Check that a user's system has no footholds of different slopes.

    Its coordinates may be lengths, or angles to another link, which do not rotate with the ground.

    Raises:
        ValueError: if it is a `Mechanism` and a slope is not 0.
    """
    if isinstance(walker, Mechanism) and np.any(slopes):
        raise ValueError(
            f"footholds of the system {walker.title!r} may differ in height, not in slope"
        )


def check_parametric(walker: Any, what: str) -> None:
    """Check that a walker has legs with McGeer's parameters, which some analyses require.

    Args:
        walker: The walker.
        what: The analysis, as the beginning of the message.

    Raises:
        ValueError: if it is a `Mechanism`.
    """
    if isinstance(walker, Mechanism):
        raise ValueError(
            f"{what} needs a walker with two legs and McGeer's parameters, not the system "
            f"{walker.title!r}"
        )
