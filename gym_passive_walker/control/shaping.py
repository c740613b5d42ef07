"""Potential shaping: torques at ankle and hip under which a walker feels another gravity.

Collisions know nothing of gravity, and two torques on two straight legs can make up for any part of
it. So a walker on one slope can move in every detail as on another (controlled symmetry), or walk
on level ground as a passive walker down a slope (virtual gravity). The torques are a law of the
state, followed at every instant: no motor that holds its torque for a while does quite that. What
they do to the motion is to replace one ground by another, so the walks themselves are passive ones,
found as such; the torques' work is what the two grounds' potentials differ by.

References:
    M. W. Spong, F. Bullo, "Controlled symmetries and passive walking", IEEE Trans. Automatic
    Control 50 (2005) 1025-1031.
    F. Asano, M. Yamakita, "Virtual gravity and coupling control for robotic gait synthesis", IEEE
    Trans. Systems, Man, and Cybernetics A 31 (2001) 737-745.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.polynomial import Chebyshev
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker.arguments import check_state, number, one_slope
from gym_passive_walker.envs.scene import Scene, SceneError, make_scene
from gym_passive_walker.gaits.actuation import actuation_units
from gym_passive_walker.gaits.dense_stride import states_at
from gym_passive_walker.gaits.gait import Gait
from gym_passive_walker.physics.hybrid import Control, Ground, State
from gym_passive_walker.physics.systems import body_of, system_of
from gym_passive_walker.units import units_of
from gym_passive_walker.walkers import Walker, WalkerError, WalkerLike, as_walker

_DEGREE = 60  # of the polynomial through a stride's power, which is smooth: error at rounding
_REAL = 1e-7  # imaginary part up to which a root is real; a spurious one does no harm


class ShapingWork(NamedTuple):
    """What shaping does in a stride of a gait, in the walker's own units.

    Attributes:
        hip: Net work of the hip's torque.
        ankle: Net work of the ankle's.
        hip_absolute: Integral of the hip's absolute power.
        ankle_absolute: Integral of the ankle's.
        weight: Total mass times gravity.
        step_length: Distance between contacts along the slope.
    """

    hip: float
    ankle: float
    hip_absolute: float
    ankle_absolute: float
    weight: float
    step_length: float

    @property
    def net_cost(self) -> float:
        """Net work over weight times distance."""
        return (self.hip + self.ankle) / (self.weight * self.step_length)

    @property
    def absolute_cost(self) -> float:
        """Absolute work of both motors over weight times distance."""
        return (self.hip_absolute + self.ankle_absolute) / (self.weight * self.step_length)


@dataclass(frozen=True)
class PotentialShaping:
    """The torques under which a walker feels a gravity of one's choice, whatever the slope.

    Attributes:
        walker: The walker: straight legs and point feet, so that two torques can do it.
        felt_slope: The slope in rad as on which it walks.
        strength: The gravity that it feels over its own.

    Raises:
        WalkerError: if the walker has knees or round feet.
        ValueError: if the slope or the strength is no number, or the walker none.
    """

    walker: Walker
    felt_slope: float
    strength: float = 1.0

    def __post_init__(self) -> None:
        """Refuse walkers that two torques cannot rule."""
        object.__setattr__(self, "walker", as_walker(self.walker))
        one_slope(self.felt_slope, "felt_slope")
        number(self.strength, "strength")
        if self.walker.knees:
            raise WalkerError(
                "potential shaping needs a motor for every link, and a free knee has none: "
                "lock the knees with knees=False"
            )
        if self.walker.foot_radius != 0.0:
            raise WalkerError(
                "potential shaping needs an ankle torque, and the ground under a round foot bears "
                f"none: choose foot_radius=0 instead of {self.walker.foot_radius:g}"
            )

    def torques(self, state: ArrayLike, slope: ArrayLike) -> Control:
        """The torques of the law.

        Args:
            state: [stance, thigh, shank] angles in rad, then their rates, (6,) or (n, 6).
            slope: Slope of the ground in rad, a number or (n,).

        Returns:
            Torques of hip and ankle in the walker's own units, as of `Actuation`; numbers or (n,).
        """
        units, states = units_of(self.walker), check_state(state)
        hip, ankle = self.shares(units.to_dimensionless(states), slope)
        own = actuation_units(units)
        return Control(hip * own.hip_torque, ankle * own.ankle_torque)

    def shares(self, states: NDArray, slope: ArrayLike) -> Control:
        """The same without units, from dimensionless states (..., 6)."""
        # Accelerations are affine in torques and in gravity: which torques bring those of the
        # gravity felt? They depend on the angles alone, as gravity's moments do.
        accelerations, body = system_of(self.walker).phases[0].accelerations, body_of(self.walker)
        at, ground = State(*np.moveaxis(states, -1, 0)), Ground(np.sin(slope), np.cos(slope))
        sine, cosine = math.sin(self.felt_slope), math.cos(self.felt_slope)
        felt = Ground(self.strength * sine, self.strength * cosine)
        rest, hip, ankle, wanted = (
            np.array(np.broadcast_arrays(*accelerations(body, at, torques, gravity)))
            for torques, gravity in (
                (Control(0.0), ground),
                (Control(1.0), ground),
                (Control(0.0, 1.0), ground),
                (Control(0.0), felt),
            )
        )
        (a, c), (b, d), (x, y) = hip - rest, ankle - rest, wanted - rest
        scale = 1.0 / (a * d - b * c)
        return Control((d * x - b * y) * scale, (a * y - c * x) * scale)

    def power(self, state: ArrayLike, slope: ArrayLike) -> Control:
        """The power of both torques, as `torques`; a hip's on feet without mass is 0."""
        (hip, ankle), works = self.torques(state, slope), system_of(self.walker).works
        stance, thigh = np.moveaxis(np.asarray(state, dtype=float), -1, 0)[3:5]
        return Control(works.hip * hip * (thigh - stance), -works.ankle * ankle * stance)

    @property
    def passive_twin(self) -> tuple[Walker, float]:
        """The walker that moves in the same way without torques, and the slope where it does."""
        gravity = self.strength * self.walker.gravity
        return replace(self.walker, gravity=gravity), self.felt_slope

    def work(self, gait: Gait, slope: float) -> ShapingWork:
        """What the torques do in the first stride of a gait, exact to rounding.

        Args:
            gait: A gait of the passive twin.
            slope: Slope of the ground in rad.
        """
        walker = gait.walker
        if (walker, gait.slope) != self.passive_twin:
            raise ValueError("the gait is not one of the passive twin: find_gait(*passive_twin)")
        slope, duration = one_slope(slope), float(gait.stride.duration)

        def power(times: NDArray, motor: int) -> NDArray:
            states, _ = states_at(walker, gait.slope, gait.state, times, tolerance=1e-13)
            return self.power(states, slope)[motor]

        (hip, hip_absolute), (ankle, ankle_absolute) = (
            _integrals(Chebyshev.interpolate(power, _DEGREE, [0.0, duration], args=(motor,)))
            for motor in range(len(Control._fields))
        )
        return ShapingWork(
            hip, ankle, hip_absolute, ankle_absolute,
            units_of(self.walker).force, float(gait.stride.step_length),
        )  # fmt: skip


def _integrals(power: Chebyshev) -> tuple[float, float]:
    """The integral of a power over its domain, and that of its size."""
    roots = power.roots()
    low, high = power.domain
    inside = np.sort(roots[np.abs(roots.imag) < _REAL].real)
    edges = np.concatenate([[low], inside[(inside > low) & (inside < high)], [high]])
    pieces = np.diff(power.integ()(edges))
    return float(pieces.sum()), float(np.abs(pieces).sum())


def controlled_symmetry(walker: WalkerLike, slope: float) -> PotentialShaping:
    """Spong and Bullo's law: on any ground the walker walks as on this slope.

    Args:
        walker: The walker, in a form that `as_walker` takes; straight legs and point feet.
        slope: The slope in rad as on which it walks.
    """
    return PotentialShaping(as_walker(walker), one_slope(slope))


def virtual_gravity(walker: WalkerLike, angle: float) -> PotentialShaping:
    """Asano's law: on level ground a horizontal gravity of g tan(angle) is added.

    It walks as a passive walker does on a slope of that angle with gravity g / cos(angle), and its
    motors' net work over weight and distance is tan(angle).

    Args:
        walker: The walker, in a form that `as_walker` takes; straight legs and point feet.
        angle: The virtual slope in rad.
    """
    angle = one_slope(angle, "angle")
    return PotentialShaping(as_walker(walker), angle, 1.0 / math.cos(angle))


class Shaped:
    """A policy that shapes the potential: each tick holds the torques of the state it begins with.

    The shorter the ticks, the closer it is to the law; the torques answer to the slope that is
    observed, so the ground may change under the walker.

    Args:
        shaping: The law.
        scene: A `Scene`, its name, or a mapping of its arguments, with actions "hip" and "ankle".

    Raises:
        SceneError: if the scene's walker is another one, or its actions are others.
    """

    name = "potential shaping"

    def __init__(self, shaping: PotentialShaping, scene: Scene | str | dict[str, Any]) -> None:
        self.shaping, scene = shaping, make_scene(scene)
        if scene.walker != shaping.walker:
            raise SceneError("the scene's walker is not the one whose potential is shaped")
        if set(scene.actions) != {"hip", "ankle"}:
            raise SceneError(
                f"potential shaping acts by hip and ankle, and this scene's actions are "
                f'{scene.actions}: choose make_scene(scene, actions=("hip", "ankle"))'
            )
        self.largest = {name: scene.largest(name) for name in scene.actions}

    def predict(
        self,
        observation: ArrayLike,
        state: Any = None,
        episode_start: ArrayLike | None = None,
        deterministic: bool = True,
    ) -> tuple[NDArray[np.float32], Any]:
        """The torques of what is observed, one observation or a batch, as shares of the largest."""
        seen = np.asarray(observation, dtype=float)
        torques = self.shaping.shares(seen[..., :6], seen[..., 7])
        shares = [getattr(torques, name) / largest for name, largest in self.largest.items()]
        return np.clip(np.stack(shares, axis=-1), -1.0, 1.0).astype(np.float32), state
