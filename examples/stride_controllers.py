"""Feedback once a stride: a hip torque, an ankle torque or a push-off for each stride.

    python -m examples.stride_controllers

The example shows how to write a custom controller. It begins with the stride map and its
derivatives, and ends with the Floquet multipliers and the basin of the closed loop.

`ActuationFeedback` is linear feedback of the deviation from a gait, by the linearized stride map.
`SpeedControl` is for the simplest walker. Its hip is an inverted pendulum, so the speed at
mid-stance, where the stance leg is along the ground's normal, determines its energy. The change of
that speed in a stride depends on where the foot lands and on the push-off. Kuo's walkers choose the
push-off; those of Bhounsule and Zamani choose a hip torque that places the foot.

References:
    A. D. Kuo, "Energetics of actively powered locomotion using the simplest walking model",
    J. Biomech. Eng. 124 (2002) 113-120.
    P. A. Bhounsule, A. Zamani, "A discrete control Lyapunov function for exponential orbital
    stabilization of the simplest walker", J. Mechanisms Robotics 9 (2017) 051011.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

import gym_passive_walker as gpw
from gym_passive_walker import Gait, console
from gym_passive_walker.control import Method, SceneLike, gains
from gym_passive_walker.envs.scene import make_scene

PARTS = {"hip": "hip_torque", "ankle": "ankle_torque", "push_off": "push_off"}
"""The part of an `Actuation` for each action of a scene."""

_TOLERANCE = 1e-11  # of strides that are predicted
_RIGHT_ANGLE = 0.25 * math.pi  # stance angle at which the legs are at right angles
_ANGLES, _BISECTIONS = 200, 52
_TRIED, _REFINED = 41, 8  # torques tried, and Newton iterations from the best of them


class OnceAStride:
    """A controller that chooses the actuation of a stride at its start.

    A subclass defines `actuation`. All that takes a controller calls `plan`.

    Args:
        scene: A scene in a form that `make_scene` takes: the walker, its actuators and
            their limits. Actions are held for a stride; the scene's `control` is ignored.
        **changes: Arguments of the scene that replace its own.

    Attributes:
        scene: The `Scene`, with control="stride".
        strides: Stride map of the walker without actuators.
        parts: Parts of an `Actuation` that the scene's actions are.
        largest: Largest dimensionless value of each part.
    """

    name = "feedback once a stride"

    def __init__(self, scene: SceneLike, **changes: Any) -> None:
        self.scene = make_scene(scene, control="stride", **changes)
        self.strides = gpw.stride_map(self.scene.walker, tolerance=_TOLERANCE)
        self.parts = tuple(PARTS[name] for name in self.scene.actions)
        self.largest = np.array([self.scene.largest(name) for name in self.scene.actions])

    def actuation(self, points: NDArray, slopes: ArrayLike) -> NDArray[np.float64]:
        """Dimensionless actuation of strides, (n, parts).

        Args:
            points: Points on the Poincaré section at which the strides start, dimensionless,
                (n, m).
            slopes: Slope in rad, one for all or (n,).
        """
        raise NotImplementedError

    def plan(self, points: NDArray, slopes: ArrayLike) -> NDArray[np.float64]:
        """Actions (n, 1, parts) from points (n, m) on the section; each stride is one step."""
        return (self.actuation(points, slopes) / self.largest)[:, None]


class ActuationFeedback(OnceAStride):
    """Linear feedback about a gait, by all actions of the scene.

    With method="deadbeat" the simplest walker returns to its gait in two strides with one action,
    and in one stride with two actions: two directions of its Poincaré section survive a stride.

    Args:
        scene: A scene in a form that `make_scene` takes; its walker is replaced by the
            gait's.
        gait: The gait to hold, passive or under an `Actuation`.
        method: "deadbeat" or "lqr"; see `control.feedback.gains`.
        torque_weight: Weight of the actuation for "lqr".

    Attributes:
        point: The gait's point on the Poincaré section, dimensionless, (m,).
        closed_loop: Derivative of the closed-loop stride map, dimensionless, (m, m).

    Raises:
        ValueError: if the gait needs an action that the scene does not have.
    """

    def __init__(
        self,
        scene: SceneLike,
        gait: Gait,
        method: Method = "deadbeat",
        *,
        torque_weight: float = 100.0,
    ) -> None:
        super().__init__(scene, walker=gait.walker)
        self.name, strides = method, gait.stride_map
        held = strides.actuation._asdict()
        if lacking := [part for part in held if held[part] and part not in self.parts]:
            raise ValueError(f"the gait needs {lacking[0]}, which is no action of the scene")
        self.point, m = strides.points_at(gait.state)[0], strides.dimension
        _, change = strides.linearize(self.point[None], gait.slope, by=("state", *self.parts))
        by_point, by_actuation = change.ends[0, :, :m], change.ends[0, :, m:]
        self.held = np.array([held[part] for part in self.parts])
        self.gains = gains(by_point, by_actuation, method, torque_weight=torque_weight)
        self.closed_loop = by_point - by_actuation @ self.gains

    def actuation(self, points: NDArray, slopes: ArrayLike) -> NDArray[np.float64]:
        """The gait's own actuation less the gains times the deviation; the slope is ignored."""
        return self.held - (points - self.point) @ self.gains.T

    def plan_by(self, points: NDArray, slopes: ArrayLike) -> tuple[NDArray, NDArray]:
        """Derivatives of `plan` by points, (n, 1, parts, m), and by the slope, (n, 1, parts)."""
        by_point = -self.gains / self.largest[:, None]
        shape = (len(points), 1, *by_point.shape)
        return np.broadcast_to(by_point, shape), np.zeros(shape[:-1])


def climb(angle: ArrayLike, slope: ArrayLike) -> NDArray[np.float64]:
    """Potential energy gained from heelstrike, at a stance angle, to mid-stance, over m g l."""
    return np.cos(slope) * (1.0 - np.cos(angle)) - np.sin(slope) * np.sin(angle)


def midstance_speed(points: NDArray, slopes: ArrayLike) -> NDArray[np.float64]:
    """Speed of the simplest walker's hip at mid-stance over sqrt(g l), (n,).

    Args:
        points: Points on the Poincaré section, dimensionless, (n, 3).
        slopes: Slope in rad, one for all or (n,).

    Returns:
        The speeds; NaN for walkers that fall back before mid-stance.
    """
    angle, rate = points[:, 0], points[:, 1]
    square = rate * rate - 2.0 * climb(angle, slopes)
    reaches = (rate < 0.0) & (square > 0.0)
    return np.sqrt(np.where(reaches, square, np.nan))


def speed_of(gait: Gait) -> float:
    """Mid-stance speed of a gait over sqrt(g l)."""
    return float(midstance_speed(gait.stride_map.points_at(gait.state), gait.slope)[0])


def placement(speeds: ArrayLike, wanted: ArrayLike, slopes: ArrayLike) -> NDArray[np.float64]:
    """Foot placement of the simplest walker for a wanted speed at the next mid-stance.

    Args:
        speeds: Speeds at mid-stance over sqrt(g l), (n,).
        wanted: Wanted speeds at the next mid-stance, (n,).
        slopes: Slope in rad, one for all or (n,).

    Returns:
        Half the angle between the legs at heelstrike in rad, (n,): the largest that gives the
        wanted speed, or the one that gives the highest speed if none does.
    """
    speeds, wanted, slopes = (
        np.asarray(x, dtype=float)[..., None] for x in (speeds, wanted, slopes)
    )

    def excess(angle: NDArray) -> NDArray:
        """Twice the energy at the next mid-stance in excess of the wanted speed's."""
        before = speeds * speeds + 2.0 * climb(angle, -slopes)
        return before * np.cos(2.0 * angle) ** 2 - 2.0 * climb(angle, slopes) - wanted * wanted

    # Longer steps fall farther and lose more: beyond the best one the speed only decreases, and
    # legs at right angles lose all of it.
    angles = np.linspace(0.0, _RIGHT_ANGLE, _ANGLES)
    low = angles[np.argmax(excess(angles), axis=-1)][..., None]
    high = np.full_like(low, _RIGHT_ANGLE)
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        low, high = np.where(excess(middle) >= 0.0, [middle, high], [low, middle])
    return low[..., 0]


class SpeedControl(OnceAStride):
    """Mid-stance speed of the simplest walker, by one push-off or one hip torque a stride.

    Each stride multiplies the deviation from the wanted speed by `decay`. If the actuator is too
    weak, the speed is as near to that as it permits.

    Args:
        scene: A scene in a form that `make_scene` takes; its one action is "push_off" or
            "hip".
        speed: Wanted speed at mid-stance over sqrt(g l); see `midstance_speed`.
        decay: At least 0, which removes the deviation in one stride, and less than 1.

    Raises:
        ValueError: if the walker is not the simplest, or the actions are others.
    """

    name = "speed control"

    def __init__(self, scene: SceneLike, speed: float, *, decay: float = 0.0) -> None:
        super().__init__(scene)
        if not self.scene.walker.massless_legs:
            raise ValueError("speed control is for the simplest walker: its legs have no mass")
        if self.parts not in (("push_off",), ("hip_torque",)):
            raise ValueError('speed control has one action: "push_off" or "hip"')
        self.speed, self.decay = speed, decay

    def actuation(self, points: NDArray, slopes: ArrayLike) -> NDArray[np.float64]:
        """Push-offs or hip torques, (n, 1); 0 for walkers that fall in any case."""
        slopes = np.broadcast_to(slopes, len(points))
        now = midstance_speed(points, slopes)
        wanted = self.speed + self.decay * (now - self.speed)
        if self.parts == ("push_off",):
            chosen = self._push_offs(points, slopes, wanted)
        else:
            chosen = self._hip_torques(points, slopes, placement(now, wanted, slopes))
        return np.nan_to_num(chosen)[:, None]

    def _push_offs(self, points: NDArray, slopes: NDArray, wanted: NDArray) -> NDArray:
        """Push-offs that supply the angular velocity missing after a heelstrike without them."""
        angle, rate, _ = self.strides.apply(points, slopes).ends.T
        needed = np.sqrt(np.maximum(wanted * wanted + 2.0 * climb(angle, slopes), 0.0))
        push = (needed + rate) / np.sin(2.0 * angle)  # angular velocities are negative
        return np.clip(push, 0.0, self.largest[0])

    def _hip_torques(self, points: NDArray, slopes: NDArray, angles: NDArray) -> NDArray:
        """Torques that place the foot: the best of some, then Newton's method from there."""
        most, under = self.largest[0], partial(self.strides.with_parameter, "hip_torque")
        tried = most * np.linspace(-1.0, 1.0, _TRIED) ** 3  # denser where torques are small
        starts, grounds = (np.repeat(x, _TRIED, axis=0) for x in (points, slopes))
        ends = under(np.tile(tried, len(points))).apply(starts, grounds).ends
        missed = np.abs(ends[:, 0].reshape(-1, _TRIED) - angles[:, None])
        missed[np.isnan(missed)] = np.inf
        torques = np.where(np.isinf(missed).all(axis=1), 0.0, tried[np.argmin(missed, axis=1)])
        last = torques
        for _ in range(_REFINED):
            passage, change = under(torques).linearize(points, slopes, by=("hip_torque",))
            step = (passage.ends[:, 0] - angles) / change.ends[:, 0, 0]
            further = np.clip(torques - step, -most, most)
            torques, last = np.where(passage.alive, further, 0.5 * (torques + last)), torques
        return torques


def kuo_gait() -> Gait:
    """The normal gait of Kuo: the simplest walker on level ground, with a hip spring."""
    gravity = gpw.WALKERS["D"].gravity  # legs of 1 m
    walker = replace(gpw.WALKERS["D"], hip_stiffness=2.5127 * gravity)
    push_off = gpw.Actuation(push_off=0.1877 * math.sqrt(gravity))
    return gpw.find_gait(gpw.stride_map(walker, 0.0, controller=push_off))


def cases() -> Iterator[tuple[str, Gait, OnceAStride | None]]:
    """Cases of `main`: a name, the gait to hold, and the controller (None for the gait's own)."""
    gait = gpw.find_gait("D", 0.009)
    scene = {"walker": "D", "slope": gait.slope, "max_hip_torque": 1.0}
    yield "D, passive", gait, None
    yield "D, hip torque: LQR", gait, ActuationFeedback(scene, gait, "lqr", torque_weight=1.0)
    yield "D, hip torque: deadbeat", gait, ActuationFeedback(scene, gait)
    yield "D, hip torque: speed control", gait, SpeedControl(scene, speed_of(gait))
    gait = kuo_gait()
    start = gait.stride_map.units.to_dimensionless(gait.state)
    scene = {"walker": gait.walker, "slope": 0.0, "start": tuple(start), "max_push_off": 0.5}
    push, both = scene | {"actions": "push_off"}, scene | {"actions": ("hip", "push_off")}
    yield "Kuo, constant push-off", gait, None
    yield "Kuo, push-off: speed control", gait, SpeedControl(push, speed_of(gait))
    yield "Kuo, hip, push-off: deadbeat", gait, ActuationFeedback(both, gait)


def main() -> None:
    """Print the largest Floquet multiplier and the basin of attraction under each controller."""
    print("The simplest walker at a slope of 0.009 rad (D), and on level ground (Kuo)\n")
    print("controller                     largest multiplier   basin (share of the slice)")
    for name, gait, controller in cases():
        strides = gait.stride_map if controller is None else gpw.stride_map(controller=controller)
        closed = gpw.find_gait(strides, guess=gait.state)
        basin = gpw.basin_of_attraction(strides, gait.slope, resolution=15, strides=30)
        print(f"{name:30} {abs(closed.multipliers[0]):18.5f} {basin.walks.mean():28.3f}")


if __name__ == "__main__":
    sys.exit(console.run(main))
