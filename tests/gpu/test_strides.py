"""A walker on a device walks as on a CPU: to the last bit, where one computes as the other.

Numba's simulator of a device does; a device may fuse more products with sums, and rounds
differently then.
"""

import numpy as np
import pytest

import gym_passive_walker as gpw
from gym_passive_walker.devices import gpu
from gym_passive_walker.devices.gpu import device
from gym_passive_walker.devices.gpu.strides import advance_there
from gym_passive_walker.engine.layout import RECORD
from gym_passive_walker.engine.run import advance, new_records
from gym_passive_walker.models.equations.hybrid import Outcome
from gym_passive_walker.models.equations.systems import SYSTEMS
from tests.equations.examples import LONG_GAITS
from tests.equations.statements import KINDS
from tests.gpu.thrown import thrown


def carried(name, records, own, *, tolerance=1e-8, **given):
    """Records that a device has carried on."""
    there = device.upload(records)
    advance_there(SYSTEMS[name], device.upload(own), there, tolerance=tolerance, **given)
    return device.to_host(there)


def bits(records):
    """All of some records, as bytes."""
    return np.array(records).view(np.ndarray).tobytes()


@pytest.mark.parametrize("name", KINDS)
def test_a_stride_on_a_device_is_the_processors(name):
    own, records = thrown(name, 24)
    usual = advance(SYSTEMS[name], own, records.copy(), tolerance=1e-8)
    assert bits(carried(name, records, own)) == bits(usual)
    assert {Outcome.HEELSTRIKE, Outcome.FELL_FORWARD, Outcome.SWING_OVERROTATION} <= set(
        usual["outcome"].ravel().tolist()
    )


@pytest.mark.parametrize("count", [4, 5])
def test_walkers_need_not_fill_their_blocks_of_threads(count, monkeypatch):
    """The last threads of a block may have no walker."""
    monkeypatch.setattr(device, "THREADS_IN_BLOCK", 4)
    own, records = thrown("simplest", count)
    usual = advance(SYSTEMS["simplest"], own, records.copy(), tolerance=1e-8)
    assert bits(carried("simplest", records, own)) == bits(usual)


def test_every_outcome_comes_about_on_a_device_as_on_a_cpu():
    system = SYSTEMS["kneed"]
    own, records = thrown("kneed", 40, seed=1)
    slope, beyond = LONG_GAITS["C"].slope, records[:1].copy()
    beyond["state"][:, 0, 3:] = 1e200, -1e200, 1e200
    section = gpw.WALKERS["C"].units.to_dimensionless(LONG_GAITS["C"].state)
    hurried = new_records(section[None], slope, end=1.0)
    scuffing = new_records(section[None], slope)
    late = new_records(section * [[1.0, 1.0, 1.0, 1.4, 1.0, 2.0]], slope)
    everyone = np.concatenate([records, beyond, hurried, scuffing, late])
    found = set()
    for scuff in (False, True):
        usual = advance(system, own, everyone.copy(), tolerance=1e-6, scuff=scuff)
        there = carried("kneed", everyone, own, tolerance=1e-6, scuff=scuff)
        assert bits(there) == bits(usual)
        found |= set(usual["outcome"].ravel().tolist())
    assert found == set(Outcome) - {Outcome.KNEESTRIKE, Outcome.STALLED}


def test_a_walk_does_not_depend_on_who_walks_beside():
    own, records = thrown("kneed", 12)
    together = carried("kneed", records, own)
    apart = [carried("kneed", records[i : i + 1], own) for i in (3, 8)]
    assert [bits(one) for one in apart] == [bits(together[i : i + 1]) for i in (3, 8)]
    backwards = carried("kneed", records[::-1], own)
    assert bits(backwards[::-1]) == bits(together)


def test_walkers_of_one_batch_may_differ():
    own, records = thrown("straight", 6)
    each = np.repeat(own, 6, axis=0) * (1.0 + 0.01 * np.arange(6))[:, None, None]
    usual = advance(SYSTEMS["straight"], each, records.copy(), tolerance=1e-8)
    assert bits(carried("straight", records, each)) == bits(usual)


def test_a_tick_goes_on_from_where_it_was():
    own, records = thrown("kneed", 8, wild=0.01)
    records["end"] = 1.0
    usual = advance(SYSTEMS["kneed"], own, records.copy(), tolerance=1e-8)
    there = carried("kneed", records, own)
    for end in (1.7, 2.4, 6.0):
        usual["end"] = there["end"] = end
        usual = advance(SYSTEMS["kneed"], own, usual, tolerance=1e-8, from_section=False)
        there = carried("kneed", there, own, from_section=False)
        assert bits(there) == bits(usual)
    assert Outcome.HEELSTRIKE in usual["outcome"]


def test_both_entry_points_give_the_same_strides():
    gait = LONG_GAITS["C"]
    states = gait.state * np.linspace(0.9, 1.1, 5)[:, None]
    there = gpu.stride("C", gait.slope, states, hip_torque=0.01)
    usual = gpw.stride("C", gait.slope, states, hip_torque=0.01)
    for found, known in zip(there, usual, strict=True):
        np.testing.assert_array_equal(found, known)


def test_no_walkers_need_no_thread():
    """A GPU refuses a launch without threads."""
    device.launch(None, 0)
    assert gpu.stride("C", 0.036, np.zeros((0, 6))).state.shape == (0, 6)


def test_a_device_keeps_what_the_engine_keeps():
    kept = device.kind(RECORD)
    assert kept.itemsize == RECORD.itemsize
    assert {name: kept.fields[name][1] for name in kept.names} == {
        name: RECORD.fields[name][1] for name in RECORD.names
    }
