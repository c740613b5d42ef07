"""Comparison of two sweeps."""

import numpy as np


def same(one, other):
    """Whether two sweeps have the same results, to the last bit, without durations."""
    one, other = one.columns(), other.columns()
    assert list(one) == list(other)
    for name in one.keys() - {"seconds", "version", "sweep"}:
        np.testing.assert_array_equal(one[name], other[name], err_msg=name)
