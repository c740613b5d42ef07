"""The primitives in numba's simulator of a device: functions of Python.

An address is an array of the numbers that begin at it.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from gym_passive_walker.engine.jit import fma as _fma

_fused = numba.njit(lambda a, b, c: _fma(a, b, c))
exp, tanh = (numba.njit(function) for function in (lambda x: math.exp(x), lambda x: math.tanh(x)))
sqrt = np.sqrt


def fma(a, b, c):
    """The sum a * b + c, rounded once."""
    return _fused(a, b, c)


def address(array):
    """The numbers of an array."""
    while not isinstance(array, np.ndarray):  # the simulator's wrappers
        array = array._item if hasattr(array, "_item") else array._ary
    return array.reshape(-1).view(np.ndarray).view(np.float64)


def get(first, word):
    """A number."""
    return first[word]


def put(first, word, value):
    """Write a number."""
    first[word] = value


def get_whole(first, word):
    """A whole number, as a float."""
    return np.float64(first.view(np.int64)[word])


def put_whole(first, word, value):
    """Write a whole number, given as a float."""
    first.view(np.int64)[word] = int(value)


def apart():
    """Nothing: Python copies no function into another."""


def select(condition, yes, no):
    """One of two numbers."""
    return yes if condition else no


def bits(x):
    """A number's bits, as a whole number."""
    return int(np.float64(x).view(np.int64))


def of_bits(whole):
    """The number that has some bits."""
    return np.int64(whole).view(np.float64)


def flip(x, last_bit):
    """A number, its sign changed if another's last bit is set."""
    return -x if np.float64(last_bit).view(np.int64) & 1 else x
