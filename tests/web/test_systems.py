"""Systems of one's own in Node.js are those of the CPU, to the last bit."""

import ctypes
from dataclasses import replace

import numpy as np
import pytest

import gym_passive_walker as gpw
from examples.five_links import FIVE_LINKS
from examples.torso import TORSO
from gym_passive_walker.devices import web
from gym_passive_walker.engine.layout import layout_of
from gym_passive_walker.engine.run import advance, new_records, states_in
from gym_passive_walker.envs.constraints import ROOM, hooks
from gym_passive_walker.models.model import bodies
from tests.own.statements import DRIVEN, PROGRESSIVE

pytestmark = pytest.mark.slow  # a page's modules take a minute to compile

TICKS, EVERY, IMPULSE, SEED = 130, 7, 0.002, 5
TERRAIN = gpw.rough(0.0005)
SYSTEMS = {
    "torso": (TORSO, 0.03, {"torso": 0.08}, ()),
    "driven": (DRIVEN, 0.03, {"hip": 0.7}, (0.002,)),
    "five": (FIVE_LINKS, 0.05, {"torso": 20.001}, (1e-5, 0.0, -2e-5, 1e-5)),
}


def near(system, count=200):
    rng, start = np.random.default_rng(0), np.array(system.start)
    if system is FIVE_LINKS:
        start = gpw.find_gait(system, 0.05).state
    states = start * (1.0 + 0.03 * rng.normal(size=(count, len(start))))
    states[0] = start
    return states


@pytest.fixture(scope="module", name="walked", params=SYSTEMS)
def a_system_in_node(request, run):
    """The system with another body, its slope, controls and states, and what Node makes of them."""
    name = request.param
    system, slope, body, controls = SYSTEMS[name]
    states = near(system)
    disturbed = {
        "terrain": {"rough": {"height_std": TERRAIN.height_std}}, "seed": SEED, "every": EVERY,
        "impulse": IMPULSE,
    }  # fmt: skip
    options = {"body": body, "tolerance": 1e-8} | ({} if name == "five" else {"slope": slope})
    job = {
        "what": "system", "name": name, "states": states.tolist(), "ticks": TICKS,
        "controls": list(controls), "options": options,
        "disturbed": disturbed,
    }  # fmt: skip
    (found,) = run(job)
    return (system.vary(**body), slope, controls), states, found


def records_of(walker, states, end=20.0, rise=0.0):
    system, slope, controls = walker
    held = np.tile(controls, (len(states), 1)) if controls else 0.0
    return new_records(
        states, slope, held, end=end, height_change=rise, layout=layout_of(system.hybrid)
    )


def steps_of(walker, state, system, rises=None, push=None):
    """How each control step of the CPU ends, and in which state."""
    fresh, strides = True, 0
    for i in range(TICKS):
        if fresh:
            rise = 0.0 if rises is None else rises(strides)
            records = records_of(walker, state[None], 0.0, rise)
        if push is not None and i % EVERY == 0:
            push(records)
        records["end"] = records["time"] + 0.1
        advance(system, bodies(walker[0]), records, tolerance=1e-8, from_section=fresh)
        state, ended = states_in(records[:, 0], walker[0].coordinates)[0], records["outcome"][0, 0]
        fresh = ended == gpw.Outcome.HEELSTRIKE
        strides += fresh
        yield gpw.Outcome(ended).name if ended else None, state.tolist()
        if ended and not fresh:
            return


def test_strides_of_a_system_are_the_cpus_to_the_last_bit(walked):
    walker, states, found = walked
    system, records = walker[0], records_of(walker, states)
    advance(system.hybrid, bodies(system), records, tolerance=1e-8)
    there = records[:, 0]
    assert np.mean(there["outcome"] == gpw.Outcome.HEELSTRIKE) > 0.25
    names = [gpw.Outcome(outcome).name for outcome in there["outcome"]]
    assert [each["outcome"] for each in found["strides"]] == names
    for name, field in (("duration", "time"), ("step_length", "step_length")):
        np.testing.assert_array_equal([each[name] for each in found["strides"]], there[field])
    ends = states_in(records[:, 0], system.coordinates)
    np.testing.assert_array_equal([each["state"] for each in found["strides"]], ends)
    records = records_of(walker, states[:1], rise=0.001)
    advance(system.uneven, bodies(system), records, tolerance=1e-8)
    assert found["rises"] == states_in(records[:, 0], system.coordinates)[0].tolist()
    assert found["rises"] != found["strides"][0]["state"]


def test_control_steps_of_a_system_are_the_cpus_to_the_last_bit(walked):
    walker, states, found = walked
    there = list(steps_of(walker, states[0], walker[0].hybrid))
    steps = [tuple(step) for step in found["steps"]][: len(there)]
    assert steps == there
    assert found["walked"] == sum(outcome == "HEELSTRIKE" for outcome, _ in there) >= 2
    if len(there) == TICKS and there[-2][0] is None:
        assert found["within"][1] == there[-1][1]
        assert found["within"][0] == pytest.approx(there[-2][1], abs=1e-8)


def test_pushed_walks_on_rough_ground_are_the_cpus_to_the_last_bit(walked):
    walker, states, found = walked
    system = walker[0]
    _, native = hooks(system.uneven.name, pushed=True, watched=False)
    push_native = ctypes.CFUNCTYPE(None, *[ctypes.c_int64] * 4, *[ctypes.c_double] * 2)
    body = np.array([*system.body, *np.zeros(ROOM)])

    def push(records):
        call = push_native(int(native[0]["push"]))
        call(records.ctypes.data, body.ctypes.data, 0, 0, -IMPULSE, 0.0)

    def rise(strides):
        return TERRAIN.ground([SEED], [strides])[0, 1]

    there = list(steps_of(walker, states[0], system.uneven, rise, push))
    assert [tuple(step) for step in found["uneven"]][: len(there)] == there
    heights = np.cumsum([0.0] + [rise(i) for i in range(len(found["footholds"]) - 1)])
    assert np.allclose([each["y"] for each in found["footholds"]], heights, atol=1e-15)


def test_the_gait_that_a_page_finds_is_pythons(walked):
    (system, slope, controls), _, found = walked
    held = dict(zip(system.controls, controls, strict=True)) or None
    gait = gpw.find_gait(gpw.stride_map(system, slope, controller=held))
    assert gait is not None
    np.testing.assert_allclose(found["gait"]["state"], gait.state, atol=1e-7)
    there = sorted(np.abs([complex(*z) for z in found["gait"]["multipliers"]]))
    np.testing.assert_allclose(there[-3:], np.sort(np.abs(gait.multipliers))[-3:], atol=1e-5)


def test_the_lines_of_a_system_are_those_of_its_pictures(walked):
    (system, *_), states, found = walked
    for state, lines in zip(states[:20], found["lines"], strict=False):
        for line, expected in zip(lines, system.drawn(state), strict=True):
            np.testing.assert_allclose(line, expected, atol=1e-13)


def test_a_field_that_a_body_has_not_is_refused_by_its_name(walked):
    (system, *_), _, found = walked
    assert found["refused"].startswith(f"SceneError: the body of {system.name} has no fin")


def test_a_system_with_library_functions_walks_up_to_rounding(run):
    states = near(PROGRESSIVE, 20)
    job = {
        "what": "strides of a system", "name": "progressive", "states": states.tolist(),
        "options": {"slope": 0.03, "tolerance": 1e-8},
    }  # fmt: skip
    (found,) = run(job)
    records = records_of((PROGRESSIVE, 0.03, ()), states)
    advance(PROGRESSIVE.hybrid, bodies(PROGRESSIVE), records, tolerance=1e-8)
    struck = records["outcome"][:, 0] == gpw.Outcome.HEELSTRIKE
    assert np.sum(struck) > 5
    assert [each["outcome"] == "HEELSTRIKE" for each in found] == struck.tolist()
    here = states_in(records[:, 0], 3)[struck]
    there = np.array([each["state"] for each in found])[struck]
    np.testing.assert_allclose(there, here, rtol=0.0, atol=1e-9)


def test_what_a_page_cannot_take_is_refused_in_a_sentence(tmp_path):
    with pytest.raises(ValueError, match=r"systems: '\.\./torso' must be letters"):
        web.build(tmp_path, {"../torso": replace(TORSO)})
    with pytest.raises(ValueError, match=r"systems\['lab'\] must be a gpw.System or a gait of"):
        web.build(tmp_path, {"lab": "lab"})  # type: ignore[dict-item]
    assert not list(tmp_path.iterdir())
