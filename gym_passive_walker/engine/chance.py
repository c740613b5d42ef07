"""Random numbers without a generator: each is a function of a key, a counter and a stream.

Who asks for a number need not know how many were asked for before, nor by whom. So what a walker
meets depends on its own key alone, however walkers are batched, shared out among threads or saved.
A stream of a key is a SplitMix64 generator (Steele, Lea and Flood 2014), which jumps anywhere.
"""

from __future__ import annotations

import math

import numpy as np

from gym_passive_walker.engine.jit import Kernel

# Numba makes a float of an unsigned number and a signed one, so everything here is unsigned.
_ONE = np.uint64(1)
_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_FIRST, _SECOND = np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)
_A, _B, _C, _UNUSED = np.uint64(30), np.uint64(27), np.uint64(31), np.uint64(11)
_UNIT = 2.0**-53


@Kernel
def word(seed, counter):
    """SplitMix64's number of this place, from 0 on, in the sequence of a seed: 64 bits."""
    z = np.uint64(seed) + (np.uint64(counter) + _ONE) * _GOLDEN
    z = (z ^ (z >> _A)) * _FIRST
    z = (z ^ (z >> _B)) * _SECOND
    return z ^ (z >> _C)


@Kernel
def uniform(key, counter, stream):
    """A number from 0 to below 1, every multiple of 2^-53 as likely as every other.

    Args:
        key: Whose numbers these are: any 64 bits.
        counter: Which of them, an integer.
        stream: Which of the key's independent sequences, an integer.
    """
    return np.float64(word(word(key, stream), counter) >> _UNUSED) * _UNIT


@Kernel
def normal(key, counter, stream):
    """A number of mean 0 and standard deviation 1, normally distributed (Box and Muller).

    Args:
        key: Whose numbers these are: any 64 bits.
        counter: Which of them, an integer.
        stream: Which of the key's independent sequences, an integer; that of `uniform` of the same
            number is no other, so use each for one of the two.
    """
    drawn = word(word(key, stream), counter)
    radius = math.sqrt(-2.0 * math.log(1.0 - np.float64(drawn >> _UNUSED) * _UNIT))
    turn = np.float64(word(drawn, stream) >> _UNUSED) * _UNIT
    return radius * math.cos(2.0 * math.pi * turn)
