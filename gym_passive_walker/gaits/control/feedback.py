"""Once-per-stride linear feedback: the torques of a stride from the state that it starts in.

Around a gait the stride map is x' = A x + B u. Here x is the deviation on the section, and u that
of the torques held through the pieces of the stride. Both matrices are exact derivatives.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Literal

import numpy as np
import scipy
from numpy.typing import NDArray

from gym_passive_walker.gaits.actuation import Actuation, to_own
from gym_passive_walker.gaits.find.fixed_point import find_gait
from gym_passive_walker.gaits.find.newton import newton
from gym_passive_walker.gaits.find.search import seek
from gym_passive_walker.gaits.flow import flow, states_in
from gym_passive_walker.gaits.gait import Gait, GaitNotFound, gait_at
from gym_passive_walker.gaits.section import Points
from gym_passive_walker.gaits.stride_map import StrideMap
from gym_passive_walker.models.walkers import Walker

Method = Literal["lqr", "deadbeat"]

_REFERENCE_SLOPE = 0.005
"""Slope in rad of the passive gait that is followed to other slopes with a torque."""

_TORQUES = (0.01, 0.02, 0.03, 0.05)  # constant ones tried where there is no way to a gait
_HALVINGS = 10  # of the way from one slope to another, before it is given up
_ACCURACY, _SETTLED = 1e-12, 1e-10  # of a stride's end, wanted and at least
_SURVIVES = 1e-9  # singular values below this, relative to the largest, are directions forgotten


def powered_gait(walker: Walker, slope: float) -> Gait:
    """Find a gait at any slope: passive if there is one, else with a constant torque.

    A passive gait of a reference slope is followed to the slope wanted, while a torque takes over
    the work that gravity no longer does. Where that way is lost, steeper uphill, a gait is sought
    under greater torques.

    Raises:
        GaitNotFound: if the walker has no passive gait to begin with, and none under these torques.
    """
    passive = seek(walker, slope).gait
    if passive is not None:
        return passive
    gait = find_gait(walker, _REFERENCE_SLOPE)
    if walker.massless_legs:
        raise GaitNotFound("no torque drives the simplest walker: its legs have no mass to work on")
    # A stride turns the legs by four times the stance angle against each other.
    work = walker.total_mass * walker.gravity * gait.step_length
    work *= math.sin(_REFERENCE_SLOPE) - math.sin(slope)
    torque = work / (4.0 * gait.stance_angle)
    point, here, share, step = gait.point, _REFERENCE_SLOPE, 0.0, 0.25
    while share < 1.0 and step >= 0.5**_HALVINGS:
        goal = min(1.0, share + step)
        here = (1.0 - goal) * _REFERENCE_SLOPE + goal * slope
        try:
            point = _converged(walker, here, point.states[0], goal * torque)
            share = goal
        except GaitNotFound:
            step *= 0.5
    if share == 1.0:
        return gait_at(point, slope, 1)
    found = first_driven(walker, slope, "hip_torque", _TORQUES)
    if found is not None:
        return found
    raise GaitNotFound(
        f"no gait with a constant torque was found at slope {slope} rad: the gait of slope "
        f"{_REFERENCE_SLOPE} rad was lost at {here:.4g} rad, and a search found none with up to "
        f"{_TORQUES[-1]:g} m g l"
    )


def first_driven(walker: Walker, slope: float, part: str, amounts: Iterable[float]) -> Gait | None:
    """Search for a gait under one part of an `Actuation`; the first found is returned.

    Args:
        walker: The walker.
        slope: Slope in rad.
        part: Name of the part.
        amounts: Amounts to try, in turn, dimensionless.
    """
    for amount in amounts:
        held = to_own(walker.units, Actuation(**{part: amount}))
        gait = seek(StrideMap.of(walker, controller=held), slope).gait
        if gait is not None:
            return gait
    return None


def _converged(walker: Walker, slope: float, state: NDArray, torque: float) -> Points:
    """Return the fixed point near a state (6,), which is in the walker's own units."""
    strides = StrideMap.of(walker, controller=Actuation(hip_torque=torque))

    def equations(points: NDArray) -> tuple[NDArray, NDArray]:
        passage, change = strides.linearize(points, slope)
        return passage.ends - points, change.ends - np.eye(points.shape[1])

    found = newton(equations, strides.points_at(state), accuracy=_ACCURACY)
    if not found.sizes[0] < _SETTLED:
        raise GaitNotFound("Newton's method did not settle")
    return Points(strides, found.points)


def by_inputs(
    strides: StrideMap, points: NDArray, inputs: Sequence[str]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return derivatives of a stride's end on the section by its start and by held controls.

    Args:
        strides: The stride map, with its slope.
        points: The start, (1, m).
        inputs: Names of k of the walker's `inputs`.

    Returns:
        Shapes (m, m) and (m, k).
    """
    slope = strides.chosen(None)
    walked = flow(strides.walkers, strides.state(points), slope, by=("point", *inputs))
    ends = strides.point(states_in(walked.records, strides.size // 2))[0, 1:]
    return ends[: strides.dimension].T, ends[strides.dimension :].T


def gains(
    by_point: NDArray, by_torque: NDArray, method: Method = "lqr", *, torque_weight: float = 100.0
) -> NDArray[np.float64]:
    """Return the matrix K of the feedback u = -K x, in the coordinates of the section.

    A stride forgets some directions of its start altogether, so the gains are found on those that
    survive and say nothing about the others.

    Args:
        by_point: A, derivative of the next section point by this one, (m, m).
        by_torque: B, its derivative by the torque of each piece of the stride, (m, pieces).
        method: "lqr" weighs deviations against torques over all strides to come; "deadbeat" is back
            on the gait in as few strides as can be: with one piece, as many as directions survive.
        torque_weight: Of the torques' squares, in units where A and B have comparable size. Small
            weights recover faster from small deviations, and stub the toe after large ones.

    Returns:
        Shape (pieces, m).

    Raises:
        ValueError: if the method has another name.
    """
    if method not in ("lqr", "deadbeat"):
        raise ValueError(f'method must be "lqr" or "deadbeat", not {method!r}')
    scale = np.max(np.abs(by_torque))
    left, sizes, right = np.linalg.svd(by_point)
    survive = int(np.sum(sizes > _SURVIVES * sizes[0]))
    # Coordinates of a point along the map's range, parallel to what the map sends to zero.
    inside = np.linalg.inv(np.column_stack([left[:, :survive], right[survive:].T]))[:survive]
    a, b = inside @ by_point @ left[:, :survive], inside @ by_torque / scale
    if method == "deadbeat":
        return deadbeat(a, b) @ inside / scale
    weight = torque_weight * np.eye(b.shape[1])
    p = scipy.linalg.solve_discrete_are(a, b, np.eye(survive), weight)
    return np.linalg.solve(weight + b.T @ p @ b, b.T @ p @ a) @ inside / scale


def deadbeat(a: NDArray, b: NDArray) -> NDArray[np.float64]:
    """Return gains that bring x' = A x + B u to rest in the fewest steps, by least torques.

    What no torque moves at once has to come to rest by way of what torques do move: a deadbeat
    feedback of the smaller system says where that should go, and the torques bring it there.
    """
    reach = np.linalg.pinv(b)
    left, sizes, _ = np.linalg.svd(b)
    moved = int(np.sum(sizes > _SURVIVES * sizes[0]))
    others = left[:, moved:].T
    if len(others):
        reach = reach - reach @ b @ -deadbeat(others @ a @ others.T, others @ a @ b) @ others
    return reach @ a
