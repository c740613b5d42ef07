"""What analyses need to know of a walker that is not one of McGeer's parameters."""

from __future__ import annotations

from typing import Any


class Mechanism:
    """A walker that a user states by equations of its own; see `gym_passive_walker.System`.

    Its parameters are the fields of `body`. It is dimensionless: length, mass, and gravity are 1.
    """

    knees = False
    massless_legs = False
    leg_length = total_mass = gravity = time_unit = 1.0
    title: str
    body: Any
    hybrid: Any
    """The hybrid system that it obeys, a `physics.hybrid.System`."""
