"""Walkers that a design chooses from, each judged by its gait: followed from the one before."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gym_passive_walker.gaits.circle import coefficients, inside
from gym_passive_walker.gaits.gait import Gait
from gym_passive_walker.gaits.passage import NoStride
from gym_passive_walker.gaits.quantities import QUANTITIES, Graded, size_of
from gym_passive_walker.gaits.section import logarithms
from gym_passive_walker.gaits.sensitivity import (
    SLOPE,
    Place,
    Sensitivity,
    map_change,
    place_near,
    sensitivity,
)
from gym_passive_walker.walkers import WalkerError

_PIECES = (1, 4, 16)  # in which a gait is followed to another walker, as long as need be
_LEAP = 0.3  # from where a gait is expected to where Newton's method finds one


class Judged(NamedTuple):
    """What is known of a candidate; gradients are by its k shares.

    Attributes:
        gait: Its gait.
        quantities: What was asked for, by name, with gradients (k,).
        cubic: Coefficients of the polynomial whose roots are the multipliers, as `circle` has
            them, (3,), and their derivatives (3, k); None if not asked for.
    """

    gait: Sensitivity
    quantities: dict[str, Graded]
    cubic: tuple[NDArray[np.float64], NDArray[np.float64]] | None

    @property
    def complete(self) -> bool:
        """Whether everything that was asked for has a value and derivatives."""
        told = [*self.quantities.values(), *([self.cubic] if self.cubic else [])]
        return all(np.isfinite(array).all() for pair in told for array in pair)

    def inside(self, radius: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Conditions that all multipliers lie inside a circle, positive if so.

        Returns:
            Values (5,), and derivatives (5, k + 1) by the shares and the radius.

        Raises:
            ValueError: if the multipliers were not asked for.
        """
        if self.cubic is None:
            raise ValueError("this candidate was not judged by its multipliers")
        values, by = inside(self.cubic[0], radius)
        return values, np.column_stack([by[:, :3] @ self.cubic[1], by[:, 3]])


class Candidates:
    """Walkers alike but for some parameters, and the slope if that is among them.

    A candidate is told by its shares x: how far each parameter is from its lower to its upper
    bound.

    Args:
        start: A gait to follow to all others.
        parameters: What differs, k names.
        box: Lower and upper bounds, (k, 2).
        names: Quantities to judge by.
        multipliers: Whether to judge by the multipliers, too.

    Attributes:
        tried: Candidates judged so far.
    """

    def __init__(
        self,
        start: Gait,
        parameters: Sequence[str],
        box: NDArray,
        names: Sequence[str],
        *,
        multipliers: bool,
    ) -> None:
        self._start, self._parameters, self._names = start, tuple(parameters), tuple(names)
        self._low, self._width, self._multipliers = box[:, 0], box[:, 1] - box[:, 0], multipliers
        self._sizes = [size_of(name, start.walker, start.slope) for name in parameters]
        stride_map = start.stride_map
        place = Place(stride_map, start.slope, logarithms(stride_map.points_at(start.state))[0])
        self._here = sensitivity(place, self._parameters)
        self._last: tuple[bytes, Judged | None] = b"", None
        self.tried = 0
        self.first = (self._values(place) - self._low) / self._width

    def at(self, x: NDArray) -> Judged | None:
        """What is known of a candidate; None where its gait is lost, or it is no walker."""
        if x.tobytes() != self._last[0]:
            self.tried += 1
            try:
                gait = self._followed(self._low + self._width * x)
                judged = None if gait is None else self._judged(gait)
            except (WalkerError, NoStride, np.linalg.LinAlgError):
                judged = None
            if judged is not None and not judged.complete:  # strides beside it fail
                judged = None
            self._last = x.tobytes(), judged
        return self._last[1]

    def _values(self, place: Place) -> NDArray[np.float64]:
        """The parameters at a place."""
        own = {**vars(place.walker), SLOPE: place.slope}
        return np.array([own[name] for name in self._parameters])

    def _followed(self, values: NDArray) -> Sensitivity | None:
        """The gait at some parameters, followed from the last one found."""
        origin = self._values(self._here.place)
        for pieces in _PIECES:
            here = self._here
            for share in np.arange(1, pieces + 1) / pieces:
                goal = origin + share * (values - origin)
                moved = goal - self._values(here.place)
                place = self._beside(goal, here.place.u + here.coordinates @ moved)
                if place is None:
                    break
                here = sensitivity(place, self._parameters)
            else:
                self._here = here
                return here
        return None

    def _beside(self, values: NDArray, guess: NDArray) -> Place | None:
        """The gait at some parameters that is near to a guess."""
        changed = dict(zip(self._parameters, values.tolist(), strict=True))
        slope = changed.pop(SLOPE, self._start.slope)
        walker = replace(self._start.walker, **changed)
        place = place_near(self._start.stride_map.with_walker(walker), slope, guess)
        return place if place and np.abs(place.u - guess).max() < _LEAP else None

    def _judged(self, gait: Sensitivity) -> Judged:
        quantities = {}
        for name in self._names:
            value, gradient = QUANTITIES[name](gait)
            quantities[name] = value, gradient * self._width
        if not self._multipliers:
            return Judged(gait, quantities, None)
        values, derivatives = coefficients(gait.map, map_change(gait, self._sizes))
        return Judged(gait, quantities, (values, derivatives * self._width))
