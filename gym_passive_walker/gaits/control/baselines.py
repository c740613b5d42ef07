"""Agents that learn nothing, which any learned one has to be better than.

Each is a policy object: `predict` takes one observation or a batch, and returns actions as
stable-baselines3 does.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker._tools.arguments import number, unknown
from gym_passive_walker.gaits.actuation import (
    PASSIVE,
    Actuation,
    one_actuation,
    to_dimensionless,
)
from gym_passive_walker.gaits.control import optimal
from gym_passive_walker.gaits.control.feedback import Method, by_inputs, gains, powered_gait
from gym_passive_walker.gaits.control.optimal import OptimalGait
from gym_passive_walker.gaits.control.policy import Policy, StridePlan
from gym_passive_walker.gaits.control.ticks import control_steps, hold_time, ticked_stride
from gym_passive_walker.gaits.find.fixed_point import find_gait
from gym_passive_walker.gaits.scenes.rules import CHANNELS
from gym_passive_walker.gaits.scenes.scene import Scene, make_scene, recorded_weight
from gym_passive_walker.gaits.stride_map import StrideMap
from gym_passive_walker.models.model import check_supports
from gym_passive_walker.models.walkers import describe, name_of


class ConstantTorque:
    """A constant torque.

    Args:
        torque: Torque in units of m g l; at most the scene's largest is applied.
        scene: A scene in a form that `make_scene` takes; gives what action 1 stands for.

    Raises:
        ValueError: if the scene has no hip torque.
    """

    name = "constant torque"

    def __init__(self, torque: float, scene: Scene | str | dict[str, Any]) -> None:
        scene = make_scene(scene)
        if torque and "hip" not in scene.actions:
            raise ValueError(f"a hip torque is none of this scene's actions {scene.actions}")
        largest = scene.largest("hip") if torque else 1.0
        if not largest:
            raise ValueError(
                "a constant torque needs a largest torque above 0: give the scene a max_hip_torque"
            )
        self.torque, self.scale = float(torque), largest / recorded_weight(scene.walker)
        self.acts = np.array([name == "hip" for name in scene.actions])

    def predict(
        self,
        observation: ArrayLike,
        state: Any = None,
        episode_start: ArrayLike | None = None,
        deterministic: bool = True,
    ) -> tuple[NDArray[np.float32], Any]:
        """The action, whatever is observed."""
        shape = np.shape(observation)[:-1]
        action = np.clip(self.torque / self.scale, -1.0, 1.0)
        return np.full((*shape, len(self.acts)), action * self.acts, np.float32), state


class Passive(ConstantTorque):
    """No torque: passive walking, as McGeer's machines walk.

    Args:
        scene: A scene in a form that `make_scene` takes; gives the number of actions. One
            when None.
    """

    name = "passive"

    def __init__(self, scene: Scene | str | dict[str, Any] | None = None) -> None:
        super().__init__(0.0, "level" if scene is None else scene)


class StrideFeedback(StridePlan):
    """The actions of a stride, set at its start by how far the walker is from a gait.

    Args:
        name: Name of the policy.
        scene: The scene in which it acts.
        point: The gait on the section, dimensionless, (m,).
        actions: Of the gait in each control step, as shares of the largest, (N, actions), or (N,)
            where there is one; the last are held until heelstrike.
        rows: How actions answer to deviations from the gait: -rows @ deviation; (N, actions, m),
            or (N, m). They do not when None.

    Attributes:
        scene: The scene.
    """

    def __init__(
        self, name: str, scene: Scene, point: NDArray, actions: NDArray, rows: NDArray | None = None
    ) -> None:
        super().__init__(scene, name=name)
        self.point, self.actions = point, actions.reshape(len(actions), -1)
        rows = np.zeros((self.actions.size, len(point))) if rows is None else rows
        self.rows = rows.reshape(*self.actions.shape, -1)

    def plan(self, points: NDArray, slopes: ArrayLike) -> NDArray[np.float64]:
        """Actions of strides, (n, N, actions), that start at points (n, m), on any slope."""
        answers = np.einsum("tam,nm->nta", self.rows, points - self.point)
        return np.clip(self.actions - answers, -1.0, 1.0)

    def plan_by(self, points: NDArray, slopes: ArrayLike) -> tuple[NDArray, NDArray]:
        """Their derivatives by points, (n, N, actions, m), and by the slope, (n, N, actions)."""
        plan = self.plan(points, slopes)
        return -self.rows * (np.abs(plan) < 1.0)[..., None], np.zeros_like(plan)


class Held(StrideFeedback):
    """Torques and a push-off that are equal in each stride.

    Args:
        scene: A scene in a form that `make_scene` takes.
        held: An `Actuation`, or a mapping of a walker's controls to values, in the walker's units.

    Raises:
        ValueError: if the walker has no such control, or the scene permits less.
    """

    def __init__(
        self, scene: Scene | str | dict[str, Any], held: Actuation | Mapping[str, float]
    ) -> None:
        scene = make_scene(scene)
        given = _channels(scene.walker, held)
        point = np.zeros(scene.walker.chart.dimension)
        super().__init__(str(held), scene, point, _shares(str(held), scene, given))


def _shares(name: str, scene: Scene, given: Mapping[str, ArrayLike]) -> NDArray[np.float64]:
    """Return dimensionless controls by action as shares of the scene's largest, (N, actions)."""
    largest = {action: scene.largest(action) for action in scene.actions}
    for action, values in given.items():
        needed, most = np.abs(values).max(), largest.get(action, 0.0)
        if needed > (1.0 + 1e-12) * most:
            raise ValueError(
                f"{name} needs {needed:.6g} of the action {action!r}, and the scene's largest is "
                f"{most:.6g}: choose a scene with more"
            )
    rows = [np.ravel(given.get(x, 0.0)) / (most or 1.0) for x, most in largest.items()]
    return np.stack(np.broadcast_arrays(*rows), axis=1)


def held_by(walker: Any, held: Actuation | Mapping[str, float] | None) -> Actuation | Mapping:
    """Return what actuators hold in each stride, in a walker's own units, after a check.

    Returns:
        An `Actuation`; or controls of a `System` by name, if one of them is not zero.

    Raises:
        ValueError: if the walker has no such control.
    """
    if isinstance(held, Mapping):
        own = "actuation" not in walker.supports
        names = walker.controls if own else Actuation._fields
        names = tuple(name for name in names if name not in walker.absent)
        if strange := unknown(held, names, f"the walker {name_of(walker)!r}"):
            raise ValueError(strange)
        held = {name: number(held.get(name, 0.0), name) for name in names}
        if own:
            return held if any(held.values()) else PASSIVE
        held = Actuation(**held)
    return PASSIVE if held is None or held is PASSIVE else one_actuation(walker, held)


def _channels(walker: Any, held: Actuation | Mapping[str, float]) -> Mapping[str, float]:
    """Return what is held by a scene's actions, dimensionless."""
    found = held_by(walker, held)
    if isinstance(found, Mapping):
        return found
    return dict(zip(CHANNELS, to_dimensionless(walker.units, found), strict=True))


def holding(walker: Any, slope: Any, held: Actuation | Mapping, **changes: Any) -> Scene:
    """Return the scene in which what is held is the largest, for walkers that are not passive."""
    most = {name: abs(value) for name, value in _channels(walker, held).items() if value}
    if "actuation" in walker.supports:
        limits: dict[str, Any] = {each.name: each.limit for each in walker.actuators}
        changes |= {"actions": tuple(most)} | {limits[name]: x for name, x in most.items()}
    else:
        changes["max_hip_torque"] = max(most.values()) / walker.total_mass
    return make_scene(walker=walker, slope=slope, control="stride", **changes)


class Schedule(StrideFeedback):
    """The torques and the push-off of an optimal gait, played in each stride without feedback.

    Args:
        scene: A scene in a form that `make_scene` takes; the one that the gait is of.
        gait: The gait.

    Raises:
        ValueError: if the scene permits less than the gait needs.
    """

    def __init__(self, scene: Scene | str | dict[str, Any], gait: OptimalGait) -> None:
        scene = make_scene(scene)
        actions = _shares("the optimal gait", scene, gait.held)
        super().__init__("schedule", scene, gait.point.values[0], actions)


class LinearFeedback(StrideFeedback):
    """Linear feedback by one or two torques a stride, which stabilizes the gait.

    Of a `System` it is feedback by the scene's controls, once a stride, of its passive gait.

    Args:
        scene: A scene in a form that `make_scene` takes; of a range of slopes, the gains
            belong to the gait at its middle.
        method: "lqr" or "deadbeat".
        pieces: Torques a stride: 1, or 2 for its halves where torques are held for ticks.
        torque_weight: Weight of torques with "lqr"; see `feedback.gains`.

    Attributes:
        gait: The gait that is held.
        closed_loop: Derivative of the stride map under the feedback, dimensionless, (m, m).

    Raises:
        GaitNotFound: if there is no gait to hold.
        ValueError: if the number of pieces or the method is none, or the scene permits less
            torque than the gait needs.
    """

    def __init__(
        self,
        scene: Scene | str | dict[str, Any] = "level",
        method: Method = "lqr",
        *,
        pieces: int = 1,
        torque_weight: float = 100.0,
    ) -> None:
        scene = make_scene(scene)
        if pieces not in (1, 2) or (pieces == 2 and scene.control == "stride"):
            raise ValueError(
                f'pieces must be 1, or 2 with control="tick", not {pieces!r} with '
                f"control={scene.control!r}"
            )
        walker, slope = scene.walker, float(np.mean(scene.slope))
        check_supports(walker, "feedback")
        largest = np.array([scene.largest(name) for name in scene.actions])
        if not largest.any():
            raise ValueError(
                f"feedback works actuators, and this scene has none that works: {describe(walker)} "
                "needs a control, and the scene a largest torque above 0"
            )
        if "actuation" in walker.supports:
            if scene.actions != ("hip",):
                raise ValueError(
                    f"linear feedback works the hip alone, not {', '.join(scene.actions)}: choose "
                    'a scene with actions=("hip",)'
                )
            self.gait = powered_gait(walker, slope)
            point, scale = self.gait.point.values[0], largest[0]
            torque = self.gait.stride_map.actuation.hip_torque
            free = ticked_stride(walker, slope, point, np.array([torque]), tick=np.inf)
            count = control_steps(scene, float(free.duration))
            torques = np.full(count, torque)
            walked = ticked_stride(walker, slope, point, torques, tick=scene.tick)
            # Which ticks belong to which piece.
            held = np.eye(pieces)[np.arange(count) * pieces // count]
            by_point, by_held = walked.by_point, walked.by_torque @ held
            plan = _shares("the gait that the feedback holds", scene, {"hip": torques})
        else:
            if scene.control != "stride":
                raise ValueError(
                    f"feedback of {describe(walker)} chooses controls once a stride: give it a "
                    'scene with control="stride"'
                )
            strides = StrideMap.of(walker, slope=slope)
            self.gait = gait = find_gait(strides)
            inputs = [walker.inputs[walker.controls.index(name)] for name in scene.actions]
            by_point, by_control = by_inputs(strides, gait.point.values, inputs)
            by_held, held, scale = by_control * largest, np.eye(len(largest)), 1.0
            point, plan = gait.point.values[0], np.zeros((1, len(largest)))
        answer = gains(by_point, by_held, method, torque_weight=torque_weight)
        self.closed_loop = by_point - by_held @ answer
        name = {"lqr": "LQR"}.get(method, method) + ", two torques" * (pieces - 1)
        super().__init__(name, scene, point, plan, held @ answer / scale)


class Optimal(StrideFeedback):
    """Torques of an optimal gait, with linear feedback that stabilizes it.

    On the gait it plays exactly the gait's torques. Off it, LQR over all torques of the stride
    changes them at its start, whether or not the gait is stable by itself.

    Args:
        scene: A scene in a form that `make_scene` takes.
        gait: The gait; None is the stored one that earns distance less the price of energy
            fastest. A `reward` and a `command` of the scene are not read: for these, give
            `optimal_gait(scene)`.
        torque_weight: See `feedback.gains`.

    Attributes:
        gait: The gait.
        closed_loop: Derivative of the stride map under the feedback, dimensionless, (m, m).

    Raises:
        ValueError: if no gaits of the scene are stored, actuators other than the hip's work, or
            the scene permits less torque than the gait needs.
    """

    def __init__(
        self,
        scene: Scene | str | dict[str, Any] = "level",
        gait: OptimalGait | None = None,
        *,
        torque_weight: float = 10.0,
    ) -> None:
        scene = make_scene(scene)
        check_supports(scene.walker, "actuation")
        others = {} if gait is None else {name: x for name, x in gait.held.items() if np.any(x)}
        if scene.actions != ("hip",) or others.keys() - {"hip"}:
            raise ValueError(
                'optimal gaits are played at the hip alone: choose a scene with actions=("hip",), '
                "and a gait of it"
            )
        if gait is None:
            gait = max(
                optimal.load(optimal.stored_name(scene)),
                key=lambda g: g.froude_speed * (1.0 - scene.energy_weight * g.hip_cost),
            )
        self.gait = gait
        point, torques = gait.point.values[0], gait.dimensionless.controller.hip_torque
        walked = ticked_stride(scene.walker, gait.slope, point, torques, tick=hold_time(scene))
        rows = gains(walked.by_point, walked.by_torque, torque_weight=torque_weight)
        self.closed_loop = walked.by_point - walked.by_torque @ rows
        plan, scale = _shares("the optimal gait", scene, {"hip": torques}), scene.largest("hip")
        super().__init__("optimal", scene, point, plan, rows / scale)


CONSTANT_TORQUE = 0.0025
"""Torque of the agent that holds one all along, in units of m g l: it walks on level ground."""

BASELINES: dict[str, Callable[[Scene], Policy]] = {
    "passive": Passive,
    "constant": lambda scene: ConstantTorque(CONSTANT_TORQUE, scene),
    "lqr": LinearFeedback,
    "deadbeat": lambda scene: LinearFeedback(scene, "deadbeat"),
    "optimal": Optimal,
}
"""Agents that learn nothing, by name."""
