"""When two sweeps have found the same."""

import numpy as np


def same(one, other):
    """Whether two sweeps found the same, to the last bit; how long it took is nobody's promise."""
    one, other = one.columns(), other.columns()
    assert list(one) == list(other)
    for name in one.keys() - {"seconds", "version", "sweep"}:
        np.testing.assert_array_equal(one[name], other[name], err_msg=name)
