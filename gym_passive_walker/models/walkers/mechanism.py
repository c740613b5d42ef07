"""Walkers that are not described by McGeer's parameters, as far as analyses need them."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker.models.chart import Whole
from gym_passive_walker.models.equations.systems import UNEVEN
from gym_passive_walker.models.model import constants_from
from gym_passive_walker.models.units import Units


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
    units = Units(1.0, 1.0, 1.0, 1.0)
    supports: frozenset[str] = frozenset()

    @property
    def size(self) -> int:
        """Numbers of a state."""
        return 2 * self.coordinates

    def units_with(self, **values: ArrayLike) -> Units:
        """Return the units, on which the body has no effect."""
        return self.units

    @property
    def chart(self) -> Whole:
        """Coordinates of its states just after heelstrike."""
        return Whole(self.size)

    @property
    def control_units(self) -> NDArray[np.float64]:
        """Units of the controls: 1."""
        return np.ones(len(self.controls))

    @property
    def state_names(self) -> tuple[str, ...]:
        """Names of the numbers of a state."""
        return self.State._fields  # type: ignore[attr-defined]

    @property
    def kind(self) -> str:
        """Name of its equations."""
        return self.hybrid.name

    @property
    def weight(self) -> float:
        """Weight; gravity is 1."""
        return self.total_mass

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of what actuators hold, as derivatives by them are named."""
        return tuple(f"control {name}" for name in self.controls)

    @property
    def parameters(self) -> dict[str, float]:
        """Fields of `body` by name."""
        return self.body._asdict()

    def with_parameters(self, **values: float) -> Any:
        """Return a system with other values of some fields of `body`."""
        return self.vary(**values)

    def equations(self, using: Collection[str] = ()) -> Any:
        """Return the equations of motion, for uneven ground if a change of it is in use."""
        return self.hybrid if set(UNEVEN).isdisjoint(using) else self.uneven

    def constants(self, **values: ArrayLike) -> NDArray[Any]:
        """Return the constants of systems that differ in some, (1 or n, constants)."""
        return constants_from(self.body._replace(**values))


def check_heights_only(walker: Any, slopes: Any) -> None:
    """Check that a user's system has no footholds of different slopes.

    Its coordinates may be lengths, or angles to another link, which do not rotate with the ground.

    Raises:
        ValueError: if it is a `Mechanism` and a slope is not 0.
    """
    if "tilted footholds" not in walker.supports and np.any(slopes):
        raise ValueError(
            f"footholds of the system {walker.title!r} may differ in height, not in slope"
        )
