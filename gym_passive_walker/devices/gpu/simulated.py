"""The primitives in numba's simulator of a GPU: Python functions.

An address is an array of the floats that begin at it.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from gym_passive_walker.engine import jit
from gym_passive_walker.engine.compiler import PRIMITIVES

_fma = PRIMITIVES[jit.fma]
_fused = numba.njit(lambda a, b, c: _fma(a, b, c))
exp, tanh = (numba.njit(function) for function in (lambda x: math.exp(x), lambda x: math.tanh(x)))
sqrt = np.sqrt


def fma(a, b, c):
    """Return a * b + c, rounded once."""
    return _fused(a, b, c)


def address(array):
    """Return a flat view of an array as floats."""
    while not isinstance(array, np.ndarray):  # wrapper objects of the simulator
        array = array._item if hasattr(array, "_item") else array._ary
    return array.reshape(-1).view(np.ndarray).view(np.float64)


def type_of_arrays(arrays):
    """Return None: kernels of the simulator take arrays of any type."""


def unpacker(kinds, own):
    """Return a function of kernels: the arrays of walker i, from a `columns.WalkerColumns`."""
    return lambda columns, i, column: columns.of_one(i, address(column))


def words_of(columns):
    """Return the columns: a kernel of the simulator takes them as they are."""
    return columns


def get(first, word):
    """Return the float at a word after an address."""
    return first[word]


def put(first, word, value):
    """Write a float at a word after an address."""
    first[word] = value


def get_whole(first, word):
    """Return the integer at a word after an address, as a float."""
    return np.float64(first.view(np.int64)[word])


def put_whole(first, word, value):
    """Write a float as an integer at a word after an address."""
    first.view(np.int64)[word] = int(value)


def apart():
    """Do nothing: Python does not inline functions."""


def select(condition, yes, no):
    """Return `yes` if the condition holds, else `no`."""
    return yes if condition else no


def bits(x):
    """Return the bits of a float as an integer."""
    return int(np.float64(x).view(np.int64))


def of_bits(whole):
    """Return the float with these bits."""
    return np.int64(whole).view(np.float64)


def flip(x, last_bit):
    """Return x, with the opposite sign if the last bit of `last_bit` is set."""
    return -x if np.float64(last_bit).view(np.int64) & 1 else x
