"""Mathematical functions for custom rewards, observations and terminations.

They accept numbers, NumPy arrays, torch tensors and the symbolic numbers that the compiler traces,
so that one definition runs on all of them. Arithmetic operators, powers that are whole numbers,
`abs`, comparisons, and `&`, `|`, `^`, `~` for "and", "or", "either", "not" are available too. In
arithmetic a condition counts as 1.0 where it holds, and as 0.0 elsewhere.
"""

from __future__ import annotations

import sys
from typing import Any

import numpy as np

from gym_passive_walker.models.equations.numbers import sine_cosine
from gym_passive_walker.models.expressions import Expression, choose

__all__ = ["cos", "exp", "maximum", "minimum", "sin", "sqrt", "tanh", "where"]


def exp(x: Any) -> Any:
    """The exponential function."""
    return _applied("exp", x)


def tanh(x: Any) -> Any:
    """The hyperbolic tangent."""
    return _applied("tanh", x)


def sqrt(x: Any) -> Any:
    """The square root."""
    return _applied("sqrt", x)


def sin(x: Any) -> Any:
    """The sine of an angle in rad."""
    return _applied("sin", x)


def cos(x: Any) -> Any:
    """The cosine of an angle in rad."""
    return _applied("cos", x)


def minimum(a: Any, b: Any) -> Any:
    """The smaller of two numbers."""
    return where(a < b, a, b)


def maximum(a: Any, b: Any) -> Any:
    """The larger of two numbers."""
    return where(a > b, a, b)


def where(condition: Any, yes: Any, no: Any) -> Any:
    """`yes` where the condition holds, `no` elsewhere; a number that is not zero holds."""
    if isinstance(condition, Expression):
        return choose(condition, yes, no)
    if isinstance(condition, bool | int | float | np.bool_):
        found = yes if condition else no
        return type(condition != 0)(found) if isinstance(found, bool) else found
    library = _library(condition)
    if library is not np:  # torch makes Python's numbers single precision
        kinds = {getattr(x, "dtype", type(x)) for x in (yes, no)}
        kind = library.bool if kinds <= {bool, library.bool} else library.float64
        yes, no = (library.as_tensor(x, dtype=kind) for x in (yes, no))
        condition = condition != 0
    return library.where(condition, yes, no)


def _applied(function: str, x: Any) -> Any:
    """Return a function of a number of any kind; of a condition, that of 1.0 or 0.0."""
    library = _library(x)
    if library is not np:
        return getattr(library, function)(x if x.is_floating_point() else x.double())
    if isinstance(x, Expression):
        x = x.number(x)
    elif isinstance(x, bool) or getattr(x, "dtype", None) == np.bool_:
        x = x * 1.0  # NumPy's functions of booleans have half precision
    if function in ("sin", "cos"):
        return sine_cosine(x)[function == "cos"]
    return x.applied(function) if isinstance(x, Expression) else getattr(np, function)(x)


def _library(x: Any) -> Any:
    """The library of a number: torch for its tensors, NumPy for all others."""
    torch: Any = sys.modules.get("torch")
    return torch if isinstance(x, getattr(torch, "Tensor", ())) else np
