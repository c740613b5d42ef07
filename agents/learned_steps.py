"""SHAC on learned derivatives: a model of the control steps in place of the engine's.

`first_order.SHAC` takes the derivatives of its steps from the engine. Here they are learned from
the steps themselves, as for a machine without a simulator. States and rewards are those of real
steps, so an error of the model changes a gradient, but not a return (Heess et al., 2015).

- Impacts divide steps into kinds: whether the swing knee is locked before and after a step, and
  whether the step ends with a heelstrike. Within a kind, a step is a smooth function.
- Each kind has its own cubic polynomials. They are fitted by least squares to all steps since the
  beginning of the training, with whatever policy they were made. Only sums are kept.
- The price of the torque is not learned, because it has kinks. It is the scene's rule, with the
  learned change of the hip angle.

References:
    N. Heess et al., "Learning continuous control policies by stochastic value gradients", 2015.
"""

from __future__ import annotations

from itertools import permutations
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3.common.type_aliases import GymEnv
from stable_baselines3.common.vec_env import VecEnv, VecNormalize
from stable_baselines3.common.vec_env.base_vec_env import VecEnvStepReturn
from torch import Tensor

from agents.first_order import SHAC, Taped
from agents.ppo_fast import wrapped
from gym_passive_walker.gaits.scenes import rules
from gym_passive_walker.gaits.scenes.checks import SceneError
from gym_passive_walker.gaits.scenes.rewards import FUNCTIONS
from gym_passive_walker.gaits.scenes.scene import CALM, undisturbed
from gym_passive_walker.torch.linearization import Linear

_STANCE, _THIGH, _LOCKED = 0, 1, 6  # columns of an observation
_STATE = slice(0, 6)
_KINDS = 8
_RIDGE = 1e-5
"""Weight of the squared coefficients relative to the squared errors. It bounds the coefficients of
terms that hardly vary: the shank has the angle of the thigh while the knee is locked."""

_LEAST = 16
"""Steps of a kind in one horizon from which its scale is taken; before that, it is not learned."""


class StepModel:
    """Cubic polynomials for each kind of steps, fitted by least squares to all steps so far.

    Args:
        inputs: Number of inputs of a step.
        outputs: Number of outputs of a step.

    Attributes:
        terms: Factors of each term, as indices into (1, inputs), (terms, 3).
        sums: Sums over the steps of each kind: products of two terms, and of terms and outputs,
            shape (kinds, terms, terms + outputs).
        scales: Centers and spreads of inputs and outputs, shape (kinds, 2, inputs + outputs).
        counts: Number of steps of each kind, shape (kinds,).
    """

    def __init__(self, inputs: int, outputs: int) -> None:
        self.inputs, self.outputs = inputs, outputs
        self.terms = torch.combinations(torch.arange(1 + inputs), 3, with_replacement=True)
        size = len(self.terms)
        self.sums = torch.zeros(_KINDS, size, size + outputs, dtype=torch.float64)
        self.scales = torch.ones(_KINDS, 2, inputs + outputs, dtype=torch.float64)
        self.counts = torch.zeros(_KINDS, dtype=torch.float64)

    def learn(self, kinds: Tensor, rows: Tensor) -> None:
        """Add steps.

        Args:
            kinds: Kind of each step, shape (n,).
            rows: Inputs and outputs of each step, shape (n, inputs + outputs).
        """
        for kind in kinds.unique().tolist():
            own = rows[kinds == kind]
            if not self.counts[kind]:
                if len(own) < _LEAST:
                    continue
                spread = 2.0 * own.std(0)
                # A constant, such as the slope of a scene, would divide by its rounding.
                spread[spread < 1e-6] = 1.0
                self.scales[kind] = torch.stack([own.mean(0), spread])
            scaled = (own - self.scales[kind, 0]) / self.scales[kind, 1]
            inputs, outputs = scaled.split([self.inputs, self.outputs], 1)
            terms = _with_one(inputs)[:, self.terms].prod(-1)
            self.sums[kind] += terms.T @ torch.cat([terms, outputs], 1)
            self.counts[kind] += len(own)

    def derivatives(self, kinds: Tensor, inputs: Tensor) -> Tensor:
        """Derivatives of the outputs by the inputs; 0 for kinds that are not learned.

        Args:
            kinds: Kind of each step, shape (n,).
            inputs: Inputs of each step, shape (n, inputs).

        Returns:
            Shape (n, outputs, inputs).
        """
        found = torch.zeros(len(inputs), self.outputs, self.inputs, dtype=torch.float64)
        for kind in kinds.unique().tolist():
            if self.counts[kind]:
                center, spread = self.scales[kind].split([self.inputs, self.outputs], 1)[0]
                ones = _with_one((inputs[kinds == kind] - center) / spread)
                slopes = 3.0 * torch.einsum("abco,nb,nc->noa", self._form(kind), ones, ones)
                scale = self.scales[kind, 1, self.inputs :]
                found[kinds == kind] = slopes[:, :, 1:] * scale[:, None] / spread
        return found

    def _form(self, kind: int) -> Tensor:
        """The fitted polynomials as one symmetric form of (1, inputs), (k, k, k, outputs)."""
        size = len(self.terms)
        products, results = self.sums[kind].split([size, self.outputs], 1)
        ridge = _RIDGE * self.counts[kind] * torch.eye(size, dtype=torch.float64)
        weights = torch.linalg.solve(products + ridge, results)
        form = torch.zeros(*[1 + self.inputs] * 3, self.outputs, dtype=torch.float64)
        for order in permutations(self.terms.T):
            form.index_put_(order, weights / 6.0, accumulate=True)
        return form


def _with_one(inputs: Tensor) -> Tensor:
    return torch.cat([torch.ones_like(inputs[:, :1]), inputs], 1)


class LearnedSteps:
    """Record of the steps of an environment, from which their derivatives are learned.

    It has the methods of `evaluation.linearization.StepRecorder`, and `finish`.

    Args:
        envs: A `PassiveWalkerVecEnv` of walkers that are driven by the hip alone.

    Attributes:
        model: What is learned. Inputs are the observation without the knee's flag, and the action;
            outputs are the state after the step, and the distance that is rewarded.

    Raises:
        SceneError: if the scene has other actions than the hip's torque, disturbances, a command,
            or other rules of observation, reward or termination.
    """

    left_out: tuple[str, ...] = ()
    rewarded = True

    def __init__(self, envs: Any) -> None:
        self._batch, scene = envs.batch, envs.scene
        if "units" not in scene.walker.supports:
            raise SceneError(
                "derivatives are learned of the package's walkers, and not of a System: choose shac"
            )
        if scene.actions != ("hip",):
            raise SceneError(
                "derivatives are learned of walkers that are driven by the hip alone, and this "
                f'scene\'s actions are {scene.actions}: choose make_scene(scene, actions=("hip",))'
            )
        calm = CALM | dict.fromkeys(FUNCTIONS)
        self._scene = undisturbed(scene, "derivatives of steps are learned", calm)
        self.model = StepModel(self._batch.observation_size, 7)
        self.clear()

    def clear(self) -> None:
        """Delete the recorded steps, but not what was learned from them."""
        self._steps: list[tuple[NDArray, ...]] = []
        self._learned = 0  # how many of them are in the model

    def record(self, actions: NDArray) -> None:
        """Record the observations before a step, and its actions, (n,) or (n, 1).

        Raises:
            SceneError: if the scene has changed: what was learned is of the former one.
        """
        if self._batch.scene is not self._scene:
            raise SceneError(
                "derivatives are learned in one scene, and set_scene has changed it: begin another "
                "training, or choose an algorithm other than shac-learned"
            )
        before = self._batch.observe()
        actions = rules.clip(np.array(actions, float).reshape(-1), -1.0, 1.0)
        begins = self._batch.records["time"][:, 0] == 0.0
        self._begun = before.astype(float), actions, begins, self._batch.ledger["strides"].copy()

    def finish(self, after: NDArray, rewards: NDArray, strides: NDArray, fell: NDArray) -> None:
        """Record the results of the step.

        Args:
            after: Observations at its end, before a reset, shape (n, k).
            rewards: Rewards, shape (n,).
            strides: Number of strides in each episode, before a reset, shape (n,).
            fell: Whether each walker fell, shape (n,).
        """
        *begun, earlier = self._begun
        self._steps.append((*begun, after.astype(float), rewards, strides > earlier, fell))

    def linearize(self, violated: NDArray[np.bool_] | None = None) -> Linear:
        """Learn from the steps since the last `clear`, and return their derivatives.

        No scene has constraints here, so none is `violated`.
        """
        before, actions, begins, after, rewards, struck, fell = map(
            np.stack, zip(*self._steps, strict=True)
        )
        charged = int(self._batch.rules["charged"][0])
        torques = self._scene.max_hip_torque * actions
        # The legs exchange their names at heelstrike, which turns the sign of the hip angle.
        side = np.where(struck, -1.0, 1.0)
        moved = side * _hip_angle(after) - _hip_angle(before)
        pays = self._scene.energy_weight * self._batch.system.works.hip
        charge = rules.motor_charge(charged, torques, moved, abs(moved))
        kinds = 4 * (before[..., _LOCKED] > 0.5) + 2 * (after[..., _LOCKED] > 0.5) + struck
        inputs = np.concatenate([np.delete(before, _LOCKED, axis=-1), actions[..., None]], axis=-1)
        distance = rewards + pays * charge
        rows = np.concatenate([inputs, after[..., _STATE], distance[..., None]], axis=-1)
        upright, at = torch.from_numpy(~fell), torch.from_numpy(kinds)
        new = upright.clone()
        new[: self._learned] = False
        self.model.learn(at[new], torch.from_numpy(rows)[new])
        self._learned = len(fell)
        learned = torch.zeros(*fell.shape, 7, inputs.shape[-1], dtype=torch.float64)
        learned[upright] = self.model.derivatives(at[upright], torch.from_numpy(inputs)[upright])
        # Derivatives by state and action: (T, n, 7, 7), of the state and of the distance.
        slopes = learned[..., [*range(6), -1]].numpy()
        slopes[..., 6, :] *= stands(fell, begins)[..., None]
        # The charge depends on the action directly, and through the change of the hip angle.
        turned = side[..., None] * _hip_angle(slopes.swapaxes(-1, -2)) - _hip_angle(np.eye(7))
        ways = np.where(moved < 0.0, -1.0, 1.0)[..., None] * turned
        work = rules.motor_charge(charged, torques[..., None], turned, ways)
        sign = np.where(torques < 0.0, -1.0, 1.0)
        direct = sign * rules.motor_charge(charged, sign, moved, abs(moved))
        work[..., 6] += self._scene.max_hip_torque * direct
        paid = slopes[..., 6, :] - pays * ~fell[..., None] * work
        shown = np.eye(before.shape[-1], 6)
        return Linear(
            states_by_state=slopes[..., _STATE, _STATE],
            states_by_action=slopes[..., _STATE, 6:],
            rewards_by_state=paid[..., _STATE],
            rewards_by_action=paid[..., 6:],
            seen_by_state=np.broadcast_to(shown, (*fell.shape, *shown.shape)),
            shown_by_state=np.broadcast_to(shown, (*fell.shape, *shown.shape)),
            ahead=np.zeros((fell.shape[1], 6)),
        )


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


def _hip_angle(states: NDArray) -> NDArray:
    return states[..., _THIGH] - states[..., _STANCE]


class Watched(Taped):
    """Environments that record their steps and the results, to learn their derivatives."""

    recorder: Any

    def __init__(self, venv: VecEnv) -> None:
        super().__init__(venv, LearnedSteps(venv.unwrapped))

    def step_wait(self) -> VecEnvStepReturn:
        """Finish a step, and record its results."""
        results = super().step_wait()
        _, rewards, dones, infos = results
        after, native = self.seen[-1], self.unwrapped
        if isinstance(self.venv, VecNormalize):
            after = self.venv.unnormalize_obs(after)
        strides = native.batch.ledger["strides"].copy()  # type: ignore[attr-defined]
        for i in np.flatnonzero(dones):
            strides[i] = infos[i]["strides"]
        # Algorithms add the value after a time limit to the rewards, in place.
        self.recorder.finish(after, rewards.copy(), strides, self.fell[-1])
        return results


class LearnedSHAC(SHAC):
    """`SHAC` on learned derivatives; its arguments are the same."""

    @staticmethod
    def _wrap_env(env: GymEnv, verbose: int = 0, monitor_wrapper: bool = True) -> VecEnv:
        return Watched(wrapped(env, verbose, monitor_wrapper))

    def _get_torch_save_params(self) -> tuple[list[str], list[str]]:
        states, tensors = super()._get_torch_save_params()
        learned = (f"env.recorder.model.{name}" for name in ("sums", "scales", "counts"))
        return states, [*tensors, *learned]
