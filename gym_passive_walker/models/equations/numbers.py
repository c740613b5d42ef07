"""Functions of numbers that the equations use besides + − × ÷, and derivatives by a complex step.

The models in `equations` are plain functions. They run with floats and arrays, symbols of SymPy
or heyoka, and with the expressions that the engine compiles. Each kind of number registers its
functions here. Other modules can register further kinds:

    sine_cosine.register(heyoka.expression, lambda x: (heyoka.sin(x), heyoka.cos(x)))
"""

from __future__ import annotations

import math
from functools import singledispatch
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

_INFINITESIMAL = 1e-100  # imaginary part that carries a derivative: its square is nothing


@singledispatch
def sine_cosine(x: Any) -> tuple[Any, Any]:
    """Sine and cosine of a number, real or complex, or of an array of them."""
    return np.sin(x), np.cos(x)


_INVERSE_SINE = np.frompyfunc(lambda x: math.asin(x) if -1.0 <= x <= 1.0 else math.nan, 1, 1)


def inverse_sine(x: Any) -> Any:
    """Inverse sine of a number, real or complex, or of an array of them.

    NumPy has an algorithm of its own for AVX-512, with other last bits; the bits of walks depend on
    this one.
    """
    return np.arcsin(x) if np.iscomplexobj(x) else np.asarray(_INVERSE_SINE(x), dtype=float)[()]


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
