"""Protocol of controllers, and adapters for functions, torch modules and plans of strides."""

from __future__ import annotations

import copy
import sys
from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker._tools.arguments import shown
from gym_passive_walker.gaits.scenes.scene import Scene
from gym_passive_walker.models.model import check_supports


class Policy(Protocol):
    """Protocol of controllers: stable-baselines3's algorithms, trained policies, baselines."""

    def predict(
        self,
        observation: NDArray,
        state: tuple[NDArray, ...] | None = None,
        episode_start: NDArray | None = None,
        deterministic: bool = True,
    ) -> tuple[NDArray, tuple[NDArray, ...] | None]:
        """Choose actions for a batch of observations."""
        ...


class Planner(Protocol):
    """Protocol of controllers that plan a stride where it begins; see `StridePlan`."""

    def plan(self, points: NDArray, slopes: ArrayLike) -> NDArray:
        """Return the actions (n, steps, actions) of strides from points (n, m) of the section."""
        ...


def method_of(controller: Any, name: str) -> Callable[..., Any] | None:
    """Return a method of a controller; an attribute of that name may be another thing."""
    return found if callable(found := getattr(controller, name, None)) else None


def policy_name(policy: Any) -> str:
    """Return the name of a controller: its own, or that of its class."""
    return str(getattr(policy, "name", None) or type(policy).__name__)


class StridePlan:
    """A controller that plans a stride where it begins; environments ask for it step by step.

    The memory that `predict` returns holds the actions of each walker's stride, how far it has
    come, and the last state.

    Args:
        scene: The scene in which it acts.
        plan: Function from points (n, m) of the section and slopes in rad to the actions of strides
            (n, steps, actions); the last are held until heelstrike. None is the object's own.
        plan_by: Function to their derivatives, by points and by the slope; None has none.
        name: Name of the controller.
    """

    def __init__(self, scene: Scene, plan: Any = None, plan_by: Any = None, name: str = "") -> None:
        self.scene, self.name = scene, name
        self._chart, self._slope = scene.walker.chart, len(scene.walker.observed) - 1
        self._seen, self._every = self._chart.coordinates, scene.control == "stride"
        if plan is not None:
            self.plan, self.plan_by = plan, plan_by

    def predict(
        self,
        observation: ArrayLike,
        state: Any = None,
        episode_start: ArrayLike | None = None,
        deterministic: bool = True,
    ) -> tuple[NDArray[np.float32], tuple[NDArray, ...]]:
        """The action of a step: of new actions just after heelstrike, else of those under way.

        Args:
            observation: One observation or a batch.
            state: Memory that the last call returned; None at the beginning.
            episode_start: Whether each walker has just begun an episode.
            deterministic: Ignored; actions are deterministic.

        Raises:
            ValueError: if the scene has an observation of its own.
        """
        if self.scene.observation is not None:
            raise ValueError(
                "a plan of strides reads the state from the environments' own observation, and "
                "this scene has another: choose make_scene(scene, observation=None)"
            )
        seen = np.atleast_2d(np.asarray(observation, dtype=float))
        states = seen[:, : self._slope].copy()
        plan = np.asarray(self.plan(states[:, self._seen], seen[:, self._slope]))
        step = np.zeros(len(seen), int)
        if state is not None and not self._every:
            begun = self._chart.begins(state[2], states)
            if episode_start is not None:
                begun |= np.asarray(episode_start, dtype=bool)
            plan = np.where(begun[:, None, None], plan, state[0])
            step = np.where(begun, 0, np.minimum(state[1] + 1, plan.shape[1] - 1))
        elif not self._every:
            check_supports(self.scene.walker, "stride plans")
        action = plan[np.arange(len(plan)), step].astype(np.float32)
        return action.reshape(*np.shape(observation)[:-1], plan.shape[2]), (plan, step, states)


class FunctionPolicy:
    """A controller that is a function of observations; stride maps give it double precision.

    Args:
        function: Returns actions (n, actions) for observations (n, size).
    """

    double = True

    def __init__(self, function: Callable[..., Any]) -> None:
        self.function = function
        self.name = getattr(function, "__name__", None) or policy_name(function)

    def __repr__(self) -> str:
        return f"FunctionPolicy({self.name})"

    def predict(
        self, observation: NDArray, state: Any = None, *_: Any, **__: Any
    ) -> tuple[NDArray[np.float64], Any]:
        """Return its actions."""
        return np.asarray(self.function(observation), dtype=float), state


class NormalizedPolicy:
    """A model of stable-baselines3 with its `VecNormalize`, which scales its observations.

    Args:
        model: The model.
        normalizer: Its `VecNormalize`, as `get_vec_normalize_env` returns it.
    """

    def __init__(self, model: Any, normalizer: Any) -> None:
        self.name, self._model, self._normalizer = policy_name(model), model, normalizer

    def predict(self, observation: NDArray, *rest: Any, **named: Any) -> tuple[NDArray, Any]:
        """Return the model's actions for observations of the environment; see `Policy`."""
        seen = self._normalizer.normalize_obs(np.asarray(observation))
        return self._model.predict(seen, *rest, **named)


class ModulePolicy:
    """A controller that is a torch module; a copy in evaluation mode, on the CPU.

    Args:
        module: Returns actions (n, actions) for observations (n, size), each row for its own.
    """

    def __init__(self, module: Any) -> None:
        self.name = type(module).__name__
        self._module = copy.deepcopy(module).cpu().eval().requires_grad_(False)
        self._exact = copy.deepcopy(self._module).double()
        numbers = (*self._module.parameters(), *self._module.buffers())
        self._dtype = next((x.dtype for x in numbers if x.is_floating_point()), None)

    def predict(
        self,
        observation: ArrayLike,
        state: Any = None,
        episode_start: ArrayLike | None = None,
        deterministic: bool = True,
    ) -> tuple[NDArray[np.float32], Any]:
        """Return its actions, in the precision of its parameters; see `Policy`."""
        seen = np.asarray(observation)
        rows = sys.modules["torch"].as_tensor(np.atleast_2d(seen), dtype=self._dtype)
        actions = self._answers(self._module, rows).numpy().astype(np.float32)
        return actions[0] if seen.ndim == 1 else actions, state

    def mean_actions(self, observation: NDArray) -> NDArray[np.float64]:
        """Return actions (n, actions) for observations (n, size), in double precision."""
        rows = sys.modules["torch"].as_tensor(np.asarray(observation, dtype=float))
        return self._answers(self._exact, rows).numpy()

    def linearize(self, observation: NDArray) -> tuple[NDArray, NDArray]:
        """Return actions (n, actions) and their derivatives (n, actions, size), in float64."""
        torch = sys.modules["torch"]
        with torch.enable_grad():
            rows = torch.as_tensor(np.array(observation, dtype=float)).requires_grad_()
            actions = self._answers(self._exact, rows)
            change = rows.new_zeros(*actions.shape, rows.shape[1])
            for j, each in enumerate(actions.unbind(dim=1)):
                if each.requires_grad:
                    change[:, j] = torch.autograd.grad(each.sum(), rows, retain_graph=True)[0]
        return actions.detach().numpy(), change.numpy()

    def _answers(self, module: Any, rows: Any) -> Any:
        """Return the actions of a module for observations (n, size)."""
        try:
            actions = module(rows)
        except RuntimeError as error:
            raise ValueError(
                f"the module {self.name} does not take observations of shape {tuple(rows.shape)}: "
                f"{error}"
            ) from None
        if not isinstance(actions, type(rows)) or actions.shape[:-1] != rows.shape[:-1]:
            got = tuple(actions.shape) if isinstance(actions, type(rows)) else shown(actions)
            raise ValueError(
                f"the module {self.name} must return a tensor of actions (n, actions), here with "
                f"n = {len(rows)}, not {got}"
            )
        return actions


def is_module(value: Any) -> bool:
    """Return whether a value is a torch module; torch is not loaded for it."""
    torch = sys.modules.get("torch")
    return torch is not None and isinstance(value, torch.nn.Module)
