"""Measures of a gait: cost of transport, speed and foot velocity (Garcia, 4.3.3 and 4.3.4)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker._tools.arguments import check_state, instance, one_slope, shown
from gym_passive_walker.gaits.gait import Gait
from gym_passive_walker.gaits.look.forces import struck
from gym_passive_walker.gaits.stride import Stride
from gym_passive_walker.models.chart import OFF
from gym_passive_walker.models.equations import legs
from gym_passive_walker.models.equations.hybrid import State
from gym_passive_walker.models.model import check_supports
from gym_passive_walker.models.walkers import WalkerLike, as_walker


class FootVelocity(NamedTuple):
    """Velocity of the landing foot at its contact point, just before heelstrike (Fig. 4.4).

    Attributes:
        tangential: Velocity along the slope, positive downhill; a number or (n,), in the walker's
            own units.
        normal: Velocity away from the ground, negative when the foot comes down; a number or (n,),
            in the walker's own units.
    """

    tangential: NDArray[np.float64] | float
    normal: NDArray[np.float64] | float


def foot_velocity(walker: WalkerLike | Gait, state: ArrayLike | None = None) -> FootVelocity:
    """Return the velocity of the landing foot at contact (Eq. 4.10).

    With the angles of Garcia (1999), the signs of that equation make the tangential velocity
    positive uphill. Here it is positive downhill, as its text says.

    Args:
        walker: The walker, in a form that `as_walker` takes; or a `Gait`.
        state: States just *before* heelstrike, shape (6,) or (n, 6): the stance angle negative and
            the swing angle its opposite. That at the end of a gait's first stride when None.

    Raises:
        ValueError: if a state is not just before heelstrike, or the gait is on a terrain.
    """
    gait = walker if isinstance(walker, Gait) else None
    own = walker.walker if isinstance(walker, Gait) else walker
    walker = check_supports(as_walker(own), "McGeer's parameters")
    if gait and state is None:
        _check_smooth(gait, "foot_velocity")
        duration = float(gait.stride.duration) / walker.units.time
        point = gait.point.values[0]
        state = walker.units.to_own(gait.stride_map.before_strike(point, gait.slope, duration))
    states = check_state(state)  # type: ignore[arg-type]
    swing = states[..., 1 : 3 if walker.knees else 2]
    if np.any(states[..., 0] > 0.0) or np.any(np.abs(swing + states[..., :1]) > OFF):
        raise ValueError(
            "state must be just before heelstrike, with a negative stance angle and the opposite "
            "angles of thigh and shank, such as walk.states[-1] of gpw.simulate, not "
            f"{shown(state)}"
        )
    back, up = legs.striking_velocity(walker.body, State(*np.moveaxis(states, -1, 0)))
    return FootVelocity(-back * walker.leg_length, up * walker.leg_length)


def collision_matrix(
    walker: WalkerLike | Gait, stance_angle: ArrayLike | None = None
) -> NDArray[np.float64]:
    """Return the matrix M of Eq. 4.7: a heelstrike at foot velocity v loses the energy v.M.v / 2.

    Just before the impact the motion is a roll on the new foot plus a translation v. The ground's
    impulse removes the translation, while the joints turn freely, with an old stance knee that is
    not held.
    M is the effective mass at the foot: the Schur complement of the mass matrix in the mass matrix
    of the walker off the ground. The impulse is -M v. For the simplest walker only the component
    of v along the leg contributes.

    Args:
        walker: The walker, in a form that `as_walker` takes; or a `Gait`.
        stance_angle: Stance angle in rad just after heelstrike, as `Gait.stance_angle`; 0 for M(0).
            Of a `System`, its state there, as `Gait.state`. The gait's own when None.

    Returns:
        Symmetric positive semidefinite matrix (2, 2) in the walker's unit of mass, for velocities
        (downhill, away from the ground). Its error is about the rounding of the total mass.

    Raises:
        ValueError: if equations of a system were given without `mass_matrix` and `momentum`; or
            if the gait of a `Walker` is on a terrain.
    """
    if isinstance(walker, Gait):
        gait, walker = walker, walker.walker
        if stance_angle is None:
            own = "McGeer's parameters" in walker.supports
            if own:
                _check_smooth(gait, "collision_matrix")
            stance_angle = gait.stance_angle if own else gait.state
    walker = as_walker(walker)
    if "McGeer's parameters" not in walker.supports:
        return _stated_matrix(check_supports(walker, "collision matrix"), stance_angle)  # type: ignore[arg-type]
    stance_angle = one_slope(stance_angle, "stance_angle")  # type: ignore[arg-type]
    if walker.massless_legs:
        leg = np.array([-np.sin(stance_angle), np.cos(stance_angle)])
        return walker.total_mass * np.outer(leg, leg)
    system = walker.equations()
    assert system.mass_matrix is not None
    links = system.phases[0].links
    state = State(stance_angle, -stance_angle, -stance_angle, 0.0, 0.0, 0.0)
    mass = _symmetric(system.mass_matrix(walker.body, state), links)
    # A trailing leg that is locked has one angular velocity.
    jumps = np.eye(3) if walker.knees is True else np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 1.0]])
    if links > len(jumps):
        mass = jumps @ mass @ jumps.T
    units = walker.units
    mass = mass * walker.total_mass * units.length**2
    angles = np.tile(state[:3], (len(jumps), 1))
    back, up, *_ = struck(walker.body, angles.T, jumps.T * units.time, (0.0, 0.0))
    momentum = np.stack([-back, up]) * units.force * units.time
    return _at_foot(walker, mass, momentum)


def _check_smooth(gait: Gait, what: str) -> None:
    """Refuse a gait on a terrain, where legs do not mirror each other as feet land."""
    if gait.stride_map.terrain is not None:
        raise ValueError(
            f"{what} is of a heelstrike on smooth ground, and this gait is on a terrain: give a "
            "gait of smooth ground; simulate(gait).strikes has the impulses of this one"
        )


def _stated_matrix(system: Any, state: ArrayLike) -> NDArray[np.float64]:
    """Return the matrix of `collision_matrix` for a user's system."""
    equations, count = system.hybrid, system.coordinates
    angles = system.checked_state(state, "the state")[:count]
    moving = [equations.State(*angles, *rates) for rates in np.eye(count)]
    mass = _symmetric(equations.mass_matrix(system.body, moving[0]), count)
    momenta = [equations.momentum(system.body, each) for each in moving]
    return _at_foot(system, mass, np.array(momenta).T)


def _symmetric(entries: Sequence[Any], size: int) -> NDArray[np.float64]:
    """Return a symmetric matrix from its upper triangle, row by row."""
    matrix = np.zeros((size, size))
    matrix[np.triu_indices(size)] = entries
    return matrix + np.triu(matrix, 1).T


def _at_foot(walker: Any, mass: NDArray, momentum: NDArray) -> NDArray[np.float64]:
    """Return the effective mass at the foot, from momenta (2, links) of each angular velocity."""
    matrix = walker.total_mass * np.eye(2) - momentum @ np.linalg.solve(mass, momentum.T)
    return 0.5 * (matrix + matrix.T)


def measures(gait: Gait) -> Stride:
    """Return all measures of a gait, in the walker's own units, as a stride of their means."""
    instance(gait, Gait, "gait", "gpw.find_gait returns")
    return gait.mean
