"""A rimless wheel on rough ground: a walker without a swing leg, with a one-dimensional return map.

In the long run it falls in each stride with the probability 1 - lambda. Here lambda is the leading
eigenvalue of the return map in which falls are absorbing.

References:
    K. Byl, R. Tedrake, "Metastable walking machines", Int. J. Robotics Research 28 (2009)
    1040-1064.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from gym_passive_walker import WALKERS, stride
from validation.rows import Row, number
from validation.walks import gait

SPOKES, SLOPE = 8, math.radians(8.0)
HALF = math.pi / SPOKES
KEEPS = math.cos(2.0 * HALF) ** 2
"""Share of its energy that a wheel keeps in a collision."""

FASTEST = 1.2
"""Upper bound of the squared angular velocity with the hub above the contact, times l/g."""

_WHEEL = "Byl, Tedrake 2009"
_ELSEWHERE = "Recomputed for their wheel, by another program."


def wheels(deviation: float) -> Callable[[NDArray], tuple[NDArray, NDArray]]:
    """Random return map of a rimless wheel: the squared angular velocity at mid-stance.

    From one mid-stance to the next only the slope between them matters. The slope determines the
    fall of the hub before the collision and its rise afterwards.

    Args:
        deviation: Standard deviation of the slope in rad.

    Returns:
        A return map in the form of the argument `strides` of `leading_eigenvalue`.
    """
    points, weights = np.polynomial.legendre.leggauss(80)
    along, across = 2.0 * math.cos(HALF) * (1.0 - KEEPS), 2.0 * math.sin(HALF) * (1.0 + KEEPS)

    def strides(squares: NDArray) -> tuple[NDArray, NDArray]:
        # On slopes below `least` the hub does not reach the next mid-stance.
        lacks = 2.0 * (1.0 - KEEPS) - KEEPS * squares
        least = math.atan2(across, along) - np.arccos(
            np.clip(lacks / math.hypot(along, across), -1.0, 1.0)
        )
        least = np.maximum(least, SLOPE - 9.0 * deviation)
        half = 0.5 * (SLOPE + 9.0 * deviation - least)
        slopes = least[:, None] + half[:, None] * (points + 1.0)
        density = np.exp(-0.5 * ((slopes - SLOPE) / deviation) ** 2)
        density /= deviation * math.sqrt(2.0 * math.pi)
        following = KEEPS * squares[:, None] - 2.0 * (1.0 - KEEPS)
        following = following + along * np.cos(slopes) + across * np.sin(slopes)
        return following, density * half[:, None] * weights

    return strides


def leading_eigenvalue(
    strides: Callable[[NDArray], tuple[NDArray, NDArray]], low: float, high: float, nodes: int = 60
) -> float:
    """Leading eigenvalue of a return map of one coordinate in which falls are absorbing.

    The probability of survival is a smooth function of the coordinate at which a stride begins. It
    is approximated by the polynomial through its values at Chebyshev points.

    Args:
        strides: Function of that coordinate, (n,). It returns the coordinates at which the next
            strides may begin and their probabilities, both (n, k). Probabilities that add up to
            less than 1 leave falls.
        low: Least coordinate.
        high: Greatest coordinate.
        nodes: Number of Chebyshev points.
    """
    points, degree = np.polynomial.chebyshev.chebpts1(nodes), nodes - 1
    following, chances = strides(low + 0.5 * (high - low) * (points + 1.0))
    reached = np.polynomial.chebyshev.chebvander(
        2.0 * (following - low) / (high - low) - 1.0, degree
    )
    basis = np.polynomial.chebyshev.chebvander(points, degree)
    passing = np.einsum("nk,nkj->nj", chances, reached) @ np.linalg.inv(basis)
    return float(np.abs(np.linalg.eigvals(passing)).max())


def lasts(degrees: float, nodes: int = 80) -> float:
    """Mean number of steps to a fall; `degrees` is the standard deviation of the slope."""
    passing = leading_eigenvalue(wheels(math.radians(degrees)), 0.0, FASTEST, nodes)
    return 1.0 / (1.0 - passing)


def rough_ground() -> Iterator[Row]:
    """Rows on the two numbers of the wheel, and on point feet on random steps."""
    said = f"{_WHEEL} | wheel of 8 spokes, slopes normal about 8° by"
    yield number(f"{said} 2°: steps to a fall | 4324.913", lasts(2.0), digits=8, remark=_ELSEWHERE)
    why = (
        f"{_ELSEWHERE} Ours has as many digits at 60 nodes as at 80, and wheels that walk on the "
        "package's engine fall as often."
    )
    yield number(
        f"{said} 3°: steps to a fall | 113.5564", lasts(3.0), known="113.5697", digits=8, remark=why
    )
    for name in "DEF":
        yield number(
            f"geometry | {name}, slope 0.009: stride to a foothold down along a slope steeper by "
            "0.005, and turned so, less that on the steeper slope | 0",
            _step_down(name, 0.005),
            within=1e-11,
            digits=2,
            remark="Largest difference in state and, as a share, in duration and loss.",
        )


def _step_down(name: str, steeper: float) -> float:
    """Largest difference between a step down onto a turned foothold and a steeper slope."""
    walker, walks = WALKERS[name], gait(name, 0.009)
    on_slope = stride(walker, walks.slope + steeper, walks.state, tolerance=1e-13)
    turned = np.array([steeper] * 3 + [0.0] * 3)
    on_steps = stride(
        walker, walks.slope, walks.state - turned, tolerance=1e-13,
        height_change=-on_slope.step_length * math.sin(steeper), slope_change=steeper,
    )  # fmt: skip
    shares = [
        getattr(on_steps, measure) / getattr(on_slope, measure) - 1.0
        for measure in ("duration", "heelstrike_loss")
    ]
    return float(np.abs([*(on_steps.state - on_slope.state), *shares]).max())
