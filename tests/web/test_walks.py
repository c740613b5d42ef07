"""Walks in Node.js are those of the CPU, byte for byte."""

import math
from base64 import b64decode, b64encode

import mpmath
import numpy as np
import pytest

import gym_passive_walker as gpw
from gym_passive_walker.devices.web.kernels import START
from gym_passive_walker.devices.web.page_data import TOLERANCES
from gym_passive_walker.engine.counter_rng import uniform, word
from gym_passive_walker.engine.layout import RECORD
from gym_passive_walker.engine.run import advance, new_records
from gym_passive_walker.envs.batch import Batch
from gym_passive_walker.gaits.scenes.scene import make_scene
from gym_passive_walker.gaits.scenes.starts import Starts, gait_near
from gym_passive_walker.models.model import bodies
from gym_passive_walker.pictures.pose import pose

SIX = ("lab", "C", "A", "B", "D", "lab-straight")
SPRUNG = {
    "lab": {"hip_stiffness": 0.9, "knee_stiffness": 0.4, "hip_friction": 0.05},
    "B": {"hip_stiffness": 0.3, "hip_friction": 0.01},
    "D": {"hip_stiffness": 0.2},
}


def _text(data):
    return b64encode(data).decode()


def _near(walker, slope, count, seed=0):
    """States near a walker's gait; some fall."""
    rng = np.random.default_rng(seed)
    states = np.array(gait_near(walker, slope)) * (1.0 + 0.05 * rng.normal(size=(count, 6)))
    states[:, 2] = states[:, 1]
    if not walker.knees:
        states[:, 5] = states[:, 4]
    return states


def _job(walker, given, records, *, tolerance=1e-8, **scene):
    scene = {"end_on_toe_stub": False, "tolerance": tolerance, **scene}
    return {
        "what": "strides", "walker": given, "scene": scene, "records": _text(records.tobytes()),
        "tolerance": tolerance, "fromSection": True, "body": _text(bodies(walker).tobytes()),
    }  # fmt: skip


def _unlike(found, records):
    """How many of the records in a result are not those of the CPU."""
    there = np.frombuffer(b64decode(found["records"]), RECORD).reshape(records.shape)
    return sum(a.tobytes() != b.tobytes() for a, b in zip(there, records, strict=True))


@pytest.fixture(scope="module")
def strides(run):
    """1,000 strides of each of six walkers, in Node and on the CPU."""
    jobs, there = [], []
    for name in SIX:
        walker = gpw.WALKERS[name]
        records = new_records(_near(walker, 0.03, 1000), 0.03)
        jobs.append(_job(walker, name, records))
        there.append(advance(walker.equations(), bodies(walker), records, tolerance=1e-8))
    return dict(zip(SIX, zip(run(*jobs), there, strict=True), strict=True))


@pytest.mark.parametrize("name", SIX)
def test_a_thousand_strides_are_the_cpus_byte_for_byte(strides, name):
    found, records = strides[name]
    assert np.mean(records["outcome"] == gpw.Outcome.HEELSTRIKE) > 0.6
    assert _unlike(found, records) == 0


@pytest.mark.parametrize("name", SIX)
def test_a_walkers_constants_are_the_cpus_byte_for_byte(strides, name):
    found, _ = strides[name]
    assert b64decode(found["body"]) == bodies(gpw.WALKERS[name]).tobytes()


@pytest.mark.parametrize("tolerance", TOLERANCES)
def test_strides_at_each_tolerance_are_the_cpus(run, tolerance):
    walker = gpw.WALKERS["C"]
    records = new_records(_near(walker, 0.02, 50), 0.02)
    (found,) = run(_job(walker, "C", records, tolerance=tolerance))
    advance(walker.equations(), bodies(walker), records, tolerance=tolerance)
    assert _unlike(found, records) == 0


@pytest.mark.parametrize("name", SPRUNG)
def test_strides_with_springs_and_friction_are_the_cpus(run, name):
    given = {"preset": name, **SPRUNG[name]}
    walker = gpw.as_walker(given)
    records = new_records(_near(gpw.WALKERS[name], 0.03, 100), 0.03, 0.01)
    (found,) = run(_job(walker, given, records))
    advance(walker.equations(), bodies(walker), records, tolerance=1e-8)
    assert _unlike(found, records) == 0


@pytest.mark.parametrize("name", ["C", "E", "D"])
def test_strides_on_uneven_ground_under_all_controls_are_the_cpus(run, name):
    walker, rng = gpw.WALKERS[name], np.random.default_rng(1)
    controls = rng.normal(0.0, 0.005, (100, 2)) * [1.0, walker.foot_radius == 0.0]
    records = new_records(
        _near(walker, 0.03, 100), 0.03, controls, push_off=rng.uniform(0.0, 0.02, 100),
        height_change=rng.normal(0.0, 0.002, 100), slope_change=rng.normal(0.0, 0.002, 100),
    )  # fmt: skip
    (found,) = run(_job(walker, name, records, terrain={"stairs": {"rise": 0.0}}))
    system = walker.equations(("height_change",))
    advance(system, bodies(walker), records, tolerance=1e-8)
    assert _unlike(found, records) == 0


def _word(seed, counter):
    return int(word(np.uint64(seed), np.uint64(counter)))


def _normal(key, counter, stream):
    """`chance.normal` by functions that return the nearest number."""
    drawn = _word(_word(key, stream), counter)
    with mpmath.workprec(200):
        log = float(mpmath.log(1.0 - float(drawn >> 11) * 2.0**-53))
        cosine = float(mpmath.cos(2.0 * math.pi * (float(_word(drawn, stream) >> 11) * 2.0**-53)))
    return math.sqrt(-2.0 * log) * cosine


def _as_anywhere(terrain, key, slope, count=24):
    """Whether the C library's rounding of logarithms, sines and cosines changes no foothold."""
    for place in range(count):
        tilt, rise, _ = terrain.ground(key, place)
        here = _normal(key, place, 100) if place else 0.0
        wanted = terrain.rises[0] + terrain.height_std * (_normal(key, place + 1, 100) - here)
        with mpmath.workprec(200):
            angle = mpmath.mpf(slope + float(tilt))
            sine, cosine = float(mpmath.sin(angle)), float(mpmath.cos(angle))
        if (wanted, sine, cosine) != (rise, math.sin(slope + tilt), math.cos(slope + tilt)):
            return False
    return True


def _keys(terrain, slope, count):
    """Keys of walks with footholds that do not depend on the C library."""
    rng, found = np.random.default_rng(0), []
    while len(found) < count:
        key = rng.integers(2**64, dtype=np.uint64)
        if _as_anywhere(terrain, key, slope):
            found.append(key)
    return found


def _episodes(scene, keys, act, steps):
    """What each step of some episodes leaves on the CPU; and a job of the same in Node."""
    batch, expected, starts = Batch(scene), [], []
    observation, results = (
        np.empty(batch.observation_size, np.float32),
        (np.empty(1), np.empty(1, bool), np.empty(1, bool)),
    )
    state = Starts(scene).state(scene.slope)
    own = np.array(state) / [1, 1, 1, *[scene.walker.time_unit] * 3]
    for key in keys:
        batch.randoms = [_Key(key)]
        batch.start([0], observation, {"state": own, "slope": scene.slope})
        start = batch.records["state"][0, 0].tolist()
        rows, actions = [_text(observation.tobytes())], []
        for _ in range(steps):
            actions.append(np.atleast_1d(act(observation)).astype(float).tolist())
            batch.step(np.array(actions[-1]), observation, *results)
            disturbance = batch.disturbances.states if batch.disturbances else np.zeros(0)
            rows.append([
                _text(batch.records.tobytes()), _text(batch.ledger.tobytes()),
                _text(disturbance.tobytes()), _text(observation.tobytes()),
                *(float(results[0][0]), bool(results[1][0]), bool(results[2][0])),
            ])  # fmt: skip
            if results[1][0] or results[2][0]:
                break
        expected.append(rows)
        starts.append({"key": str(key), "state": start, "actions": actions})
    body = _text(bodies(scene.walker).tobytes())
    return expected, {"what": "episodes", "body": body, "starts": starts}


class _Key:
    """A source of random numbers that draws a given key."""

    def __init__(self, key):
        self._key, self.bit_generator = key, np.random.default_rng(0).bit_generator

    def integers(self, *_, **__):
        return self._key


def _same(expected, found, *, disturbed=True):
    """Count the steps of episodes, all of which must be equal."""
    count = 0
    for here, there in zip(expected, found, strict=True):
        assert here[0] == there[0]
        for k, (a, b) in enumerate(zip(here[1:], there[1:], strict=True)):
            a, b = (list(row) for row in (a, b))
            if not disturbed:
                a[2] = b[2] = ""
            assert a == b, f"step {k}"
            count += 1
    return count


def test_ten_thousand_control_steps_on_rough_ground_are_the_cpus_byte_for_byte(run):
    policy = gpw.load_policy("rough-ppo")
    scene = make_scene("rough", reset_noise_scale=0.0)
    keys = _keys(scene.terrain, scene.slope, 30)
    expected, job = _episodes(scene, keys, lambda seen: policy.predict(seen)[0], 500)
    arguments = {
        "slope": 0.02, "terrain": {"rough": {"height_std": 0.002}}, "terrain_lookahead": 2,
    }  # fmt: skip
    (found,) = run(job | {"walker": "C", "scene": arguments})
    assert _same(expected, found) >= 10_000


_KICKED = {"rate": 0.3, "impulse": (-0.01, 0.01)}


@pytest.mark.parametrize(
    ("walker", "changes"),
    [
        ("C", {"slope": 0.02}),
        ("lab", {"slope": 0.036, "control": "stride"}),
        ("C", {"slope": 0.02, "energy": "positive", "end_on_toe_stub": False}),
        ("E", {"slope": 0.01, "actions": ("hip", "ankle", "push_off"), "energy": "net"}),
        ("D", {"slope": 0.01, "control": "stride", "actions": ("push_off",), "max_push_off": 0.02}),
        ("B", {"slope": 0.02, "terrain": {"waves": {"height": 0.002, "strides": 5}}}),
    ],
)
def test_control_steps_of_other_scenes_are_the_cpus(run, walker, changes):
    scene = make_scene({"walker": walker, **changes}, reset_noise_scale=0.0)
    rng = np.random.default_rng(0)
    count = len(scene.actions)
    expected, job = _episodes(scene, np.arange(3), lambda _: rng.uniform(-0.3, 0.3, count), 150)
    terrain = changes.get("terrain")
    if terrain:  # a page has its own sine
        heights = scene.terrain.rises, scene.terrain.slopes
        terrain = {"rises": list(heights[0]), "slopes": list(heights[1])}
    (found,) = run(job | {"walker": walker, "scene": {**changes, "terrain": terrain}})
    assert _same(expected, found, disturbed=terrain is not None) >= 15


def test_control_steps_with_pushes_noise_delay_and_a_command_are_the_cpus(run):
    changes = {
        "slope": 0.02, "pushes": _KICKED, "action_delay": 2, "command": 0.15,
    }  # fmt: skip
    scene = make_scene({"walker": "C", **changes}, reset_noise_scale=0.0)
    rng = np.random.default_rng(0)
    keys = [7, 8, 9]
    expected, job = _episodes(
        scene, np.array(keys, np.uint64), lambda _: rng.uniform(-0.2, 0.2, 1), 150
    )
    (found,) = run(job | {"walker": "C", "scene": changes})
    assert _same(expected, found) >= 200


def test_the_start_of_a_seed_has_three_numbers_of_its_own(run):
    starts = [{"key": str(key), "state": None, "actions": []} for key in (5, 6)]
    job = {"what": "episodes", "walker": "C", "starts": starts}
    scenes = ({"slope": 0.02, "reset_noise_scale": scale} for scale in (0.0, 0.1))
    calm, noisy = (
        np.array([np.frombuffer(b64decode(rows[0]), np.float32)[:6] for rows in found])
        for found in run(*({**job, "scene": scene} for scene in scenes))
    )
    factors = (noisy / calm - 1.0) / 0.1
    for key, row in zip((5, 6), factors, strict=True):
        draws = [2.0 * uniform(np.uint64(key), k, START) - 1.0 for k in (1, 2, 3)]
        np.testing.assert_allclose(row, np.array(draws)[[0, 0, 0, 1, 2, 2]], atol=1e-5)


def test_joints_are_those_of_pictures(run):
    names = ("C", "B", "D")
    states = [_near(gpw.WALKERS[name], 0.02, 5).tolist() for name in names]
    jobs = [
        {"what": "joints", "walker": name, "states": each}
        for name, each in zip(names, states, strict=True)
    ]
    for name, each, found in zip(names, states, run(*jobs), strict=True):
        walker = gpw.WALKERS[name]
        there = pose(walker, walker.units.to_own(np.array(each)))
        for i, joints in enumerate(found):
            assert joints["hip"] == pytest.approx(there.hip[i], abs=1e-12)
            for leg in ("stance", "swing"):
                for part in ("knee", "foot", "tip"):
                    wanted = getattr(getattr(there, leg), part)[i]
                    assert joints[f"{leg}_{part}"] == pytest.approx(wanted, abs=1e-12)


@pytest.mark.parametrize(
    ("name", "slope"), [("lab", 0.036), ("C", 0.02), ("B", 0.02), ("D", 0.009)]
)
def test_the_gait_and_multipliers_of_a_page_are_pythons(run, name, slope):
    (found,) = run({"what": "gait", "walker": name, "slope": slope})
    gait = gpw.find_gait(name, slope)
    units = gpw.WALKERS[name].units
    assert found["state"] == pytest.approx(units.to_dimensionless(gait.state), abs=1e-8)
    multipliers = sorted(abs(complex(*each)) for each in found["multipliers"])[-2:]
    assert multipliers == pytest.approx(np.sort(np.abs(gait.multipliers))[-2:], abs=1e-5)


def test_a_slope_at_a_reset_is_that_of_the_whole_episode(run):
    job = {"what": "begun", "walker": "C", "scene": {"slope": 0.02}, "slope": 0.05, "pushes": []}
    (found,) = run(job)
    np.testing.assert_allclose(np.arcsin(found["slopes"][2]), 0.05, atol=1e-9)
    assert (found["slopes"][:2], found["again"]) == ([0.05, 0.05], 0.02)


def test_pushes_before_a_control_step_add(run):
    job = {"what": "begun", "walker": "C", "scene": {"slope": 0.02}, "slope": 0.02}
    twice, once, none, cancelled = run(
        *({**job, "pushes": pushes} for pushes in ([0.01, 0.02], [0.03], [], [0.01, -0.01]))
    )
    assert twice["state"] == pytest.approx(once["state"], abs=1e-12) != none["state"]
    assert cancelled["state"] == none["state"]


def test_a_search_of_a_page_ends_where_newtons_step_has_any_length(run):
    """Between two families the matrix is nearly singular: a step of more than 50 is asked for."""
    slope = 0.09626752948760986
    assert run({"what": "gait", "walker": "lab", "slope": slope}) == [None]
    with pytest.raises(gpw.GaitNotFound):
        gpw.find_gait("lab", slope)
