"""Tensors for users' functions: in arithmetic, conditions count as 1.0 and 0.0."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from torch import Tensor

from gym_passive_walker.envs.views import IN_PLACE
from gym_passive_walker.gaits.scenes.checks import SceneError
from gym_passive_walker.gaits.scenes.rewards import FUNCTIONS, rule_of
from gym_passive_walker.gaits.scenes.transition import Transition

_ARITHMETIC = frozenset(
    name
    for operator in (
        "add", "sub", "subtract", "mul", "multiply", "div", "divide", "truediv", "true_divide",
        "floordiv", "floor_divide", "mod", "remainder", "pow", "neg", "negative", "pos", "positive",
        "abs", "absolute", "square",
    )
    for name in (operator, f"{operator}_", *(f"__{kind}{operator}__" for kind in ("", "r", "i")))
) | {"rsub"}  # fmt: skip
"""Names of torch's functions in which a condition is a number; it would not be one, or of single
precision."""


class _Counting(Tensor):
    """A tensor of one entry for each walker."""

    @classmethod
    def __torch_function__(
        cls, function: Any, types: Any, given: Any = (), options: Any = None
    ) -> Any:
        """Apply a function of torch, with conditions as numbers if it is arithmetic."""
        if function.__name__ in _ARITHMETIC:
            given = [x.double() if _is_condition(x) else x for x in given]
        return super().__torch_function__(function, types, given, options or {})


for _name in IN_PLACE:  # as for numbers: `x += 1` changes no field of the step
    setattr(_Counting, f"__i{_name}__", getattr(Tensor, f"__{_name}__"))


def _is_condition(x: Any) -> bool:
    return isinstance(x, Tensor) and x.dtype == torch.bool


def applied(function: Callable[[Transition], Any], step: Transition) -> list[Tensor]:
    """Return the results of a user's function of tensors (n,), each (n,) and float64."""
    found = function(each_tensor(step, lambda x: x.clone().as_subclass(_Counting)))
    found = [*found] if isinstance(found, tuple | list) else [found]
    plain = (torch.as_tensor(x).as_subclass(Tensor).double() for x in found)
    return [x.expand(step.time.shape) for x in plain]


def check_alone(scene: Any, step: Transition) -> None:
    """Refuse functions of a scene that give a walker another result beside other walkers.

    Raises:
        SceneError: if three walkers of a step together give other numbers than each alone.
    """
    few = each_tensor(step, lambda x: x[:3].detach())
    for name in FUNCTIONS:
        function = getattr(scene, name) and rule_of(getattr(scene, name))
        if function is None:
            continue
        each = [each_tensor(few, lambda x, i=i: x[i : i + 1]) for i in range(len(few.time))]
        together, alone = applied(function, few), [applied(function, one) for one in each]
        for column, parts in zip(together, zip(*alone, strict=True), strict=True):
            if not torch.allclose(column, torch.cat(parts), rtol=1e-9, atol=1e-12, equal_nan=True):
                raise SceneError(
                    f"{name} mixes walkers: for three of them together it gives "
                    f"{column.tolist()}, for each alone {torch.cat(parts).tolist()}; its result "
                    "must depend on one walker alone"
                )


def each_tensor(part: Any, change: Callable[[Any], Tensor]) -> Any:
    """Return a nested structure with all of its tensors, or arrays of NumPy, changed."""
    if isinstance(part, Tensor | np.ndarray):
        return change(part)
    parts = [each_tensor(x, change) for x in part]
    return type(part)._make(parts) if hasattr(part, "_make") else tuple(parts)
