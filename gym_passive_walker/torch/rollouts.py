"""Whole walks under a policy, many side by side, with the gradient of what they return.

The scene's rules are the environment's, and so are the equations of its reward (see `envs.task`);
everything is dimensionless.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

from gym_passive_walker.arguments import whole
from gym_passive_walker.envs import task
from gym_passive_walker.envs.batch import Batch
from gym_passive_walker.envs.custom import RULES, rule_of
from gym_passive_walker.envs.scene import CHANNELS, Scene, make_scene, undisturbed
from gym_passive_walker.envs.transitions import STOPPED, Transition
from gym_passive_walker.envs.vector_env import seed_randoms
from gym_passive_walker.gaits.actuation import Actuation
from gym_passive_walker.physics.hybrid import Outcome, State
from gym_passive_walker.physics.systems import UNEVEN, system_of
from gym_passive_walker.torch.operation import Manner, Moved, as_tensor, carry_on, check_parameters

_INPUT: dict[str, str] = dict(zip(CHANNELS, Actuation._fields, strict=True))
_RUNNING, _STRUCK, _STALLED = map(int, (Outcome.RUNNING, Outcome.HEELSTRIKE, Outcome.STALLED))


class Standing(NamedTuple):
    """Where n walkers are in their episodes; dimensionless.

    Attributes:
        states: (n, 6).
        slopes: In rad, (n,); footholds of a terrain slope that much more or less.
        phases: Of their strides, (n,).
        times: Since their strides began, (n,).
        starts: Stance angles with which their strides began, (n,).
        progress: How far the hip has come in the stride, (n,).
        strides: That have ended in the episode, (n,).
        keys: Of what is drawn for the walk: footholds, (n,).
        commands: Speeds over sqrt(g l) that are commanded, (n,); 0 where none is.
        last: What their last step has come to; zeros where an episode begins.
        parameters: Values of the walkers' parameters that are not the scene's, (n,) each.
        outcome: How the episode ended, an `Outcome`; RUNNING while it goes on.
    """

    states: Tensor
    slopes: Tensor
    phases: Tensor
    times: Tensor
    starts: Tensor
    progress: Tensor
    strides: Tensor
    keys: Tensor
    commands: Tensor
    last: Transition
    parameters: dict[str, Tensor]
    outcome: Tensor

    @property
    def going(self) -> Tensor:
        """Whose episode goes on, (n,)."""
        return self.outcome == _RUNNING

    def detach(self) -> Standing:
        """The same without a past: gradients of what follows end here."""
        return self._replace(
            states=self.states.detach(),
            starts=self.starts.detach(),
            progress=self.progress.detach(),
            last=_detached(self.last),
        )


def _detached(part: Any) -> Any:
    """Tensors without a past, however they are nested."""
    if isinstance(part, Tensor):
        return part.detach()
    parts = map(_detached, part)
    return type(part)._make(parts) if hasattr(part, "_make") else tuple(parts)


class Rollout(NamedTuple):
    """Walks of n walkers over at most T ticks.

    Attributes:
        returns: Sum of each walker's rewards, (n,), with its gradient.
        rewards: (T, n); 0 after an episode has ended.
        distances: How far the hip came in each tick, (T, n); a stride that falls takes back what
            it brought.
        energies: What motors were charged for, (T, n).
        observations: What the policy saw, (T, n, 8) or more, as in the environment.
        outcomes: How each tick ended, an `Outcome`, (T, n).
        going: Whose episode went on when each tick began, (T, n).
        margins: How fast strikes in it fell through zero, (T, n); see `Tick`.
        end: Where walkers are now: to go on from.
    """

    returns: Tensor
    rewards: Tensor
    distances: Tensor
    energies: Tensor
    observations: Tensor
    outcomes: Tensor
    going: Tensor
    margins: Tensor
    end: Standing


def standing(
    scene: Scene | str | Mapping[str, Any],
    count: int = 16,
    *,
    seed: int | None = None,
    parameters: Mapping[str, Any] | None = None,
) -> Standing:
    """Walkers where episodes of a scene begin, as a vector environment with this seed draws them.

    Args:
        scene: A scene, its name, or its arguments.
        count: How many walkers.
        seed: Of the first walker; the others' follow.
        parameters: Values of parameters of the walker in place of the scene's, numbers or (count,).
    """
    scene, count = _differentiable(make_scene(scene)), whole(count, "count")
    batch = Batch(scene, count)
    seed_randoms(batch, seed, range(count))
    batch.start(np.arange(count), np.empty(count * batch.seen, np.float32))
    slopes, keys, commands = batch.ledger["slope"], np.zeros(count, np.uint64), np.zeros(count)
    if batch.disturbances:
        fates = batch.disturbances.fates
        slopes, keys, commands = fates["slope"], fates["key"], fates["command"]
    values = {
        name: torch.tensor([getattr(walker, name) for walker in batch.walkers])
        for name in scene.domain_randomization
    }
    values = {name: value.double() for name, value in values.items()}
    given = check_parameters(parameters)
    zeros = torch.zeros(count, dtype=torch.float64)
    states = torch.from_numpy(batch.records["state"][:, 0].copy())
    here = Standing(
        states=states,
        slopes=torch.from_numpy(slopes.copy()),
        phases=torch.zeros(count, dtype=torch.int64),
        times=zeros,
        starts=states[:, 0],
        progress=zeros,
        strides=torch.zeros(count, dtype=torch.int64),
        keys=torch.from_numpy(keys.view(np.int64).copy()),
        commands=torch.from_numpy(commands.copy()),
        last=Transition._make([zeros] * len(Transition._fields)),
        parameters=values | {name: value.expand(count) for name, value in given.items()},
        outcome=torch.zeros(count, dtype=torch.int64),
    )
    none, never = (zeros,) * len(scene.actions), torch.zeros(count, dtype=torch.bool)
    tilts, rises, turns = _ground(scene, here).T
    at = State(*states.T)
    last = here.last._replace(
        before=at, state=at, knee_locked=never, heelstrike=never, fell=never, action=none,
        last_action=none, slope=here.slopes + tilts, height_change=rises, slope_change=turns,
        command=here.commands,
    )  # fmt: skip
    return here._replace(last=last)


def _differentiable(scene: Scene) -> Scene:
    """A scene on whose ground walks have gradients: footholds and commands may differ.

    Raises:
        SceneError: if there is noise, delay, or what else is not known beforehand.
    """
    known = {"terrain": None, "terrain_lookahead": 0, "command": None}
    undisturbed(make_scene(scene, **known), "walks with gradients go")
    return scene


def rollout(
    policy: Callable[[Tensor], Tensor],
    scene: Scene | str | Mapping[str, Any],
    horizon: int,
    *,
    count: int = 16,
    seed: int | None = None,
    start: Standing | None = None,
    pushes: Any = None,
) -> Rollout:
    """Let walkers walk under a policy; what they return has its exact gradient.

    Args:
        policy: Takes observations (n, 8) or more, as of the environment but in float64, to actions
            (n, actions), or (n,) where there is one, which are clipped to their bounds.
        scene: A scene, its name, or its arguments; without noise, delay and random pushes.
        horizon: Control steps.
        count: How many walkers.
        seed: As of `standing`.
        start: Where they are, instead: from `standing` or from an earlier rollout's end.
        pushes: Impulses on the hip along the slope as each control step begins, over m sqrt(g l),
            positive downhill; a number, (horizon, 1) or (horizon, n). None when None.

    Raises:
        TypeError: if actions are not of float64.
        ValueError: if the policy gives other than an action for each motor of each walker.
    """
    scene, horizon = _differentiable(make_scene(scene)), whole(horizon, "horizon")
    here = standing(scene, count, seed=seed) if start is None else start
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
        told, here = _tick(policy, scene, here, None if impulses is None else impulses[k])
        ticks.append(told)
    told = [torch.stack(columns) for columns in zip(*ticks, strict=True)]
    return Rollout._make([told[0].sum(0), *told, here])


def _ground(scene: Scene, here: Standing, ahead: int = 0) -> Tensor:
    """Slope, rise to the next and turn of footholds so many ahead of walkers' own, (n, 3)."""
    if scene.terrain is None:
        return torch.zeros((len(here.slopes), 3), dtype=torch.float64)
    keys = here.keys.numpy().view(np.uint64)
    return torch.from_numpy(scene.terrain.ground(keys, here.strides.numpy() + ahead))


def observed(scene: Scene, here: Standing) -> Tensor:
    """What the environment tells of walkers, (n, 8) or more; see `envs.task.see`."""
    if scene.observation is not None:
        seen = scene.observation(here.last)
        columns = seen if isinstance(seen, tuple | list) else [seen]
        return torch.stack([torch.zeros_like(here.times) + column for column in columns], 1)
    bounds = torch.from_numpy(task.BOUNDS)
    seen = _locked(scene, here.phases).double()
    slopes = here.slopes + _ground(scene, here)[:, 0]
    seen = torch.cat([here.states, seen[:, None], slopes[:, None]], 1)
    parts = [torch.maximum(torch.minimum(seen, bounds), -bounds)]
    if scene.command is not None:
        parts.append(here.commands[:, None])
    most = torch.tensor([task.HIGHEST, task.STEEPEST], dtype=torch.float64)
    for ahead in range(scene.terrain_lookahead):
        parts.append(torch.clamp(_ground(scene, here, ahead)[:, 1:], -most, most))
    return torch.cat(parts, 1)


def _tick(
    policy: Callable[[Tensor], Tensor], scene: Scene, here: Standing, pushes: Tensor | None
) -> tuple[tuple[Tensor, ...], Standing]:
    """One control step: what `Rollout` tells of it, in the order there; and where it ends."""
    seen, going = observed(scene, here), here.going
    actions, wanted = (
        as_tensor(policy(seen), "the policy's action"),
        (len(seen), len(scene.actions)),
    )
    if actions.shape != wanted and (actions.shape != wanted[:1] or wanted[1] > 1):
        raise ValueError(
            f"a policy gives one action for each of {wanted[0]} walkers and each of its motors "
            f"({', '.join(scene.actions)}): shape {wanted}, not {tuple(actions.shape)}"
        )
    held: dict[str, Tensor] = {name: torch.zeros_like(here.times) for name in CHANNELS}
    for name, share in zip(scene.actions, actions.reshape(wanted).T, strict=True):
        held[name] = scene.largest(name) * share.clamp(-1.0 * (name != "push_off"), 1.0)
    spans = torch.full_like(here.times, scene.tick if scene.control == "tick" else math.inf)
    left, (tilts, rises, turns) = scene.max_stride_time - here.times, _ground(scene, here).T
    columns = [
        here.slopes + tilts, *held.values(), rises, turns,
        torch.zeros_like(left) if pushes is None else pushes, here.starts,
        torch.minimum(spans, left), *here.parameters.values(),
    ]  # fmt: skip
    motors = tuple(_INPUT[name] for name in scene.actions)
    other = () if pushes is None else ("push",)
    ruled = any(getattr(scene, name) is not None for name in RULES)
    other += ("start",) if ruled or scene.command is not None else ()  # the step's length is needed
    parameters, uneven = tuple(here.parameters), () if scene.terrain is None else UNEVEN
    using = (*(motor for motor in motors if motor != "hip_torque"), *uneven, *other)
    manner = Manner(
        scene.walker, parameters, (*motors, *other, *parameters), using, scene.tolerance,
        bool(scene.end_on_toe_stub),
    )  # fmt: skip
    inputs = torch.cat([here.states, torch.stack(columns, 1)], 1)
    moved = carry_on(inputs, here.phases, going, manner)
    struck = moved.outcomes == _STRUCK
    stalled = (moved.outcomes == _RUNNING) & (left <= spans)
    outcomes = torch.where(stalled & going, _STALLED, moved.outcomes)
    walks = outcomes <= _STRUCK
    # What was paid in advance for a stride that does not come is taken back.
    distances = torch.where(walks, moved.result("distance"), 0.0 - here.progress)
    energies = torch.zeros_like(distances)
    charged, works = task.ENERGIES.index(scene.energy), system_of(scene.walker).works
    for name, work, of in zip(CHANNELS, works, ("", "ankle_"), strict=False):
        if name in scene.actions and work:
            torques = torch.where(walks, held[name], held[name].detach())
            angles = moved.result(f"{of}moved"), moved.result(f"{of}turned")
            energies = energies + task.motor_charge(charged, torques, *angles)
    if "push_off" in scene.actions:
        energies = energies + torch.where(struck, moved.result("push_work"), 0.0)
    distances, energies = (torch.where(going, x, 0.0) for x in (distances, energies))
    rewards = task.reward(distances, energies, scene.energy_weight)
    durations = here.times + moved.result("time")
    if scene.command is not None:
        length = moved.result("step_length")
        missed = scene.command_weight * (length - here.commands * durations).abs()
        rewards = rewards - torch.where(struck, torch.minimum(missed, length), 0.0)
    ends = here._replace(
        states=moved.states,
        phases=moved.phases,
        times=torch.where(struck, 0.0, durations.detach()),
        starts=torch.where(struck, moved.states[:, 0], here.starts),
        progress=torch.where(struck, 0.0, here.progress + distances),
        strides=here.strides + struck,
    )
    if ruled:
        zero = torch.zeros_like(left)
        step = _step(scene, here, ends, moved, held, zero if pushes is None else pushes)._replace(
            distance=distances, energy=energies, fell=~walks, reward=rewards,
            step_period=torch.where(struck, durations, 0.0), slope=here.slopes + tilts,
        )  # fmt: skip
        ends = ends._replace(last=step)
        if scene.reward is not None:
            rewards = torch.where(going, zero + rule_of(scene.reward)(step), 0.0)
        if scene.terminated is not None:
            stops = torch.as_tensor(scene.terminated(step)).bool()
            outcomes = torch.where(going & walks & stops, STOPPED, outcomes)
    told = (rewards, distances, energies, seen, outcomes, going, moved.margins)
    over = going & (outcomes > _STRUCK)
    return told, ends._replace(outcome=torch.where(over, outcomes, here.outcome))


def _step(
    scene: Scene,
    here: Standing,
    ends: Standing,
    moved: Moved,
    held: dict[str, Tensor],
    push: Tensor,
) -> Transition:
    """What functions of one's own are told of a step, but for what the reward has worked out."""
    works = system_of(scene.walker).works
    hip, ankle = (
        [
            task.motor_charge(
                task.ENERGIES.index(kind), held[name] * work, moved.result(f"{of}moved"),
                moved.result(f"{of}turned"),
            )
            for kind in ("net", "absolute")
        ]
        for name, work, of in (("hip", works.hip, ""), ("ankle", works.ankle, "ankle_"))
    )  # fmt: skip
    struck, last = moved.outcomes == _STRUCK, here.last
    _, rises, turns = _ground(scene, ends).T
    largest = {name: scene.largest(name) or 1.0 for name in scene.actions}
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
        push=push,
        action=tuple(held[name] / largest[name] for name in scene.actions),
        last_action=last.action,
    )


def _locked(scene: Scene, phases: Tensor) -> Tensor:
    """Whose swing leg is straight, (n,)."""
    return torch.tensor([phase.links == 2 for phase in system_of(scene.walker).phases])[phases]
