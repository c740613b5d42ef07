"""Disturbances that a walk withstands: rough ground, steps, pushes, and starts off its gait.

Each is simulated in the environment, passive or under a controller. Only the first-passage time of
a passive walker is sampled by the engine itself, which is faster.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gym_passive_walker._tools.arguments import KEPT, number, seed_number, shown, whole
from gym_passive_walker._tools.progress import progress
from gym_passive_walker._tools.shown import Table
from gym_passive_walker.envs.evaluation.steps import steps
from gym_passive_walker.envs.vector_env import PassiveWalkerVectorEnv
from gym_passive_walker.gaits.control.baselines import Passive
from gym_passive_walker.gaits.control.controllers import ControllerLike, acting
from gym_passive_walker.gaits.control.maps import acting_as, map_in
from gym_passive_walker.gaits.control.policy import Policy, policy_name
from gym_passive_walker.gaits.flow import Walkers
from gym_passive_walker.gaits.gait import Gait
from gym_passive_walker.gaits.robust.basin import narrowed
from gym_passive_walker.gaits.robust.first_passage import SETTLING as FORGETTING
from gym_passive_walker.gaits.robust.first_passage import FirstPassage, survivors
from gym_passive_walker.gaits.scenes.scene import (
    Scene,
    SceneLike,
    make_scene,
    seen_by_policy,
)
from gym_passive_walker.gaits.section import Section
from gym_passive_walker.gaits.stride_map import MapLike, StrideMap
from gym_passive_walker.gaits.terrain import Terrain, rough
from gym_passive_walker.models.model import check_supports
from gym_passive_walker.models.walkers import (
    Walker,
    WalkerLike,
    as_walker,
    is_walker,
    name_of,
)

if TYPE_CHECKING:
    from gym_passive_walker.gaits.robust.first_passage_mesh import MeshPassage

SETTLED_AFTER = 200
"""Strides in which a walker settles on its gait, before any disturbance."""

AFTER = 30
"""Strides that a walker must make after a disturbance to count as a survivor."""

PHASES = np.linspace(0.0, 0.9, 10)
"""Times of pushes, as shares of the gait's period."""

_TRIES = 24  # sizes that are tried at once
_SMALL = 1e-4  # leg lengths: a step with an answer in proportion to it
_ANSWERS = 60  # strides that are evaluated after it
_IDLE = {"rate": 0.0, "impulse": 0.0}  # pushes
_CALM = {
    "observation_noise": 0.0, "action_noise": 0.0, "reset_noise_scale": 0.0,
    "domain_randomization": {}, "randomization_pool": None, "constraints": {},
}  # fmt: skip


class _Walks(NamedTuple):
    """Walks of n walkers.

    Attributes:
        made: Number of strides of each, (n,).
        periods: Time of each stride in sqrt(l/g), (n, strides); NaN where there is none.
        states: State at the end of each stride, in the walker's own units, (n, strides, 6), or
            (n, strides, 2 m) of a `System`.
        lengths: Step length of each stride, in leg lengths, (n, strides).
    """

    made: NDArray[np.int64]
    periods: NDArray[np.float64]
    states: NDArray[np.float64]
    lengths: NDArray[np.float64]


@dataclass(frozen=True, repr=False)
class Robustness(Table):
    """Disturbances that a walk withstands. Lengths are in leg lengths l, times in sqrt(l/g).

    Attributes:
        controller_name: Name of the controller.
        walker: The walker.
        slope: On which slope, in rad.
        step_length: Step length of the gait.
        step_period: Time of a stride of the gait.
        roughness: Standard deviation of the heights of footholds, on rough ground.
        first_passage: Strides to a fall there, sampled or computed by a mesh of states.
        survivors: Share of walkers that are left there after each stride, (10 + strides,); those
            of the first ten do not count in `first_passage`. By a mesh: the exponential decay with
            its mean, (strides,).
        sensitivity: Gait sensitivity norm: root of the sum of squares of by how much the periods
            of the strides after a small step in the ground change, for each leg length of it.
        period_response: These changes, stride by stride, (strides,).
        step_up: Highest step of the ground that the walker walks on over, as it does over any lower
            one that was tried.
        step_down: Deepest step down, in leg lengths.
        push_phases: Times of pushes, as shares of the period, (k,).
        push_forward: Largest impulse downhill then, on the hip or on the centre of mass of a
            `System`, in m sqrt(g l), (k,).
        push_backward: Largest uphill, (k,).
        initial_error: Largest share of the gait's angle and rates by which starts were off.
        recovered: Share of starts within it from which the walker walks on.
        recovered_error: Standard error of this share.
        recovery: Strides after which a small error is a tenth of what it was; infinite if never.
    """

    controller_name: str
    walker: Walker
    slope: float
    step_length: float
    step_period: float
    roughness: float
    first_passage: FirstPassage | MeshPassage
    survivors: NDArray[np.float64]
    sensitivity: float
    period_response: NDArray[np.float64]
    step_up: float
    step_down: float
    push_phases: NDArray[np.float64]
    push_forward: NDArray[np.float64]
    push_backward: NDArray[np.float64]
    initial_error: float
    recovered: float
    recovered_error: float
    recovery: float

    def facts(self) -> dict[str, str]:
        """Every measure with its unit, and its error where it is of a sample."""
        ahead, back = self.push_forward, self.push_backward
        return {
            "controller": f"{self.controller_name}, walker {name_of(self.walker)}",
            "downhill": f"{self.slope:.6g} rad",
            "step length": f"{self.step_length:.4g} l",
            "step period": f"{self.step_period:.4g} √(l/g)",
            "rough ground": f"heights differ by {self.roughness:.3g} l",
            "first passage": f"{self.first_passage} there",
            "gait sensitivity norm": f"{self.sensitivity:.4g} √(l/g) per l",
            "step up": f"{self.step_up:.4g} l",
            "step down": f"{self.step_down:.4g} l",
            "push forward": f"{ahead.min():.4g} to {ahead.max():.4g} m √(g l)",
            "push backward": f"{back.min():.4g} to {back.max():.4g} m √(g l)",
            "starts": f"{self.recovered:.3f} ± {self.recovered_error:.3f} of those "
            f"up to {self.initial_error:.0%} off keep walking",
            "recovery": f"{self.recovery:g} strides to a tenth",
        }

    def columns(self) -> dict[str, NDArray]:
        """A row for each phase of the stride at which the walker was pushed."""
        names = ("push_phases", "push_forward", "push_backward")
        return {name: getattr(self, name) for name in names}


def robustness(
    controller: MapLike | Gait | ControllerLike,
    scene: SceneLike | None = None,
    *,
    slope: float | None = None,
    roughness: float = 0.002,
    first_passage: Literal["sampled", "mesh"] = "sampled",
    walkers: int | None = None,
    strides: int = 200,
    initial_error: float = 0.5,
    starts: int = 512,
    seed: int = 0,
) -> Robustness:
    """Measure which disturbances a walk withstands.

    Example:
        >>> import gym_passive_walker as gpw
        >>> bears = gpw.robustness("lab", slope=0.036, walkers=200, strides=20)
        >>> 0.0 < bears.step_down < 0.1
        True

    Args:
        controller: A passive walker, in a form that `as_walker` takes, or a `System`; a map of
            `stride_map`, or a `Gait` of one; or a controller, in a form that `gauntlet` takes.
        scene: The scene: a `Scene`, its name or a mapping of its arguments. A learned policy's
            own when None. A passive walker needs none, but its slope; without one it may scuff.
        slope: Slope in rad instead of the scene's; the middle of a range when None.
        roughness: Standard deviation of the heights of footholds on rough ground, in leg lengths.
            A scene's own random terrain is used.
        first_passage: "sampled": walkers walk over rough ground until they fall. "mesh": the mean
            is computed by weighted ensembles of walkers over a mesh of states, and reaches means
            that cannot be sampled. It needs footholds of random heights alone, and a controller
            without memory that observes at most two of them.
        walkers: Number of walkers on rough ground; 4096 passive ones or 512 others when None.
        strides: Number of strides of each of them there.
        initial_error: Largest share of the gait's angle and rates by which starts are off.
        starts: Number of starts.
        seed: Seed of ground and starts.

    Returns:
        All measures; print it, `plot` it, or write it with `to_csv`.

    Raises:
        ValueError: if an argument is out of its range, or the walker does not come to walk the
            same stride again and again; or if this controller or ground permits no mesh.
    """
    strides_of = controller.stride_map if isinstance(controller, Gait) else controller
    if isinstance(strides_of, StrideMap):
        if scene is not None:
            raise ValueError("a stride map has its own walker and motors: leave the scene out")
        if strides_of.terrain is not None:
            raise ValueError("robustness tries ground of its own: give a map of smooth ground")
        slope = strides_of.chosen(slope)
        controller = strides_of.walker
        if not strides_of.passive:
            controller, scene = acting_as(strides_of, slope)
    passive = is_walker(controller)
    if passive:
        tried, name = _scene_of(controller, scene, slope), "passive"
        policy: Policy = Passive(tried)
    else:
        changes = {} if slope is None else {"slope": slope}
        policy, tried = acting(controller, scene, calmed=_alone, **changes)  # type: ignore[arg-type]
        name = policy_name(policy)
    check_supports(tried.walker, "robustness")
    roughness = number(roughness, "roughness", least=0.0, most=1e3)
    strides, starts = whole(strides, "strides", 1, KEPT), whole(starts, "starts", 2, KEPT)
    seed = seed_number(seed)
    if first_passage not in ("sampled", "mesh"):
        raise ValueError(f'first_passage must be "sampled" or "mesh", not {shown(first_passage)}')
    if not 0.0 < number(initial_error, "initial_error") < 0.9:
        raise ValueError(f"initial_error must be a share between 0 and 0.9, not {initial_error!r}")
    count = (4096 if passive else 512) if walkers is None else whole(walkers, "walkers", 1, KEPT)
    tries = _Tries(policy, tried)
    with progress("measures of robustness", 6) as done:
        step_length, period = tries.settled(seed)
        done()
        ground = tried.terrain if tried.terrain and tried.terrain.random else rough(roughness)
        state = tries.gait
        if first_passage == "mesh":
            # Imported here: its parts of SciPy take as long to import as the rest of the package.
            from gym_passive_walker.gaits.robust.first_passage_mesh import mesh_passage

            strides_in = map_in(tried, None if passive else policy)
            lasting = mesh_passage(strides_in, state, ground, seed=seed)
            survived = lasting.survivors(strides)
        else:
            left = tries.left(ground, count, FORGETTING + strides, seed, in_scene=not passive)
            lasting, survived = FirstPassage.of(left), left[1:] / count
        done()
        period_response = tries.period_response()
        done()
        down, up = (tries.largest_step(way) for way in (-1.0, 1.0))
        done()
        forward, backward = (tries.largest_pushes(way, period) for way in (1.0, -1.0))
        done()
        share, error = tries.recovered(initial_error, starts, seed)
        recovery = tries.recovery(seed)
        done()
    return Robustness(
        controller_name=name,
        walker=tried.walker,
        slope=float(np.mean(tried.slope)),
        step_length=step_length,
        step_period=period,
        roughness=ground.height_std,
        first_passage=lasting,
        survivors=survived,
        sensitivity=float(np.sqrt(np.sum(period_response**2))),
        period_response=period_response,
        step_up=up,
        step_down=down,
        push_phases=PHASES,
        push_forward=forward,
        push_backward=backward,
        initial_error=float(initial_error),
        recovered=share,
        recovered_error=error,
        recovery=recovery,
    )


def _scene_of(controller: WalkerLike, scene: Any, slope: float | None) -> Scene:
    """The scene of a passive walker."""
    if scene is None and slope is None:
        raise ValueError("a passive walker needs a slope: robustness('C', slope=0.05)")
    changes: dict[str, Any] = {} if slope is None else {"slope": slope}
    passive = as_walker(controller)
    walker = {"walker": passive, "end_on_toe_stub": False} if scene is None else {}
    found = make_scene({} if scene is None else scene, **walker, **changes)
    if scene is not None and found.walker != passive:
        found = make_scene(found, walker=passive, end_on_toe_stub=None)
    return _alone(make_scene(found, control="stride"))


def _alone(scene: Scene) -> Scene:
    """Return a scene of one slope and command, without disturbances but those tried."""
    command = None if scene.command is None else float(np.mean(scene.command))
    slope = float(np.mean(scene.slope))
    return make_scene(seen_by_policy(scene), **_CALM, slope=slope, command=command)


class _Tries:
    """Simulated walks that test a policy.

    Args:
        policy: The policy.
        scene: The scene.
    """

    def __init__(self, policy: Policy, scene: Scene) -> None:
        self.policy, self.scene = policy, scene
        self.section = Section(walker=scene.walker)
        self.gait = np.zeros(self.section.size)

    def walk(
        self,
        states: NDArray | None,
        strides: int,
        *,
        terrain: Terrain | None = None,
        seed: int = 0,
        **way: Any,
    ) -> _Walks:
        """Simulate walks.

        Args:
            states: Initial states, (n, 6) or (n, 2 m); None for one walker as in the scene's
                episodes.
            strides: Largest number of strides.
            terrain: Terrain; smooth ground when None.
            seed: Seed of the disturbances.
            **way: Scheduled disturbances; see `Batch.schedule_events`.
        """
        count = 1 if states is None else len(states)
        scene = make_scene(self.scene, pushes=_IDLE, terrain=terrain or Terrain())
        envs = PassiveWalkerVectorEnv(count, scene, max_episode_steps=-1)
        options = {} if states is None else {"state": states}
        observations, _ = envs.reset(seed=seed, options=options)
        envs.batch.schedule_events(**way)
        made, going = np.zeros(count, np.int64), np.ones(count, bool)
        periods, lengths = np.full((2, count, strides), np.nan)
        ends = np.full((count, strides, self.section.size), np.nan)
        for step in steps(self.policy, envs, observations):
            going &= ~step.terminated
            struck = np.flatnonzero(step.struck & going)
            if len(struck):
                periods[struck, made[struck]] = step.infos["step_period"][struck]
                lengths[struck, made[struck]] = step.infos["step_length"][struck]
                ends[struck, made[struck]] = envs.batch.states[struck]
                made[struck] += 1
                going[struck] &= made[struck] < strides
            if not going.any():
                break
        return _Walks(made, periods, ends, lengths)

    def settled(self, seed: int) -> tuple[float, float]:
        """Walk until each stride is as the last; from there everything is tried.

        Returns:
            Its length and its period.

        Raises:
            ValueError: if the walker does not come to that.
        """
        found = self.walk(None, SETTLED_AFTER, seed=seed)
        last, before = found.states[0, -1], found.states[0, -2]
        if found.made[0] < SETTLED_AFTER:
            raise ValueError(
                f"the walker falls after {found.made[0]} strides of smooth ground: there is no "
                "gait of which robustness could be measured"
            )
        scale = np.abs(last).max()
        if np.abs(last - before).max() > 1e-3 * scale:
            raise ValueError(
                f"after {SETTLED_AFTER} strides the walker still does not make the same one again "
                "and again: it limps, wanders, or needs longer to settle"
            )
        self.gait = last
        return float(found.lengths[0, -1]), float(found.periods[0, -1])

    def left(
        self, terrain: Terrain, count: int, strides: int, seed: int, *, in_scene: bool
    ) -> NDArray[np.int64]:
        """Return the number of walkers left on rough ground, before any stride and after each.

        The engine alone, without the scene, follows passive walkers faster.
        """
        scene = self.scene
        if not in_scene:
            kind = Walkers(
                walker=scene.walker, tolerance=scene.tolerance,
                end_on_toe_stub=scene.end_on_toe_stub,
            )  # fmt: skip
            state = scene.walker.units.to_dimensionless(self.gait)
            slope = float(np.mean(scene.slope))
            return survivors(kind, state, slope, terrain, walkers=count, strides=strides, seed=seed)
        starts = np.tile(self.gait, (count, 1))
        made = self.walk(starts, strides, terrain=terrain, seed=seed).made
        return np.array([count, *(np.count_nonzero(made > k) for k in range(strides))])

    def period_response(self) -> NDArray[np.float64]:
        """Return changes of the period after a small step in the ground, per leg length of it."""
        starts = np.tile(self.gait, (2, 1))
        found = self.walk(starts, _ANSWERS, height_changes=[_SMALL, -_SMALL])
        if found.made.min() < _ANSWERS:
            return np.full(_ANSWERS, np.inf)
        return (found.periods[0] - found.periods[1]) / (2.0 * _SMALL)

    def _survived(self, sizes: NDArray, **way: Any) -> NDArray[np.bool_]:
        """Return whether the walker survives disturbances of some sizes, in their shape."""
        starts = np.tile(self.gait, (sizes.size, 1))
        return (self.walk(starts, AFTER, **way).made == AFTER).reshape(sizes.shape)

    def largest_step(self, way: float) -> float:
        """Return the largest step up (way 1) or down (-1) that is survived, with all below it."""

        def survived(sizes: NDArray) -> NDArray[np.bool_]:
            return self._survived(sizes, height_changes=way * sizes.ravel())

        return float(_largest(survived, 1, 0.5)[0])

    def largest_pushes(self, way: float, period: float) -> NDArray[np.float64]:
        """Return the largest pushes survived, forward (way 1) or backward (-1), by phase."""

        def survived(sizes: NDArray) -> NDArray[np.bool_]:
            times = np.broadcast_to(PHASES[:, None] * period, sizes.shape).ravel()
            return self._survived(sizes, impulses=way * sizes.ravel(), times=times)

        return _largest(survived, len(PHASES), 1.0)

    def recovered(self, initial_error: float, count: int, seed: int) -> tuple[float, float]:
        """Return the share of starts off the gait from which the walker walks on, and its error."""
        made = self.walk(self.near(initial_error, count, seed), AFTER).made
        share = float(np.mean(made == AFTER))
        return share, math.sqrt(share * (1.0 - share) / len(made))

    def near(self, initial_error: float, count: int, seed: int) -> NDArray[np.float64]:
        """Return states with both feet down, with angles and rates up to a share off the gait's.

        Fewer than `count` if some of a `System` cannot have both feet down.
        """
        draw = np.random.default_rng(seed).uniform
        walker: Any = self.scene.walker
        low, high = 1.0 - initial_error, 1.0 + initial_error
        if walker.chart.trailing_leg_follows:
            return self.gait * draw(low, high, (count, 3))[:, [0, 0, 0, 1, 2, 2]]
        states, angles = self.gait * draw(low, high, (count, self.section.size)), walker.coordinates
        if angles == 1:  # both feet of a wheel are down at one angle only
            states[:, 0] = self.gait[0]
        else:
            states[:, :angles] = walker.with_both_feet_down(states[:, :angles])
        return states[np.isfinite(states).all(axis=1)]

    def recovery(self, seed: int, off: float = 0.01) -> float:
        """Return the strides until walkers a little off the gait are ten times as near to it."""
        starts = self.near(off, 32, seed)
        found = self.walk(starts, _ANSWERS)
        units = self.scene.walker.units
        gait, seen = units.to_dimensionless(self.gait), self.section.chart.coordinates
        away = np.abs(units.to_dimensionless(found.states) - gait)[..., seen].max(axis=2)
        began = np.abs(units.to_dimensionless(starts) - gait)[:, seen].max(axis=1)
        near = np.all(away <= 0.1 * began.max(), axis=0)  # walkers that fell are not
        far = np.flatnonzero(~near)
        last = far[-1] if len(far) else -1  # index of the last stride after which they are not
        return math.inf if last == _ANSWERS - 1 else float(last + 2)


def _largest(survived: Any, count: int, most: float) -> NDArray[np.float64]:
    """Return the largest sizes survived, each with all smaller ones tried, to a hundredth.

    Args:
        survived: Function of sizes (count, tries) that returns whether walkers survive each.
        count: Number of sizes wanted.
        most: Largest size tried.
    """
    low, high, even = np.zeros(count), np.full(count, most), np.linspace(0.0, 1.0, _TRIES)
    for shares in (np.geomspace(1e-4, 1.0, _TRIES), even, even):
        low, high, _ = narrowed(survived, low, high, shares)
    return low
