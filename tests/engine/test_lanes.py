"""Each walker of a batch moves as it does alone, to the last bit and on any CPU."""

from __future__ import annotations

import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from hashlib import sha256

import numpy as np
import pytest

from gym_passive_walker import WALKERS, Outcome, stride
from gym_passive_walker.engine import machine
from gym_passive_walker.engine.compiled import compiled, phases_of, written
from gym_passive_walker.engine.layout import HISTORY, TILE, WIDTH, aligned
from gym_passive_walker.engine.native import GROUP, Module
from gym_passive_walker.engine.run import (
    advance,
    in_parts,
    integrate,
    new_records,
    options,
    workspace,
)
from gym_passive_walker.gaits.flow import Walkers, flow
from gym_passive_walker.models.equations.systems import SYSTEMS
from gym_passive_walker.models.model import bodies
from tests.engine.machine import CPUS
from tests.equations import statements
from tests.equations.examples import LONG_GAITS, random_walker


def many(name: str, count: int, seed: int = 0):
    """Slopes, states and torques of walkers: strides, falls, extreme and resting states."""
    rng = np.random.default_rng(seed)
    walker, gait = WALKERS[name], LONG_GAITS[name]
    states = gait.state * (1.0 + rng.normal(size=(count, 6)) * rng.choice([0.02, 0.5], (count, 1)))
    states[:, 1] = states[:, 2] = -states[:, 0]
    states[::7] = rng.normal(scale=3.0, size=states[::7].shape)
    states[::11] = 0.0
    slopes = gait.slope + 0.02 * rng.normal(size=count)
    torques = rng.choice([0.0, 0.02], count) * rng.normal(size=count) * walker.units.torque
    return slopes, states, torques


def assert_bitwise_same(one, other) -> None:
    """Compare all fields of two strides, NaN for NaN."""
    for field in one._fields:
        np.testing.assert_array_equal(getattr(one, field), getattr(other, field), err_msg=field)


def pick(found, which):
    """Some of the strides of a batch."""
    return type(found)(*(value[which] if np.ndim(value) else value for value in found))


@pytest.mark.parametrize("name", WALKERS)
def test_a_walker_walks_alike_alone_and_in_a_batch(name):
    slopes, states, torques = many(name, 150)
    together = stride(name, slopes, states, hip_torque=torques)
    assert len(set(together.outcome)) >= 3
    for i in range(150):
        alone = stride(name, slopes[i], states[i], hip_torque=torques[i])
        assert_bitwise_same(alone, pick(together, i))


@pytest.mark.parametrize("name", WALKERS)
@pytest.mark.parametrize("count", [1, 7, 8, 9, 16, 17, 31, 129])
def test_it_does_not_matter_who_walks_beside_whom(name, count):
    slopes, states, torques = many(name, 150)
    together = stride(name, slopes, states, hip_torque=torques)
    which = np.random.default_rng(count).permutation(150)[:count]
    some = stride(name, slopes[which], states[which], hip_torque=torques[which])
    assert_bitwise_same(some, pick(together, which))


@pytest.mark.parametrize("name", WALKERS)
def test_threads_change_nothing(name):
    slopes, states, torques = many(name, 2100)
    one = stride(name, slopes, states, hip_torque=torques, threads=1)
    for threads in (2, 3, None):
        more = stride(name, slopes, states, hip_torque=torques, threads=threads)
        assert_bitwise_same(more, one)


def test_strides_that_many_threads_ask_for_are_those_that_one_asks_for():
    """Each thread has its own tile and guard history."""
    groups = {name: many(name, 300) for name in ("lab", "A", "D")}

    def walked(name):
        slopes, states, torques = groups[name]
        return stride(name, slopes, states, hip_torque=torques)

    alone = {name: walked(name) for name in groups}
    with ThreadPoolExecutor(6) as threads:
        found = [(name, threads.submit(walked, name)) for _ in range(20) for name in groups]
    for name, each in found:
        assert_bitwise_same(each.result(), alone[name])


def with_derivatives(name: str, count: int):
    """Records of a batch with tangents, before its strides."""
    walker, rng = WALKERS[name], np.random.default_rng(3)
    slopes, states, torques = many(name, count)
    scaled, along = statements.dimensionless(walker, states), np.zeros((count, 6, 4))
    along[:, :, :2] = rng.normal(size=(count, 6, 2))
    return flow(
        Walkers(walker=walker), scaled, slopes, controls=torques / walker.units.torque,
        by=("point", "slope", "hip_torque"), along=along, backend=lambda *_, **__: None,
    ).records  # fmt: skip


@pytest.mark.parametrize("name", ["lab", "A", "D"])
def test_derivatives_are_alike_alone_and_in_a_batch(name):
    walker, together = WALKERS[name], with_derivatives(name, 1030)
    system, own, single = walker.equations(), bodies(walker), together[:60].copy()
    parts = together.copy()
    with np.errstate(all="ignore"):
        advance(system, own, together, tolerance=1e-10, threads=1)
        advance(system, own, parts, tolerance=1e-10, threads=2)
        for i in range(len(single)):
            advance(system, own, single[i : i + 1], tolerance=1e-10)
    assert parts.tobytes() == together.tobytes()
    assert single.tobytes() == together[:60].tobytes()
    assert len(set(together["outcome"][:, 0])) >= 3


@pytest.mark.parametrize("name", ["lab", "A"])
def test_walkers_of_many_shapes_walk_alike_alone_and_together(name):
    rng = np.random.default_rng(5)
    system, count = WALKERS[name].equations(), 150
    slopes, states, _ = many(name, count)
    states = statements.dimensionless(WALKERS[name], states)
    shapes = bodies(*(random_walker(rng, knees=WALKERS[name].knees) for _ in range(count)))
    together = new_records(states, slopes, 0.01)
    advance(system, shapes, together, tolerance=1e-10)
    for i in range(count):
        alone = new_records(states[i : i + 1], slopes[i : i + 1], 0.01)
        advance(system, shapes[i : i + 1], alone, tolerance=1e-10)
        np.testing.assert_array_equal(alone[0], together[i])
    assert len(set(together["outcome"][:, 0])) >= 3


def test_one_shape_given_once_or_to_each_is_the_same():
    slopes, states, _ = many("lab", 40)
    states, system = statements.dimensionless(WALKERS["lab"], states), WALKERS["lab"].equations()
    own = bodies(WALKERS["lab"])
    once, each = new_records(states, slopes), new_records(states, slopes)
    advance(system, own, once, tolerance=1e-10)
    advance(system, np.repeat(own, 40, axis=0), each, tolerance=1e-10)
    np.testing.assert_array_equal(once, each)


@pytest.mark.parametrize("part", [np.s_[::2], np.s_[0]])
def test_records_of_another_form_are_refused(part):
    slopes, states, _ = many("D", 4)
    records = new_records(statements.dimensionless(WALKERS["D"], states), slopes)
    with pytest.raises(TypeError, match="records are a contiguous array of two axes"):
        advance(WALKERS["D"].equations(), bodies(WALKERS["D"]), records[part], tolerance=1e-8)


def test_a_walker_that_has_arrived_is_left_alone_by_ticks_of_the_others():
    """Records restart only where this is requested."""
    walker, gait = WALKERS["lab"], LONG_GAITS["lab"]
    state = statements.dimensionless(walker, gait.state)[None]
    records = new_records(np.repeat(state, 3, axis=0), gait.slope, end=[0.1, 1.0, 100.0])
    values = advance(walker.equations(), bodies(walker), records, tolerance=1e-10)[:, 0]
    assert list(values["outcome"]) == [Outcome.RUNNING, Outcome.RUNNING, Outcome.HEELSTRIKE]
    np.testing.assert_array_equal(values["time"][:2], [0.1, 1.0])
    assert values["time"][2] > 1.0
    values["end"][:2] += 0.1
    advance(walker.equations(), bodies(walker), records[:2], tolerance=1e-10, from_section=False)
    np.testing.assert_array_equal(values["time"][:2], [0.2, 1.1])
    assert list(values["outcome"]) == [Outcome.RUNNING, Outcome.RUNNING, Outcome.HEELSTRIKE]


def test_every_walker_is_taken_care_of_once_by_however_many_threads():
    for count in (0, 1, 1023, 2048, 5000, 100_000):
        for threads in (None, 1, 2, 7):
            seen = np.zeros(count, int)

            def job(first, last, seen=seen):
                seen[first:last] += 1

            in_parts(job, count, threads)
            assert (seen == 1).all()


def test_what_goes_wrong_in_a_thread_is_heard_of():
    def job(first, last):
        if last == 8192:
            raise RuntimeError("one of the last")

    with pytest.raises(RuntimeError, match="one of the last"):
        in_parts(job, 8192, 2)


def test_each_vector_of_a_tile_lies_in_one_line_of_the_cache():
    for count in range(1, 10):
        tiles = aligned(TILE, count)
        assert tiles.shape == (count,)
        assert not tiles.view(np.uint8).any()
        for name in TILE.names:
            assert tiles[name].ctypes.data % 64 == 0
    assert TILE.itemsize % 64 == 0
    assert WIDTH % GROUP == 0
    assert HISTORY["before"].shape == HISTORY["after"].shape


@pytest.mark.parametrize("name", ["lab", "A", "D"])
def test_it_does_not_matter_what_a_lane_held_before(name):
    """On a GPU the memory may hold any values."""
    slopes, states, _ = many(name, 60)
    walker, rng, found = WALKERS[name], np.random.default_rng(1), []
    for garbage in (0.0, 1.0, 30.0):
        records = new_records(walker.units.to_dimensionless(states), slopes)
        working = workspace()
        for place in working:
            numbers = place.view(float)
            numbers[:] = garbage * rng.normal(size=numbers.shape)
        phases, reported = (
            compiled(walker.equations().name),
            options(1e-6, from_section=True, scuff=True),
        )
        integrate(records, bodies(walker), phases, reported, *working)
        found.append(records.tobytes())
    assert found[0] == found[1] == found[2]


@pytest.mark.parametrize("name", ["D", pytest.param("lab", marks=pytest.mark.slow)])
@pytest.mark.parametrize("lanes", [2, 4])
def test_vectors_may_be_shorter(name, lanes):
    """Those of an ARM CPU hold two numbers."""
    slopes, states, _ = many(name, 60)
    states, own = statements.dimensionless(WALKERS[name], states), bodies(WALKERS[name])
    system = SYSTEMS[WALKERS[name].equations().name]
    code = machine.loaded(machine.object_code(written(system, module=Module(group=lanes))))
    found = []
    for phases in (compiled(system.name), phases_of(system, code, lanes)):
        records = new_records(states, slopes)
        integrate(records, own, phases, options(1e-10, from_section=True, scuff=True), *workspace())
        found.append(records.tobytes())
    assert compiled(system.name)["group"][0] == machine.group() != lanes
    assert found[0] == found[1]


DIGEST = """
from hashlib import sha256
from tests.engine.test_lanes import walk
print(sha256(walk({name!r}, {derivatives})).hexdigest())
"""


def walk(name: str, derivatives: bool) -> bytes:
    """Records of a batch after a stride, with derivatives or without."""
    walker, records = WALKERS[name], with_derivatives(name, 60)
    records = records[:, : None if derivatives else 1].copy()
    with np.errstate(all="ignore"):
        advance(walker.equations(), bodies(walker), records, tolerance=1e-10, threads=1)
    return records.tobytes()


@pytest.mark.parametrize(
    ("cpu", "name", "derivatives"),
    [
        *(("haswell", name, derivatives) for name in "DA" for derivatives in (False, True)),
        ("haswell", "lab", False),
        pytest.param("haswell", "lab", True, marks=pytest.mark.slow),
        # Without fused instructions, derivatives take minutes to compile.
        *(pytest.param("generic", name, False, marks=pytest.mark.slow) for name in ("D", "A")),
    ],
)
@pytest.mark.skipif(len(CPUS) < 3, reason="this CPU does not understand their code")
def test_a_walk_is_the_same_to_the_last_bit_on_another_cpu(cpu, name, derivatives):
    """With vectors of half the width, and without fused instructions."""
    done = subprocess.run(
        [sys.executable, "-c", DIGEST.format(name=name, derivatives=derivatives)],
        env={**os.environ, "NUMBA_CPU_NAME": cpu},
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert done.stdout.strip() == sha256(walk(name, derivatives)).hexdigest()
