"""Sweeps of the tasks of `odd_tasks`, and comparison of two sweeps."""

import numpy as np

import gym_passive_walker as gpw


def odd_sweep(name, out, x, **options):
    """A sweep of a task over values of x, or over as many whole numbers, by one worker."""
    over = {"x": list(range(x)) if isinstance(x, int) else x}
    usual = {"trust": True, "workers": 1, "over": over}
    return gpw.sweep(f"odd_tasks:{name}", out, **usual | options)


def same(one, other):
    """Whether two sweeps have the same results, to the last bit, without durations."""
    one, other = one.columns(), other.columns()
    assert list(one) == list(other)
    for name in one.keys() - {"seconds", "version", "sweep"}:
        np.testing.assert_array_equal(one[name], other[name], err_msg=name)
