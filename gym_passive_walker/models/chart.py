"""Coordinates of a model on the Poincaré section just after heelstrike, in which gaits are found.

A *point* holds the coordinates that determine a state there. *Search coordinates* scale steps of
every size alike.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gym_passive_walker._tools.arguments import shown
from gym_passive_walker.models.equations.numbers import natural_logarithm, power_of_e

OFF = 1e-6
"""Largest angle in rad by which a state may lie off an impact: many digits, but not all of them."""


_STANDS = 1e-5  # rad, in single precision: legs that mirror each other have just changed roles
_SWAPPED = 0.1  # rad: angles of both legs jump by more where they change roles on uneven ground

LARGEST = 1.4
"""Stance angle in rad that no gait exceeds."""


class Mirrored(NamedTuple):
    """Straight legs that mirror each other: a stance angle and angular velocities.

    A point is [angle, stance, thigh, shank] with knees, else [angle, stance, swing]. Search
    coordinates are u = (ln angle, angular velocities / angle), from slopes of 1e-8 on.
    """

    knees: bool

    trailing_leg_follows = True
    """Whether the trailing leg's angle just after heelstrike follows from the ground."""
    balance = 1
    """The equation of a gait that its energy balance replaces, which keeps its digits; or None."""

    @property
    def dimension(self) -> int:
        """Number m of coordinates of a point."""
        return 4 if self.knees else 3

    @property
    def coordinates(self) -> list[int]:
        """Indices of a state's entries that are coordinates of a point."""
        return [0, *range(3, 2 + self.dimension)]

    @property
    def free(self) -> list[int]:
        """Indices of a state's entries that are free on footholds of different heights."""
        return [0, 1, *range(3, 2 + self.dimension)]

    @property
    def box(self) -> NDArray[np.float64]:
        """Least and largest coordinates of a point of an optimal gait, (m, 2)."""
        return np.array([[0.01, 1.0]] + [[-3.0, 3.0]] * (self.dimension - 1))

    @property
    def starts(self) -> NDArray[np.float64]:
        """Changes of a state's angles with those of a point, (1, 3)."""
        return np.array([[1.0, -1.0, -1.0]])

    def state(self, points: NDArray) -> NDArray:
        """Return states (..., 6) at points (..., m)."""
        states = np.empty((*points.shape[:-1], 6), points.dtype)
        states[..., 0] = points[..., 0]
        states[..., 1] = states[..., 2] = -points[..., 0]
        states[..., 3 : 2 + self.dimension] = points[..., 1:]
        states[..., 5] = points[..., -1]
        return states

    def straighten(self, states: NDArray) -> None:
        """Let thigh and shank be one body in states (..., 6) if there are no knees, in place."""
        if not self.knees:
            states[..., 2], states[..., 5] = states[..., 1], states[..., 4]

    def trail(self, states: NDArray) -> None:
        """Let the trailing leg of states (..., 6) just after heelstrike be straight, in place."""
        states[..., 2] = states[..., 1]
        self.straighten(states)

    def check(self, states: NDArray, *, smooth: bool) -> None:
        """Check that states (n, 6) lie on the section.

        Args:
            states: The states; their angular velocities may have any unit.
            smooth: Whether the ground is; else footholds determine the swing leg's angle.

        Raises:
            ValueError: if one does not.
        """
        angles = states[:, : 3 if self.knees else 2]
        off = angles[:, 0] <= 0.0
        if smooth:
            off |= np.abs(angles[:, 1:] + angles[:, :1]).max(axis=1) > OFF
        if np.any(off):
            raise ValueError(
                "a state on the Poincaré section is just after heelstrike: its stance angle is "
                "positive, and the angles of thigh and shank are its opposite, not "
                f"{shown(angles[off][0].tolist())}"
            )

    def begins(self, before: NDArray, now: NDArray) -> NDArray[np.bool_]:
        """Which of states (n, 6), a control step after others, are just after heelstrike.

        A heelstrike raises the stance angle and lowers the swing angle; a stride does not.
        """
        jump = now[:, :2] - before[:, :2]
        mirrored = np.abs(now[:, 1:3] + now[:, :1]).max(axis=1) < _STANDS
        return mirrored | (jump[:, 0] > _SWAPPED) & (jump[:, 1] < -_SWAPPED)

    def walking(self, points: NDArray) -> NDArray[np.bool_]:
        """Which of points (n, m) a stride may begin in: the stance foot ahead, no leg lying."""
        return (points[:, 0] > 0.0) & (points[:, 0] < 0.5 * math.pi)

    def ahead(self, points: NDArray) -> NDArray[np.bool_]:
        """Which of points (n, m) just after heelstrike have the stance foot ahead."""
        return points[:, 0] > 0.0

    def within(self, u: NDArray) -> NDArray[np.float64]:
        """Return search coordinates (n, m), with NaN for stance angles larger than a gait's."""
        return np.where(u[:, :1] < math.log(LARGEST), u, np.nan)

    def point(self, u: NDArray) -> NDArray[np.float64]:
        """Return points (n, m) at search coordinates (n, m)."""
        angle = power_of_e(u[:, :1])
        return np.concatenate([angle, u[:, 1:] * angle], axis=1)

    def search(self, points: NDArray) -> NDArray[np.float64]:
        """Return search coordinates (n, m) of points (n, m)."""
        return np.concatenate(
            [natural_logarithm(points[:, :1]), points[:, 1:] / points[:, :1]], axis=1
        )

    def by_search(self, points: NDArray) -> NDArray[np.float64]:
        """Derivative of points (n, m) by search coordinates, (n, m, m)."""
        derivative = points[:, :1, None] * np.eye(self.dimension)
        derivative[:, :, 0] = points
        return derivative

    def in_search(self, points: NDArray, changes: NDArray) -> NDArray[np.float64]:
        """Convert changes (n, m, k) of points to changes of search coordinates."""
        angle = points[:, 0, None, None]
        relative = changes / angle
        relative[:, 1:] -= (points[:, 1:, None] / angle) * relative[:, :1]
        return relative


class Whole(NamedTuple):
    """Whole states: points and search coordinates are the states of a user's system."""

    size: int

    trailing_leg_follows = False
    balance = None

    @property
    def dimension(self) -> int:
        """Number m of coordinates of a point."""
        return self.size

    @property
    def coordinates(self) -> list[int]:
        """Indices of a state's entries that are coordinates of a point."""
        return list(range(self.size))

    @property
    def free(self) -> list[int]:
        """Indices of a state's entries that are free on footholds of different heights."""
        return self.coordinates

    @property
    def box(self) -> NDArray[np.float64]:
        """Least and largest coordinates of a point of an optimal gait, (m, 2): all are allowed."""
        return np.tile([-math.inf, math.inf], (self.size, 1))

    @property
    def starts(self) -> NDArray[np.float64]:
        """Changes of a state's coordinates with those of a point, (m / 2, m / 2)."""
        return np.eye(self.size // 2)

    def state(self, points: NDArray) -> NDArray:
        """Return states at points."""
        return np.array(points)

    def straighten(self, states: NDArray) -> None:
        """Leave states as they are."""

    trail = straighten

    def check(self, states: NDArray, *, smooth: bool) -> None:
        """Accept all states."""

    def walking(self, points: NDArray) -> NDArray[np.bool_]:
        """Which of points (n, m) a stride may begin in: all that are finite."""
        return np.asarray(np.isfinite(points).all(axis=1))

    ahead = walking
    within = point = search = state

    def by_search(self, points: NDArray) -> NDArray[np.float64]:
        """Derivative of points (n, m) by search coordinates, (n, m, m)."""
        return np.tile(np.eye(self.size), (len(points), 1, 1))

    def in_search(self, points: NDArray, changes: NDArray) -> NDArray[np.float64]:
        """Return changes (n, m, k) as they are."""
        return np.array(changes)


Chart = Mirrored | Whole
