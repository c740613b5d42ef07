"""Steps of an environment, recorded as they are made and differentiated all at once.

A step begins where the one before has ended, so once all are made each can be differentiated by
itself: any number of walkers and steps are one call of the engine, and the chain rule, backwards
through the steps, is left to the caller.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gym_passive_walker.gaits.flow import Walkers, go_on, report_of
from gym_passive_walker.gaits.scenes import rules
from gym_passive_walker.gaits.scenes.checks import checked
from gym_passive_walker.gaits.scenes.rewards import FUNCTIONS
from gym_passive_walker.gaits.scenes.scene import UNDISTURBED, Scene, SceneError, undisturbed
from gym_passive_walker.models.model import check_supports
from gym_passive_walker.models.walkers import PARAMETERS

_STATE, _STANCE, _ACTION, _START = slice(0, 6), 0, 6, 7  # columns of derivatives
_WIDTH = 1e-6  # of differences


class Linear(NamedTuple):
    """Derivatives of T steps of n walkers by initial state and action of each step.

    States are the first six numbers of an observation; actions are those within their bounds. All
    is 0 in a step in which a walker falls; a stride that falls takes back what its distance
    earned, so there its steps' rewards change by what the motor is charged alone. The penalty of a
    command depends on where the stride began: this is a derivative of its first step's reward.

    Attributes:
        states_by_state: (T, n, 6, 6): [..., i, j] is the end's i by the start's j.
        states_by_action: (T, n, 6).
        rewards_by_state: (T, n, 6).
        rewards_by_action: (T, n).
    """

    states_by_state: NDArray[np.float64]
    states_by_action: NDArray[np.float64]
    rewards_by_state: NDArray[np.float64]
    rewards_by_action: NDArray[np.float64]


def differentiable(scene: Scene) -> Scene:
    """Return a scene after a check that its steps have derivatives.

    Raises:
        SceneError: if it has other actions than the hip's torque, disturbances, or other rules of
            observation, reward or termination.
    """
    subject = "steps that are differentiated"
    checked(check_supports, scene.walker, "step derivatives")
    if scene.actions != ("hip",):
        raise SceneError(
            f"{subject} are driven by the hip alone, and this scene's actions are "
            f'{scene.actions}: choose make_scene(scene, actions=("hip",))'
        )
    return undisturbed(scene, f"{subject} go", UNDISTURBED | dict.fromkeys(FUNCTIONS))


class StepRecorder:
    """Record of the steps of an environment, for differentiation.

    Args:
        envs: A vector environment, for Gymnasium or stable-baselines3, of walkers that are
            driven by the hip alone, without disturbances.
        learning: Whether the derivatives of a command's penalty are those that learners need. They
            ignore the bound of the penalty, so that they point to the commanded speed where a
            stride earns nothing. And a stride that has not ended has, by its start, the derivative
            of the stride before it in the same episode, if there is one.

    Raises:
        SceneError: if it is otherwise.
    """

    def __init__(self, envs: Any, *, learning: bool = False) -> None:
        self._batch, self._learning = envs.batch, learning
        self._scene = differentiable(envs.scene)
        self.clear()

    def clear(self) -> None:
        """Forget all steps."""
        self._records: list[NDArray] = []
        self._actions: list[NDArray] = []
        self._commands: list[NDArray] = []
        self._walkers: list = []

    def record(self, actions: NDArray) -> None:
        """Record a step that is about to be made, with its actions, (n,) or (n, 1)."""
        self._records.append(self._batch.records.copy())
        self._actions.append(np.array(actions, dtype=float).reshape(-1))
        self._steps = self._batch.ledger["steps"].copy()
        self._walkers += self._batch.walkers
        if self._scene.command is not None:
            self._commands.append(self._batch.disturbances.states["command"].copy())

    def linearize(self) -> Linear:
        """Return the derivatives of the steps since the last `clear`."""
        scene, settings = self._scene, self._batch.rules[0]
        shape = (len(self._records), self._batch.count)
        torques = scene.max_hip_torque * rules.clip(np.concatenate(self._actions), -1.0, 1.0)
        records = np.concatenate(self._records)
        record = records[:, 0]
        record["control"][:, 0] = torques
        record["moved"], record["turned"] = 0.0, 0.0
        longest = settings["max_stride_time"]
        record["end"] = rules.step_end(record["time"], settings["tick"], longest)
        by = ("state", "hip_torque") if scene.command is None else ("state", "hip_torque", "start")
        walkers, lanes = self._recorded()
        walked = go_on(walkers, records, by, lanes=lanes)
        results, distance, report = walked.rows, walked.distance, report_of(walked.system)
        fell = rules.ends_episode(rules.outcome_of(walked.outcomes, record["end"], longest))
        results[fell, :, 1:] = 0.0
        begins = record["time"].reshape(shape) == 0.0
        fallen = fell.reshape(shape)
        standing = stands(fallen, begins)
        distance = distance[:, 1:] * standing.reshape(-1, 1)
        energy = np.zeros_like(distance)
        if scene.walker.equations().works.hip:
            charged = int(settings["charged"])
            moved, turned = (results[:, report.at[name, 0]] for name in ("moved", "turned"))
            energy += rules.motor_charge(charged, torques[:, None], moved[:, 1:], turned[:, 1:])
            sign = np.where(torques < 0.0, -1.0, 1.0)
            charge = rules.motor_charge(charged, sign, moved[:, 0], turned[:, 0])
            energy[:, _ACTION] += ~fell * sign * charge
        rewards = rules.reward(distance, energy, scene.energy_weight)
        if scene.command is not None:
            length, period = (results[:, report.at[name]] for name in ("step_length", "time"))
            rewards -= walked.struck[:, None] * self._penalties_by(length, period)
            by_start, going = rewards[:, _START].reshape(shape), 0.0
            if self._learning:
                struck = walked.struck.reshape(shape)
                goes_on = ~(struck | fallen)[-1]
                here = np.arange(len(struck))[::-1, None] <= self._steps  # in the last episode
                going = goes_on * _last(by_start, struck & here)
            by_start = at_first_steps(by_start, begins, going)
            rewards[:, _STANCE] += by_start.reshape(-1)
        states = results[:, _STATE, 1:]
        rewards[:, _ACTION] *= scene.max_hip_torque
        return Linear(
            states_by_state=states[..., _STATE].reshape(*shape, 6, 6),
            states_by_action=scene.max_hip_torque * states[..., _ACTION].reshape(*shape, 6),
            rewards_by_state=rewards[:, _STATE].reshape(*shape, 6),
            rewards_by_action=rewards[:, _ACTION].reshape(shape),
        )

    def _penalties_by(self, length: NDArray, period: NDArray) -> NDArray[np.float64]:
        """Return the derivatives (n, k) of `command_penalty` from values and tangents (n, 1 + k).

        It is linear in pieces, so differences are derivatives.
        """
        commands, weight = np.concatenate(self._commands)[:, None], self._scene.command_weight

        def penalty(lengths: NDArray, periods: NDArray) -> Any:
            if self._learning:
                return weight * rules.command_error(lengths, periods, commands)
            return rules.command_penalty(lengths, periods, commands, weight)

        here, there = (
            penalty(length[:, :1] + width * length[:, 1:], period[:, :1] + width * period[:, 1:])
            for width in (0.0, _WIDTH)
        )
        return (there - here) / _WIDTH

    def _recorded(self) -> tuple[Walkers, NDArray[np.intp]]:
        """Return the walkers of the recorded steps, each once, and the index of each step's."""
        scene, parameters = self._scene, {}
        each = {id(walker): walker for walker in self._walkers}
        places = {key: place for place, key in enumerate(each)}
        if len(each) > 1:
            parameters = {
                name: np.array([getattr(walker, name) for walker in each.values()])
                for name in PARAMETERS
            }
        walkers = Walkers(
            walker=scene.walker,
            parameters=parameters,
            tolerance=scene.tolerance,
            end_on_toe_stub=scene.end_on_toe_stub,
        )
        return walkers, np.array([places[id(walker)] for walker in self._walkers])


def stands(fell: NDArray[np.bool_], begins: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return whether each step's stride does not end in a fall, as far as is known, (T, n).

    Args:
        fell: Whether each walker falls in a step, (T, n).
        begins: Whether a stride begins with it, (T, n).
    """
    standing, so_far = np.empty(fell.shape, bool), np.ones(fell.shape[1], bool)
    for step in reversed(range(len(fell))):
        standing[step] = so_far & ~fell[step]
        so_far = standing[step] | begins[step]
    return standing


def at_first_steps(
    amounts: NDArray, begins: NDArray[np.bool_], going: NDArray | float = 0.0
) -> NDArray[np.float64]:
    """Return amounts of steps (T, n), moved to the first step of each one's stride.

    Those of a stride that began before the first step are dropped. `begins` is that of `stands`,
    and `going` is what comes after the last step, in the strides that go on, (n,).
    """
    moved, so_far = np.zeros(amounts.shape), np.zeros(amounts.shape[1]) + going
    for step in reversed(range(len(amounts))):
        so_far += amounts[step]
        moved[step, begins[step]] = so_far[begins[step]]
        so_far[begins[step]] = 0.0
    return moved


def _last(amounts: NDArray, struck: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return the amounts (n,) at each walker's last heelstrike of (T, n) steps; 0 without one."""
    last = len(struck) - 1 - np.argmax(struck[::-1], axis=0)
    return np.where(struck.any(axis=0), np.take_along_axis(amounts, last[None], axis=0)[0], 0.0)
