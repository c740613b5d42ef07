"""Systems of one's own in Node.js are those of the CPU, to the last bit."""

from dataclasses import replace

import numpy as np
import pytest

import gym_passive_walker as gpw
from examples.five_links import FIVE_LINKS
from examples.torso import TORSO
from gym_passive_walker import web
from gym_passive_walker.engine.layout import layout_of
from gym_passive_walker.engine.run import advance, new_records, states_in
from gym_passive_walker.physics.systems import bodies
from tests.modeling.statements import DRIVEN

SLOPE, TICKS = 0.03, 60
SYSTEMS = {"torso": (TORSO, {"torso": 0.08}, ()), "driven": (DRIVEN, {"hip": 0.7}, (0.002,))}


def near(system, count=200):
    rng, start = np.random.default_rng(0), np.array(system.start)
    return start * (1.0 + 0.05 * rng.normal(size=(count, len(start))))


@pytest.fixture(scope="module", name="walked", params=SYSTEMS)
def a_system_in_node(request, run):
    """The system with another body, its controls, its states, and what Node makes of them."""
    system, body, controls = SYSTEMS[request.param]
    states = near(system)
    job = {
        "what": "system", "name": request.param, "states": states.tolist(), "ticks": TICKS,
        "controls": list(controls), "options": {"slope": SLOPE, "body": body, "tolerance": 1e-8},
    }  # fmt: skip
    (found,) = run(job)
    return system.vary(**body), controls, states, found


def records_of(system, controls, states, end=20.0):
    held = np.tile(controls, (len(states), 1)) if controls else 0.0
    return new_records(states, SLOPE, held, end=end, layout=layout_of(system.hybrid))


def test_strides_of_a_system_are_the_cpus_to_the_last_bit(walked):
    system, controls, states, found = walked
    records = records_of(system, controls, states)
    advance(system.hybrid, bodies(system), records, tolerance=1e-8)
    there = records[:, 0]
    assert np.mean(there["outcome"] == gpw.Outcome.HEELSTRIKE) > 0.5
    names = [gpw.Outcome(outcome).name for outcome in there["outcome"]]
    assert [each["outcome"] for each in found["strides"]] == names
    for name, field in (("duration", "time"), ("step_length", "step_length")):
        np.testing.assert_array_equal([each[name] for each in found["strides"]], there[field])
    ends = states_in(records[:, 0], system.coordinates)
    np.testing.assert_array_equal([each["state"] for each in found["strides"]], ends)


def test_control_steps_of_a_system_are_the_cpus_to_the_last_bit(walked):
    system, controls, states, found = walked
    records, strides, fresh = records_of(system, controls, states[:1], 0.0), 0, True
    for outcome, state in found["steps"]:
        records["end"] = records["time"] + 0.1
        advance(system.hybrid, bodies(system), records, tolerance=1e-8, from_section=fresh)
        here, fresh = states_in(records[:, 0], system.coordinates)[0], False
        np.testing.assert_array_equal(state, here)
        ended = gpw.Outcome(records["outcome"][0, 0])
        assert outcome == (ended.name if ended else None)
        if ended == gpw.Outcome.HEELSTRIKE:
            records, fresh = records_of(system, controls, here[None], 0.0), True
            strides += 1
    assert found["walked"] == strides >= 2


def test_the_lines_of_a_system_are_those_of_its_pictures(walked):
    system, _, states, found = walked
    for state, lines in zip(states[:20], found["lines"], strict=False):
        for line, expected in zip(lines, system.drawn(state), strict=True):
            np.testing.assert_allclose(line, expected, atol=1e-13)


def test_a_field_that_a_body_has_not_is_refused_by_its_name(walked):
    system, *_, found = walked
    assert found["refused"].startswith(f"SceneError: the body of {system.name} has no knee")


def test_what_a_page_cannot_take_is_refused_in_a_sentence(tmp_path):
    with pytest.raises(ValueError, match="system 'five links' is too large for a page: at most 3"):
        web.build(tmp_path, {"five": FIVE_LINKS})
    with pytest.raises(ValueError, match=r"systems: '\.\./torso' must be letters"):
        web.build(tmp_path, {"../torso": replace(TORSO)})
    with pytest.raises(ValueError, match=r"systems\['lab'\] must be a gpw.System"):
        web.build(tmp_path, {"lab": "lab"})  # type: ignore[dict-item]
    assert not list(tmp_path.iterdir())
