"""Batched episodes under a policy, with the gradient of the return.

The rules and the reward of a scene are those of the environment (see `envs.task`). All quantities
are dimensionless.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

from gym_passive_walker._tools.arguments import shown, whole
from gym_passive_walker.envs import disturbance_kernels as kernels
from gym_passive_walker.envs.batch import Batch
from gym_passive_walker.envs.disturbances import settings_of
from gym_passive_walker.envs.vector_env import seed_randoms
from gym_passive_walker.gaits.scenes import rules
from gym_passive_walker.gaits.scenes.scene import (
    Scene,
    SceneError,
    SceneLike,
    make_scene,
    seen_by_policy,
)
from gym_passive_walker.models.model import check_heights_only
from gym_passive_walker.models.units import observed_numbers
from gym_passive_walker.torch.counting import applied, check_alone
from gym_passive_walker.torch.operation import array_of, as_tensor, check_parameters, check_phases
from gym_passive_walker.torch.steps import (
    RolloutState,
    drawn,
    exchanged,
    exchanged_names,
    footing_of,
    is_locked,
    is_ruled,
    recorded_state,
    take_step,
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
        outcomes: Outcome of each control step, (T, n): an `Outcome` as a number, or where the
            scene's own `terminated` ends an episode within a stride, the place of "stopped" in
            `interface.OUTCOMES`.
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
        SceneError: if feasibility constraints end episodes of the scene.
        ValueError: if `footholds` or parameters have another shape, or `footholds` have slopes that
            a `System` does not support.
        WalkerError: if a walker has no such parameter.
    """
    scene, count = _differentiable(scene), whole(count, "count")
    batch = Batch(scene, count)
    seed_randoms(batch, seed, range(count))
    batch.start(np.arange(count), np.empty(count * batch.observation_size, np.float32))
    parameters_of = [walker.parameters for walker in batch.walkers]
    values = {
        name: torch.tensor([each[name] for each in parameters_of], dtype=torch.float64)
        for name in dict.fromkeys((*scene.randomized, *exchanged_names(scene)))
        if name in parameters_of[0]
    }
    given = check_parameters(scene.walker, parameters)
    for name, value in given.items():
        if value.shape not in ((), (count,)):
            raise ValueError(f"{name} must be a number or ({count},), not {tuple(value.shape)}")
    changes = as_tensor(np.zeros((0, 2)) if footholds is None else footholds, "footholds")
    if changes.ndim == 2:
        changes = changes[:, None]
    if changes.ndim != 3 or changes.shape[1] not in (1, count) or changes.shape[2] != 2:
        raise ValueError(
            f"footholds must have shape (k, 2) or (k, {count}, 2), not {tuple(changes.shape)}"
        )
    check_heights_only(scene.walker, array_of(changes[:, :, 1]))
    here = recorded_state(scene, batch.arrays)._replace(
        footholds=changes.expand(-1, count, -1),
        parameters=values | {name: value.expand(count) for name, value in given.items()},
    )
    zeros = torch.zeros(count, dtype=torch.float64)
    still, never = (zeros,) * len(scene.actions), torch.zeros(count, dtype=torch.bool)
    tilts, rises, turns = footing_of(scene, here).T
    at = scene.walker.equations().State(*here.states.T)
    last = here.last._replace(
        before=at, state=at, knee_locked=is_locked(scene, here.phases), heelstrike=never,
        fell=never, action=still, last_action=still, slope=here.slopes + tilts,
        height_change=rises, slope_change=turns, command=here.commands,
    )  # fmt: skip
    return here._replace(last=last)


def _differentiable(given: SceneLike) -> Scene:
    """Return a scene after a check that no feasibility constraint ends its episodes."""
    scene = make_scene(given)
    ending = [name for name, what in scene.constraints.items() if what == "end"]
    if ending:
        raise SceneError(
            f"rollouts check no constraints, and {' and '.join(ending)} end episodes of this "
            'scene: choose make_scene(scene, constraints={}), or "report" for each'
        )
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

    Terrain, bodies, noise and random pushes are those of a vector environment with this seed. They
    are constants: gradients are those of the walks with these draws.

    Args:
        policy: Maps observations (n, k), those of the environment in float64, to actions
            (n, actions), or (n,) for a single action. Actions are clipped to their bounds.
        scene: A scene, its name, or its arguments.
        horizon: Number of control steps.
        count: Number of walkers.
        seed: Seed of the first walker; the others use seed + 1, seed + 2, ...
        start: From `initial_state`, or the `end` of a rollout; replaces count and seed.
        pushes: Impulses on the hip along the slope as each control step begins, over m sqrt(g l),
            positive downhill; a number, (horizon, 1) or (horizon, n). They add to the scene's
            random pushes. None applies none.

    Raises:
        TypeError: if the actions are not float64 tensors on the CPU.
        ValueError: if the actions or `pushes` have another shape, or `start` is of a scene with
            other states, phases, actions or delays.
        SceneError: if feasibility constraints end episodes of the scene, or a function of its own
            mixes walkers.
    """
    if not callable(policy):
        raise ValueError(
            "rollout needs a function or a module from tensors of observations to tensors of "
            f"actions, not {shown(policy)}: robustness and gauntlet take other controllers"
        )
    scene, horizon = _differentiable(scene), whole(horizon, "horizon")
    here = initial_state(scene, count, seed=seed) if start is None else _checked(scene, start)
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
        seen, going = _observed(scene, here), here.going
        actions = _actions(policy, scene, seen)
        found, here = take_step(scene, here, actions, None if impulses is None else impulses[k])
        ticks.append((*found[:3], seen, found.outcomes, going, found.margins))
        if k == 0 and is_ruled(scene):
            check_alone(scene, here.last)
    results = [torch.stack(columns) for columns in zip(*ticks, strict=True)]
    return Rollout._make([results[0].sum(0), *results, here])


def _checked(scene: Scene, start: RolloutState) -> RolloutState:
    """Return states after a check that their arrays have the sizes of a scene's."""
    actions = len(scene.actions)
    wanted = {
        "states": (scene.walker.size,), "strengths": (actions,),
        "pending": (int(scene.ends("action_delay")[1]), actions),
    }  # fmt: skip
    for name, shape in wanted.items():
        found = tuple(getattr(start, name).shape[1:])
        if found != shape:
            raise ValueError(
                f"start is of another scene: its {name} have shape {('n', *found)}, and those of "
                f"this scene {('n', *shape)}; begin with initial_state of this scene"
            )
    check_phases(scene.walker, array_of(start.phases))
    return start


def _observed(scene: Scene, here: RolloutState) -> Tensor:
    """Return the observations of the environment in float64, (n, k)."""
    if callable(scene.observation):
        return _stacked(applied(scene.observation, here.last), here)
    slopes = here.slopes + footing_of(scene, here)[:, 0]
    locked = is_locked(scene, here.phases).double()
    ahead = [footing_of(scene, here, place).T[1:] for place in range(scene.terrain_lookahead)]
    first = exchanged(scene, here.parameters, here.strides % 2 == 1)  # of the first stride
    body = observed_numbers(scene.walker, scene.observe_body, first)
    seen = rules.observed(scene, here.states.T, locked, slopes, here.commands, ahead, body)
    return _stacked(_noisy(scene, here, seen), here)


def _noisy(scene: Scene, here: RolloutState, seen: list[Any]) -> list[Any]:
    """Return the entries of an observation, (n,) each, with their noise."""
    size = len(scene.walker.observed)
    deviations = settings_of(scene)["noise"][0, :size]
    noisy = np.flatnonzero(deviations).tolist()
    if not noisy:
        return seen
    lowest, highest = rules.bounds_of(scene.walker)
    draws = drawn(kernels.observation_draw, here, size, noisy).T
    for k, draw in zip(noisy, draws, strict=True):
        seen[k] = rules.clip(seen[k] + float(deviations[k]) * draw, lowest[k], highest[k])
    return seen


def _stacked(columns: Sequence[Any], here: RolloutState) -> Tensor:
    """Return columns (n,) or numbers as one tensor (n, columns)."""
    return torch.stack([torch.zeros_like(here.times) + column for column in columns], 1)


def _actions(policy: Callable[[Tensor], Tensor], scene: Scene, seen: Tensor) -> Tensor:
    """Return a policy's actions, (n, actions)."""
    actions = as_tensor(policy(seen), "the policy's action")
    wanted = len(seen), len(scene.actions)
    if actions.shape != wanted and (actions.shape != wanted[:1] or wanted[1] > 1):
        raise ValueError(
            f"a policy gives one action for each of {wanted[0]} walkers and each of its motors "
            f"({', '.join(scene.actions)}): shape {wanted}, not {tuple(actions.shape)}"
        )
    return actions.reshape(wanted)
