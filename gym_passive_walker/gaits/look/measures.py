"""Measures of a gait: cost of transport, speed and foot velocity (Garcia, 4.3.3 and 4.3.4)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker._tools.arguments import check_state, instance, one_slope, shown
from gym_passive_walker.gaits.gait import Gait
from gym_passive_walker.gaits.look.forces import struck
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


class Measures(NamedTuple):
    """Measures of a gait, in the walker's own units.

    Attributes:
        step_period: Mean time of a stride.
        step_length: Mean distance between contacts along the slope.
        speed: Mean speed along the slope.
        froude_speed: Speed over sqrt(g l) (Eq. 4.6).
        cost_of_transport: Energy lost over weight times distance (Eq. 4.3).
        kneestrike_loss: Energy lost at kneestrike, in the first stride.
        heelstrike_loss: Energy lost at heelstrike, in the first stride.
        foot_velocity: Velocity of the landing foot at the end of the first stride.
    """

    step_period: float
    step_length: float
    speed: float
    froude_speed: float
    cost_of_transport: float
    kneestrike_loss: float
    heelstrike_loss: float
    foot_velocity: FootVelocity


def foot_velocity(walker: WalkerLike, state: ArrayLike) -> FootVelocity:
    """Return the velocity of the landing foot at contact (Eq. 4.10).

    With the angles of Garcia (1999), the signs of that equation make the tangential velocity
    positive uphill. Here it is positive downhill, as its text says.

    Args:
        walker: The walker, in a form that `as_walker` takes.
        state: States just *before* heelstrike, shape (6,) or (n, 6): the stance angle negative and
            the swing angle its opposite. `StrideMap.before_strike` finds them.

    Raises:
        ValueError: if a state is not just before heelstrike.
    """
    walker = check_supports(as_walker(walker), "McGeer's parameters")
    states = check_state(state)
    swing = states[..., 1 : 3 if walker.knees else 2]
    if np.any(states[..., 0] > 0.0) or np.any(np.abs(swing + states[..., :1]) > OFF):
        raise ValueError(
            "state must be just before heelstrike, with a negative stance angle and the opposite "
            "angles of thigh and shank, such as walk.states[-1] of gpw.simulate, not "
            f"{shown(state)}"
        )
    back, up = legs.striking_velocity(walker.body, State(*np.moveaxis(states, -1, 0)))
    return FootVelocity(-back * walker.leg_length, up * walker.leg_length)


def collision_matrix(walker: WalkerLike, stance_angle: float) -> NDArray[np.float64]:
    """Return the matrix M of Eq. 4.7: a heelstrike at foot velocity v loses the energy v.M.v / 2.

    Just before the impact the motion is a roll on the new foot plus a translation v. The ground's
    impulse removes the translation, while the joints, including an old stance knee, turn freely.
    M is the effective mass at the foot: the Schur complement of the mass matrix in the mass matrix
    of the walker off the ground. The impulse is -M v. For the simplest walker only the component
    of v along the leg contributes.

    Args:
        walker: The walker, in a form that `as_walker` takes.
        stance_angle: Stance angle in rad just after heelstrike, as `Gait.stance_angle`; 0 for M(0).

    Returns:
        Symmetric positive semidefinite matrix (2, 2) in the walker's unit of mass, for velocities
        (downhill, away from the ground). Its error is about the rounding of the total mass.
    """
    walker, stance_angle = (
        check_supports(as_walker(walker), "McGeer's parameters"),
        one_slope(stance_angle, "stance_angle"),
    )
    if walker.massless_legs:
        leg = np.array([-np.sin(stance_angle), np.cos(stance_angle)])
        return walker.total_mass * np.outer(leg, leg)
    system = walker.equations()
    assert system.mass_matrix is not None
    links = system.phases[0].links
    state = State(stance_angle, -stance_angle, -stance_angle, 0.0, 0.0, 0.0)
    mass = np.zeros((links, links))
    mass[np.triu_indices(links)] = system.mass_matrix(walker.body, state)
    mass += np.triu(mass, 1).T
    units, jumps = walker.units, np.eye(3)[:links]
    mass = mass * walker.total_mass * units.length**2
    if not walker.knees:
        jumps[1, 2] = 1.0
    angles = np.tile(state[:3], (links, 1))
    back, up, *_ = struck(walker.body, angles.T, jumps.T * units.time, (0.0, 0.0))
    momentum = np.stack([-back, up]) * units.force * units.time
    matrix = walker.total_mass * np.eye(2) - momentum @ np.linalg.solve(mass, momentum.T)
    return 0.5 * (matrix + matrix.T)


def measures(gait: Gait) -> Measures:
    """Return all measures of a gait."""
    instance(gait, Gait, "gait", "gpw.find_gait returns")
    stride_map = gait.stride_map
    duration = float(gait.stride.duration) / stride_map.units.time
    verge = stride_map.before_strike(gait.point.values[0], gait.slope, duration)
    velocity = foot_velocity(gait.walker, stride_map.units.to_own(verge))
    landing = FootVelocity(float(velocity.tangential), float(velocity.normal))
    own = {name: getattr(gait, name) for name in Measures._fields[:-1]}
    return Measures(**own, foot_velocity=landing)
