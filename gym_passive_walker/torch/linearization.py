"""Steps of an environment, recorded as they are made and differentiated all at once.

A step begins where the one before has ended, so once all are made each can be differentiated by
itself: any number of walkers and steps are one call of the engine, and the chain rule, backwards
through the steps, is left to the caller.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from gym_passive_walker.envs.interface import observation_space
from gym_passive_walker.envs.views import of_notes, samples, shape_of
from gym_passive_walker.gaits.scenes import rules
from gym_passive_walker.gaits.scenes.rewards import rule_of
from gym_passive_walker.gaits.scenes.scene import Scene, SceneLike, make_scene, seen_by_policy
from gym_passive_walker.gaits.scenes.transition import Transition
from gym_passive_walker.models.equations.hybrid import Outcome
from gym_passive_walker.torch.counting import applied, check_alone, each_tensor
from gym_passive_walker.torch.steps import (
    RolloutState,
    exchanged,
    exchanged_names,
    is_ruled,
    recorded_state,
    take_step,
)

_STRUCK = int(Outcome.HEELSTRIKE)
_GIVEN = ("slope", "height_change", "slope_change", "command", "push", "strides", "steps")
"""Fields of a `Transition` that do not change with actions, but for jumps."""


class Linear(NamedTuple):
    """Derivatives of T steps of n walkers by the state before each step and its k actions.

    A state has s numbers. The first m are coordinates and their rates, dimensionless: of a walker
    the first six of the environment's own observation. The others are not observed. They are
    present if a reward or a later step depends on them, in this order:

    - the coordinates with which the stride began;
    - the distance of the hip in the stride;
    - the time of the next push since the stride began;
    - time and actions of the last step;
    - the actions that have not acted yet.

    Actions are those within their bounds. What was drawn at random is a constant. A fall has no
    derivative but that it takes back the distance of its stride.

    Attributes:
        states_by_state: (T, n, s, s): [..., i, j] is the end's i by the start's j.
        states_by_action: (T, n, s, k).
        rewards_by_state: (T, n, s).
        rewards_by_action: (T, n, k).
        seen_by_state: Observations before each step by the first m numbers, (T, n, numbers, m).
        shown_by_state: The same after each step, before a reset.
        ahead: Derivative of what is known to be earned after the last step by the state there,
            (n, s).
    """

    states_by_state: NDArray[np.float64]
    states_by_action: NDArray[np.float64]
    rewards_by_state: NDArray[np.float64]
    rewards_by_action: NDArray[np.float64]
    seen_by_state: NDArray[np.float64]
    shown_by_state: NDArray[np.float64]
    ahead: NDArray[np.float64]


class _Rules(NamedTuple):
    """What holds in recorded steps."""

    given: Scene  # the environment's
    scene: Scene  # the parts of it that have derivatives
    rewarded: bool  # whether rewards have derivatives


class StepRecorder:
    """Record of the steps of an environment, for differentiation.

    Each step is of the scene, and of the kind of work, that the environment has when it is made.

    Args:
        envs: A vector environment, for Gymnasium or stable-baselines3.
        learning: Whether the derivatives of a command's penalty are those that learners need. They
            ignore the bound of the penalty, so that they point to the commanded speed where a
            stride earns nothing. And a stride that has not ended has, by its start, the derivative
            of the stride before it in the same episode, if there is one.

    Attributes:
        left_out: What of the scene has no derivative, and which derivative is left out; a sentence
            each.
        rewarded: Whether rewards have derivatives; they are 0 if not. These two are of the scene
            in which the last step was recorded.
    """

    def __init__(self, envs: Any, *, learning: bool = False) -> None:
        self._batch, self._learning = envs.batch, learning
        self._checked: Scene | None = None
        self._follow(self._batch.scene)
        self.clear()

    def _follow(self, given: Scene) -> None:
        """Set the rules to those of a scene of the environment."""
        scene = seen_by_policy(given)
        parts, self.left_out = _parts(scene)
        self.rewarded = scene.reward is None or "reward" in parts
        kept = {name: getattr(scene, name) if name in parts else None for name in _OWN}
        # What ends episodes is known from the environment.
        made = make_scene(scene, **kept, terminated=None, constraints={})
        self._rules = _Rules(given, made, self.rewarded)

    def clear(self) -> None:
        """Forget all steps."""
        self._before: list[dict[str, NDArray]] = []
        self._made: list[_Rules] = []
        self._actions: list[NDArray] = []
        self._walkers: list = []

    def record(self, actions: NDArray) -> None:
        """Record a step that is about to be made, with its actions, (n,) or (n, k).

        Raises:
            ValueError: if `schedule_events` has added a push or a step in the ground.
        """
        batch, names = self._batch, ("records", "ledger", "disturbances", "pending", "notes")
        now = {name: batch.arrays[name].copy() for name in names if name in batch.arrays}
        if "disturbances" in now and any(
            now["disturbances"][name].any() for name in ("known", "extra_height")
        ):
            raise ValueError(
                "scheduled pushes and steps in the ground have no recorded derivative: give the "
                "scene pushes or a terrain of its own"
            )
        if batch.scene is not self._rules.given:
            self._follow(batch.scene)
        charged = rules.ENERGIES[int(batch.rules["charged"][0])]
        if charged != self._rules.scene.energy:
            scene = make_scene(self._rules.scene, energy=charged)
            self._rules = self._rules._replace(scene=scene)
        self._made.append(self._rules)
        self._before.append(now)
        self._actions.append(np.array(actions, dtype=float).reshape(batch.count, -1))
        self._walkers += batch.walkers

    def linearize(self, violated: NDArray[np.bool_] | None = None) -> Linear:
        """Return the derivatives of the steps since the last `clear`.

        Args:
            violated: Whether a violated constraint ended each walker's episode, (T, n); required if
                the scene's constraints end episodes.

        Raises:
            ValueError: if `violated` is required, or no step is recorded, or the states of the
                steps' scenes differ in size.
        """
        made, count = self._made, len(self._made)
        if count == 0:
            raise ValueError("linearize needs recorded steps: call record before each step")
        if violated is None and any("end" in each.given.constraints.values() for each in made):
            raise ValueError("linearize needs `violated`, since constraints end episodes here")
        cuts = [0, *(k for k in range(1, count) if made[k] is not made[k - 1]), count]
        parts = [
            self._linearized(slice(*ends), None if violated is None else violated[slice(*ends)])
            for ends in pairwise(cuts)
        ]
        sizes = {part.states_by_state.shape[-1] for part in parts}
        if len(sizes) > 1:
            raise ValueError(
                f"the states of the recorded steps' scenes have {sorted(sizes)} numbers: "
                "call clear between the scenes, or let all or none of them have pushes, a delay, a "
                "command and functions of their own"
            )
        *columns, _ = zip(*parts, strict=True)
        return Linear(*(np.concatenate(column) for column in columns), ahead=parts[-1].ahead)

    def _linearized(self, steps: slice, violated: NDArray[np.bool_] | None) -> Linear:
        """Return the derivatives of some recorded steps, all made by the same rules."""
        made = self._made[steps.start]
        scene, shape = made.scene, (steps.stop - steps.start, self._batch.count)
        here, actions = self._episodes(scene, steps), np.concatenate(self._actions[steps])
        leaves = [
            _packed(scene, here).requires_grad_(),
            torch.from_numpy(actions).clamp(-1.0, 1.0).requires_grad_(),
        ]
        found, ends = take_step(
            scene, _unpacked(scene, here, leaves[0]), leaves[1], by_parameters=False,
            violated=None if violated is None else torch.from_numpy(violated.reshape(-1)),
            penalty=_unbounded if self._learning else rules.command_penalty,
        )  # fmt: skip
        if is_ruled(scene) and self._checked is not scene:
            check_alone(scene, ends.last)
            self._checked = scene
        after = _packed(scene, ends)
        rewards = found.rewards * float(made.rewarded)
        by_state, by_action = _derivatives(torch.cat([after, rewards[:, None]], 1), leaves)
        by_state, by_action = (x.reshape(*shape, *x.shape[1:]) for x in (by_state, by_action))
        struck = (found.outcomes == _STRUCK).numpy().reshape(shape)
        goes_on = here.going.numpy().reshape(shape)[-1] & ends.going.numpy().reshape(shape)[-1]
        ahead = np.zeros((shape[1], by_state.shape[-1]))
        if self._learning and len(starts := _places(scene, here)["starts"]):
            steps = here.steps.numpy().reshape(shape)[-1]
            known = np.arange(shape[0])[::-1, None] <= steps  # in the last episode
            last = _last(by_state[:, :, -1, starts], struck & known)
            ahead[:, starts] = (goes_on & ~struck[-1])[:, None] * last
        return Linear(
            states_by_state=by_state[:, :, :-1],
            states_by_action=by_action[:, :, :-1],
            rewards_by_state=by_state[:, :, -1],
            rewards_by_action=by_action[:, :, -1],
            seen_by_state=self._shown(made, here.last, shape),
            shown_by_state=self._shown(made, ends.last, shape),
            ahead=ahead,
        )

    def _shown(self, made: _Rules, step: Transition, shape: tuple[int, int]) -> NDArray[np.float64]:
        """Return derivatives of observations after steps by the state, (T, n, numbers, m)."""
        scene, size = made.scene, made.scene.walker.size
        if seen_by_policy(made.given).observation is None:
            own = np.eye(observation_space(scene).shape[0], size)
            return np.broadcast_to(own, (*shape, *own.shape))
        if not callable(scene.observation):
            seen = np.zeros((*shape, self._batch.observation_size, size))
            groups = self._batch.custom.groups
            return seen if groups is None else seen[:, :, groups["policy"]]
        step = each_tensor(step, Tensor.detach)
        states = torch.stack(list(step.state), 1).requires_grad_()
        seen = applied(scene.observation, step._replace(state=type(step.state)(*states.T)))
        return _derivatives(torch.stack(seen, 1), [states])[0].reshape(*shape, -1, size)

    def _episodes(self, scene: Scene, steps: slice) -> RolloutState:
        """Return the states before recorded steps of a scene, one behind the other."""
        before = self._before[steps]
        arrays = {name: np.concatenate([now[name] for now in before]) for name in before[0]}
        here = recorded_state(scene, arrays)
        if "notes" in arrays:
            here = here._replace(last=_tensors_of(arrays["notes"], scene))
        walkers = self._walkers[steps.start * self._batch.count :][: len(here.steps)]
        return here._replace(parameters=_parameters(scene, walkers, here.strides))


def _parameters(scene: Scene, walkers: list, strides: Tensor) -> dict[str, Tensor]:
    """Return the parameters in which recorded walkers differ from the scene's, (T n,) each."""
    each = {id(walker): walker for walker in walkers}
    numbers = {key: walker.parameters for key, walker in each.items()}
    usual, names = scene.walker.parameters, exchanged_names(scene)
    names += [
        name for name in usual
        if name not in names and any(own[name] != usual[name] for own in numbers.values())
    ]  # fmt: skip
    found = {
        name: torch.tensor([numbers[id(w)][name] for w in walkers], dtype=torch.float64)
        for name in names
    }
    return exchanged(scene, found, strides % 2 == 1)


_OWN = ("reward", "observation")


def left_out(scene: SceneLike) -> list[str]:
    """Return a sentence on each part of a scene without a derivative for learners.

    Terrain, pushes, noise, delays and random bodies need none: they are constants of a walk.

    Args:
        scene: A scene, its name, or its arguments.

    Raises:
        SceneError: if there is no such scene.
    """
    return _parts(seen_by_policy(make_scene(scene)))[1]


def _parts(scene: Scene) -> tuple[set[str], list[str]]:
    """Return the scene's own functions that have derivatives, and the sentences of `left_out`."""
    parts, said = set(), []
    for name in _OWN:
        if getattr(scene, name) is None:
            continue
        try:
            by = _fields_in(scene, rule_of(getattr(scene, name)))
        except Exception as error:  # a user's function may raise anything
            why = f"since it takes no tensors ({type(error).__name__}: {error}; see gpw.math)"
            said.append(f"{name} has no derivative, {why}: {_WITHOUT[name]}.")
            continue
        if name == "reward" and not by:
            said.append(f"reward is constant but for jumps: {_WITHOUT[name]}.")
            continue
        parts.add(name)
        others = [field for field in by if field != "state"]
        if name == "observation" and others:
            said.append(
                f"observation: its derivative by {', '.join(others)} is left out; that by the "
                "state is not."
            )
    if scene.terminated is not None:
        said.append("terminated: when it ends an episode has no derivative, which is left out.")
    if "end" in scene.constraints.values():
        said.append(
            "constraints: when a violated one ends an episode has no derivative; it counts as a "
            "fall."
        )
    if scene.command is not None:
        said.append(
            "command: the bound of its penalty is left out, so that derivatives point to the "
            "commanded speed from afar."
        )
    return parts, said


_WITHOUT = {
    "reward": "its derivative is left out, and actions follow the critic's alone",
    "observation": "what an action changes in later observations is left out",
}


def _fields_in(scene: Scene, function: Any) -> list[str]:
    """Return the fields of a `Transition` by which a function has a derivative somewhere."""
    step = _tensors_of(samples(shape_of(scene), begun=False), scene)
    step = each_tensor(step, lambda x: x.requires_grad_() if x.is_floating_point() else x)
    total = torch.stack([x.sum() for x in applied(function, step)]).sum()
    if not total.requires_grad:
        return []
    found = []
    for name in step._fields:
        given = getattr(step, name)
        leaves = [x for x in (given if isinstance(given, tuple) else (given,)) if x.requires_grad]
        if name in _GIVEN or not leaves:
            continue
        slopes = torch.autograd.grad(total, leaves, retain_graph=True, materialize_grads=True)
        if any(x.any() for x in slopes):
            found.append(name)
    return found


def _tensors_of(notes: NDArray, scene: Scene) -> Transition:
    """Return recorded transitions (n,) as one `Transition` of tensors."""
    step = of_notes(notes, shape_of(scene))
    return each_tensor(step, lambda x: torch.from_numpy(np.array(x)))


def _unbounded(length: Tensor, period: Tensor, command: Tensor, weight: float) -> Tensor:
    """Return the penalty of `rules.command_penalty` without its bound."""
    return weight * rules.command_error(length, period, command)


def _whole(scene: Scene, here: RolloutState) -> dict[str, Tensor]:
    """Return the parts of a `Linear`'s state by name, (n, numbers) each."""
    ruled, none = is_ruled(scene), here.states[:, :0]
    return {
        "states": here.states,
        "starts": here.starts if ruled or scene.command is not None else none,
        "progress": here.progress[:, None],
        "due": here.due[:, None] if scene.pushes else none,
        "time": here.last.time[:, None] if ruled else none,
        "action": torch.stack(here.last.action, 1) if ruled else none,
        "pending": here.pending.flatten(1),
    }


def _places(scene: Scene, here: RolloutState) -> dict[str, NDArray[np.int64]]:
    """Return the places of each part in a `Linear`'s state."""
    sizes = {name: part.shape[1] for name, part in _whole(scene, here).items()}
    ends = np.cumsum([*sizes.values()])
    return {
        name: np.arange(end - size, end)
        for (name, size), end in zip(sizes.items(), ends, strict=True)
    }


def _packed(scene: Scene, here: RolloutState) -> Tensor:
    """Return states as one tensor (n, s)."""
    return torch.cat([*_whole(scene, here).values()], 1)


def _unpacked(scene: Scene, here: RolloutState, whole: Tensor) -> RolloutState:
    """Return states with the numbers of one tensor (n, s)."""
    parts = {name: whole[:, at] for name, at in _places(scene, here).items() if len(at)}
    last, pending = here.last, here.pending
    if "time" in parts:
        last = last._replace(time=parts["time"][:, 0], action=tuple(parts["action"].T))
    if "pending" in parts:
        pending = parts["pending"].reshape(pending.shape)
    return here._replace(
        states=parts["states"],
        starts=parts.get("starts", here.starts),
        progress=parts["progress"][:, 0],
        due=parts["due"][:, 0] if "due" in parts else here.due,
        pending=pending,
        last=last,
    )


def _derivatives(results: Tensor, leaves: list[Tensor]) -> list[NDArray[np.float64]]:
    """Return derivatives of results (n, r) of walkers by leaves (n, k) of theirs, (n, r, k)."""
    rows = [
        torch.autograd.grad(column.sum(), leaves, retain_graph=True, materialize_grads=True)
        if column.requires_grad
        else [torch.zeros_like(leaf) for leaf in leaves]
        for column in results.T
    ]
    return [torch.stack(parts, 1).numpy() for parts in zip(*rows, strict=True)]


def _last(amounts: NDArray, struck: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return amounts (n, k) at each walker's last heelstrike of (T, n) steps; 0 without one."""
    last = len(struck) - 1 - np.argmax(struck[::-1], axis=0)
    found = amounts[last, np.arange(amounts.shape[1])]
    return np.where(np.any(struck, axis=0)[:, None], found, 0.0)
