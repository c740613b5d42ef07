"""The derivative of the stride map, exact to rounding."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker._tools.arguments import (
    check_state,
    check_tolerance,
    number,
    one_slope,
    unknown,
)
from gym_passive_walker.gaits.actuation import Actuation, actuation_units, one_actuation
from gym_passive_walker.gaits.find.fixed_point import state_on
from gym_passive_walker.gaits.flow import LONGEST_STRIDE
from gym_passive_walker.gaits.given import GaitLike, walk_of
from gym_passive_walker.gaits.map_result import NoStride
from gym_passive_walker.gaits.stride_map import StrideMap
from gym_passive_walker.models.equations.hybrid import Outcome
from gym_passive_walker.models.units import growth
from gym_passive_walker.models.walkers import PARAMETERS


def stride_jacobian(
    walker: GaitLike,
    slope: float | None = None,
    state: ArrayLike | None = None,
    *,
    hip_torque: float | None = None,
    ankle_torque: float | None = None,
    push_off: float | None = None,
    wrt: str | Sequence[str] = "state",
    tolerance: float = 1e-13,
) -> NDArray[np.float64]:
    """Return the exact derivative of the stride map on its Poincaré section.

    The section's coordinates are the stance angle and the angular velocities: [angle, stance,
    thigh, shank] for a kneed walker, [angle, stance, swing] for the others. Automatic
    differentiation carries the derivative through the flow, the impacts and the times of the
    impacts, so there is no step size and no cancellation.

    A kneed walker's matrix has one eigenvalue that is zero to rounding. Kneestrike makes two
    angular velocities equal, so only three of the four coordinates affect the next state. The
    simplest walker's matrix has one, as each heelstrike sets the swing leg's angular velocity.

    Args:
        walker: The walker, in a form that `as_walker` takes; or a stride map or a `Gait`, which
            supplies slope, state and actuation where they are not given.
        slope: Slope in rad.
        state: State on the Poincaré section, just after heelstrike, (6,), or several, (n, 6); that
            of the gait when None.
        hip_torque: Torque held through the stride; 0 by default, or the gait's own.
        ankle_torque: Torque held through the stride, as for `stride`; 0 by default, or the gait's
            own.
        push_off: Impulse at the end of the stride, as for `stride`; 0 by default, or the gait's
            own.
        wrt: Columns wanted, in order: "state" (one per coordinate), "slope", "hip_torque",
            "ankle_torque", "push_off", or any numerical parameter of `Walker`, such as
            "foot_radius".
        tolerance: Tolerance of the integration.

    Returns:
        Shape (m, columns), or (n, m, columns) for several states, in the walker's own units; m is 4
        with knees and 3 without.

    Raises:
        GaitNotFound: if no state is given, and the walker has no gait.
        NoStride: if a stride does not end with a heelstrike.
        ValueError: if an argument is out of range, or a state is not just after heelstrike.
    """
    tolerance = check_tolerance(number(tolerance, "tolerance"))
    walker, slope, state, motors, _, controlled = walk_of(
        walker, slope, state, hip_torque, ankle_torque, push_off
    )
    slope = one_slope(slope)
    motors = one_actuation(walker, motors)
    stride_map = (controlled or StrideMap.of(walker, controller=motors)).with_tolerance(tolerance)
    stride_map = replace(stride_map, max_stride_time=LONGEST_STRIDE)
    names = [wrt] if isinstance(wrt, str) else list(wrt) if np.iterable(wrt) else []
    known = ("state", "slope", *stride_map.parameters)
    if strange := unknown(names or [wrt], known, "wrt: the stride map"):
        raise ValueError(strange)
    state, units = state_on(stride_map, slope, state), stride_map.units
    states = check_state(state, of=stride_map.walker)
    points, driving = stride_map.points_at(states), actuation_units(units)._asdict()
    moved = set(names)
    # A parameter also changes the units, hence the dimensionless state and torques.
    driven = [name for name in Actuation._fields if getattr(stride_map.actuation, name)]
    scaled = "units" in walker.supports
    if scaled and moved & set(PARAMETERS):
        moved |= {"state", *driven}
    by = sorted(moved)
    passage, change = stride_map.linearize(points, slope, by=by)
    fallen = np.flatnonzero(~passage.alive)
    if len(fallen):
        which = f"the stride from state {fallen[0]}" if len(points) > 1 else "this stride"
        raise NoStride(
            f"{which} does not end with a heelstrike but with "
            f"{Outcome(passage.outcomes[fallen[0]]).name}, so the stride map has no derivative here"
        )
    first = np.cumsum([0, *(points.shape[1] if name == "state" else 1 for name in by)])
    found = {name: change.ends[:, :, i:j] for name, i, j in zip(by, first, first[1:], strict=False)}
    rated = np.arange(points.shape[1]) > 0  # all coordinates but the angle
    time = np.where(rated, units.time, 1.0)

    def column(name: str) -> NDArray:
        """Return the dimensionless point's derivative by a quantity in the walker's own units."""
        if name == "state":
            return found["state"] * time
        if name == "slope" or not scaled:
            return found[name]
        if name in driving:
            return found[name] / driving[name]
        grown = growth(stride_map.walker, name)
        of_point = found["state"] @ (points * rated * grown.time)[:, :, None]
        of_rates = (passage.ends * rated * grown.time)[:, :, None]
        whole = found[name] + of_point - of_rates
        shares = Actuation(grown.torque, grown.energy, grown.energy + grown.time - grown.length)
        for part in driven:
            whole = whole - found[part] * (
                getattr(stride_map.actuation, part) * getattr(shares, part)
            )
        return whole

    jacobian = np.concatenate([column(name) for name in names], axis=2) / time[:, None]
    return jacobian.reshape(*states.shape[:-1], *jacobian.shape[1:])
