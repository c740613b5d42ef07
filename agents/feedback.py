"""Once-per-stride linear feedback: the hip torque of a stride from the state that it starts in.

Around a gait the stride map is x' = A x + B u, x being the deviation on the section and u that of
the torque. Both matrices are the exact derivatives of the stride map.
"""

from __future__ import annotations

import math
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_discrete_are

from gym_passive_walker import GaitNotFound, Walker, find_gait, stride, stride_jacobian

Method = Literal["lqr", "deadbeat"]

_REFERENCE_SLOPE = 0.005
"""Where the passive gait is taken from that a motor then carries to other slopes."""

_HALVINGS = 10  # of the way from one slope to another, before it is given up
_ITERATIONS = 12
_SURVIVES = 1e-9  # singular values below this, relative to the largest, are directions forgotten


class PoweredGait(NamedTuple):
    """A gait under a torque that is the same all along.

    Attributes:
        state: Section state (6,), in the walker's own units.
        hip_torque: The torque, in the walker's own units.
        map: A, derivative of the next section point by this one, (m, m).
        by_torque: B, its derivative by the torque, (m,).
    """

    state: NDArray[np.float64]
    hip_torque: float
    map: NDArray[np.float64]
    by_torque: NDArray[np.float64]


def coordinates(walker: Walker) -> list[int]:
    """Which entries of a state are coordinates of the section."""
    return [0, 3, 4, 5] if walker.knees else [0, 3, 4]


def powered_gait(walker: Walker, slope: float) -> PoweredGait:
    """A gait at any slope: passive where there is one, else with a constant torque.

    A passive gait of a reference slope is followed to the slope wanted, while a torque takes over
    the work that gravity no longer does.

    Raises:
        GaitNotFound: if the walker has no passive gait to begin with, or loses it on the way.
    """
    try:
        gait = find_gait(walker, slope)
        return _at(walker, slope, gait.state, 0.0)
    except GaitNotFound:
        gait = find_gait(walker, _REFERENCE_SLOPE)
    if walker.massless_legs:
        raise GaitNotFound("no torque drives the simplest walker: its legs have no mass to work on")
    # A stride turns the legs by four times the stance angle against each other.
    work = walker.total_mass * walker.gravity * gait.step_length
    work *= math.sin(_REFERENCE_SLOPE) - math.sin(slope)
    torque = work / (4.0 * gait.stance_angle)
    state, share, step = gait.state, 0.0, 0.25
    while share < 1.0:
        goal = min(1.0, share + step)
        try:
            here = (1.0 - goal) * _REFERENCE_SLOPE + goal * slope
            state = _converged(walker, here, state, goal * torque)
            share = goal
        except (ValueError, np.linalg.LinAlgError):
            step *= 0.5
            if step < 0.5**_HALVINGS:
                raise GaitNotFound(
                    f"no gait with a constant torque was found at slope {slope} rad: the gait of "
                    f"slope {_REFERENCE_SLOPE} rad was lost at {here:.4g} rad"
                ) from None
    return _at(walker, slope, state, torque)


def _at(walker: Walker, slope: float, state: NDArray, torque: float) -> PoweredGait:
    both = stride_jacobian(walker, slope, state, hip_torque=torque, wrt=["state", "hip_torque"])
    return PoweredGait(state, torque, both[:, :-1], both[:, -1])


def _converged(walker: Walker, slope: float, state: NDArray, torque: float) -> NDArray:
    """Newton's method for the fixed point near a state."""
    keep, state = coordinates(walker), state.copy()
    for _ in range(_ITERATIONS):
        map_ = stride_jacobian(walker, slope, state, hip_torque=torque)
        end = stride(walker, slope, state, hip_torque=torque, tolerance=1e-12).state
        change = np.linalg.solve(np.eye(len(keep)) - map_, end[keep] - state[keep])
        state[keep] += change
        state[1] = state[2] = -state[0]
        state[5] = state[keep[-1]]
        if np.max(np.abs(change)) < 1e-10:
            return state
    raise ValueError("Newton's method did not settle")


def gains(gait: PoweredGait, method: Method = "lqr", *, torque_weight: float = 100.0) -> NDArray:
    """Row K of the feedback u = -K x.

    A stride forgets some directions of its start altogether, so the gains are found on those that
    survive and say nothing about the others.

    Args:
        gait: The gait to hold.
        method: "lqr" weighs deviations against torque over all strides to come; "deadbeat" is back
            on the gait in as many strides as directions survive.
        torque_weight: Of the torque's square, in units where A and B have comparable size. Small
            weights recover faster from small deviations, and stub the toe after large ones.
    """
    scale = np.max(np.abs(gait.by_torque))
    a, b = gait.map, gait.by_torque[:, None] / scale
    left, sizes, right = np.linalg.svd(a)
    survive = int(np.sum(sizes > _SURVIVES * sizes[0]))
    # Coordinates of a point along the map's range, parallel to what the map sends to zero.
    inside = np.linalg.inv(np.column_stack([left[:, :survive], right[survive:].T]))[:survive]
    a_small, b_small = inside @ a @ left[:, :survive], inside @ b
    if method == "lqr":
        p = solve_discrete_are(a_small, b_small, np.eye(survive), [[torque_weight]])
        k = np.linalg.solve(torque_weight + b_small.T @ p @ b_small, b_small.T @ p @ a_small)
    elif method == "deadbeat":  # Ackermann's formula with all poles at zero
        reach = np.column_stack(
            [np.linalg.matrix_power(a_small, i) @ b_small for i in range(survive)]
        )
        last = np.linalg.solve(reach.T, np.eye(survive)[-1])
        k = last[None] @ np.linalg.matrix_power(a_small, survive)
    else:
        raise ValueError(f'method must be "lqr" or "deadbeat", not {method!r}')
    return (k @ inside)[0] / scale
