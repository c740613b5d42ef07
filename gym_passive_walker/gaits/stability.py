"""The derivative of the stride map, exact to rounding."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from types import SimpleNamespace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker.arguments import check_state, check_tolerance, number, one_slope
from gym_passive_walker.gaits.section import INFINITESIMAL, section_of
from gym_passive_walker.physics import constants as K
from gym_passive_walker.physics import record as R
from gym_passive_walker.physics.engine import advance
from gym_passive_walker.physics.events import Outcome
from gym_passive_walker.physics.record import new_records
from gym_passive_walker.walkers import Walker, as_walker


class NoStride(ValueError):
    """The stride did not end with a heelstrike, so the map has no value there."""


def stride_jacobian(
    walker: Walker | str,
    slope: float,
    state: ArrayLike,
    *,
    hip_torque: float = 0.0,
    wrt: str | Sequence[str] = "state",
    tolerance: float = 1e-13,
) -> NDArray[np.float64]:
    """Exact derivative of the stride map on its section.

    The section's coordinates are the stance angle and the rates: [angle, stance rate, thigh rate,
    shank rate] for a kneed walker, [angle, stance rate, swing rate] for the others. The derivative
    is carried through the flow, through each collision and through the moment at which it happens
    by infinitesimal numbers, so there is no step size and no cancellation.

    A kneed walker's matrix has one eigenvalue zero to rounding: kneestrike makes two rates one, so
    of the four coordinates only three survive a stride. The simplest walker's has one for the same
    reason: its swing rate is made new at each heelstrike.

    Args:
        walker: The walker, or a preset's name.
        slope: Slope in rad.
        state: Section state (6,); thigh and shank angle are taken as minus the stance angle.
        hip_torque: Torque held through the stride.
        wrt: Columns wanted, in order: "state" (one per coordinate), "slope", "hip_torque", or any
            numerical parameter of `Walker`, such as "foot_radius".
        tolerance: Of the integration.

    Returns:
        Shape (m, columns), in the walker's own units; m is 4 with knees and 3 without.

    Raises:
        NoStride: if the stride does not end with a heelstrike.
        ValueError: if an argument is out of range.
    """
    walker, slope = as_walker(walker), one_slope(slope)
    tolerance = check_tolerance(number(tolerance, "tolerance"))
    hip_torque = number(hip_torque, "hip_torque")
    names = [wrt] if isinstance(wrt, str) else list(wrt)
    section = section_of(walker)
    m = section.dimension
    start = np.array(check_state(state), dtype=complex).reshape(6)
    steps: list[tuple[str, int]] = []
    for name in names:
        steps += [(name, i) for i in range(m)] if name == "state" else [(name, 0)]
    allowed = [name for name in asdict(walker) if name != "knees"]
    states, slopes, torques, constants, times = [], [], [], [], []
    for name, i in steps:
        shift = 1j * INFINITESIMAL
        lane = start.copy()
        if name == "state":
            lane[0 if i == 0 else 2 + i] += shift
        values = SimpleNamespace(**asdict(walker))
        if name not in ("state", "slope", "hip_torque"):
            if name not in allowed:
                raise ValueError(
                    f"cannot differentiate by {name!r}: choose from state, slope, hip_torque, "
                    f"{', '.join(allowed)}"
                )
            setattr(values, name, getattr(values, name) + shift)
        length = values.thigh_length + values.shank_length
        time = np.sqrt(length / values.gravity + 0j)
        mass = 2.0 * (values.thigh_mass + values.shank_mass) + values.hip_mass
        unit = values.gravity * length * (1.0 if walker.massless_legs else mass)
        lane[1] = lane[2] = -lane[0]
        lane[3:] *= time
        if m == 3:
            lane[5] = lane[4]
        states.append(lane)
        slopes.append(slope + (shift if name == "slope" else 0.0))
        torques.append((hip_torque + (shift if name == "hip_torque" else 0.0)) / unit)
        constants.append(K.constants_from(values, knees=walker.knees).astype(complex))
        times.append(time)
    records = new_records(np.array(states), np.array(slopes), np.array(torques))
    advance(section.kind, np.array(constants), records, tolerance=tolerance)
    outcome = Outcome(int(records[0, R.OUTCOME].real))
    if outcome != Outcome.HEELSTRIKE:
        raise NoStride(
            f"this stride does not end with a heelstrike but with {outcome.name}, so the stride "
            "map has no derivative here"
        )
    ends = records[:, [0, *range(3, 2 + m)]].copy()
    ends[:, 1:] /= np.array(times)[:, None]
    return np.imag(ends).T / INFINITESIMAL
