"""Stride maps that a function returns for the values of a parameter, such as a controller's gain.

A function can vary whatever a stride map consists of: gains, terrain, a command, or several
parameters of a walker at once. Derivatives by the parameter are central differences.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker._tools.arguments import shown
from gym_passive_walker.gaits.section import Points
from gym_passive_walker.gaits.stride_map import MapLike, Samples, StrideMap, map_of
from gym_passive_walker.models.units import Units
from gym_passive_walker.models.walkers import WalkerError

_SHIFT = 1e-4  # of the range, for differences

MapOfValue = Callable[[float], MapLike]
"""Type of a function from a parameter's value to a stride map, or to a passive walker."""


def map_at(make: MapOfValue, parameter: str, value: float, tolerance: float) -> StrideMap:
    """Return the stride map of a value.

    Raises:
        ValueError: if the function raises one, or returns no stride map.
    """
    try:
        made = make(value)
    except ValueError as error:
        raise ValueError(f"the function of {parameter} failed at {value:.6g}: {error}") from error
    try:
        return map_of(made, tolerance=tolerance)
    except WalkerError as error:
        raise ValueError(
            f"the function of {parameter} must return a stride map or a walker: {error}"
        ) from error


@dataclass(frozen=True, eq=False, kw_only=True)
class VariedMap(StrideMap):
    """The stride maps of n values of a parameter, with one point for each.

    Beyond its range, a map is continued linearly, so that a branch of gaits may cross the end.

    Attributes:
        parameter: Name of what varies.
        values: Its values, (n,).
        make: The function from a value to a map.
        bounds: Range of the parameter: its lowest and highest value.
    """

    parameter: str
    values: NDArray[np.float64]
    make: MapOfValue
    bounds: tuple[float, float]

    @cached_property
    def maps(self) -> list[StrideMap]:
        """The stride map of each value, (n,), of the nearest one in the range."""
        return [self._map(value) for value in self._inside.tolist()]

    @cached_property
    def _inside(self) -> NDArray[np.float64]:
        """The nearest values in the range; its start where a guess has failed."""
        values = self.values
        return np.clip(np.where(np.isfinite(values), values, self.bounds[0]), *self.bounds)

    def _map(self, value: float) -> StrideMap:
        found = map_at(self.make, self.parameter, value, self.tolerance)
        if found.dimension != self.dimension:
            raise ValueError(
                f"maps of one section are needed: at {self.parameter} = {value:.6g} points have "
                f"{shown(found.dimension)} coordinates, not {self.dimension}"
            )
        if len(found.ground) != len(self.ground):
            raise ValueError(
                f"maps that repeat after as many strides are needed: at {self.parameter} = "
                f"{value:.6g} it is {len(found.ground)}, elsewhere {len(self.ground)}"
            )
        return found

    @property
    def parameters(self) -> dict[str, float]:
        """The parameter; a family varies no other."""
        return {self.parameter: self.bounds[0]}

    @property
    def passive(self) -> bool:
        """Whether no actuator drives any of the walkers."""
        return all(each.passive for each in self.maps)

    @property
    def controlled(self) -> bool:  # type: ignore[override]
        """Whether a controller observes the walkers, as in the first map."""
        return self.maps[0].controlled

    @property
    def weights(self) -> NDArray[np.float64]:
        """The walkers' weights over the unit of force, (n,)."""
        return np.array([each.weights for each in self.maps])

    @property
    def hold(self) -> float:
        """Time for which torques are held, as in the first map."""
        return self.maps[0].hold

    @cached_property
    def units(self) -> Units:
        """Each walker's units, arrays (n,)."""
        return Units(*map(np.array, zip(*(each.units for each in self.maps), strict=True)))  # type: ignore[arg-type]

    def points(self, states: ArrayLike) -> Points:
        """Return the points of states (n, 6), each on the ground and in the units of its map."""
        each = zip(self.maps, np.atleast_2d(states), strict=True)
        return Points(self, np.concatenate([own.points_at(state) for own, state in each]))

    def state(
        self, points: NDArray, place: int = 0, lanes: NDArray | None = None
    ) -> NDArray[np.float64]:
        """Return dimensionless states (n, 6) at points (n, m), on foothold `place`."""
        maps = self.maps if lanes is None else [self.maps[lane] for lane in lanes]
        each = zip(maps, points, strict=True)
        return np.array([own.state(point, place) for own, point in each])

    def steepness(self, points: NDArray, slopes: NDArray) -> NDArray[np.float64]:
        """How steeply the foot comes down at heelstrikes, as `StrideMap.steepness` does, (n,)."""
        each = zip(self.maps, points[:, None], slopes[:, None], strict=True)
        return np.concatenate([own.steepness(*x) for own, *x in each])

    def sample(self, points: NDArray, slopes: ArrayLike, times: NDArray) -> Samples:
        """Sample strides at given times, as `StrideMap.sample` does."""
        each = zip(self.maps, points[:, None], np.ravel(slopes), times[:, None], strict=True)
        return Samples(
            *map(np.concatenate, zip(*(own.sample(*x) for own, *x in each), strict=True))
        )

    def _follow(
        self,
        points: NDArray,
        slopes: NDArray,
        lanes: NDArray,
        strides: int,
        by: Sequence[str] = (),
        along: NDArray | None = None,
    ) -> tuple[NDArray, NDArray[np.int8]]:
        """Return fields of `Change`, values before derivatives, (1 + k, m + 7, n), and outcomes."""
        results, outcomes = [], []
        for i, lane in enumerate(lanes.tolist()):
            here = slice(i, i + 1)
            walk = points[here], slopes[here], np.zeros(1, np.intp), strides
            ways = None if along is None else along[here]
            rest = [name for name in by if name != self.parameter]
            found, ended = self.maps[lane]._follow(*walk, rest, ways)
            beyond = self.values[lane] - self._inside[lane]
            if self.parameter in by or beyond != 0.0:
                rate = self._rate(float(self._inside[lane]), walk)
                found[:1] += beyond * rate
                if self.parameter in by:  # the only one besides the coordinates, and the last
                    found = np.concatenate([found, rate])
            results.append(found)
            outcomes.append(ended)
        return np.concatenate(results, axis=2), np.concatenate(outcomes)

    def _rate(self, value: float, walk: tuple[NDArray, NDArray, NDArray, int]) -> NDArray:
        """Return the derivative of a walk's results by the parameter, (1, m + 7, 1)."""
        low, high = self.bounds
        shift = _SHIFT * (high - low)
        ends = max(value - shift, low), min(value + shift, high)
        before, after = (self._map(end)._follow(*walk)[0] for end in ends)
        return (after - before) / (ends[1] - ends[0])
