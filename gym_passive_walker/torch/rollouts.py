"""Batched episodes under a policy, with the gradient of the return.

The rules and the reward of a scene are those of the environment (see `envs.task`). All quantities
are dimensionless.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from gym_passive_walker._tools.arguments import shown, whole
from gym_passive_walker.envs.batch import Batch
from gym_passive_walker.envs.transitions import STOPPED
from gym_passive_walker.envs.vector_env import seed_randoms
from gym_passive_walker.gaits.flow import states_in
from gym_passive_walker.gaits.scenes import rules
from gym_passive_walker.gaits.scenes.rewards import FUNCTIONS, rule_of
from gym_passive_walker.gaits.scenes.scene import (
    Scene,
    SceneLike,
    make_scene,
    seen_by_policy,
    undisturbed,
)
from gym_passive_walker.gaits.scenes.transition import Transition
from gym_passive_walker.models.equations.hybrid import Outcome
from gym_passive_walker.models.equations.systems import UNEVEN
from gym_passive_walker.models.model import check_heights_only
from gym_passive_walker.models.units import proportions
from gym_passive_walker.models.walkers.walker import varied
from gym_passive_walker.torch.counting import applied, check_alone, each_tensor
from gym_passive_walker.torch.operation import (
    FlowOptions,
    FlowResult,
    as_tensor,
    carry_on,
    check_parameters,
    columns_of,
)

_RUNNING, _STRUCK = map(int, (Outcome.RUNNING, Outcome.HEELSTRIKE))


class RolloutState(NamedTuple):
    """State of n walkers within their episodes, dimensionless.

    Attributes:
        states: States, (n, 6); of a `System` (n, 2 m).
        slopes: Slopes of the ground in rad, (n,); slopes of a terrain's footholds add to them.
        phases: Index of the present phase of each stride, (n,).
        times: Time since each stride began, in sqrt(l/g), (n,).
        starts: Stance angle in rad with which each stride began, (n, 1); of a `System` all m
            coordinates, (n, m).
        progress: Distance of the hip in the present stride, in leg lengths, (n,).
        strides: Number of strides that have ended in the episode, (n,).
        keys: Terrain seeds, 64 bits each, (n,).
        footholds: Changes from each foothold to the next beyond the terrain's, (k, n, 2); see
            `initial_state`.
        commands: Commanded speeds over sqrt(g l), (n,); 0 without a command.
        last: The last control step; zeros where an episode begins.
        parameters: Walker parameters that differ from the scene's, by name, (n,) each.
        outcome: Outcome of the episode, an `Outcome` as a number, (n,); RUNNING until it ends.
    """

    states: Tensor
    slopes: Tensor
    phases: Tensor
    times: Tensor
    starts: Tensor
    progress: Tensor
    strides: Tensor
    keys: Tensor
    footholds: Tensor
    commands: Tensor
    last: Transition
    parameters: dict[str, Tensor]
    outcome: Tensor

    @property
    def going(self) -> Tensor:
        """Whether each episode is still running, (n,)."""
        return self.outcome == _RUNNING

    def detach(self) -> RolloutState:
        """Return a copy that is detached from the graph: gradients stop here."""
        return self._replace(
            states=self.states.detach(),
            starts=self.starts.detach(),
            progress=self.progress.detach(),
            last=each_tensor(self.last, Tensor.detach),
        )


class Rollout(NamedTuple):
    """Episodes of n walkers over T control steps, dimensionless.

    Attributes:
        returns: Sum of the rewards of each walker, (n,), with its gradient.
        rewards: Rewards, (T, n); 0 after an episode has ended.
        distances: Distance of the hip in each control step, in leg lengths, (T, n). A fall
            subtracts the distance of the unfinished stride.
        energies: Energy that the actuators are charged for, in m g l, (T, n).
        observations: Observations of the policy, (T, n, k), as in the environment.
        outcomes: Outcome of each control step, an `Outcome` as a number, (T, n).
        going: Whether the episode was running when each control step began, (T, n).
        margins: Rates with which the events of impacts cross zero, (T, n); see `Tick`.
        end: State after the last control step, from which another rollout can start.
    """

    returns: Tensor
    rewards: Tensor
    distances: Tensor
    energies: Tensor
    observations: Tensor
    outcomes: Tensor
    going: Tensor
    margins: Tensor
    end: RolloutState


def initial_state(
    scene: SceneLike,
    count: int = 16,
    *,
    seed: int | None = None,
    parameters: Mapping[str, Any] | None = None,
    footholds: Any = None,
) -> RolloutState:
    """Draw initial states of episodes, as a vector environment with this seed does.

    Args:
        scene: A scene, its name, or its arguments.
        count: Number of walkers.
        seed: Seed of the first walker; the others use seed + 1, seed + 2, ...
        parameters: Values of walker parameters that replace the scene's, numbers or (count,).
        footholds: Changes from each foothold of an episode to the next: height in leg lengths and
            slope in rad, (k, 2) or (k, count, 2). They add to those of the scene's terrain. Later
            footholds are without such changes, and all of them when None.

    Raises:
        SceneError: if the scene has noise, delays, random pushes or feasibility constraints.
        ValueError: if `footholds` have another shape, or slopes that a `System` does not support.
        WalkerError: if a walker has no such parameter.
    """
    scene, count = _differentiable(make_scene(scene)), whole(count, "count")
    batch = Batch(scene, count)
    seed_randoms(batch, seed, range(count))
    batch.start(np.arange(count), np.empty(count * batch.observation_size, np.float32))
    slopes, keys, commands = batch.ledger["slope"], np.zeros(count, np.uint64), np.zeros(count)
    if batch.disturbances:
        disturbances = batch.disturbances.states
        slopes, keys, commands = disturbances["slope"], disturbances["key"], disturbances["command"]
    coordinates, parameters_of = scene.walker.coordinates, [w.parameters for w in batch.walkers]
    values = {
        name: torch.tensor([each[name] for each in parameters_of], dtype=torch.float64)
        for name in dict.fromkeys((*scene.randomized, *_exchanged(scene)))
        if name in parameters_of[0]
    }
    given = check_parameters(scene.walker, parameters)
    changes = torch.zeros((0, 2), dtype=torch.float64)
    if footholds is not None:
        changes = as_tensor(footholds, "footholds")
    if changes.ndim == 2:
        changes = changes[:, None]
    if changes.ndim != 3 or changes.shape[1] not in (1, count) or changes.shape[2] != 2:
        raise ValueError(
            f"footholds must have shape (k, 2) or (k, {count}, 2), not {tuple(changes.shape)}"
        )
    check_heights_only(scene.walker, changes[:, :, 1].numpy(force=True))
    zeros = torch.zeros(count, dtype=torch.float64)
    states = torch.from_numpy(states_in(batch.records[:, 0], coordinates).copy())
    here = RolloutState(
        states=states,
        slopes=torch.from_numpy(slopes.copy()),
        phases=torch.zeros(count, dtype=torch.int64),
        times=zeros,
        starts=states[:, : len(columns_of(scene.walker).inputs["start"])],
        progress=zeros,
        strides=torch.zeros(count, dtype=torch.int64),
        keys=torch.from_numpy(keys.view(np.int64).copy()),
        footholds=changes.expand(-1, count, -1),
        commands=torch.from_numpy(commands.copy()),
        last=Transition._make([zeros] * len(Transition._fields)),
        parameters=values | {name: value.expand(count) for name, value in given.items()},
        outcome=torch.zeros(count, dtype=torch.int64),
    )
    none, never = (zeros,) * len(scene.actions), torch.zeros(count, dtype=torch.bool)
    tilts, rises, turns = _ground(scene, here).T
    at = scene.walker.equations().State(*states.T)
    last = here.last._replace(
        before=at, state=at, knee_locked=never, heelstrike=never, fell=never, action=none,
        last_action=none, slope=here.slopes + tilts, height_change=rises, slope_change=turns,
        command=here.commands,
    )  # fmt: skip
    return here._replace(last=last)


def _exchanged(scene: Scene) -> list[str]:
    """Names of the parameters that legs exchange at heelstrikes."""
    return [scene.walker.body._fields[place] for place in scene.walker.exchanged_places]


def _swapped(scene: Scene, parameters: dict[str, Tensor], where: Tensor) -> dict[str, Tensor]:
    """Return parameters with the legs exchanged for some walkers, (n,)."""
    other = {name: parameters[scene.walker.counterpart(name)] for name in _exchanged(scene)}
    return parameters | {
        name: torch.where(where, value, parameters[name]) for name, value in other.items()
    }


def _differentiable(scene: Scene) -> Scene:
    """Return the scene if its episodes have gradients; terrain and commands are allowed.

    Raises:
        SceneError: if the scene has noise, delays, random pushes or feasibility constraints.
    """
    known = {"terrain": None, "terrain_lookahead": 0, "command": None}
    undisturbed(make_scene(scene, **known), "walks with gradients go")
    return seen_by_policy(scene)


def rollout(
    policy: Callable[[Tensor], Tensor],
    scene: SceneLike,
    horizon: int,
    *,
    count: int = 16,
    seed: int | None = None,
    start: RolloutState | None = None,
    pushes: Any = None,
) -> Rollout:
    """Simulate episodes under a policy, with the exact gradient of their returns.

    Args:
        policy: Maps observations (n, k), those of the environment in float64, to actions
            (n, actions), or (n,) for a single action. Actions are clipped to their bounds.
        scene: A scene, its name, or its arguments; without noise, delays and random pushes.
        horizon: Number of control steps.
        count: Number of walkers.
        seed: Seed of the first walker; the others use seed + 1, seed + 2, ...
        start: From `initial_state`, or the `end` of a rollout; replaces count and seed.
        pushes: Impulses on the hip along the slope as each control step begins, over m sqrt(g l),
            positive downhill; a number, (horizon, 1) or (horizon, n). None applies none.

    Raises:
        TypeError: if the actions are not float64 tensors on the CPU.
        ValueError: if the actions or `pushes` have another shape.
        SceneError: if the scene has noise, delays, random pushes or feasibility constraints, or if
            a function of its own mixes walkers.
    """
    if not callable(policy):
        raise ValueError(
            "rollout needs a function or a module from tensors of observations to tensors of "
            f"actions, not {shown(policy)}: robustness and gauntlet take other controllers"
        )
    scene, horizon = _differentiable(make_scene(scene)), whole(horizon, "horizon")
    here = initial_state(scene, count, seed=seed) if start is None else start
    impulses = None
    if pushes is not None:
        size = len(here.slopes)
        impulses = as_tensor(pushes, "pushes")
        if impulses.ndim > 2 or any(
            given not in (1, wanted)
            for given, wanted in zip(impulses.shape[::-1], (size, horizon), strict=False)
        ):
            raise ValueError(
                f"pushes must be a number or of shape ({horizon}, {size}), with 1 for what is "
                f"alike, not {tuple(impulses.shape)}"
            )
        impulses = impulses.expand(horizon, size)
    ticks = []
    for k in range(horizon):
        results, here = _tick(policy, scene, here, None if impulses is None else impulses[k])
        ticks.append(results)
        if k == 0 and _ruled(scene):
            check_alone(scene, here.last)
    results = [torch.stack(columns) for columns in zip(*ticks, strict=True)]
    return Rollout._make([results[0].sum(0), *results, here])


def _ground(scene: Scene, here: RolloutState, ahead: int = 0) -> Tensor:
    """Return ground data of the footholds that lie `ahead` strides in front.

    Returns:
        Slope in rad, height change in leg lengths and slope change in rad to the next, (n, 3).
    """
    count, places = len(here.footholds), here.strides + ahead
    if scene.terrain is None:
        ground = torch.zeros((len(here.slopes), 3), dtype=torch.float64)
    else:
        keys = here.keys.numpy().view(np.uint64)
        ground = torch.from_numpy(scene.terrain.ground(keys, places.numpy()))
    if count == 0:
        return ground
    level = torch.zeros_like(here.footholds[:1])
    changes, lanes = torch.cat([here.footholds, level]), torch.arange(len(places))
    slopes = torch.cat([level, here.footholds])[:, :, 1].cumsum(0)
    places = places.clamp(max=count)  # the last is level
    return ground + torch.cat([slopes[places, lanes, None], changes[places, lanes]], 1)


def _observed(scene: Scene, here: RolloutState) -> Tensor:
    """Return the observations of the environment in float64, (n, k)."""
    if callable(scene.observation):
        return _stacked(applied(scene.observation, here.last), here)
    slopes, body = here.slopes + _ground(scene, here)[:, 0], ()
    locked = _locked(scene, here.phases).double()
    ahead = [_ground(scene, here, place).T[1:] for place in range(scene.terrain_lookahead)]
    if scene.observe_body and "units" in scene.walker.supports:
        body = proportions(varied(scene.walker, here.parameters), scene.observe_body)
    elif scene.observe_body:
        numbers = _swapped(scene, here.parameters, here.strides % 2 == 1)  # of the first stride
        numbers = scene.walker.parameters | numbers
        body = [numbers[name] for name in scene.observe_body]
    seen = rules.observed(scene, here.states.T, locked, slopes, here.commands, ahead, body)
    return _stacked(seen, here)


def _stacked(columns: Sequence[Any], here: RolloutState) -> Tensor:
    """Return columns (n,) or numbers as one tensor (n, columns)."""
    return torch.stack([torch.zeros_like(here.times) + column for column in columns], 1)


def _tick(
    policy: Callable[[Tensor], Tensor], scene: Scene, here: RolloutState, pushes: Tensor | None
) -> tuple[tuple[Tensor, ...], RolloutState]:
    """Simulate one control step.

    Returns:
        Per-step fields of `Rollout` from `rewards` to `margins`, in order; and the final state.
    """
    seen, going = _observed(scene, here), here.going
    actions = as_tensor(policy(seen), "the policy's action")
    wanted = len(seen), len(scene.actions)
    if actions.shape != wanted and (actions.shape != wanted[:1] or wanted[1] > 1):
        raise ValueError(
            f"a policy gives one action for each of {wanted[0]} walkers and each of its motors "
            f"({', '.join(scene.actions)}): shape {wanted}, not {tuple(actions.shape)}"
        )
    shares = tuple(
        rules.clip(action, scene.least(name), 1.0)
        for name, action in zip(scene.actions, actions.reshape(wanted).T, strict=True)
    )
    held = dict.fromkeys(scene.channels, torch.zeros_like(here.times))
    for name, share in zip(scene.actions, shares, strict=True):
        held[name] = scene.largest(name) * share
    spans = torch.full_like(here.times, scene.tick if scene.control == "tick" else math.inf)
    left, (tilts, rises, turns) = scene.max_stride_time - here.times, _ground(scene, here).T
    columns = [
        here.slopes + tilts, *held.values(), rises, turns,
        torch.zeros_like(left) if pushes is None else pushes, *here.starts.T,
        torch.minimum(spans, left), *here.parameters.values(),
    ]  # fmt: skip
    inputs_by = dict(zip(scene.channels, columns_of(scene.walker).controls, strict=True))
    motors = tuple(inputs_by[name] for name in scene.actions)
    other = () if pushes is None else ("push",)
    ruled = _ruled(scene)
    other += ("start",) if ruled or scene.command is not None else ()  # for the step length
    parameters, given = tuple(here.parameters), len(here.footholds) > 0
    uneven = UNEVEN if given or scene.terrain is not None else ()
    ground = ("slope", *UNEVEN) if given else ()
    using = (*(motor for motor in motors if motor != "hip_torque"), *uneven, *other)
    options = FlowOptions(
        scene.walker, parameters, (*motors, *other, *ground, *parameters), using, scene.tolerance,
        bool(scene.end_on_toe_stub),
    )  # fmt: skip
    inputs = torch.cat([here.states, torch.stack(columns, 1)], 1)
    moved = carry_on(inputs, here.phases, going, options)
    struck = moved.outcomes == _STRUCK
    end = rules.step_end(here.times, spans, scene.max_stride_time)
    outcomes = rules.outcome_of(moved.outcomes, end, scene.max_stride_time).long()
    outcomes = torch.where(going, outcomes, moved.outcomes)
    falls = rules.ends_episode(outcomes)
    distances = rules.distance_of(falls, moved.distance, here.progress)
    energies = torch.zeros_like(distances)
    charged, works = rules.ENERGIES.index(scene.energy), _works(scene)
    for j, (name, work) in enumerate(zip(scene.channels, works, strict=False)):
        if name in scene.actions and work:
            torques = torch.where(falls, held[name].detach(), held[name]) * work
            angles = moved.result("moved", j), moved.result("turned", j)
            energies = energies + rules.motor_charge(charged, torques, *angles)
    if "push_off" in scene.actions and "actuation" in scene.walker.supports:
        energies = energies + torch.where(struck, moved.result("push_work"), 0.0)
    distances, energies = (torch.where(going, x, 0.0) for x in (distances, energies))
    rewards = rules.reward(distances, energies, scene.energy_weight)
    durations = here.times + moved.result("time")
    if scene.command is not None:
        lost = rules.command_penalty(
            moved.result("step_length"), durations, here.commands, scene.command_weight
        )
        rewards = rewards - torch.where(struck, lost, 0.0)
    ends = here._replace(
        states=moved.states,
        phases=moved.phases,
        times=torch.where(struck, 0.0, durations.detach()),
        starts=torch.where(struck[:, None], moved.states[:, : here.starts.shape[1]], here.starts),
        progress=torch.where(struck, 0.0, here.progress + distances),
        strides=here.strides + struck,
        parameters=_swapped(scene, here.parameters, struck),
    )
    if ruled:
        zero = torch.zeros_like(left)
        step = _step(scene, here, ends, moved, held)._replace(
            distance=distances, energy=energies, fell=falls, reward=rewards,
            step_period=torch.where(struck, durations, 0.0), slope=here.slopes + tilts,
            push=zero if pushes is None else pushes, action=shares,
        )  # fmt: skip
        ends = ends._replace(last=step)
        if scene.reward is not None:
            (paid,) = applied(rule_of(scene.reward), step)
            rewards = torch.where(going, paid, 0.0)
        if scene.terminated is not None:
            (stops,) = applied(scene.terminated, step)
            outcomes = torch.where(going & ~falls & (stops != 0.0), STOPPED, outcomes)
    results = (rewards, distances, energies, seen, outcomes, going, moved.margins)
    over = going & rules.ends_episode(outcomes)
    return results, ends._replace(outcome=torch.where(over, outcomes, here.outcome))


def _step(
    scene: Scene,
    here: RolloutState,
    ends: RolloutState,
    moved: FlowResult,
    held: dict[str, Tensor],
) -> Transition:
    """Build the `Transition` for custom rewards and terminations.

    Not filled in here: distance, energy, fell, reward, step_period, slope, push and action.
    """
    hip, ankle = [[torch.zeros_like(here.times)] * 2 for _ in range(2)]
    for j, (of, name, work) in enumerate(
        zip((hip, ankle), scene.channels, _works(scene), strict=False)
    ):
        angles = moved.result("moved", j), moved.result("turned", j)
        of[:] = rules.work_of(held[name] * work, *angles)
    State = scene.walker.equations().State
    struck, last = moved.outcomes == _STRUCK, here.last
    _, rises, turns = _ground(scene, ends).T
    return last._replace(
        before=State(*here.states.T),
        state=State(*moved.states.T),
        knee_locked=_locked(scene, moved.phases),
        duration=moved.result("time"),
        time=last.time + moved.result("time"),
        hip_work=hip[0],
        hip_work_absolute=hip[1],
        ankle_work=ankle[0],
        ankle_work_absolute=ankle[1],
        push_off_work=torch.where(struck, moved.result("push_work"), 0.0),
        collision_loss=moved.result("knee_loss") + moved.result("heel_loss"),
        heelstrike=struck,
        step_length=torch.where(struck, moved.result("step_length"), 0.0),
        strides=ends.strides.double(),
        steps=last.steps + 1.0,
        height_change=rises,
        slope_change=turns,
        last_action=last.action,
    )


def _ruled(scene: Scene) -> bool:
    """Return whether a scene has functions of the user's own."""
    return any(getattr(scene, name) is not None for name in FUNCTIONS)


def _works(scene: Scene) -> NDArray[np.float64]:
    """Return the work of a unit of each control per unit of motion in m g l, (controls,)."""
    walker = scene.walker
    return np.divide(walker.equations().works, walker.weight / walker.units.force)


def _locked(scene: Scene, phases: Tensor) -> Tensor:
    """Return whether each swing leg is straight, (n,)."""
    return torch.tensor([phase.links == 2 for phase in scene.walker.equations().phases])[phases]
