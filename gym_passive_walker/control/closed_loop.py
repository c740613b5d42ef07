"""What a policy does to the walker: its periodic gait, its multipliers, and its basin."""

from __future__ import annotations

import math
from dataclasses import dataclass
from os import PathLike
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker.arguments import real_array, whole
from gym_passive_walker.control.controlled import ControlledMap, stride_map
from gym_passive_walker.control.controllers import ControllerLike, SceneLike
from gym_passive_walker.control.policy import Policy, steps
from gym_passive_walker.control.ticks import course
from gym_passive_walker.envs.scene import CHANNELS, Scene
from gym_passive_walker.envs.vector_env import PassiveWalkerVectorEnv
from gym_passive_walker.gaits.drive import Drive
from gym_passive_walker.gaits.gait import GaitNotFound, multipliers_of
from gym_passive_walker.gaits.newton import fixed_point
from gym_passive_walker.gaits.section import Section
from gym_passive_walker.gaits.stride import STATE_NAMES
from gym_passive_walker.progress import progress
from gym_passive_walker.shown import Table
from gym_passive_walker.walkers import name_of

_SETTLING = 100  # strides before the search begins
_CLOSED = 1e-5  # observations are single numbers in single precision: no stride closes to rounding
_ROUNDING = 1e-12  # to which strides close under a network that is followed in double precision
_WORK = (
    "gravity_cost", "hip_cost", "net_hip_cost", "ankle_cost", "net_ankle_cost", "push_off_cost",
)  # fmt: skip
_TORQUES = CHANNELS[:2]  # held through a step, so that a stride's course needs them


class Strides(NamedTuple):
    """Some strides of each of n walkers under a policy, dimensionless.

    Attributes:
        ends: Where they end on the section, (n, m); NaN for walkers that fell before.
        length: Distance walked, (n,).
        duration: Time taken, (n,).
        work: Over m g l, (6, n): of gravity, absolute and net of the hip, absolute and net of the
            ankle, and of the push-off.
        torques: The torques of hip and ankle in the first stride's steps, in units of m g l,
            (2, steps, n); 0 where there is no such motor, NaN once the stride is over.
    """

    ends: NDArray[np.float64]
    length: NDArray[np.float64]
    duration: NDArray[np.float64]
    work: NDArray[np.float64]
    torques: NDArray[np.float64]


class PolicyBasin(NamedTuple):
    """From where a policy keeps its walker walking.

    Attributes:
        stance_angles: rad, (columns,).
        stance_rates: In units of sqrt(g/l), (rows,).
        survived: Whether a walker that starts there, and else like the gait, makes all the strides
            asked for; shape (rows, columns).
    """

    stance_angles: NDArray[np.float64]
    stance_rates: NDArray[np.float64]
    survived: NDArray[np.bool_]


def policy_strides(
    policy: Policy, scene: Scene, slope: float, points: NDArray, count: int = 1
) -> Strides:
    """Take walkers through some strides under a policy.

    Args:
        policy: Who acts.
        scene: A scene whose motors are charged for absolute work.
        slope: Slope in rad.
        points: Starts on the section, dimensionless, (n, m).
        count: Strides.
    """
    n, walker = len(points), scene.walker
    worlds = PassiveWalkerVectorEnv(n, scene, max_episode_steps=-1)
    # Where the knee would bend backwards, or a leg lies on the ground, no stride begins.
    sound = (points[:, 0] > 0.0) & (points[:, 0] < 0.5 * math.pi)
    if walker.knees:
        sound &= points[:, 3] <= points[:, 2]
    states = Section(walker=walker).states_at(np.where(sound[:, None], points, 0.0))
    seen, _ = worlds.reset(seed=0, options={"state": states, "slope": slope})
    ends, torques = np.full_like(points, np.nan), []
    length, duration, work = np.zeros(n), np.zeros(n), np.zeros((len(_WORK), n))
    left = np.where(sound, count, 0)
    with progress("steps under a policy") as taken:
        for step in steps(policy, worlds, seen):
            if (left == count).any():
                torques.append(np.where(left == count, _torques(scene, step.actions), np.nan))
            struck = (left > 0) & step.struck
            if struck.any():
                far = step.infos["step_length"][struck]
                length[struck] += far
                duration[struck] += step.infos["step_period"][struck]
                work[:, struck] += far * [step.infos[name][struck] for name in _WORK]
            left[struck] -= 1
            there = struck & (left == 0)
            ends[there] = Section(walker=walker).points_at(worlds.states[there])
            left[step.terminated] = 0
            if not left.any():
                break
            taken()
    held = np.reshape(torques, (-1, len(_TORQUES), n)).swapaxes(0, 1)
    return Strides(ends, length, duration, work, held)


def _torques(scene: Scene, actions: NDArray) -> NDArray[np.float64]:
    """Torques of hip and ankle that actions (n, actions) are, in units of m g l, (2, n)."""
    torques = np.zeros((len(_TORQUES), len(actions)))
    for share, name in zip(np.clip(actions, -1.0, 1.0).T, scene.actions, strict=True):
        if name in _TORQUES:
            torques[_TORQUES.index(name)] = share * scene.largest(name)
    return torques


@dataclass(frozen=True, repr=False)
class ClosedLoopGait(Table):
    """The periodic gait of a walker under a policy; dimensionless, energies over weight and length.

    Attributes:
        policy: Who acts.
        scene: The scene, with the motors charged for absolute work.
        slope: Slope in rad.
        period: Strides until it repeats.
        point: Where it starts on the section, (m,).
        multipliers: Eigenvalues of the stride map under the policy over one period, largest modulus
            first, (m,).
        violation: Largest distance between the period's end and its start.
        speed: Mean speed over sqrt(g l).
        step_length: Mean step length over l.
        step_period: Mean time of a stride over sqrt(l/g).
        gravity_cost: What gravity pays.
        hip_cost: Absolute work of the hip's motor.
        net_hip_cost: Its net work.
        ankle_cost: Absolute work of the ankle's motor, 0 if there is none.
        net_ankle_cost: Its net work.
        push_off_cost: Work of the push-off, 0 if there is none.
        times: Instants of the first stride, from heelstrike to just before the next, (k,).
        states: Angles in rad and dimensionless rates at these, (k, 6).
        torques: The hip's torque under which the walker came to each, in units of m g l, (k,).
        ankle_torques: The ankle's, (k,); 0 if there is none.
    """

    policy: Policy
    scene: Scene
    slope: float
    period: int
    point: NDArray[np.float64]
    multipliers: NDArray[np.complex128]
    violation: float
    speed: float
    step_length: float
    step_period: float
    gravity_cost: float
    hip_cost: float
    net_hip_cost: float
    ankle_cost: float
    net_ankle_cost: float
    push_off_cost: float
    times: NDArray[np.float64]
    states: NDArray[np.float64]
    torques: NDArray[np.float64]
    ankle_torques: NDArray[np.float64]

    @property
    def agent(self) -> str:
        """What its policy is called."""
        return str(getattr(self.policy, "name", type(self.policy).__name__))

    @property
    def stable(self) -> bool:
        """Whether small disturbances die out."""
        return bool(abs(self.multipliers[0]) < 1.0)

    @property
    def positive_hip_cost(self) -> float:
        """Work of the hip's motor where it drives."""
        return 0.5 * (self.hip_cost + self.net_hip_cost)

    @property
    def motor_cost(self) -> float:
        """Absolute work of all motors."""
        return self.hip_cost + self.ankle_cost + self.push_off_cost

    @property
    def cost_of_transport(self) -> float:
        """Gravity's work and the motors' absolute work."""
        return self.gravity_cost + self.motor_cost

    def facts(self) -> dict[str, str]:
        """Who walks under whom, and its measures."""
        return {
            "policy": self.agent,
            "walker": name_of(self.scene.walker),
            "slope": f"{self.slope:.6g} rad",
            "period": str(self.period),
            "speed": f"{self.speed:.6g} √(g l)",
            "cost of transport": f"{self.cost_of_transport:.6g}",
            "largest multiplier": f"{abs(self.multipliers[0]):.3g}",
            "": "stable" if self.stable else "unstable",
        }

    def columns(self) -> dict[str, NDArray]:
        """A row for each instant of the first stride, dimensionless."""
        states = dict(zip(STATE_NAMES, self.states.T, strict=True))
        torques = {"torque": self.torques, "ankle_torque": self.ankle_torques}
        return {"time": self.times, **states, **torques}

    def basin(self, *, resolution: int = 31, reach: float = 2.0, strides: int = 20) -> PolicyBasin:
        """From where the policy keeps the walker walking, on a slice through the gait.

        Stance angle and stance rate are free; the swing leg's rates keep the gait's own ratio to
        the stance rate.

        Args:
            resolution: Points along each axis.
            reach: How far the axes go, in multiples of the gait's angle and rate.
            strides: How many strides count as walking.
        """
        shares = np.linspace(reach / resolution, reach, resolution)
        rate, angle = np.meshgrid(shares, shares, indexing="ij")
        points = np.column_stack([angle.ravel(), *[rate.ravel()] * (len(self.point) - 1)])
        points *= self.point
        ends = policy_strides(self.policy, self.scene, self.slope, points, strides).ends
        survived = np.isfinite(ends).all(axis=1).reshape(resolution, resolution)
        return PolicyBasin(shares * self.point[0], shares * self.point[1], survived)


def closed_loop_gait(
    policy: ControllerLike,
    scene: SceneLike | None = None,
    *,
    slope: float | None = None,
    period: int = 1,
    start: ArrayLike | None = None,
) -> ClosedLoopGait:
    """The periodic gait that a walker has under a policy.

    Example:
        >>> import gym_passive_walker as gpw
        >>> from gym_passive_walker.control.baselines import LinearFeedback
        >>> gait = gpw.closed_loop_gait(LinearFeedback("steep"), "steep")
        >>> gait.stable, round(gait.speed, 3)
        (True, 0.325)

    The walker walks for a while, and Newton's method closes what remains; so gaits are found that
    the policy holds, and unstable ones near the start. Of a policy whose network has a derivative
    (`load_policy`) multipliers are exact; of others they are central differences through `predict`,
    whose observations have single precision, and are good to about three digits. See `stride_map`.

    Args:
        policy: A baseline, a trained policy or its name, or a model of stable-baselines3. What it
            remembers must start anew with each stride.
        scene: A `Scene`, its name, or a mapping of its arguments. None is the policy's own, or
            "level" for one without a scene.
        slope: Slope in rad; the scene's, or the middle of its range, if None.
        period: Strides until the gait repeats.
        start: Where to start on the section, dimensionless, (m,); None is the scene's own start.

    Raises:
        GaitNotFound: if the walker falls at once, or no gait is found.
        ValueError: if the policy cannot act, the slope is none, the period not positive, or the
            start no point on the section.
    """
    period = whole(period, "period")
    if scene is None and not isinstance(policy, str | PathLike):
        scene = getattr(policy, "scene", "level")
    if policy is None or isinstance(policy, Drive):
        raise ValueError(
            "closed_loop_gait needs a policy, which observes its walker; find_gait(walker, slope, "
            "drive=...) finds the gaits of motors that do the same in each stride"
        )
    strides = stride_map(None, slope, controller=policy, scene=scene)
    assert isinstance(strides, ControlledMap)
    acts: Policy = strides.controller
    slope = strides.slope
    if start is None:
        point = strides.beginning(slope)[0]
    else:
        allowed = f"a point on the section, {strides.dimension} numbers: stance angle and rates"
        point = real_array(start, "start", allowed).copy()
        if point.shape != (strides.dimension,):
            raise ValueError(f"start must be {allowed}, not of shape {point.shape}")
    settled = strides.apply(point[None], strides=_SETTLING).ends[0]
    if np.isfinite(settled).all():  # else it falls: the gait may be unstable, and near the start
        point = settled

    def linearized(points: NDArray) -> tuple[NDArray, NDArray]:
        here, by_point = points, np.eye(strides.dimension)
        for _ in range(period):  # stride by stride: over several, differences would be too coarse
            passage, change = strides.linearize(here)
            here, by_point = passage.ends, change.ends[0] @ by_point
        return here, by_point[None]

    accuracy = _ROUNDING if strides.exact else _CLOSED
    found = fixed_point(linearized, point[None], accuracy=accuracy, damped=False)
    violation, name = float(found.sizes[0]), getattr(acts, "name", "this policy")
    if not math.isfinite(violation):
        raise GaitNotFound(
            f"a walker under {name} does not make {period} strides from near its start; give a "
            "start near the gait"
        )
    if violation > _CLOSED:
        raise GaitNotFound(
            f"no gait of period {period} under {name}: the best stride ends {violation:.1e} from "
            "where it began; try another period or start"
        )
    by_point = found.derivatives[0] + np.eye(len(point))
    if not np.isfinite(by_point).all():  # with legs together, every stride closes
        raise GaitNotFound(
            f"no gait of period {period} under {name}: a stride from the stance angle "
            f"{found.points[0, 0]:.1e} rad closes, but not all from points beside it end with a "
            "heelstrike; give a start with longer steps"
        )
    multipliers = multipliers_of(by_point)
    return _measured(acts, strides.scene, slope, period, found.points[0], multipliers, violation)


def _measured(
    policy: Policy,
    scene: Scene,
    slope: float,
    period: int,
    point: NDArray,
    multipliers: NDArray,
    violation: float,
) -> ClosedLoopGait:
    """The gait at a fixed point."""
    taken = policy_strides(policy, scene, slope, point[None], period)
    length, duration = float(taken.length[0]), float(taken.duration[0])
    costs = dict(zip(_WORK, (taken.work[:, 0] / length).tolist(), strict=True))
    one = policy_strides(policy, scene, slope, point[None])
    tick = scene.tick if scene.control == "tick" else math.inf
    times, states, torques = course(
        scene.walker, slope, point, one.torques[..., 0], tick=tick, duration=float(one.duration[0])
    )
    return ClosedLoopGait(
        policy, scene, slope, period, point, multipliers, violation,
        speed=length / duration, step_length=length / period, step_period=duration / period,
        **costs, times=times, states=states, torques=torques[0], ankle_torques=torques[1],
    )  # fmt: skip
