"""Counter-based random numbers: each is a function of a key, a counter and a stream.

There is no generator state. The numbers of a walker depend only on its key, not on batching,
threads or saved states. A stream of a key is a SplitMix64 generator (Steele, Lea and Flood 2014),
evaluated at any counter.
"""

from __future__ import annotations

import math

import numpy as np

from gym_passive_walker.engine.jit import Kernel

# Numba converts mixed signed and unsigned operands to floats, so all integers are unsigned.
_ONE = np.uint64(1)
_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_FIRST, _SECOND = np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)
_A, _B, _C, _UNUSED = np.uint64(30), np.uint64(27), np.uint64(31), np.uint64(11)
_UNIT = 2.0**-53


@Kernel
def word(seed, counter):
    """Return number `counter`, from 0 on, of the SplitMix64 sequence of a seed: 64 bits."""
    z = np.uint64(seed) + (np.uint64(counter) + _ONE) * _GOLDEN
    z = (z ^ (z >> _A)) * _FIRST
    z = (z ^ (z >> _B)) * _SECOND
    return z ^ (z >> _C)


@Kernel
def uniform(key, counter, stream):
    """Return a uniform random number in [0, 1), a multiple of 2^-53.

    Args:
        key: Key of the walker, any 64 bits.
        counter: Index of the number in its stream, an integer.
        stream: Index of one of the key's independent streams, an integer.
    """
    return np.float64(word(word(key, stream), counter) >> _UNUSED) * _UNIT


@Kernel
def normal(key, counter, stream):
    """Return a normal random number of mean 0 and standard deviation 1 (Box and Muller).

    Args:
        key: Key of the walker, any 64 bits.
        counter: Index of the number in its stream, an integer.
        stream: Index of one of the key's independent streams, an integer. `uniform` draws from
            the stream of this index too, so use an index for only one of the two functions.
    """
    drawn = word(word(key, stream), counter)
    radius = math.sqrt(-2.0 * math.log(1.0 - np.float64(drawn >> _UNUSED) * _UNIT))
    turn = np.float64(word(drawn, stream) >> _UNUSED) * _UNIT
    return radius * math.cos(2.0 * math.pi * turn)
