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
from gym_passive_walker.envs.scene import Scene, by_hip_alone, make_scene, undisturbed
from gym_passive_walker.envs.vector_env import seed_randoms
from gym_passive_walker.physics.hybrid import Outcome
from gym_passive_walker.physics.systems import system_of
from gym_passive_walker.torch.operation import Manner, as_tensor, carry_on, check_parameters

_RUNNING, _STRUCK, _STALLED = map(int, (Outcome.RUNNING, Outcome.HEELSTRIKE, Outcome.STALLED))


class Standing(NamedTuple):
    """Where n walkers are in their episodes; dimensionless.

    Attributes:
        states: (n, 6).
        slopes: In rad, (n,).
        phases: Of their strides, (n,).
        times: Since their strides began, (n,).
        progress: How far the hip has come in the stride, (n,).
        parameters: Values of the walkers' parameters that are not the scene's, (n,) each.
        outcome: How the episode ended, an `Outcome`; RUNNING while it goes on.
    """

    states: Tensor
    slopes: Tensor
    phases: Tensor
    times: Tensor
    progress: Tensor
    parameters: dict[str, Tensor]
    outcome: Tensor

    @property
    def going(self) -> Tensor:
        """Whose episode goes on, (n,)."""
        return self.outcome == _RUNNING

    def detach(self) -> Standing:
        """The same without a past: gradients of what follows end here."""
        return self._replace(states=self.states.detach(), progress=self.progress.detach())


class Rollout(NamedTuple):
    """Walks of n walkers over at most T ticks.

    Attributes:
        returns: Sum of each walker's rewards, (n,), with its gradient.
        rewards: (T, n); 0 after an episode has ended.
        distances: How far the hip came in each tick, (T, n); a stride that falls takes back what
            it brought.
        energies: What the motor was charged for, (T, n).
        observations: What the policy saw, (T, n, 8).
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
    scene, count = (
        undisturbed(
            by_hip_alone(make_scene(scene), "walks on the tape are driven"), "walks on the tape go"
        ),
        whole(count, "count"),
    )
    batch = Batch(scene, count)
    seed_randoms(batch, seed, range(count))
    batch.start(np.arange(count), np.empty(count * task.SIZE, np.float32))
    values = {
        name: torch.tensor([getattr(walker, name) for walker in batch.walkers])
        for name in scene.randomise
    }
    values = {name: value.double() for name, value in values.items()}
    given = check_parameters(parameters)
    zeros = torch.zeros(count, dtype=torch.float64)
    return Standing(
        states=torch.from_numpy(batch.records["state"][:, 0].copy()),
        slopes=torch.from_numpy(batch.ledger["slope"].copy()),
        phases=torch.zeros(count, dtype=torch.int64),
        times=zeros,
        progress=zeros,
        parameters=values | {name: value.expand(count) for name, value in given.items()},
        outcome=torch.zeros(count, dtype=torch.int64),
    )


def rollout(
    policy: Callable[[Tensor], Tensor],
    scene: Scene | str | Mapping[str, Any],
    horizon: int,
    *,
    count: int = 16,
    seed: int | None = None,
    start: Standing | None = None,
) -> Rollout:
    """Let walkers walk under a policy; what they return has its exact gradient.

    Args:
        policy: Takes observations (n, 8), as of the environment but in float64, to actions (n,) or
            (n, 1), which are clipped to [-1, 1].
        scene: A scene, its name, or its arguments.
        horizon: Ticks.
        count: How many walkers.
        seed: As of `standing`.
        start: Where they are, instead: from `standing` or from an earlier rollout's end.

    Raises:
        TypeError: if actions are not of float64.
        ValueError: if the policy gives other than one action for each walker.
    """
    scene, horizon = make_scene(scene), whole(horizon, "horizon")
    here = standing(scene, count, seed=seed) if start is None else start
    ticks = []
    for _ in range(horizon):
        told, here = _tick(policy, scene, here)
        ticks.append(told)
    told = [torch.stack(columns) for columns in zip(*ticks, strict=True)]
    return Rollout._make([told[0].sum(0), *told, here])


def observed(scene: Scene, here: Standing) -> Tensor:
    """What the environment tells of walkers, (n, 8); see `envs.task.see`."""
    bounds = torch.from_numpy(task.BOUNDS)
    locked = [float(phase.links == 2) for phase in system_of(scene.walker).phases]
    seen = torch.tensor(locked, dtype=torch.float64)[here.phases]
    seen = torch.cat([here.states, seen[:, None], here.slopes[:, None]], 1)
    return torch.maximum(torch.minimum(seen, bounds), -bounds)


def _tick(
    policy: Callable[[Tensor], Tensor], scene: Scene, here: Standing
) -> tuple[tuple[Tensor, ...], Standing]:
    """One tick: reward, distance, energy, observation, outcome, going and margin; and the end."""
    seen, going = observed(scene, here), here.going
    actions = as_tensor(policy(seen), "the policy's action")
    if actions.shape not in ((len(seen),), (len(seen), 1)):
        raise ValueError(
            f"a policy gives one action for each of {len(seen)} walkers: shape ({len(seen)},) or "
            f"({len(seen)}, 1), not {tuple(actions.shape)}"
        )
    torques = scene.max_hip_torque * actions.reshape(-1).clamp(-1.0, 1.0)
    spans = torch.full_like(here.times, scene.tick if scene.control == "tick" else math.inf)
    left = scene.longest_stride - here.times
    none = [torch.zeros_like(torques)] * 4  # neither ankle nor push-off, nor steps in the ground
    columns = [here.slopes, torques, *none, torch.minimum(spans, left), *here.parameters.values()]
    parameters = tuple(here.parameters)
    manner = Manner(
        scene.walker, parameters, ("hip_torque", *parameters), (), scene.tolerance, scene.stub
    )
    inputs = torch.cat([here.states, torch.stack(columns, 1)], 1)
    moved = carry_on(inputs, here.phases, going, manner)
    struck = moved.outcomes == _STRUCK
    stalled = (moved.outcomes == _RUNNING) & (left <= spans)
    outcomes = torch.where(stalled & going, _STALLED, moved.outcomes)
    walks = outcomes <= _STRUCK
    # What was paid in advance for a stride that does not come is taken back.
    distances = torch.where(walks, moved.result("distance"), 0.0 - here.progress)
    energies = torch.zeros_like(distances)
    if system_of(scene.walker).works.hip:
        held = torch.where(walks, torques, torques.detach())
        charged = task.ENERGIES.index(scene.energy)
        energies = task.motor_charge(charged, held, moved.result("moved"), moved.result("turned"))
    distances, energies = (torch.where(going, x, 0.0) for x in (distances, energies))
    rewards = task.reward(distances, energies, scene.energy_weight)
    told = (rewards, distances, energies, seen, outcomes, going, moved.margins)
    return told, here._replace(
        states=moved.states,
        phases=moved.phases,
        times=torch.where(struck, 0.0, here.times + moved.result("time").detach()),
        progress=torch.where(struck, 0.0, here.progress + distances),
        outcome=torch.where(going & ~walks, outcomes, here.outcome),
    )
