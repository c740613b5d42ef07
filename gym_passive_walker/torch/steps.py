"""One control step of walkers within their episodes, as operations of torch.

The rules and the reward of a scene are those of the environment (see `envs.task`). What is drawn at
random, terrain, pushes, noise and bodies, is drawn by the same keys, so a step is that of the
environment, and a constant of its derivatives. All quantities are dimensionless.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from gym_passive_walker.envs import disturbance_kernels as kernels
from gym_passive_walker.envs.disturbances import settings_of
from gym_passive_walker.envs.transitions import STOPPED
from gym_passive_walker.gaits.flow import states_in
from gym_passive_walker.gaits.scenes import rules
from gym_passive_walker.gaits.scenes.rewards import FUNCTIONS, rule_of
from gym_passive_walker.gaits.scenes.scene import Scene, recorded_weight
from gym_passive_walker.gaits.scenes.transition import Transition
from gym_passive_walker.models.equations.hybrid import Outcome
from gym_passive_walker.models.equations.systems import UNEVEN
from gym_passive_walker.torch.counting import applied, each_tensor
from gym_passive_walker.torch.operation import (
    FlowOptions,
    FlowResult,
    array_of,
    carry_on,
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
        keys: Seeds of terrain, pushes and noise, 64 bits each, (n,).
        footholds: Changes from each foothold to the next beyond the terrain's, (k, n, 2); see
            `initial_state`.
        commands: Commanded speeds over sqrt(g l), (n,); 0 without a command.
        last: The last control step; zeros where an episode begins.
        steps: Number of control steps in the episode, (n,).
        due: Time of the next random push since the stride began, in sqrt(l/g), (n,); infinite
            without random pushes. It depends on when the strides before it ended.
        pushes: Number of random pushes in the episode, (n,).
        pending: Actions that have not acted yet, (n, largest delay, actions).
        delays: Number of control steps between an action and its effect, (n,).
        strengths: Effect of each action over its largest, (n, actions).
        parameters: Walker parameters that differ from the scene's, by name, (n,) each.
        outcome: Outcome of the episode, (n,): RUNNING until it ends, then an `Outcome` as a number,
            or the place of "stopped" in `interface.OUTCOMES`.
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
    steps: Tensor
    due: Tensor
    pushes: Tensor
    pending: Tensor
    delays: Tensor
    strengths: Tensor
    parameters: dict[str, Tensor]
    outcome: Tensor

    @property
    def going(self) -> Tensor:
        """Whether each episode is still running, (n,)."""
        return self.outcome == _RUNNING

    def detach(self) -> RolloutState:
        """Return a copy with its motion detached from the graph: gradients by earlier actions stop.

        `parameters` and `footholds` stay attached, and later walks have gradients by them. If they
        are computed from other tensors, PyTorch frees that graph in the first `backward`: give
        them computed again, `end.detach()._replace(parameters=...)`, or use `retain_graph=True`.
        """
        moving = ("states", "starts", "progress", "due", "pending")
        return self._replace(
            last=each_tensor(self.last, Tensor.detach),
            **{name: getattr(self, name).detach() for name in moving},
        )


def recorded_state(scene: Scene, arrays: Mapping[str, NDArray]) -> RolloutState:
    """Return the states of n walkers from arrays of a `Batch`, without parameters and `last`."""
    records, ledger = arrays["records"][:, 0], arrays["ledger"]
    count, actions = len(records), len(scene.actions)
    zeros, none = np.zeros(count), np.zeros(count, np.int64)
    undisturbed = {
        "slope": ledger["slope"], "key": none, "command": zeros, "due": np.full(count, np.inf),
        "pushes": none, "delay": none, "strength": np.ones((count, actions)),
    }  # fmt: skip
    each: Any = arrays.get("disturbances", undisturbed)
    over = (ledger["ending"] != 0) | (ledger["truncated"] != 0)
    here = {
        "states": states_in(records, scene.walker.coordinates),
        "slopes": each["slope"],
        "phases": records["phase"].astype(np.int64),
        "times": records["time"],
        "starts": records["start"][:, : len(columns_of(scene.walker).inputs["start"])],
        "progress": ledger["progress"],
        "strides": ledger["strides"],
        "keys": np.ascontiguousarray(each["key"]).view(np.int64),
        "footholds": np.zeros((0, count, 2)),
        "commands": each["command"],
        "steps": ledger["steps"],
        "due": each["due"],
        "pushes": each["pushes"],
        "pending": arrays.get("pending", np.zeros((count, 0, actions))),
        "delays": each["delay"],
        "strengths": each["strength"][:, :actions],
        "outcome": np.where(over, int(Outcome.STALLED), _RUNNING),
    }
    tensors = {name: torch.from_numpy(np.array(x)) for name, x in here.items()}
    last = Transition._make([torch.from_numpy(zeros)] * len(Transition._fields))
    return RolloutState(**tensors, last=last, parameters={})


class StepResult(NamedTuple):
    """Results of a control step of n walkers; see the fields of `Rollout`, each (n,)."""

    rewards: Tensor
    distances: Tensor
    energies: Tensor
    outcomes: Tensor
    margins: Tensor


def take_step(
    scene: Scene,
    here: RolloutState,
    actions: Tensor,
    impulses: Tensor | None = None,
    *,
    by_parameters: bool = True,
    violated: Tensor | None = None,
    penalty: Callable[..., Tensor] = rules.command_penalty,
) -> tuple[StepResult, RolloutState]:
    """Simulate one control step.

    Args:
        scene: The scene.
        here: States before the step.
        actions: Actions, (n, actions); they are clipped to their bounds.
        impulses: Impulses on the hip as the step begins, over m sqrt(g l), (n,); None for none.
        by_parameters: Whether to differentiate by the walkers' parameters.
        violated: Whether a constraint ends each episode with this step, (n,); None for none.
        penalty: Function of the commands' penalty.
    """
    going, channels, zeros = here.going, scene.channels, torch.zeros_like(here.times)
    least = torch.tensor([scene.least(name) for name in scene.actions], dtype=torch.float64)
    shares = rules.clip(actions, least, 1.0)
    acted, pending = _disturbed(scene, here, shares)
    acted = rules.clip(acted, least, 1.0)
    held = dict.fromkeys(channels, zeros)
    for name, share in zip(scene.actions, acted.T, strict=True):
        held[name] = scene.largest(name) * share
    tilts, rises, turns = footing_of(scene, here).T
    tick = scene.tick if scene.control == "tick" else math.inf
    until = rules.step_end(here.times, torch.full_like(here.times, tick), scene.max_stride_time)
    inputs_by = dict(zip(channels, columns_of(scene.walker).controls, strict=True))
    motors = tuple(inputs_by[name] for name in scene.actions)
    ruled = is_ruled(scene)
    start = ("start",) if ruled or scene.command is not None else ()  # for the step length
    parameters, given = tuple(here.parameters), len(here.footholds) > 0
    uneven = UNEVEN if given or scene.terrain is not None else ()
    by = (*motors, *start, *(("slope", *UNEVEN) if given else ()))
    using = (*(motor for motor in motors if motor != "hip_torque"), *uneven, *start)
    options = FlowOptions(
        scene.walker, parameters, by + (parameters if by_parameters else ()), using,
        scene.tolerance, bool(scene.end_on_toe_stub),
    )  # fmt: skip
    grounded = [here.slopes + tilts, *held.values(), rises, turns]
    moved, met = _walked(scene, here, grounded, until, impulses, options)
    lands = moved.outcomes == _STRUCK
    outcomes = rules.outcome_of(moved.outcomes, until, scene.max_stride_time).long()
    outcomes = torch.where(going, outcomes, moved.outcomes)
    struck = lands
    if violated is not None:
        outcomes = torch.where(violated & going, STOPPED, outcomes)
        struck = lands & ~violated  # the episode ends, and not a stride
    falls = rules.ends_episode(outcomes)
    distances = rules.distance_of(falls, moved.distance, here.progress)
    energies = torch.zeros_like(distances)
    charged, works = rules.ENERGIES.index(scene.energy), _works(scene)
    for j, (name, work) in enumerate(zip(channels, works, strict=False)):
        if name in scene.actions and work:
            torques = torch.where(falls, held[name].detach(), held[name]) * work
            energies = energies + rules.motor_charge(charged, torques, *moved.moved(j))
    if "push_off" in scene.actions and "actuation" in scene.walker.supports:
        energies = energies + torch.where(lands, moved.result("push_work"), 0.0)
    distances, energies = (torch.where(going, x, 0.0) for x in (distances, energies))
    rewards = rules.reward(distances, energies, scene.energy_weight)
    durations = here.times + moved.result("time")
    if scene.command is not None:
        lost = penalty(moved.result("step_length"), durations, here.commands, scene.command_weight)
        rewards = rewards - torch.where(struck, lost, 0.0)
    ends = here._replace(
        states=moved.states,
        phases=moved.phases,
        times=torch.where(struck, 0.0, durations.detach()),
        starts=torch.where(struck[:, None], moved.states[:, : here.starts.shape[1]], here.starts),
        progress=torch.where(struck, 0.0, here.progress + distances),
        strides=here.strides + struck,
        parameters=exchanged(scene, here.parameters, lands),
        steps=here.steps + going,
        due=torch.where(struck, met.due - durations, met.due),
        pushes=met.pushes,
        pending=pending,
    )
    endings = outcomes
    if ruled:
        step = _transition(scene, here, ends, moved, held)._replace(
            distance=distances, energy=energies, fell=falls, reward=rewards,
            step_period=torch.where(struck, durations, 0.0), push=met.impulse,
            action=tuple(shares.T),
        )  # fmt: skip
        ends = ends._replace(last=step)
        if scene.reward is not None:
            (paid,) = applied(rule_of(scene.reward), step)
            rewards = torch.where(going, paid, 0.0)
        if scene.terminated is not None:
            (stops,) = applied(scene.terminated, step)
            endings = torch.where(going & ~falls & (stops != 0.0), STOPPED, outcomes)
            outcomes = torch.where(outcomes == _RUNNING, endings, outcomes)  # strides end as well
    over = going & rules.ends_episode(endings)
    ends = ends._replace(outcome=torch.where(over, endings, here.outcome))
    return StepResult(rewards, distances, energies, outcomes, moved.margins), ends


class _Pushes(NamedTuple):
    """Pushes of n walkers after a step: fields of `RolloutState`, and the sum in the step, (n,)."""

    due: Tensor
    pushes: Tensor
    impulse: Tensor


def _walked(
    scene: Scene,
    here: RolloutState,
    grounded: list[Tensor],
    until: Tensor,
    impulses: Tensor | None,
    options: FlowOptions,
) -> tuple[FlowResult, _Pushes]:
    """Integrate walkers to a time of their strides, (n,), with all pushes on the way.

    `grounded` has the slope, the controls, and the changes to the next foothold, (n,) each; the
    `options` are without pushes, and the `impulses` those with which the step begins.
    """
    zeros = torch.zeros_like(until)
    push, met = zeros if impulses is None else impulses, _Pushes(here.due, here.pushes, zeros)
    met = met._replace(impulse=push)
    states, phases, now, on = here.states, here.phases, here.times, here.going
    total, pushed, timed = None, impulses is not None, False
    while True:
        end = until
        if scene.pushes:
            before = met.impulse
            met = _taken(scene, here.keys, met, on & (met.due <= now + kernels.INSTANT), now)
            push = push + (met.impulse - before)
            pushed = pushed or bool(push.any())
            end = torch.where(met.due < until - kernels.INSTANT, met.due, until)
            timed = timed or bool((on & (end < until)).any())
        columns = [*grounded, push, *here.starts.T, end - now, *here.parameters.values()]
        moved = carry_on(
            torch.cat([states, torch.stack(columns, 1)], 1), phases, on,
            replace(
                options,
                by=options.by + ("push",) * pushed + ("end",) * timed,
                using=options.using + ("push",) * pushed,
            ),
        )  # fmt: skip
        total = moved if total is None else _joined(total, moved, on)
        if not scene.pushes:
            return total, met
        on = on & (total.outcomes == _RUNNING) & (end < until)
        if not on.any():
            return total, met
        states, phases, now, push, pushed = total.states, total.phases, end, zeros, True


def _taken(scene: Scene, keys: Tensor, met: _Pushes, ready: Tensor, now: Tensor) -> _Pushes:
    """Return pushes after those that are due at a time, (n,), of the walkers that are ready."""
    settings = settings_of(scene).view(np.recarray)[0]
    waits, impulses = np.zeros((2, len(ready)))
    counts, due, ends = array_of(met.pushes).copy(), array_of(met.due), array_of(now)
    for i in np.flatnonzero(array_of(ready)):
        walker = SimpleNamespace(key=int(keys[i]) % 2**64, pushes=int(counts[i]))
        while due[i] + waits[i] <= ends[i] + kernels.INSTANT:
            impulses[i] += kernels.drawn_impulse(walker, settings)
            walker.pushes += 1
            waits[i] += kernels.time_to_push(walker, settings)
        counts[i] = walker.pushes
    return _Pushes(
        met.due + torch.from_numpy(waits), torch.from_numpy(counts),
        met.impulse + torch.from_numpy(impulses),
    )  # fmt: skip


def _joined(first: FlowResult, then: FlowResult, on: Tensor) -> FlowResult:
    """Return results of two parts of a motion, of which some walkers made the second, (n,)."""
    report = first.columns.report
    sums = (first.values + then.values)[:, report.size :]  # 0 before a stride has ended, or so far
    values = torch.cat([then.states, sums], 1)
    values = torch.where((then.outcomes > _STRUCK)[:, None], values.detach(), values)
    return first._replace(
        values=torch.where(on[:, None], values, first.values),
        phases=torch.where(on, then.phases, first.phases),
        outcomes=torch.where(on, then.outcomes, first.outcomes),
        margins=torch.minimum(first.margins, then.margins),
    )


def _disturbed(scene: Scene, here: RolloutState, actions: Tensor) -> tuple[Tensor, Tensor]:
    """Return the actions that act in a step, with delay and noise, and those that are pending."""
    pending, acted = here.pending, actions
    if pending.shape[1]:
        lanes, place = torch.arange(len(actions)), here.steps % here.delays.clamp(min=1)
        late = (here.delays > 0)[:, None]
        acted, pending = torch.where(late, pending[lanes, place], actions), pending.clone()
        pending[lanes, place] = actions
    if scene.action_noise > 0.0:
        count = len(scene.actions)
        noise = drawn(kernels.action_draw, here, count, range(count))
        acted = acted + scene.action_noise * noise
    return rules.clip(acted, -1.0, 1.0) * here.strengths, pending


def drawn(
    draw: Callable[..., float], here: RolloutState, size: int, entries: Sequence[int]
) -> Tensor:
    """Return random numbers of the present steps of n walkers, (n, entries).

    Args:
        draw: `observation_draw` or `action_draw` of `disturbance_kernels`.
        here: States of the walkers.
        size: Number of entries in all.
        entries: Indices of those that have noise.
    """
    pairs = zip(array_of(here.keys).view(np.uint64).tolist(), here.steps.tolist(), strict=True)
    rows = [[draw(key, step, size, k) for k in entries] for key, step in pairs]
    return torch.tensor(rows, dtype=torch.float64).reshape(len(rows), len(entries))


def footing_of(scene: Scene, here: RolloutState, ahead: int = 0) -> Tensor:
    """Return ground data of the footholds that lie `ahead` strides in front.

    Footholds are numbered: they do not depend on where the feet of earlier strides came down.

    Returns:
        Slope in rad, height change in leg lengths and slope change in rad to the next, (n, 3).
    """
    count, places = len(here.footholds), here.strides + ahead
    if scene.terrain is None:
        ground = torch.zeros((len(here.slopes), 3), dtype=torch.float64)
    else:
        keys = array_of(here.keys).view(np.uint64)
        ground = torch.from_numpy(scene.terrain.ground(keys, array_of(places)))
    if count == 0:
        return ground
    level = torch.zeros_like(here.footholds[:1])
    changes, lanes = torch.cat([here.footholds, level]), torch.arange(len(places))
    slopes = torch.cat([level, here.footholds])[:, :, 1].cumsum(0)
    places = places.clamp(max=count)  # the last is level
    return ground + torch.cat([slopes[places, lanes, None], changes[places, lanes]], 1)


def exchanged_names(scene: Scene) -> list[str]:
    """Names of the parameters that legs exchange at heelstrikes."""
    return [scene.walker.body._fields[place] for place in scene.walker.exchanged_places]


def exchanged(scene: Scene, parameters: dict[str, Tensor], where: Tensor) -> dict[str, Tensor]:
    """Return parameters with the legs exchanged for some walkers, (n,)."""
    other = {name: parameters[scene.walker.counterpart(name)] for name in exchanged_names(scene)}
    return parameters | {
        name: torch.where(where, value, parameters[name]) for name, value in other.items()
    }


def _transition(
    scene: Scene,
    here: RolloutState,
    ends: RolloutState,
    moved: FlowResult,
    held: dict[str, Tensor],
) -> Transition:
    """Build the `Transition` for custom rewards and terminations.

    Not filled in here: distance, energy, fell, reward, step_period, push and action.
    """
    hip, ankle = [[torch.zeros_like(here.times)] * 2 for _ in range(2)]
    for j, (of, name, work) in enumerate(
        zip((hip, ankle), scene.channels, _works(scene), strict=False)
    ):
        of[:] = rules.work_of(held[name] * work, *moved.moved(j))
    State = scene.walker.equations().State
    struck, last = ends.strides > here.strides, here.last
    tilts, rises, turns = footing_of(scene, ends).T
    lost = moved.result("knee_loss") + torch.where(struck, moved.result("heel_loss"), 0.0)
    return last._replace(
        before=State(*here.states.T),
        state=State(*moved.states.T),
        knee_locked=is_locked(scene, moved.phases),
        duration=moved.result("time"),
        time=last.time + moved.result("time"),
        hip_work=hip[0],
        hip_work_absolute=hip[1],
        ankle_work=ankle[0],
        ankle_work_absolute=ankle[1],
        push_off_work=torch.where(struck, moved.result("push_work"), 0.0),
        collision_loss=lost / recorded_weight(scene.walker),
        heelstrike=struck,
        step_length=torch.where(struck, moved.result("step_length"), 0.0),
        strides=ends.strides.double(),
        steps=last.steps + 1.0,
        slope=here.slopes + tilts,
        height_change=rises,
        slope_change=turns,
        last_action=last.action,
    )


def is_ruled(scene: Scene) -> bool:
    """Return whether a scene has functions of the user's own."""
    return any(getattr(scene, name) is not None for name in FUNCTIONS)


def _works(scene: Scene) -> NDArray[np.float64]:
    """Return the work of a unit of each control per unit of motion in m g l, (controls,)."""
    return np.divide(scene.walker.equations().works, recorded_weight(scene.walker))


def is_locked(scene: Scene, phases: Tensor) -> Tensor:
    """Return whether each swing leg is straight, (n,)."""
    return torch.tensor([phase.knee_locked for phase in scene.walker.equations().phases])[phases]
