"""The Markov chain of a walker on footholds of random heights, and its linearization.

Each foothold's height is drawn by itself, so a height change depends on the height before it. The
state of the chain is therefore the walker's state just after heelstrike together with the height of
its foothold, and with the heights ahead that a controller observes.
"""

from __future__ import annotations

import numpy as np
import scipy
from numpy.typing import NDArray

from gym_passive_walker.gaits.stride_map import StrideMap
from gym_passive_walker.models.equations.hybrid import Outcome

_TOLERANCE = 1e-8  # of the strides; far below what changes a share of falls by a percent
_SHIFT = 1e-4  # of a coordinate, for the linearized chain
_NEGLIGIBLE = 3e-3  # of the largest Hankel singular value: directions below it are left out
_CHUNK = 2048  # strides at once: as many as a map follows at once under a controller


class Chain:
    """The Markov chain of a walker on footholds of random heights.

    Its state holds the walker's state in units of `height_std`, and heights in standard deviations:
    of the present foothold, and of those ahead that are observed, except the last. That is drawn.

    Args:
        strides: The stride map.
        state: State of the gait, (6,), in the walker's own units.
        height_std: Standard deviation of heights, in leg lengths.
        slope: Slope in rad.

    Attributes:
        gait: State of the chain on the gait, (k,).
        memory: Spectral radius of the linearized chain.
        axes: Balanced coordinates of the chain's state, (d, k).
        strides: Number of strides computed so far.
    """

    def __init__(self, strides: StrideMap, state: NDArray, height_std: float, slope: float) -> None:
        self._map, self._slope = strides.with_tolerance(_TOLERANCE), slope
        self._std, self.strides = height_std, 0
        self._gait = strides.dimensionless(state)[0]
        # A walker's trailing leg is free as well: its angle depends on the last height change.
        self._free = strides.chart.free
        self._ahead = max(strides.terrain_lookahead, 1)
        self.gait = np.concatenate([self._gait[self._free] / height_std, np.zeros(self._ahead)])
        self._scale()

    def step(self, states: NDArray, heights: NDArray) -> tuple[NDArray, NDArray[np.bool_]]:
        """The next states (n, k) from states (n, k) and drawn heights (n,), and which walk on."""
        size, unit, ahead = len(self._free), self._map.units, self._map.terrain_lookahead
        feet = np.column_stack([states[:, size:], heights])
        changes = np.diff(feet, axis=1) * self._std
        own = np.repeat(self._gait[None], len(states), axis=0)
        own[:, self._free] = states[:, :size] * self._std
        self._map.chart.trail(own)
        seen = np.zeros((len(states), 2 * ahead))
        seen[:, ::2] = changes[:, :ahead]
        ends, struck = np.empty((len(states), size)), np.empty(len(states), bool)
        for first in range(0, len(states), _CHUNK):
            some = slice(first, first + _CHUNK)
            walked = self._map.stride(
                unit.to_own(own[some]), self._slope, ahead=seen[some],
                height_change=changes[some, 0] * unit.length, slope_change=0.0,
            )  # fmt: skip
            struck[some] = walked.outcome == Outcome.HEELSTRIKE
            ends[some] = unit.to_dimensionless(walked.state)[:, self._free] / self._std
        self.strides += len(states)
        return np.concatenate([ends, feet[:, 1:]], axis=1), struck

    def place(self, states: NDArray) -> NDArray[np.float64]:
        """Balanced coordinates (n, d) of states (n, k)."""
        return (states - self.gait) @ self.axes.T

    def _scale(self) -> None:
        """Find balanced coordinates, from differences of strides about the gait.

        Raises:
            ValueError: if the gait is not stable, or strides beside it fail.
        """
        size, count = len(self._free), len(self.gait)
        shift = np.zeros((count + 1, count + 1))
        np.fill_diagonal(shift, _SHIFT / self._std)
        starts = self.gait + np.concatenate([shift, -shift])[:, :count]
        ends, struck = self.step(starts, np.concatenate([shift, -shift])[:, count])
        if not struck.all():
            raise ValueError("a mesh of states needs a gait; strides beside this state fail")
        by = (ends[: count + 1] - ends[count + 1 :]) / (2.0 * _SHIFT / self._std)
        transition, drawn = by[:count].T, by[count:].T
        self.memory = float(np.abs(np.linalg.eigvals(transition)).max())
        if not self.memory < 1.0:
            raise ValueError(
                "a mesh of states needs a stable gait; the largest multiplier here is "
                f"{self.memory:.3g}"
            )
        excited = scipy.linalg.solve_discrete_lyapunov(transition, drawn @ drawn.T)
        output = np.diag([1.0] * size + [0.0] * self._ahead)
        acts = scipy.linalg.solve_discrete_lyapunov(transition.T, output)
        variances, axes = np.linalg.eigh(excited)
        root = axes * np.sqrt(np.maximum(variances, 1e-9 * variances[-1]))
        squares, turn = np.linalg.eigh(root.T @ acts @ root)
        share = np.sqrt(np.maximum(squares, 0.0) / squares[-1])  # Hankel singular values
        kept = share > _NEGLIGIBLE
        self.axes = (share[:, None] * (turn.T @ np.linalg.inv(root)))[kept]
