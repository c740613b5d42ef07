"""The Poincaré section just after heelstrike, and coordinates of its points.

A model's `chart` says which coordinates of a state make a point, and in which gaits are searched.
Points are dimensionless (see `units`); `Points` converts them to states in the walker's own units.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker.models.chart import Chart
from gym_passive_walker.models.units import Units
from gym_passive_walker.models.walkers import Walker


@dataclass(frozen=True, eq=False, kw_only=True)
class Section:
    """The Poincaré section of one walker, or of n walkers that differ in some parameters.

    Attributes:
        walker: The walker.
        varied: Parameters in which the walkers differ: a value for each of n points, (n,).
    """

    walker: Walker
    varied: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)

    def with_parameter(self, name: str, values: ArrayLike) -> Self:
        """Return the section of walkers that differ in a parameter too, with one point for each."""
        return replace(self, varied={**self.varied, name: np.asarray(values, dtype=float)})

    @cached_property
    def chart(self) -> Chart:
        """Coordinates of the points."""
        return self.walker.chart

    @property
    def dimension(self) -> int:
        """Number m of coordinates of a point."""
        return self.chart.dimension

    @property
    def size(self) -> int:
        """Number of entries of a state."""
        return self.walker.size

    @cached_property
    def units(self) -> Units:
        """The walker's units; arrays (n,) where walkers differ."""
        return self.walker.units_with(**self.varied) if self.varied else self.walker.units

    def state(self, points: NDArray, place: int = 0) -> NDArray:
        """Return dimensionless states (..., 6) at points (..., m); `place` is ignored here."""
        return self.chart.state(points)

    def point(self, states: NDArray) -> NDArray:
        """Return points (..., m) of dimensionless states (..., 6) on the section."""
        return states[..., self.chart.coordinates]

    def dimensionless(self, states: ArrayLike) -> NDArray[np.float64]:
        """Return dimensionless states (n, 6) of any states in the walker's own units."""
        given = self.units.to_dimensionless(np.atleast_2d(np.array(states, dtype=float)))
        self.chart.straighten(given)
        return given

    def at(self, values: NDArray) -> Points:
        """Return the points with dimensionless coordinates (n, m)."""
        return Points(self, values)

    def points(self, states: ArrayLike) -> Points:
        """Return the points of states (6,) or (n, 6) on the section, in the walker's own units.

        Raises:
            ValueError: if the shape does not fit, or a state is not one just after heelstrike.
        """
        given = np.atleast_2d(states)
        if given.shape[-1] != self.size:
            raise ValueError(f"states must have shape ({self.size},) or (n, {self.size})")
        self.chart.check(given, smooth=getattr(self, "terrain", None) is None)
        return Points(self, self.point(self.units.to_dimensionless(given)))

    def searched(self, u: NDArray) -> Points:
        """Return the points at search coordinates (n, m)."""
        points = Points(self, self.chart.point(u))
        points.__dict__["search"] = u  # a logarithm would round it
        return points

    def points_at(self, states: ArrayLike) -> NDArray[np.float64]:
        """Return coordinates (n, m) of states (n, 6) on the section, in the walker's own units."""
        return self.points(states).values

    def states_at(self, points: NDArray) -> NDArray[np.float64]:
        """Return states (n, 6), in the walker's own units, at coordinates (n, m)."""
        return Points(self, points).states


@dataclass(frozen=True, eq=False)
class Points:
    """Points of a Poincaré section, in each of their forms.

    Attributes:
        section: The section; a `StrideMap` is one.
        values: Dimensionless coordinates, (n, m).
    """

    section: Any
    values: NDArray[np.float64]

    @property
    def states(self) -> NDArray[np.float64]:
        """States (n, 6), in the walker's own units."""
        return self.section.units.to_own(self.section.state(self.values))

    @cached_property
    def search(self) -> NDArray[np.float64]:
        """Coordinates (n, m) in which gaits are searched for."""
        return self.section.chart.search(self.values)

    @property
    def by_search(self) -> NDArray[np.float64]:
        """Derivative of `values` by `search`, (n, m, m)."""
        return self.section.chart.by_search(self.values)

    def in_search(self, changes: NDArray) -> NDArray[np.float64]:
        """Convert changes (n, m, k) of `values` to changes of `search`."""
        return self.section.chart.in_search(self.values, changes)
