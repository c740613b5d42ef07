"""Protocol of controllers, and adapters for functions and torch modules."""

from __future__ import annotations

import copy
import sys
from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker._tools.arguments import shown


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


class FunctionPolicy:
    """A controller that is a function of observations; stride maps give it double precision.

    Args:
        function: Returns actions (n, actions) for observations (n, size).
    """

    double = True

    def __init__(self, function: Callable[..., Any]) -> None:
        self.function, self.name = function, getattr(function, "__name__", "function")

    def __repr__(self) -> str:
        return f"FunctionPolicy({self.name})"

    def predict(
        self, observation: NDArray, state: Any = None, *_: Any, **__: Any
    ) -> tuple[NDArray[np.float64], Any]:
        """Return its actions."""
        return np.asarray(self.function(observation), dtype=float), state


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
            change = [
                torch.autograd.grad(each.sum(), rows, retain_graph=True)[0]
                if each.requires_grad
                else torch.zeros_like(rows)
                for each in actions.unbind(dim=1)
            ]
        return actions.detach().numpy(), torch.stack(change, dim=1).numpy()

    def _answers(self, module: Any, rows: Any) -> Any:
        """Return the actions of a module for observations (n, size).

        Raises:
            ValueError: if it does not take them, or returns no actions (n, actions).
        """
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
