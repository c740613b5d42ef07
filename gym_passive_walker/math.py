"""Mathematical functions for custom rewards, observations and terminations.

They accept numbers, NumPy arrays, torch tensors and the symbolic numbers that the compiler traces,
so that one definition runs on all of them. Arithmetic operators, `abs`, comparisons, and `&`, `|`,
`~` for "and", "or", "not" are available too.
"""

from __future__ import annotations

import sys
from typing import Any

import numpy as np

from gym_passive_walker.engine.expressions import Expression, choose, square_root
from gym_passive_walker.engine.jit import selecting, shared
from gym_passive_walker.physics.numbers import sine_cosine

__all__ = ["cos", "exp", "maximum", "minimum", "sin", "sqrt", "tanh", "where"]


def exp(x: Any) -> Any:
    """The exponential function."""
    return x._with("exp", x) if isinstance(x, Expression) else _library(x).exp(x)


def tanh(x: Any) -> Any:
    """The hyperbolic tangent."""
    return x._with("tanh", x) if isinstance(x, Expression) else _library(x).tanh(x)


def sqrt(x: Any) -> Any:
    """The square root."""
    return square_root(x) if isinstance(x, Expression) else _library(x).sqrt(x)


def sin(x: Any) -> Any:
    """The sine of an angle in rad."""
    return sine_cosine(x)[0] if _library(x) is np else _library(x).sin(x)


def cos(x: Any) -> Any:
    """The cosine of an angle in rad."""
    return sine_cosine(x)[1] if _library(x) is np else _library(x).cos(x)


@shared
def minimum(a: Any, b: Any) -> Any:
    """The smaller of two numbers."""
    return where(a < b, a, b)


@shared
def maximum(a: Any, b: Any) -> Any:
    """The larger of two numbers."""
    return where(a > b, a, b)


@selecting
def where(condition: Any, yes: Any, no: Any) -> Any:
    """`yes` where the condition holds, `no` elsewhere."""
    if isinstance(condition, Expression):
        return choose(condition, yes, no)
    if isinstance(condition, bool | np.bool_):
        return yes if condition else no
    library = _library(condition)
    if library is not np:  # torch makes Python's numbers single precision
        yes, no = (library.as_tensor(x, dtype=library.float64) for x in (yes, no))
    return library.where(condition, yes, no)


def _library(x: Any) -> Any:
    """The library of a number: torch for its tensors, NumPy for all others."""
    torch: Any = sys.modules.get("torch")
    return torch if isinstance(x, getattr(torch, "Tensor", ())) else np
