"""Walkers side by side: each walks bitwise as it does alone; sine and cosine are exact enough."""

from __future__ import annotations

import math

import numba
import numpy as np
import pytest
from gym_passive_walker.physics.engine import advance
from gym_passive_walker.units import units_of
from gym_passive_walker.physics.lanes import align_stack, new_tile, sine_cosine
from gym_passive_walker.physics.record import new_records
from hypothesis import given
from hypothesis import strategies as st

from gym_passive_walker import WALKERS, Outcome, stride
from gym_passive_walker.physics import constants as K
from gym_passive_walker.physics import record as R
from tests.physics import statements
from tests.physics.examples import LONG_GAITS, random_walker


def crowd(name: str, count: int, seed: int = 0):
    """Slopes, states and torques of many walkers of a kind: strides, falls, throws, rests."""
    rng = np.random.default_rng(seed)
    walker, gait = WALKERS[name], LONG_GAITS[name]
    states = gait.state * (1.0 + rng.normal(size=(count, 6)) * rng.choice([0.02, 0.5], (count, 1)))
    states[:, 1] = states[:, 2] = -states[:, 0]
    states[::7] = rng.normal(scale=3.0, size=states[::7].shape)
    states[::11] = 0.0
    slopes = gait.slope + 0.02 * rng.normal(size=count)
    torques = rng.choice([0.0, 0.02], count) * rng.normal(size=count) * units_of(walker).torque
    return slopes, states, torques


def assert_bitwise_same(one, other) -> None:
    """Compare all fields of two strides, NaN for NaN."""
    for field in one._fields:
        np.testing.assert_array_equal(getattr(one, field), getattr(other, field), err_msg=field)


def pick(found, which):
    """Some of the strides of a batch."""
    return type(found)(*(value[which] if np.ndim(value) else value for value in found))


@pytest.mark.parametrize("name", WALKERS)
def test_a_walker_walks_alike_alone_and_in_a_crowd(name):
    slopes, states, torques = crowd(name, 150)
    together = stride(name, slopes, states, hip_torque=torques)
    assert len(set(together.outcome)) >= 3
    for i in range(150):
        alone = stride(name, slopes[i], states[i], hip_torque=torques[i])
        assert_bitwise_same(alone, pick(together, i))


@pytest.mark.parametrize("name", WALKERS)
@pytest.mark.parametrize("count", [1, 7, 8, 9, 16, 17, 31, 129])
def test_it_does_not_matter_who_walks_beside_whom(name, count):
    slopes, states, torques = crowd(name, 150)
    together = stride(name, slopes, states, hip_torque=torques)
    which = np.random.default_rng(count).permutation(150)[:count]
    some = stride(name, slopes[which], states[which], hip_torque=torques[which])
    assert_bitwise_same(some, pick(together, which))


@pytest.mark.parametrize("name", WALKERS)
def test_threads_change_nothing(name):
    slopes, states, torques = crowd(name, 2100)
    one = stride(name, slopes, states, hip_torque=torques, threads=1)
    for threads in (2, 3, None):
        more = stride(name, slopes, states, hip_torque=torques, threads=threads)
        assert_bitwise_same(more, one)


@pytest.mark.parametrize("name", ["lab", "A"])
def test_walkers_of_many_shapes_walk_alike_alone_and_together(name):
    rng = np.random.default_rng(5)
    kind, count = K.kind_of(WALKERS[name]), 150
    slopes, states, _ = crowd(name, count)
    states = statements.dimensionless(WALKERS[name], states)
    shapes = [random_walker(rng, knees=WALKERS[name].knees) for _ in range(count)]
    constants = np.array([K.constants(walker) for walker in shapes])
    together = new_records(states, slopes, 0.01)
    advance(kind, constants, together, tolerance=1e-10)
    for i in range(count):
        alone = new_records(states[i : i + 1], slopes[i : i + 1], 0.01)
        advance(kind, constants[i : i + 1], alone, tolerance=1e-10)
        np.testing.assert_array_equal(alone[0], together[i])
    assert len(set(together[:, R.OUTCOME])) >= 3


def test_one_shape_given_once_or_to_each_is_the_same():
    slopes, states, _ = crowd("lab", 40)
    states = statements.dimensionless(WALKERS["lab"], states)
    constants = K.constants(WALKERS["lab"])[None]
    once, each = new_records(states, slopes), new_records(states, slopes)
    advance(K.Kind.KNEED, constants, once, tolerance=1e-10)
    advance(K.Kind.KNEED, np.repeat(constants, 40, axis=0), each, tolerance=1e-10)
    np.testing.assert_array_equal(once, each)


def test_a_walker_that_has_arrived_is_left_alone_by_ticks_of_the_others():
    """Records start again only where they are asked to."""
    gait = LONG_GAITS["lab"]
    state = statements.dimensionless(WALKERS["lab"], gait.state)[None]
    records = new_records(np.repeat(state, 3, axis=0), np.full(3, gait.slope))
    records[:, R.END] = [0.1, 1.0, 100.0]
    advance(K.Kind.KNEED, K.constants(WALKERS["lab"])[None], records, tolerance=1e-10)
    assert list(records[:, R.OUTCOME]) == [Outcome.RUNNING, Outcome.RUNNING, Outcome.HEELSTRIKE]
    np.testing.assert_array_equal(records[:2, R.TIME], [0.1, 1.0])
    assert records[2, R.TIME] > 1.0


@numba.njit
def sines_cosines(angles):
    """Both of an array of angles."""
    result = np.empty((2, len(angles)))
    for i in range(len(angles)):
        result[0, i], result[1, i] = sine_cosine(angles[i])
    return result


def test_sine_and_cosine_are_right_to_the_last_bit_or_so():
    """Against the mathematical library, whose own error is half a last bit."""
    rng = np.random.default_rng(6)
    halves = 0.5 * np.pi * np.arange(-636, 637)
    angles = np.concatenate(
        [
            np.linspace(-1000.0, 1000.0, 100_001),
            rng.uniform(-4.0, 4.0, 100_000),
            halves,
            np.nextafter(halves, np.inf),
            np.nextafter(halves, -np.inf),
        ]
    )
    found = sines_cosines(angles)
    expected = [[function(x) for x in angles] for function in (math.sin, math.cos)]
    assert np.abs(found - expected).max() <= 2.5e-16


def test_the_sine_of_a_small_angle_keeps_all_its_digits():
    angles = np.concatenate([np.logspace(-320, -1, 2000), -np.logspace(-320, -1, 2000)])
    found = sines_cosines(angles)[0]
    expected = [math.sin(x) for x in angles]
    np.testing.assert_allclose(found, expected, rtol=2.5e-16, atol=0.0)


def test_sine_and_cosine_of_zero_are_exact():
    np.testing.assert_array_equal(sines_cosines(np.zeros(1)), [[0.0], [1.0]])


@given(angle=st.floats(-1000.0, 1000.0))
def test_sine_is_odd_and_cosine_even(angle):
    (sine, other_sine), (cosine, other_cosine) = sines_cosines(np.array([angle, -angle]))
    assert other_sine == -sine
    assert other_cosine == cosine


def test_sine_and_cosine_of_no_number_are_none():
    assert np.all(np.isnan(sines_cosines(np.array([np.nan, np.inf, -np.inf]))))


@pytest.mark.parametrize("numbers", [np.float64, np.complex128])
def test_each_vector_of_a_tile_lies_in_one_line_of_the_cache(numbers):
    tiles = [new_tile(rows, np.zeros(1, numbers)) for rows in range(1, 101)]
    assert all(tile.ctypes.data % 64 == 0 and not tile.any() for tile in tiles)


def test_vectors_on_the_stack_are_aligned_on_request():
    @numba.njit
    def aligned(x):
        align_stack()
        return x

    assert aligned(1.0) == 1.0
    assert "alignstack(64)" in aligned.inspect_llvm(aligned.signatures[0])
