"""The section just after heelstrike, its coordinates, and the stride map's residual on it.

On the section the legs mirror each other and are straight, so a state is the stance angle and the
rates: four numbers for a kneed walker, three for the others. The charts here are dimensionless and
logarithmic, u = (ln angle, rates / angle): steps of every size look alike in them, from slopes of
1e-8 on.

Derivatives are exact: every function here takes complex arguments, and an infinitesimal imaginary
part passes through the flow, the collisions and the moments at which they happen (which is what
saltation matrices account for elsewhere).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gym_passive_walker.physics import constants as K
from gym_passive_walker.physics import record as R
from gym_passive_walker.physics.constants import Kind
from gym_passive_walker.physics.engine import advance
from gym_passive_walker.physics.events import Outcome
from gym_passive_walker.physics.frame import frame_of
from gym_passive_walker.physics.record import LONGEST_STRIDE, new_records
from gym_passive_walker.walkers import Walker

INFINITESIMAL = 1e-100
"""Imaginary part that carries a derivative; its square is nothing beside any real part."""

_DIMENSION = {Kind.KNEED: 4, Kind.COMPASS: 3, Kind.SIMPLEST: 3}


class Section(NamedTuple):
    """A walker's section and what its stride map needs.

    Attributes:
        kind: Which equations it obeys.
        constants: Its dimensionless constants, shape (1, COUNT) or one row per point.
        dimension: Coordinates of a point on the section.
        time: Its unit of time.
    """

    kind: Kind
    constants: NDArray
    dimension: int
    time: float

    def state(self, u: NDArray) -> NDArray:
        """Dimensionless states (n, 6) at points u (n, dimension)."""
        angle = np.exp(u[:, 0])
        state = np.empty((len(u), 6), u.dtype)
        state[:, 0] = angle
        state[:, 1] = state[:, 2] = -angle
        state[:, 3 : 2 + self.dimension] = u[:, 1:] * angle[:, None]
        if self.dimension == 3:
            state[:, 5] = state[:, 4]
        return state

    def point(self, state: NDArray) -> NDArray:
        """Points u (n, dimension) of dimensionless states (n, 6) on the section."""
        return np.column_stack(
            [np.log(state[:, 0]), state[:, 3 : 2 + self.dimension] / state[:, :1]]
        )


def section_of(walker: Walker) -> Section:
    """The section of a walker."""
    kind = K.kind_of(walker)
    frame = frame_of(walker)
    return Section(kind, K.constants(walker)[None], _DIMENSION[kind], frame.time)


class Return(NamedTuple):
    """Where some strides took points of the section.

    Attributes:
        end: Points after the strides, (n, dimension).
        imbalance: Energy lost at collisions less energy supplied, over their mean, as if each
            stride ended at the height where it began; (n,). Zero on a gait, and precise where
            the small difference of two states would not be.
        records: The engine's record of the last stride, (n, FIELDS).
        duration: Of all strides, (n,).
        length: Of all steps along the slope, over the leg length, (n,).
        alive: Whether every stride ended with a heelstrike, (n,).
    """

    end: NDArray
    imbalance: NDArray
    records: NDArray
    duration: NDArray
    length: NDArray
    alive: NDArray


def strides(
    section: Section,
    u: NDArray,
    slope: NDArray,
    *,
    count: int = 1,
    torque: NDArray | float = 0.0,
    tolerance: float = 1e-13,
    longest: float = LONGEST_STRIDE,
) -> Return:
    """Take points of the section through a number of strides.

    Args:
        section: The section.
        u: Points, (n, dimension), real or complex.
        slope: Slope in rad of each point, (n,).
        count: Strides to take.
        torque: Hip torque held through them, dimensionless.
        tolerance: Of the integration.
        longest: Time after which a stride is given up.
    """
    c = section.constants
    dtype = np.result_type(u, slope, torque, c)
    c = c.astype(dtype)
    state = section.state(u.astype(dtype))
    lost = np.zeros(len(u), dtype)
    gained = np.zeros(len(u), dtype)
    duration = np.zeros(len(u), dtype)
    length = np.zeros(len(u), dtype)
    alive = np.ones(len(u), bool)
    records = new_records(state, slope, torque)
    for _ in range(count):
        start = state[:, 0]
        records = new_records(state, slope, torque, end=longest)
        records[~alive, R.END] = 0.0  # nothing to follow
        with np.errstate(all="ignore"):
            advance(section.kind, c, records, tolerance=tolerance)
        alive &= np.real(records[:, R.OUTCOME]) == Outcome.HEELSTRIKE
        state = records[:, :6]
        end = state[:, 0]
        step = 2.0 * c[:, K.LEG] * np.sin(end) + c[:, K.FOOT_RADIUS] * (start + end)
        length += step
        lost += records[:, R.KNEE_LOSS] + records[:, R.HEEL_LOSS]
        gained += np.sin(slope) * step
        if section.kind != Kind.SIMPLEST:
            gained += torque * records[:, R.HIP_NET]
        duration += records[:, R.TIME]
    state = np.where(alive[:, None], state, section.state(u.astype(dtype)))
    imbalance = np.where(alive, 2.0 * (lost - gained) / np.where(alive, lost + gained, 1.0), 2.0)
    return Return(section.point(state), imbalance, records, duration, length, alive)


def with_derivatives(points: NDArray) -> NDArray:
    """Each row repeated once per column, with an infinitesimal step in that column.

    Args:
        points: Shape (n, m).

    Returns:
        Complex array of shape (n * m, m).
    """
    count, columns = points.shape
    steps = 1j * INFINITESIMAL * np.eye(columns)
    return (points[:, None, :] + steps[None]).reshape(count * columns, columns)


def split(values: NDArray, columns: int) -> tuple[NDArray, NDArray]:
    """Values and derivatives from a function of `with_derivatives`.

    Args:
        values: Complex array of shape (n * columns, k) or (n * columns,).
        columns: How many columns the points have.

    Returns:
        Values of shape (n, k) and derivatives of shape (n, k, columns).
    """
    values = values.reshape(-1, columns, *values.shape[1:])
    derivative = np.moveaxis(np.imag(values), 1, -1) / INFINITESIMAL
    return np.real(values[:, 0]), derivative
