"""Logarithmic coordinates of the section, u = (ln angle, rates / angle), for searches and curves.

Steps of every size look alike in them, from slopes of 1e-8 on.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def from_logarithms(u: NDArray) -> NDArray[np.float64]:
    """Points (n, m) at logarithmic coordinates (n, m)."""
    angle = np.exp(u[:, :1])
    return np.concatenate([angle, u[:, 1:] * angle], axis=1)


def logarithms(points: NDArray) -> NDArray[np.float64]:
    """Logarithmic coordinates (n, m) of points (n, m)."""
    return np.concatenate([np.log(points[:, :1]), points[:, 1:] / points[:, :1]], axis=1)


def by_logarithms(points: NDArray) -> NDArray[np.float64]:
    """Derivative of points by their logarithmic coordinates, (n, m, m)."""
    derivative = points[:, :1, None] * np.eye(points.shape[1])
    derivative[:, :, 0] = points
    return derivative


def in_logarithms(points: NDArray, changes: NDArray) -> NDArray[np.float64]:
    """Changes (n, m, k) of points (n, m), as changes of their logarithmic coordinates."""
    angle = points[:, 0, None, None]
    relative = changes / angle
    relative[:, 1:] -= (points[:, 1:, None] / angle) * relative[:, :1]
    return relative
