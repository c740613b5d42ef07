"""Functions of numbers that the equations use besides + − × ÷, and derivatives by a complex step.

The models in `equations` are plain functions. They run with floats and arrays, symbols of SymPy
or heyoka, and with the expressions that the engine compiles. Each kind of number registers its
functions here. Other modules can register further kinds:

    sine_cosine.register(heyoka.expression, lambda x: (heyoka.sin(x), heyoka.cos(x)))
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import singledispatch
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

_INFINITESIMAL = 1e-100  # imaginary part that carries a derivative: its square is nothing


@singledispatch
def sine_cosine(x: Any) -> tuple[Any, Any]:
    """Sine and cosine of a number, real or complex, or of an array of them."""
    return np.sin(x), np.cos(x)


def _of_library(function: Callable[[float], float], low: float, high: float) -> Any:
    """Return a function of the C library for real arrays; NaN outside its domain."""

    def of_each(x: Any) -> Any:
        given = np.asarray(x, dtype=float)
        values = [function(v) if low <= v <= high else math.nan for v in given.ravel().tolist()]
        return np.array(values).reshape(given.shape)[()]

    return of_each


# NumPy has algorithms of its own for AVX-512, with other last bits; the bits of walks depend on
# these.
_INVERSE_SINE = _of_library(math.asin, -1.0, 1.0)
natural_logarithm = _of_library(math.log, 5e-324, math.inf)
"""Logarithm of a positive number, or of an array of them."""
power_of_e = _of_library(math.exp, -math.inf, 709.0)
"""Exponential of a number up to 709, or of an array of them."""


def inverse_sine(x: Any) -> Any:
    """Inverse sine of a number, real or complex, or of an array of them."""
    return np.arcsin(x) if np.iscomplexobj(x) else _INVERSE_SINE(x)


@singledispatch
def larger(a: Any, b: Any) -> Any:
    """The larger of two numbers, by their real parts; the second where they do not compare."""
    first = np.real(a) > np.real(b)
    return np.where(first, a, b) if np.ndim(first) else (a if first else b)


def complex_step(value: ArrayLike, change: ArrayLike = 1.0) -> NDArray[np.complex128]:
    """Return a value changed by an imaginary and infinitesimal part of `change`."""
    return np.asarray(value) + 1j * _INFINITESIMAL * np.asarray(change)


def step_derivative(result: ArrayLike) -> NDArray[np.float64]:
    """Return the derivative along the changes of `complex_step` of what was computed from them."""
    return np.imag(result) / _INFINITESIMAL
