"""Potential shaping: torques at ankle and hip that act on a walker as another gravity.

    python -m examples.potential_shaping

The example shows how to write a control law. From the law it makes a controller that holds its
torques for a control step, and analyzes that controller with stride maps.

The potential energy V of two straight legs on point feet is a function of two angles. The gradient
of V_felt - V is a pair of torques. Under these torques the walker moves as under the gravity of
V_felt. Collisions do not depend on gravity, so its gaits are those of a passive walker, the passive
twin. The law needs torques that follow the state at every instant. An actuator that holds its
torque for a control step approximates the law.

References:
    M. W. Spong, F. Bullo, "Controlled symmetries and passive walking", IEEE Trans. Automatic
    Control 50 (2005) 1025-1031.
    F. Asano, M. Yamakita, "Virtual gravity and coupling control for robotic gait synthesis", IEEE
    Trans. Systems, Man, and Cybernetics A 31 (2001) 737-745.
"""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.integrate import simpson

import gym_passive_walker as gpw
from gym_passive_walker import Gait, Walker, console

_SAMPLES = 4001  # of a stride, for Simpson's rule
_BEFORE = 1.0 - 1e-12  # at its end the collision has changed the angular velocities

COMPASS = Walker(
    thigh_length=0.5, thigh_mass=5.0, thigh_com=0.5, shank_length=0.5, shank_mass=0.0,
    hip_mass=10.0, knees=False, gravity=9.8,
)  # fmt: skip
"""The compass walker of Goswami et al. 1998: half of its mass is in the legs."""


class Torques(NamedTuple):
    """Torques of hip and ankle, or their powers."""

    hip: Any
    ankle: Any


class Cost(NamedTuple):
    """Work of a stride over weight times distance, by actuator.

    Attributes:
        hip: Net work of the hip torque.
        ankle: Net work of the ankle torque.
        hip_absolute: Integral of the absolute power of the hip torque.
        ankle_absolute: Integral of the absolute power of the ankle torque.
    """

    hip: float
    ankle: float
    hip_absolute: float
    ankle_absolute: float

    @property
    def net(self) -> float:
        """Net cost of transport."""
        return self.hip + self.ankle

    @property
    def absolute(self) -> float:
        """Cost of transport by absolute work."""
        return self.hip_absolute + self.ankle_absolute


@dataclass(frozen=True)
class PotentialShaping:
    """Torques that act on a walker as another gravity, on any slope.

    Attributes:
        walker: The walker, with straight legs, point feet and masses on the line of each leg.
        felt_slope: Slope in rad of the passive twin.
        strength: Gravity of the passive twin over the walker's own.
    """

    walker: Walker
    felt_slope: float
    strength: float = 1.0

    def __post_init__(self) -> None:
        """Check that two torques can shape the walker's potential.

        Raises:
            ValueError: if the walker has knees, round feet or masses off the line of the leg.
        """
        walker = self.walker
        if walker.knees or walker.foot_radius:
            raise ValueError("potential shaping needs a walker with knees=False and foot_radius=0")
        if walker.thigh_offset or walker.shank_offset or walker.foot_angle:
            raise ValueError("this example is for walkers with masses on the line of the leg")

    def torques(self, state: ArrayLike, slope: ArrayLike) -> Torques:
        """Torques of the law, in the walker's own units.

        Args:
            state: [stance, thigh, shank] angles in rad, then their angular velocities, (6,) or
                (n, 6).
            slope: Slope of the ground in rad, a number or (n,).
        """
        stance, swing = np.moveaxis(np.asarray(state, dtype=float), -1, 0)[:2]
        walker = self.walker
        leg, length = walker.thigh_mass + walker.shank_mass, walker.leg_length
        swing_moment = walker.thigh_mass * walker.thigh_com
        swing_moment += walker.shank_mass * (walker.thigh_length + walker.shank_com)
        stance_moment = (walker.hip_mass + 2.0 * leg) * length - swing_moment

        def difference(angle: NDArray) -> NDArray:
            felt = self.strength * np.sin(angle - self.felt_slope)
            return walker.gravity * (np.sin(angle - slope) - felt)

        if walker.massless_legs:  # the hip torque is per unit of foot mass, and moves no hip
            return Torques(length * difference(swing), stance_moment * difference(stance))
        hip = swing_moment * difference(swing)
        return Torques(hip, stance_moment * difference(stance) - hip)

    def power(self, state: ArrayLike, slope: ArrayLike) -> Torques:
        """Powers of both torques; the power of a hip torque on massless feet is 0."""
        hip, ankle = self.torques(state, slope)
        stance, swing = np.moveaxis(np.asarray(state, dtype=float), -1, 0)[3:5]
        opening = 0.0 if self.walker.massless_legs else swing - stance
        return Torques(hip * opening, -ankle * stance)

    @property
    def passive_twin(self) -> tuple[Walker, float]:
        """The walker that moves in the same way without torques, and its slope in rad."""
        gravity = self.strength * self.walker.gravity
        return replace(self.walker, gravity=gravity), self.felt_slope

    def cost(self, gait: Gait, slope: float) -> Cost:
        """Cost of transport of a gait of the passive twin on a slope in rad."""
        if (gait.walker, gait.slope) != self.passive_twin:
            raise ValueError("the gait is not of the passive twin: find_gait(*passive_twin)")
        strides = gait.stride_map.with_tolerance(1e-13)
        times = np.linspace(0.0, gait.step_period, _SAMPLES)
        instants = _BEFORE * times[None] / gait.walker.time_unit
        sampled = strides.sample(strides.points_at(gait.state), gait.slope, instants)
        states = strides.units.to_own(sampled.states[0])
        power = np.array(self.power(states, slope))
        scale = self.walker.total_mass * self.walker.gravity * gait.step_length
        works = [simpson(each, x=times) / scale for each in (*power, *np.abs(power))]
        return Cost(*map(float, works))


def controlled_symmetry(walker: Walker, slope: float) -> PotentialShaping:
    """The law of Spong and Bullo: the walker walks on any ground as on this slope in rad."""
    return PotentialShaping(walker, slope)


def virtual_gravity(walker: Walker, angle: float) -> PotentialShaping:
    """The law of Asano: on level ground a horizontal gravity of g tan(angle) is added.

    The walker walks as on a slope of that angle (in rad) with gravity g / cos(angle). The net cost
    of transport is tan(angle).
    """
    return PotentialShaping(walker, angle, 1.0 / math.cos(angle))


class HeldTorques:
    """A controller: each control step holds the torques of the state that it begins with.

    The torques follow the observed slope, so the ground may change under the walker.

    Args:
        law: The law.
        **scene: Arguments of the scene, such as slope and tick.

    Attributes:
        scene: All arguments of the scene, for `gpw.stride_map` and `gym.make`.
    """

    name = "potential shaping"

    def __init__(self, law: PotentialShaping, **scene: Any) -> None:
        motors = {"actions": ("hip", "ankle"), "max_hip_torque": 0.2, "max_ankle_torque": 0.3}
        self.law, self.scene = law, {"walker": law.walker, **motors, **scene}
        units = gpw.stride_map(law.walker).units
        self.largest = np.array([self.scene["max_hip_torque"] * units.torque,
                                 self.scene["max_ankle_torque"] * units.energy])  # fmt: skip

    def __call__(self, observation: NDArray) -> NDArray[np.float64]:
        """Actions (..., 2) of observations (..., 8)."""
        torques = self.law.torques(observation[..., :6], observation[..., 7])
        return np.clip(np.stack(torques, axis=-1) / self.largest, -1.0, 1.0)


def main() -> None:
    """Print what the law costs, and how holding its torques changes the gait."""
    law = controlled_symmetry(COMPASS, math.radians(3.0))
    gait = gpw.find_gait(*law.passive_twin)
    print("Compass walker, controlled symmetry: the gait of 3 degrees on other slopes\n")
    print("slope (degrees)   net cost   absolute cost")
    for degrees in (-3.0, 0.0, 3.0, 6.0):
        cost = law.cost(gait, math.radians(degrees))
        print(f"{degrees:15.1f} {cost.net:10.5f} {cost.absolute:15.5f}")
    print("\nOn level ground, torques held for a control step\n")
    print("tick (sqrt(l/g))   speed (sqrt(g l))   largest Floquet multiplier")
    for tick in (0.05, 0.02, 0.01):
        held = HeldTorques(law, slope=0.0, tick=tick)
        strides = gpw.stride_map(controller=held)
        walks = gpw.find_gait(strides, guess=gait.state)
        print(f"{tick:16.2f} {walks.froude_speed:19.5f} {abs(walks.multipliers[0]):28.4f}")
    print(f"{'the law':>16} {gait.froude_speed:19.5f} {abs(gait.multipliers[0]):28.4f}")


if __name__ == "__main__":
    sys.exit(console.run(main))
