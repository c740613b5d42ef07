"""Native code computes the models in plain Python, in every lane and equally on every CPU."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from gym_passive_walker import Outcome
from gym_passive_walker.engine.compiled import compiled, constants_used
from gym_passive_walker.engine.layout import HISTORY, PAIR, RECORD, TILE, WIDTH, aligned
from gym_passive_walker.engine.native import FEW, GROUP, Memory
from gym_passive_walker.engine.one_lane import first_where
from gym_passive_walker.engine.step import ALERT, LONGEST_STEP, PLAIN, UP
from gym_passive_walker.models.equations import legs
from gym_passive_walker.models.equations.hybrid import SMOOTH, Control, Ground, State, System
from gym_passive_walker.models.equations.numbers import sine_cosine
from gym_passive_walker.models.equations.systems import SYSTEMS
from gym_passive_walker.models.expressions import choose, inverse_root, read, square_root
from tests.engine.machine import CPUS, Native, call, evaluate, in_lanes, rows
from tests.equations.statements import KINDS
from tests.equations.test_statements import PHASES, some_state, some_walker

NUMBERS = np.random.default_rng(1).normal(size=(3, 200)) * 10.0 ** np.random.default_rng(
    2
).integers(-8, 8, (3, 200))


def inverse_root_in_plain(x: float, order: int) -> float:
    """The estimate from the bits of a number, in Python."""
    whole = read({}, "x")
    return evaluate(inverse_root(whole, order), {whole: x})


PLAIN_OPERATIONS = {
    "sum": (lambda x, y, z: x + y, lambda x, y, z: x + y),
    "difference": (lambda x, y, z: x - y, lambda x, y, z: x - y),
    "product": (lambda x, y, z: x * y, lambda x, y, z: x * y),
    "quotient": (lambda x, y, z: x / y, lambda x, y, z: x / y),
    "opposite": (lambda x, y, z: -x, lambda x, y, z: -x),
    "size": (lambda x, y, z: abs(x), lambda x, y, z: abs(x)),
    "root": (lambda x, y, z: square_root(abs(x)), lambda x, y, z: np.sqrt(abs(x))),
    "one over a root, roughly": (
        lambda x, y, z: inverse_root(abs(x), 8),
        lambda x, y, z: inverse_root_in_plain(abs(x), 8),
    ),
    "less": (lambda x, y, z: choose(x < y, x, z), lambda x, y, z: x if x < y else z),
    "not more": (lambda x, y, z: choose(x <= y, x, z), lambda x, y, z: x if x <= y else z),
    "more": (lambda x, y, z: choose(x > y, x, 2.0), lambda x, y, z: x if x > y else 2.0),
    "not less": (lambda x, y, z: choose(x >= y, -1.0, z), lambda x, y, z: -1.0 if x >= y else z),
    "both": (
        lambda x, y, z: choose((x < y) & (y < z), x, y),
        lambda x, y, z: x if x < y and y < z else y,
    ),
    "either": (
        lambda x, y, z: choose((x < y) | (y < z), x, y),
        lambda x, y, z: x if x < y or y < z else y,
    ),
    "neither": (
        lambda x, y, z: choose(~((x < y) | (y < z)), x, y),
        lambda x, y, z: y if x < y or y < z else x,
    ),
}

everywhere = pytest.mark.parametrize("cpu", CPUS)


@everywhere
@pytest.mark.parametrize("name", PLAIN_OPERATIONS)
def test_an_operation_does_what_python_does(name, cpu):
    native, plain = PLAIN_OPERATIONS[name]
    (found,) = in_lanes(lambda *xyz: [native(*xyz)], *NUMBERS, cpu=cpu)[:1]
    np.testing.assert_array_equal(found, [plain(*xyz) for xyz in NUMBERS.T])


@everywhere
@pytest.mark.parametrize("count", [1, 7, 64])
def test_code_over_rows_goes_through_two_arrays_and_no_further(count, cpu):
    given = np.dtype([("x", "f8", (3,)), ("whole", "i8"), ("kept", "f8")])
    made = np.dtype([("sum", "f8"), ("left", "f8"), ("larger", "f8")])

    def code(first: Memory, second: Memory) -> None:
        x, y, z = first.entries("x")
        second["sum"] = x + y * z + first["whole"]
        second["larger"] = choose(x > y, x, y)
        first["whole"] = first["whole"] + 1.0

    rng, extra = np.random.default_rng(5), 3
    first, second = np.zeros(count + extra, given), np.zeros(count + extra, made)
    first["x"], first["kept"] = rng.normal(size=(count + extra, 3)), rng.normal(size=count + extra)
    first["whole"] = rng.integers(-9, 9, count + extra)
    second["left"] = rng.normal(size=count + extra)
    before, begun = first.copy(), second.copy()
    Native(code, given, made, over_rows=True, cpu=cpu)(first, second, count)
    x, y, z = before["x"][:count].T
    np.testing.assert_allclose(second["sum"][:count], x + y * z + before["whole"][:count])
    np.testing.assert_array_equal(second["larger"][:count], np.maximum(x, y))
    before["whole"][:count] += 1
    np.testing.assert_array_equal(first, before)
    np.testing.assert_array_equal(second["left"], begun["left"])
    np.testing.assert_array_equal(second[count:], begun[count:])


def test_what_does_not_compare_is_neither_more_nor_less():
    nothing, one = np.full(8, np.nan), np.ones(8)
    found = in_lanes(
        lambda x, y: [choose(c, 1.0, 0.0) for c in (x < y, x <= y, x > y, x >= y, ~(x <= y))],
        nothing,
        one,
    )
    np.testing.assert_array_equal(found[:5].T, np.tile([0.0, 0.0, 0.0, 0.0, 1.0], (8, 1)))


FUSED = {
    "product + z": lambda x, y, z: x * y + z,
    "z + product": lambda x, y, z: z + x * y,
    "product - z": lambda x, y, z: x * y - z,
    "z - product": lambda x, y, z: z - x * y,
}


@everywhere
@pytest.mark.parametrize("name", FUSED)
def test_a_product_that_only_a_sum_needs_is_rounded_with_it(name, cpu):
    (found,) = in_lanes(lambda *xyz: [FUSED[name](*xyz)], *NUMBERS, cpu=cpu)[:1]
    exact = [float(FUSED[name](*map(Fraction, xyz))) for xyz in NUMBERS.T]
    np.testing.assert_array_equal(found, exact)
    assert np.any(found != FUSED[name](*NUMBERS))


@everywhere
def test_a_product_that_others_need_too_is_rounded_once_for_all(cpu):
    found = in_lanes(lambda x, y, z: [x * y + z, x * y - z, x * y], *NUMBERS, cpu=cpu)
    x, y, z = NUMBERS
    np.testing.assert_array_equal(found[:3], [x * y + z, x * y - z, x * y])


def formula(x, y, z):
    """A formula with each operation."""
    sine, cosine = sine_cosine(x * y + z)
    root = square_root(1.0 + z * z) if hasattr(z, "op") else np.sqrt(1.0 + z * z)
    return [sine * x - cosine / root, abs(cosine - y) * root, x * y + sine * (y - 3.0 * z)]


def test_cpus_agree_to_the_last_bit():
    some = np.random.default_rng(3).normal(size=(3, 1000)) * 5.0
    here = in_lanes(formula, *some)[:3]
    for cpu in CPUS:
        np.testing.assert_array_equal(in_lanes(formula, *some, cpu=cpu)[:3], here)
    np.testing.assert_allclose(here, formula(*some), rtol=1e-12, atol=1e-14)


@everywhere
def test_lanes_agree_with_a_number_by_itself(cpu):
    """In any lane, and in code for one lane of a tile."""
    layout = rows(given=3, found=3)

    def code(tile: Memory, *_) -> None:
        for i, result in enumerate(formula(*(tile["given", i] for i in range(3)))):
            tile["found", i] = result

    numbers = np.dtype([("given", "f8", (3,)), ("found", "f8", (3,))])
    together = Native(code, layout, lanes=True, cpu=cpu)
    one_lane = Native(code, layout, lane=True, cpu=cpu)
    single = Native(code, numbers, cpu=cpu)
    tile = aligned(layout, 1)
    tile["given"] = np.random.default_rng(4).normal(size=tile["given"].shape)
    for group in range(WIDTH // GROUP):
        call(together.address, tile.view(np.uint8)[8 * GROUP * group :], together.table)
    by_vectors = tile["found"][0].copy()
    for lane in range(WIDTH):
        record = np.zeros(1, numbers)
        record["given"] = tile["given"][0, :, lane]
        single(record)
        np.testing.assert_array_equal(record["found"][0], by_vectors[:, lane])
        tile["found"] = 0.0
        call(one_lane.address, tile, 0, lane)
        np.testing.assert_array_equal(tile["found"][0, :, lane], by_vectors[:, lane])
        assert np.count_nonzero(tile["found"]) == 3


def test_all_is_read_before_anything_is_written():
    def swap(memory: Memory) -> None:
        a, b = memory["pair", 0], memory["pair", 1]
        memory["pair", 0], memory["pair", 1] = b, a
        memory["total"] = memory["pair", 0] - 2.0 * memory["pair", 1]  # as they will be

    record = np.zeros(1, np.dtype([("pair", "f8", (2,)), ("total", "f8")]))
    record["pair"] = 3.0, 5.0
    Native(swap, record.dtype)(record)
    assert record["pair"].tolist() == [[5.0, 3.0]]
    assert record["total"] == -1.0


def test_whole_numbers_stay_whole_and_arguments_arrive():
    def code(memory: Memory) -> None:
        memory["count"] = memory["count"] + memory.argument(0) * memory.argument(1)

    record = np.zeros(1, np.dtype([("count", "i8")]))
    record["count"] = 40
    Native(code, record.dtype)(record, x=0.5, y=4.0)
    assert record["count"] == 42


def test_tangents_behind_the_values_hold_their_derivatives():
    layout = np.dtype([("given", "f8", (2,)), ("found", "f8", (2,)), ("still", "f8")])

    def code(memory: Memory) -> None:
        x, y = memory.entries("given")
        memory["found", 0] = x * sine_cosine(y)[0]
        memory["found", 1] = 7.0
        memory["still"] = x

    native = Native(code, layout, active=("given", "found"))
    records = np.zeros(3, layout)
    records["found"][:, 1] = records["still"] = 9.0
    records["given"] = [[0.4, 0.7], [1.0, 0.0], [0.5, -2.0]]
    native(records, tangents=2)
    x, y = 0.4, 0.7
    expected = [x * np.sin(y), np.sin(y), 0.5 * np.sin(y) - 2.0 * x * np.cos(y)]
    np.testing.assert_allclose(records["found"][:, 0], expected, rtol=1e-15)
    assert records["found"][:, 1].tolist() == [7.0, 0.0, 0.0]
    assert records["still"].tolist() == [0.4, 9.0, 9.0]  # not active: its tangents are left alone


# Whole systems.


def some_ground(rng, system: System, slope: float) -> Ground:
    """A slope, and where there may be one a next foothold that is higher or lower, or tilted."""
    uneven = rng.uniform(-0.05, 0.05, 2) if "height_change" not in system.absent else (0.0, 0.0)
    return Ground(np.sin(slope), np.cos(slope), *uneven)


every_phase = pytest.mark.parametrize(("system", "index"), PHASES)


class Filled:
    """A tile full of random walkers, one in each lane, and the arguments of the models."""

    def __init__(self, system: System, index: int, seed: int, tangents: int = 0) -> None:
        rng, phase = np.random.default_rng(seed), system.phases[index]
        self.system, self.phase, self.links = system, phase, phase.links
        self.bodies = [some_walker(rng, system).body for _ in range(WIDTH)]
        self.states = [some_state(rng, phase.links) for _ in range(WIDTH)]
        self.moving = [i for i, name in enumerate(Control._fields) if name not in system.absent]
        self.controls = [self.held(rng.normal(size=len(Control._fields))) for _ in range(WIDTH)]
        slopes = rng.uniform(-0.5, 0.5, WIDTH)
        self.grounds = [some_ground(rng, system, slope) for slope in slopes]
        self.tile = tile = aligned(TILE, tangents + 1)
        names = constants_used(system, phase)
        for lane in range(WIDTH):
            tile["angle"][0, :, lane] = self.states[lane][:3]
            tile["rate"][0, :, lane] = self.states[lane][3:]
            tile["control"][0, :, lane] = self.controls[lane]
            tile["ground"][0, :, lane] = self.grounds[lane]
            own = [getattr(self.bodies[lane], name) for name in names]
            tile["body"][0, : len(names), lane] = own
        tile["fresh"][0] = 1.0
        tile["end"][0] = 100.0
        self.tangents, self.code = tangents, compiled(system.name, derived=tangents > 0)[index]

    def held(self, controls) -> Control:
        """Those of some controls that there are; the others are zero."""
        return Control(*(x if i in self.moving else 0.0 for i, x in enumerate(controls)))

    def run(self, function: str, fineness: float = 2.0, group: int = GROUP) -> None:
        """Call one of the phase's functions for all lanes."""
        for lane in range(0, WIDTH, group):
            here = self.tile.view(np.uint8)[8 * lane :]
            table, tangents = self.code["table"], self.tangents
            call(self.code[function], here, table, 0, fineness, 1.0, tangents=tangents)

    def accelerations(self, lane: int, state: State) -> np.ndarray:
        """What is stated."""
        return np.array(
            self.phase.accelerations(
                self.bodies[lane], state, self.controls[lane], self.grounds[lane]
            )
        )

    def state(self, angles, rates) -> State:
        """A state from what moves by itself."""
        last = self.links - 1
        return State(*(v[min(i, last)] for v in (angles, rates) for i in range(3)))


@every_phase
def test_accelerations_are_as_stated_in_every_lane(system, index):
    for seed in range(20):
        filled = Filled(system, index, seed)
        filled.run("first")
        for lane, state in enumerate(filled.states):
            stated = filled.accelerations(lane, state)
            found = filled.tile["stage"][0, 0, : filled.links, lane]
            np.testing.assert_allclose(found, stated, rtol=0.0, atol=1e-13 * np.abs(stated).max())
        assert not filled.tile["fresh"].any()


@every_phase
def test_lanes_in_use_keep_their_first_stage(system, index):
    filled = Filled(system, index, 1)
    filled.tile["fresh"][0, ::2] = 0.0
    filled.run("first")
    stage = filled.tile["stage"][0, 0, : filled.links]
    assert not stage[:, ::2].any()
    assert stage[:, 1::2].all()


@every_phase
def test_derivatives_of_accelerations_are_those_of_a_complex_step(system, index):
    tangents, rng = 3, np.random.default_rng(5)
    filled = Filled(system, index, 2, tangents)
    tile, names = filled.tile, constants_used(system, filled.phase)
    for field in ("angle", "rate", "control", "ground", "body"):
        tile[field][1:] = rng.normal(size=tile[field][1:].shape)
    filled.run("first")
    for lane in range(WIDTH):
        for tangent in range(1, tangents + 1):
            change, tiny = tile[tangent], 1e-100j

            def moved(value, row, lane=lane, tiny=tiny):
                return type(value)(
                    *(x + tiny * d for x, d in zip(value, row[:, lane], strict=False))
                )

            last = filled.links - 1
            angles, rates = change["angle"][:, lane], change["rate"][:, lane]
            state = State(
                *np.array(filled.states[lane]) + tiny * np.array(filled.state(angles, rates))
            )
            body = filled.bodies[lane]
            own = {
                n: getattr(body, n) + tiny * change["body"][i, lane] for i, n in enumerate(names)
            }
            stated = filled.phase.accelerations(
                body._replace(**own),
                state,
                filled.held(moved(filled.controls[lane], change["control"])),
                moved(filled.grounds[lane], change["ground"]),
            )
            expected = np.imag(stated) / 1e-100
            found = tile["stage"][tangent, 0, : last + 1, lane]
            np.testing.assert_allclose(
                found, expected, rtol=0.0, atol=1e-11 * (1.0 + np.abs(expected).max())
            )


@every_phase
def test_a_sweep_makes_the_pairs_step_and_estimates_its_error(system, index):
    """Against the same sums in NumPy, stage by stage."""
    filled, fineness = Filled(system, index, 3), 3.0
    tile, links = filled.tile, filled.links
    h = np.random.default_rng(6).uniform(0.02, 0.08, WIDTH)
    tile["h"][0] = h
    filled.run("first")
    filled.run("sweep", fineness)
    rates, weights = (np.asarray(x, float) for x in (PAIR.weights, PAIR.error))
    angles = rates @ rates[:-1]
    for lane, state in enumerate(filled.states):
        q, v = np.array(state[:links]), np.array(state[3 : 3 + links])
        stages = np.zeros((PAIR.stages, links))
        for i in range(PAIR.stages + 1):
            at = q + h[lane] * float(PAIR.nodes[i]) * v + h[lane] ** 2 * angles[i] @ stages
            speed = v + h[lane] * rates[i] @ stages
            if i < PAIR.stages:
                stages[i] = filled.accelerations(lane, filled.state(at, speed))
        scale = np.abs([at, speed]).max()
        found = tile["new_angle"][0, :links, lane], tile["new_rate"][0, :links, lane]
        np.testing.assert_allclose(found, [at, speed], rtol=0.0, atol=1e-12 * scale)
        error = np.abs(h[lane] * weights @ stages).sum() / scale
        reported = tile["error"][0, lane] / fineness
        assert reported == pytest.approx(error, rel=1e-4, abs=1e-15)  # rounding
        assert error > 0.0


@every_phase
@pytest.mark.parametrize("tangents", [0, 2])
def test_a_step_of_a_few_walkers_has_the_bits_of_a_step_of_many(system, index, tangents):
    tiles = []
    for sweep, group in (("sweep", GROUP), ("sweep_few", FEW)):
        filled = Filled(system, index, 5, tangents)
        filled.tile["h"][0] = np.linspace(0.01, 0.5, WIDTH)
        filled.run("first")
        filled.run(sweep, group=group)
        tiles.append(filled.tile.tobytes())
    assert tiles[0] == tiles[1]


@every_phase
def test_the_judge_takes_a_plain_step_and_leaves_any_other_to_be_looked_at(system, index):
    """Accepted where nothing can have happened; time is up where the step has used it up."""
    filled = Filled(system, index, 4)
    tile, links = filled.tile, filled.links
    tile["h"][0] = 0.01
    tile["next"][0] = 0.02
    tile["end"][0, ::2] = 0.01
    filled.run("first")
    filled.run("sweep")
    verdicts = set()
    for lane, state in enumerate(filled.states):
        end = filled.state(tile["new_angle"][0, :, lane], tile["new_rate"][0, :, lane])
        body, verdict = filled.bodies[lane], tile["verdict"][0, lane]
        verdicts.add(verdict)
        kept = tile["angle"][0, :links, lane]
        if verdict == ALERT:
            np.testing.assert_array_equal(kept, state[:links])
            assert tile["time"][0, lane] == 0.0
            assert tile["h"][0, lane] == 0.01
            continue
        assert verdict == (UP if lane % 2 == 0 else PLAIN)
        for guard in filled.phase.guards:
            before, after = (guard.falls(body, at, filled.grounds[lane]) for at in (state, end))
            assert not before > 0.0 >= after
        assert tile["error"][0, lane] <= 1.0
        np.testing.assert_array_equal(kept, tile["new_angle"][0, :links, lane])
        np.testing.assert_array_equal(
            tile["stage"][0, 0, :links, lane], tile["stage"][0, PAIR.stages, :links, lane]
        )
        assert tile["time"][0, lane] == 0.01
        travel = np.subtract(system.travel(end), system.travel(state))[filled.moving]
        moved, turned = (tile[name][0, filled.moving, lane] for name in ("moved", "turned"))
        np.testing.assert_allclose(moved, travel, rtol=1e-12)
        np.testing.assert_allclose(turned, np.abs(travel), rtol=1e-12)
        assert 0.01 < tile["next"][0, lane] <= LONGEST_STEP
    assert {PLAIN, UP} <= verdicts
    assert (tile["steps"][0] == 1.0).all()


@every_phase
def test_a_guard_that_falls_within_a_step_is_always_looked_at(system, index):
    fell = 0
    for seed in range(10):
        filled = Filled(system, index, 100 + seed)
        tile = filled.tile
        tile["h"][0] = np.random.default_rng(seed).uniform(0.01, 0.6, WIDTH)
        filled.run("first")
        filled.run("sweep", 1.5)
        for lane, state in enumerate(filled.states):
            end = filled.state(tile["new_angle"][0, :, lane], tile["new_rate"][0, :, lane])
            body, ground = filled.bodies[lane], filled.grounds[lane]
            for guard in filled.phase.guards:
                counts = all(where(body, end, ground) > 0.0 for where in guard.where)
                if counts and guard.falls(body, state, ground) > 0.0 >= guard.falls(
                    body, end, ground
                ):
                    assert tile["verdict"][0, lane] == ALERT
                    fell += 1
    assert fell > 3


STENCIL = {1: 3 / 4, 2: -3 / 20, 3: 1 / 60}
"""Central differences of order six."""


def rate_at(function, state: State, bends, time: float) -> float:
    """Time derivative of a function of the state, some time along its motion of second order."""
    angles, rates, bends = np.array(state[:3]), np.array(state[3:]), np.array(bends)
    then = rates + time * bends
    there = angles + time * (rates + 0.5 * time * bends)
    return np.imag(function(State(*(there + 1e-100j * then), *then))) / 1e-100


@every_phase
def test_a_look_tells_how_guards_and_controls_run_over_a_step(system, index):
    filled = Filled(system, index, 7)
    tile, history = filled.tile, np.zeros(1, HISTORY)
    tile["h"][0] = 0.03
    filled.run("first")
    filled.run("sweep")
    # As during the check of a step: its start is kept.
    for lane, state in enumerate(filled.states):
        tile["angle"][0, :, lane], tile["rate"][0, :, lane] = state[:3], state[3:]
        tile["stage"][0, 0, : filled.links, lane] = filled.accelerations(lane, state)
    for lane, state in enumerate(filled.states):
        body = filled.bodies[lane]
        call(filled.code["look"], tile, history, lane)
        end = filled.state(tile["new_angle"][0, :, lane], tile["new_rate"][0, :, lane])
        guards, ground = filled.phase.guards, filled.grounds[lane]
        functions = {
            **{
                i: lambda s, falls=guard.falls, b=body, g=ground: falls(b, s, g)
                for i, guard in enumerate(guards)
            },
            **{len(guards) + i: lambda s, i=i: system.travel(s)[i] for i in filled.moving},
            **{
                first_where(system, filled.phase, i) + k: lambda s, where=where, b=body, g=ground: (
                    where(b, s, g)
                )
                for i, guard in enumerate(guards)
                for k, where in enumerate(guard.where)
            },
        }
        for when, at in (("before", state), ("after", end)):
            bends = filled.accelerations(lane, at)
            bends = [bends[min(i, filled.links - 1)] for i in range(3)]
            for i, function in functions.items():
                assert history[when][0, i] == pytest.approx(function(at), rel=1e-13, abs=1e-14)
                flow = State(*at[3:], *bends)
                step = State(*(x + 1e-100j * v for x, v in zip(at, flow, strict=True)))
                rate = np.imag(function(step)) / 1e-100
                assert history[f"rate_{when}"][0, i] == pytest.approx(rate, rel=1e-13, abs=1e-14)
                bend = sum(
                    weight
                    / 1e-4
                    * (
                        rate_at(function, at, bends, 1e-4 * k)
                        - rate_at(function, at, bends, -1e-4 * k)
                    )
                    for k, weight in STENCIL.items()
                )
                found = history[f"bend_{when}"][0, i]
                assert found == pytest.approx(bend, rel=1e-10, abs=1e-10)


STRIKES = [
    pytest.param(system, index, outcome, id=f"{name}-{outcome.name}")
    for name, system in KINDS.items()
    for index, phase in enumerate(system.phases)
    for outcome in phase.resets
]


def strike(code, outcome, record, body, scuff=0.0) -> None:
    """Apply an impact to a record."""
    body, tangents = np.ascontiguousarray(body, dtype=float), len(record) - 1
    call(code["resets"][outcome], record, body, 0, 0.0, scuff, tangents=tangents)


@pytest.mark.parametrize(("system", "index", "outcome"), STRIKES)
def test_a_strike_does_to_a_record_what_is_stated(system, index, outcome):
    rng, code = np.random.default_rng(8), compiled(system.name)[index]
    reset = system.phases[index].resets[outcome]
    for _ in range(50):
        body, record = some_walker(rng, system).body, np.zeros(1, RECORD)
        angle, ground = rng.uniform(0.1, 0.7), some_ground(rng, system, 0.1)
        before = State(-angle, angle, angle, *rng.normal(size=3))
        if outcome == Outcome.KNEESTRIKE:
            before = before._replace(stance=rng.uniform(-0.7, 0.7))
        record["state"] = before
        record["start"] = first = 0.3, -0.3, -0.3
        record["ground"], record["time"], record["outcome"] = ground, 1.5, outcome
        strike(code, outcome, record, body)
        after, loss, _ = reset.strike(body, before, 0.0, ground)
        (found,) = record
        np.testing.assert_allclose(found["state"], after, rtol=0.0, atol=1e-13)
        lost = found["knee_loss" if outcome == Outcome.KNEESTRIKE else "heel_loss"]
        assert lost == pytest.approx(loss, rel=1e-11, abs=1e-15)
        assert found["phase"] == (reset.into or 0)
        if outcome == Outcome.KNEESTRIKE:
            assert found["knee_time"] == 1.5
            continue
        assert found["outcome"] == Outcome.HEELSTRIKE
        np.testing.assert_array_equal(found["start"], found["state"][:3])
        landed = legs.standing(body, before, ground)
        length = legs.step_length(body, first[0], landed.thigh, landed.stance, ground.slope_change)
        assert found["step_length"] == pytest.approx(length, rel=1e-12)
        assert found["passed"] == pytest.approx(legs.hip_travel(body, landed.stance), rel=1e-13)
        end = State(*landed[:3], 0, 0, 0)
        gain = system.potential_gain(body, State(*first, 0, 0, 0), end, ground)
        assert found["gravity_work"] == pytest.approx(-gain, rel=1e-11, abs=1e-15)


@pytest.mark.parametrize(("system", "index", "outcome"), STRIKES)
def test_derivatives_pass_through_a_strike(system, index, outcome):
    """All values that an impact writes, against complex numbers in the plain model."""
    tangents, rng, tiny = 3, np.random.default_rng(9), 1e-100j
    code = compiled(system.name, derived=True)[index]
    reset = system.phases[index].resets[outcome]
    for _ in range(10):
        constants = some_walker(rng, system).body
        bodies = np.zeros((tangents + 1, len(constants)))
        bodies[0], bodies[1:] = constants, rng.normal(size=bodies[1:].shape)
        records = np.zeros(tangents + 1, RECORD)
        angle = rng.uniform(0.1, 0.7)
        records["state"][0] = -angle, angle, angle, *rng.normal(size=3)
        records["ground"][0] = some_ground(rng, system, 0.1)
        records["start"][0] = 0.3, -0.3, -0.3
        for field in ("state", "ground", "start", "time"):
            records[field][1:] = rng.normal(size=records[field][1:].shape)
        before = records.copy()
        strike(code, outcome, records, bodies)
        for tangent in range(1, tangents + 1):
            body = system.Body(*(bodies[0] + tiny * bodies[tangent]))
            given = {
                field: before[field][0] + tiny * before[field][tangent]
                for field in ("state", "ground", "start")
            }
            ground = Ground(*given["ground"])
            if "height_change" in system.absent:
                ground = ground._replace(height_change=0.0, slope_change=0.0)
            after, loss, _ = reset.strike(body, State(*given["state"]), 0.0, ground)
            expected = [*after, loss]
            found = [*records["state"][tangent]]
            if outcome == Outcome.KNEESTRIKE:
                found.append(records["knee_loss"][tangent])
                assert records["knee_time"][tangent] == before["time"][tangent]
            else:
                end = legs.standing(body, State(*given["state"]), ground)
                begun = State(*given["start"], 0, 0, 0)
                gain = system.potential_gain(body, begun, end, ground)
                length = legs.step_length(
                    body, begun.stance, end.thigh, end.stance, ground.slope_change
                )
                expected += [length, -gain]
                expected += after[:3]
                found += [records[x][tangent] for x in ("heel_loss", "step_length", "gravity_work")]
                found += [*records["start"][tangent]]
            expected = np.imag(expected) / 1e-100
            scale = 1.0 + np.abs(expected).max()
            np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-11 * scale)


def test_no_phase_begins_where_it_is_refused():
    """STUBBED_TOE only with `end_on_toe_stub`, and before KNEE_NOT_LOCKED."""
    system, rng = SYSTEMS["kneed"], np.random.default_rng(10)
    code, reset = compiled("kneed")[0], system.phases[0].resets[Outcome.KNEESTRIKE]
    met = []
    for _ in range(300):
        body, record = some_walker(rng, system).body, np.zeros(1, RECORD)
        before = State(*rng.uniform(-0.7, 0.7, 2), 0.0, *rng.normal(size=3))
        before = before._replace(shank=before.thigh)
        after, _, _ = reset.strike(body, before, 0.0, SMOOTH)
        for scuff in (0.0, 1.0):
            record["state"], record["outcome"] = before, Outcome.KNEESTRIKE
            strike(code, Outcome.KNEESTRIKE, record, body, scuff)
            refused = [
                refusal.outcome
                for refusal in reset.refuses
                if refusal.if_(body, after, SMOOTH) and (scuff or not refusal.scuff)
            ]
            met.append((scuff, int(record["outcome"][0])))
            assert record["outcome"] == (refused[0] if refused else Outcome.RUNNING)
    assert set(met) == {
        (0.0, Outcome.RUNNING), (0.0, Outcome.KNEE_NOT_LOCKED),
        (1.0, Outcome.RUNNING), (1.0, Outcome.STUBBED_TOE),
    }  # fmt: skip


@pytest.mark.parametrize("system", KINDS.values(), ids=KINDS)
def test_a_hips_place_is_written_down(system):
    rng, code = np.random.default_rng(11), compiled(system.name)[0]
    body, record = some_walker(rng, system).body, np.zeros(1, RECORD)
    record["state"] = 0.3
    call(code["place"], record, np.array(body, dtype=float))
    assert record["place"] == pytest.approx(legs.hip_travel(body, 0.3), rel=1e-14)
    # A hip that turns forward about a foot on the ground is further on.
    assert legs.hip_travel(body, -0.3) > 0.0 > legs.hip_travel(body, 0.3)
