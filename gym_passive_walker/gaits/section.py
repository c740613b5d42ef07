"""The Poincaré section just after heelstrike, and coordinates of its points.

On the section the legs are straight and mirror each other. The stance angle and the angular
velocities determine the state. A point is [angle, stance, thigh, shank] for a kneed walker, and
[angle, stance, swing] for the others. Points are dimensionless (see `units`);
`Points` converts them to states in the walker's own units, and to the chart.

The chart has logarithmic coordinates u = (ln angle, angular velocities / angle), which searches and
continuation use. They scale steps of every size alike, from slopes of 1e-8 on.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker._tools.arguments import shown
from gym_passive_walker.models.equations.numbers import exponential, logarithm
from gym_passive_walker.models.units import Units
from gym_passive_walker.models.walkers import Mechanism, Walker, varied

OFF = 1e-6
"""Largest angle in rad by which a state may lie off an impact: many digits, but not all of them."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Section:
    """The Poincaré section of one walker, or of n walkers that differ in one parameter.

    Attributes:
        walker: The walker.
        parameter: Name of the parameter in which the walkers differ; None if there is none.
        values: Value of `parameter` for each of n points, (n,).
    """

    walker: Walker
    parameter: str | None = None
    values: NDArray[np.float64] | None = None

    def with_parameter(self, name: str, values: ArrayLike) -> Self:
        """Return the section of walkers that differ in a parameter, with one point for each."""
        return replace(self, parameter=name, values=np.asarray(values, dtype=float))

    @property
    def dimension(self) -> int:
        """Number m of coordinates of a point."""
        if self.own:
            return self.walker.size
        return 4 if self.walker.knees else 3

    @property
    def size(self) -> int:
        """Number of entries of a state."""
        return self.dimension if self.own else 6

    @property
    def own(self) -> bool:
        """Whether a user has stated the system: a point is then a whole state."""
        return isinstance(self.walker, Mechanism)

    @cached_property
    def units(self) -> Units:
        """The walker's units; arrays (n,) where walkers differ."""
        if self.parameter is None or self.own:
            return self.walker.units
        return varied(self.walker, {self.parameter: self.values}).units

    def state(self, points: NDArray, place: int = 0) -> NDArray:
        """Return dimensionless states (..., 6) at points (..., m); `place` is ignored here."""
        if self.own:
            return np.array(points)
        states = np.empty((*points.shape[:-1], 6), points.dtype)
        states[..., 0] = points[..., 0]
        states[..., 1] = states[..., 2] = -points[..., 0]
        states[..., 3 : 2 + self.dimension] = points[..., 1:]
        states[..., 5] = points[..., -1]
        return states

    @property
    def coordinates(self) -> list[int]:
        """Indices of a state's entries that are coordinates of a point."""
        return list(range(self.dimension)) if self.own else [0, *range(3, 2 + self.dimension)]

    def point(self, states: NDArray) -> NDArray:
        """Return points (..., m) of dimensionless states (..., 6) on the section."""
        return states[..., self.coordinates]

    def dimensionless(self, states: ArrayLike) -> NDArray[np.float64]:
        """Return dimensionless states (n, 6) of any states in the walker's own units."""
        given = self.units.to_dimensionless(np.atleast_2d(np.array(states, dtype=float)))
        if not (self.walker.knees or self.own):  # thigh and shank are one body
            given[:, 2], given[:, 5] = given[:, 1], given[:, 4]
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
        found = Points(self, self.point(self.units.to_dimensionless(given)))
        if not self.own:
            angles = given[:, : 3 if self.walker.knees else 2]
            off = angles[:, 0] <= 0.0
            if getattr(self, "terrain", None) is None:  # else footholds determine the swing leg's
                off |= np.abs(angles[:, 1:] + angles[:, :1]).max(axis=1) > OFF
            if np.any(off):
                raise ValueError(
                    "a state on the Poincaré section is just after heelstrike: its stance angle is "
                    "positive, and the angles of thigh and shank are its opposite, not "
                    f"{shown(angles[off][0].tolist())}"
                )
        return found

    def from_chart(self, u: NDArray) -> Points:
        """Return the points with coordinates `u` (n, m) of the chart."""
        if self.own:
            return Points(self, np.array(u))
        angle = exponential(u[:, :1])
        points = Points(self, np.concatenate([angle, u[:, 1:] * angle], axis=1))
        points.__dict__["chart"] = u  # the logarithm would round it
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
    def chart(self) -> NDArray[np.float64]:
        """Coordinates (n, m) in which gaits are searched for."""
        values = self.values
        if self.section.own:
            return np.array(values)
        return np.concatenate([logarithm(values[:, :1]), values[:, 1:] / values[:, :1]], axis=1)

    @property
    def by_chart(self) -> NDArray[np.float64]:
        """Derivative of `values` by `chart`, (n, m, m)."""
        if self.section.own:
            return np.tile(np.eye(self.section.dimension), (len(self.values), 1, 1))
        derivative = self.values[:, :1, None] * np.eye(self.section.dimension)
        derivative[:, :, 0] = self.values
        return derivative

    def in_chart(self, changes: NDArray) -> NDArray[np.float64]:
        """Convert changes (n, m, k) of `values` to changes of `chart`."""
        if self.section.own:
            return np.array(changes)
        angle = self.values[:, 0, None, None]
        relative = changes / angle
        relative[:, 1:] -= (self.values[:, 1:, None] / angle) * relative[:, :1]
        return relative
