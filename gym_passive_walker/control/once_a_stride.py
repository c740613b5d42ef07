"""One decision a stride: hip torque, ankle torque or push-off, chosen anew at each heelstrike.

`ActuationFeedback` answers to small deviations from any gait by the linearized stride map.
`SpeedControl` needs no linearisation: the simplest walker's hip is an inverted pendulum, so its
speed at mid-stance, where the stance leg is along the ground's normal, says all about its energy,
and what a stride does to that is known in closed form up to where the foot lands. A push-off sets
the next speed as A. D. Kuo's walkers do, a hip torque through the place of the foot as P. A.
Bhounsule's and A. Zamani's does.

References:
    A. D. Kuo, "Energetics of actively powered locomotion using the simplest walking model",
    J. Biomech. Eng. 124 (2002) 113-120.
    P. A. Bhounsule, A. Zamani, "A discrete control Lyapunov function for exponential orbital
    stabilization of the simplest walker", J. Mechanisms Robotics 9 (2017) 051011.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker.control.feedback import Method, gains
from gym_passive_walker.envs.scene import Scene, SceneError, make_scene
from gym_passive_walker.gaits.actuation import USES, for_each
from gym_passive_walker.gaits.gait import Gait
from gym_passive_walker.gaits.section import Section
from gym_passive_walker.gaits.stride_map import StrideMap

_PARTS = {channel: part for part, channel in USES.items()}
"""The part of a `Actuation` that each channel of a scene is."""

_RIGHT = 0.25 * math.pi  # stance angle of legs at right angles
_ANGLES, _BISECTIONS = 200, 52
_TRIED = 41  # torques of which the best is followed by Newton's method
_REFINED = 8  # iterations of it
_TOLERANCE = 1e-11  # of a stride whose torque is sought


class OnceAStride:
    """A policy that chooses what motors do at each heelstrike, from the section state alone.

    Args:
        name: What the policy is called.
        scene: A `Scene`, its name, or a mapping of its arguments, with control="stride".

    Attributes:
        parts: What it chooses, parts of a `Actuation` in the order of the scene's actions.

    Raises:
        SceneError: if the scene's torques are held for ticks.
    """

    def __init__(self, name: str, scene: Scene | str | dict[str, Any]) -> None:
        self.name, scene = name, make_scene(scene)
        if scene.control != "stride":
            raise SceneError(
                f"{name} decides once a stride, and this scene's control is {scene.control!r}: "
                'choose make_scene(scene, control="stride")'
            )
        self.scene = scene
        self.walker, self.parts = scene.walker, tuple(_PARTS[name] for name in scene.actions)
        self.largest = np.array([scene.largest(name) for name in scene.actions])
        self._seen = Section(walker=scene.walker).coordinates

    def given(self, points: NDArray, slopes: ArrayLike) -> NDArray[np.float64]:
        """What motors do in the strides that begin, dimensionless.

        Args:
            points: Where they begin on the section, dimensionless, (n, m).
            slopes: Slope in rad, one for all or (n,).

        Returns:
            Values of `parts`, (n, parts).
        """
        raise NotImplementedError

    def plan(self, points: NDArray, slopes: ArrayLike) -> NDArray[np.float64]:
        """Actions of strides that start at points (n, m), of one control step, (n, 1, parts)."""
        return np.clip(self.given(points, slopes) / self.largest, -1.0, 1.0)[:, None]

    def predict(
        self,
        observation: ArrayLike,
        state: Any = None,
        episode_start: ArrayLike | None = None,
        deterministic: bool = True,
    ) -> tuple[NDArray[np.float32], Any]:
        """The action of a stride, from one observation or a batch."""
        seen = np.atleast_2d(np.asarray(observation, dtype=float))
        action = self.plan(seen[:, self._seen], seen[:, 7])[:, 0].astype(np.float32)
        return action.reshape(*np.shape(observation)[:-1], len(self.parts)), state


class ActuationFeedback(OnceAStride):
    """Linear feedback about a gait under motors, by all of the scene's actions.

    As "deadbeat", one action brings the simplest walker back to its gait in two strides and two
    actions in one, for two directions of its section survive a stride.

    Args:
        scene: A `Scene`, its name, or a mapping of its arguments, with control="stride".
        gait: The gait that is held, of the scene's walker; `find_gait` of a map of `stride_map`.
        method: "lqr" or "deadbeat"; see `feedback.gains`.
        torque_weight: Of "lqr"; likewise.

    Attributes:
        point: The gait on the section, dimensionless, (m,).
        closed_loop: Derivative of the stride map under the feedback, dimensionless, (m, m).

    Raises:
        SceneError: if the scene has another walker, or lacks an action that the gait needs.
        ValueError: if the method is none.
    """

    def __init__(
        self,
        scene: Scene | str | dict[str, Any],
        gait: Gait,
        method: Method = "deadbeat",
        *,
        torque_weight: float = 100.0,
    ) -> None:
        super().__init__({"lqr": "LQR", "deadbeat": "deadbeat"}.get(method, method), scene)
        if gait.walker != self.walker:
            raise SceneError("the scene's walker is not the one whose gait is to be held")
        held = gait.stride_map.actuation
        idle = [USES[part] for part, value in held._asdict().items()
                if value and part not in self.parts]  # fmt: skip
        if idle:
            raise SceneError(f"the gait needs the action {idle[0]!r}, which the scene has not")
        strides = gait.stride_map
        self.point, m = strides.points_at(gait.state)[0], strides.dimension
        _, change = strides.linearize(self.point[None], gait.slope, by=("state", *self.parts))
        by_point, by_motors = change.ends[0, :, :m], change.ends[0, :, m:]
        self.own = np.array([getattr(held, part) for part in self.parts])
        self.rows = gains(by_point, by_motors, method, torque_weight=torque_weight)
        self.closed_loop = by_point - by_motors @ self.rows

    def given(self, points: NDArray, slopes: ArrayLike) -> NDArray[np.float64]:
        """What the gait's motors do, less the answer to the deviation; the slope is ignored."""
        return self.own - (points - self.point) @ self.rows.T

    def plan_by(self, points: NDArray, slopes: ArrayLike) -> tuple[NDArray, NDArray]:
        """Derivatives of actions by points, (n, 1, parts, m), and by the slope, (n, 1, parts)."""
        plan = self.plan(points, slopes)
        rows = -self.rows / self.largest[:, None]
        return rows * (np.abs(plan) < 1.0)[..., None], np.zeros_like(plan)


def _climb(angle: ArrayLike, slope: ArrayLike) -> NDArray[np.float64]:
    """Height energy gained from just after heelstrike to mid-stance / (m g l)."""
    return np.cos(slope) * (1.0 - np.cos(angle)) - np.sin(slope) * np.sin(angle)


def midstance_speed(points: NDArray, slopes: ArrayLike) -> NDArray[np.float64]:
    """Speed of the simplest walker's hip over its foot, at mid-stance, over sqrt(g l).

    Args:
        points: Just after heelstrike on the section, dimensionless, (n, 3).
        slopes: Slope in rad, one for all or (n,).

    Returns:
        Shape (n,); NaN for walkers that fall back before.
    """
    angle, rate = points[:, 0], points[:, 1]
    square = rate * rate - 2.0 * _climb(angle, slopes)
    reaches = (rate < 0.0) & (square > 0.0)
    return np.sqrt(np.where(reaches, square, np.nan))


def placement(speeds: ArrayLike, wanted: ArrayLike, slopes: ArrayLike) -> NDArray[np.float64]:
    """Where the simplest walker has to put its foot for a speed at the next mid-stance.

    Args:
        speeds: Speeds at mid-stance, over sqrt(g l), (n,).
        wanted: Speeds wanted at the next, (n,).
        slopes: Slope in rad, one for all or (n,).

    Returns:
        Half the angle between the legs at heelstrike, (n,): the largest that gives the speed
        wanted, or if none does, that which gives the greatest.
    """
    speeds, wanted, slopes = (
        np.asarray(x, dtype=float)[..., None] for x in (speeds, wanted, slopes)
    )

    def excess(angle: NDArray) -> NDArray:
        """Twice the energy that is left over at the next mid-stance."""
        before = speeds * speeds + 2.0 * _climb(angle, -slopes)
        return before * np.cos(2.0 * angle) ** 2 - 2.0 * _climb(angle, slopes) - wanted * wanted

    # Longer steps fall farther and lose more: beyond the best one the speed only decreases, and
    # legs at right angles lose all of it.
    angles = np.linspace(0.0, _RIGHT, _ANGLES)
    low = angles[np.argmax(excess(angles), axis=-1)][..., None]
    high = np.full_like(low, _RIGHT)
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        low, high = np.where(excess(middle) >= 0.0, [middle, high], [low, middle])
    return low[..., 0]


class SpeedControl(OnceAStride):
    """The simplest walker's speed at mid-stance, set by one push-off or one hip torque a stride.

    The deviation from the speed wanted is multiplied by `decay` in each stride, where the motor is
    strong enough; where it is not, it does what brings the speed nearest.

    Args:
        scene: A `Scene`, its name, or a mapping of its arguments, with control="stride"; its one
            action is "push_off" or "hip".
        speed: Speed wanted at mid-stance, over sqrt(g l); see `midstance_speed`.
        decay: From 0, back in one stride, to less than 1.

    Raises:
        SceneError: if the scene has another walker, or other actions.
        ValueError: if speed or decay is out of its range.
    """

    def __init__(
        self, scene: Scene | str | dict[str, Any], speed: float, *, decay: float = 0.0
    ) -> None:
        super().__init__("speed control", scene)
        if not self.walker.massless_legs:
            raise SceneError("speed control is the simplest walker's: its legs have no mass")
        if self.parts not in (("push_off",), ("hip_torque",)):
            raise SceneError(
                'speed control acts by "push_off" or by "hip": choose '
                'make_scene(scene, actions=("push_off",))'
            )
        if not speed > 0.0:
            raise ValueError(f"speed must be positive, over sqrt(g l), not {speed!r}")
        if not 0.0 <= decay < 1.0:
            raise ValueError(f"decay must be a number from 0 to less than 1, not {decay!r}")
        self.speed, self.decay = float(speed), float(decay)

    def given(self, points: NDArray, slopes: ArrayLike) -> NDArray[np.float64]:
        """Push-offs, or hip torques, of the strides that begin; 0 where a walker falls anyhow."""
        slopes = for_each(slopes, len(points))
        now = midstance_speed(points, slopes)
        wanted = self.speed + self.decay * (now - self.speed)
        choose = self._push_offs if self.parts == ("push_off",) else self._hip_torques
        return np.nan_to_num(choose(points, slopes, wanted))[:, None]

    def _push_offs(self, points: NDArray, slopes: NDArray, wanted: NDArray) -> NDArray:
        """What is missing of the rate after the strike; no strike can be had back."""
        strides = StrideMap(walker=self.walker, tolerance=_TOLERANCE)
        angle, rate, _ = strides.apply(points, slopes).ends.T
        needed = np.sqrt(np.maximum(wanted * wanted + 2.0 * _climb(angle, slopes), 0.0))
        push = (needed + rate) / np.sin(2.0 * angle)  # rates are negative
        return np.clip(push, 0.0, self.largest[0])

    def _hip_torques(self, points: NDArray, slopes: NDArray, wanted: NDArray) -> NDArray:
        """Torques that bring the foot to where it has to be, or as near as they can."""
        angles, most = placement(midstance_speed(points, slopes), wanted, slopes), self.largest[0]
        tried = most * np.linspace(-1.0, 1.0, _TRIED) ** 3  # denser where torques are small
        starts, grounds = (np.repeat(x, _TRIED, axis=0) for x in (points, slopes))
        ends = self._strides(np.tile(tried, len(points))).apply(starts, grounds).ends
        missed = np.abs(ends[:, 0].reshape(-1, _TRIED) - angles[:, None])
        missed[np.isnan(missed)] = np.inf
        torques = np.where(np.isinf(missed).all(axis=1), 0.0, tried[np.argmin(missed, axis=1)])
        last = torques
        for _ in range(_REFINED):
            passage, change = self._strides(torques).linearize(points, slopes, by=("hip_torque",))
            step = (passage.ends[:, 0] - angles) / change.ends[:, 0, 0]
            further = np.clip(torques - step, -most, most)
            torques, last = np.where(passage.alive, further, 0.5 * (torques + last)), torques
        return np.where(np.isnan(torques), 0.0, torques)

    def _strides(self, torques: NDArray) -> StrideMap:
        strides = StrideMap(walker=self.walker, tolerance=_TOLERANCE)
        return strides.with_parameter("hip_torque", torques)
