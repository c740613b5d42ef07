"""Footholds by their definitions, and what a search for a gait says and returns."""

from __future__ import annotations

import json
import math
from dataclasses import asdict, replace

import numpy as np
import pytest

import gym_passive_walker as gpw
from gym_passive_walker import (
    WALKERS,
    Actuation,
    GaitNotFound,
    find_gait,
    find_gaits,
    footholds,
    optimize_walker,
    rough,
    stairs,
    stride,
    stride_map,
    waves,
)
from gym_passive_walker.gaits.flow import Walkers
from gym_passive_walker.gaits.robust.first_passage import survivors
from gym_passive_walker.gaits.terrain import Terrain, contacts, terrain_from


def rows(terrain, count, key=0):
    """Slope, and height and slope change to the next, of the first footholds."""
    return np.array([terrain.ground(key, place) for place in range(count)])


def test_stairs_rise_by_the_same_at_each_foothold():
    np.testing.assert_allclose(rows(stairs(0.01), 5), [[0.0, 0.01, 0.0]] * 5)
    np.testing.assert_allclose(rows(stairs(-0.02), 3), [[0.0, -0.02, 0.0]] * 3)


@pytest.mark.parametrize("strides", [3, 4, 7])
def test_waves_are_a_sine_that_returns_to_its_start(strides):
    found = rows(waves(0.05, strides), 2 * strides)
    heights = [0.05 * math.sin(2.0 * math.pi * i / strides) for i in range(2 * strides + 1)]
    np.testing.assert_allclose(found[:, 1], np.diff(heights), atol=1e-15)
    assert not found[:, [0, 2]].any()


def test_footholds_are_those_of_the_list_and_then_like_the_last():
    ground = footholds([0.0, 0.02, -0.01], [0.0, 0.1, -0.05])
    expected = [[0.0, 0.02, 0.1], [0.1, -0.03, -0.15], [-0.05, 0.0, 0.0], [-0.05, 0.0, 0.0]]
    np.testing.assert_allclose(rows(ground, 4), expected, atol=1e-15)
    np.testing.assert_allclose(rows(footholds([0.0, 0.02]), 3)[:, 1], [0.02, 0.0, 0.0])
    alone = rows(footholds(slopes=[0.0, 0.1]), 3)
    np.testing.assert_allclose(alone, [[0.0, 0.0, 0.1], [0.1, 0.0, 0.0], [0.1, 0.0, 0.0]])
    assert rows(footholds([0.0]), 2).tolist() == [[0.0] * 3] * 2


def test_random_footholds_deviate_from_level_each_by_itself():
    """The change to the next foothold is the difference of two deviations."""
    keys, count = np.arange(4000, dtype=np.uint64), 4
    ground = rough(height_std=0.01, slope_std=0.02)
    found = np.stack([ground.ground(keys, place) for place in range(count)])  # (4, walks, 3)
    assert not found[0, :, 0].any()
    heights = np.cumsum(found[:, :, 1], axis=0)
    np.testing.assert_allclose(heights.std(axis=1), 0.01, rtol=0.05)
    np.testing.assert_allclose(found[1:, :, 0].std(axis=1), 0.02, rtol=0.05)
    np.testing.assert_allclose(found[:-1, :, 0] + found[:-1, :, 2], found[1:, :, 0], atol=1e-15)
    deviations = np.concatenate([heights / 0.01, found[1:, :, 0] / 0.02])
    assert np.abs(np.corrcoef(deviations) - np.eye(len(deviations))).max() < 0.06
    assert np.abs(deviations.mean(axis=1)).max() < 0.06
    np.testing.assert_array_equal(ground.ground(7, 2), found[2, 7])
    assert ground.random and not ground.smooth


@pytest.mark.parametrize(
    ("ground", "random", "smooth"),
    [
        (rough(0.0), False, True), (rough(0.01), True, False), (rough(0.0, 0.01), True, False),
        (stairs(0.0), False, True), (stairs(0.1), False, False),
        (footholds(slopes=[0.0, 0.1]), False, False), (footholds([0.0, 0.0]), False, True),
    ],
)  # fmt: skip
def test_which_ground_is_random_and_which_is_smooth(ground, random, smooth):
    assert (ground.random, ground.smooth) == (random, smooth)


FORMS = {
    "rough:height_std=0.01,slope_std=0.02": rough(0.01, 0.02),
    '{"rough": {"slope_std": 0.02}}': rough(slope_std=0.02),
    "stairs:rise=-0.01": stairs(-0.01),
    "waves:height=0.01,strides=6": waves(0.01, 6),
    "footholds:heights=[0, 0.1, 0.2],slopes=[0, 0, 0.1]": footholds([0, 0.1, 0.2], [0, 0, 0.1]),
}


@pytest.mark.parametrize("text", FORMS)
def test_ground_in_each_form(text, tmp_path):
    assert terrain_from(text) == FORMS[text]
    assert terrain_from(FORMS[text]) is FORMS[text]
    as_fields = asdict(FORMS[text])
    assert terrain_from(as_fields) == FORMS[text]
    file = tmp_path / "ground.json"
    file.write_text(json.dumps(as_fields))
    assert terrain_from(file) == terrain_from(str(file)) == FORMS[text]


WRONG = {
    "rough:height_std": "a terrain is written as rough",
    "rough:height_std=high": "terrain 'rough' takes numbers, not|terrain rough takes numbers, not",
    "{": "cannot be read: Expecting",
    "rough": "rough ground needs height_std",
    "rough:": "rough ground needs height_std",
    "footholds": "footholds need heights",
    "stairs": "rise",
    "waves": "height",
    "waves:height=0.1": "strides",
    '{"rough": {}}': "rough ground needs height_std",
    '{"footholds": {}}': "footholds need heights",
    "rough:height_std=0.1,height_std=0.2": "terrain rough: 'height_std' is given twice",
    '{"rough": {"height_std": 0.1, "height_std": 0.2}}': "'height_std' is given twice",
    '{"rough": {"height_std": 0.1}, "rough": {"height_std": 0.2}}': "'rough' is given twice",
    "hills:height=1": "hills",
    "rough:height=1": "height",
    "stairs:rise=1e9": "rise must be",
    "waves:height=0.1,strides=1": "strides must be",
}


@pytest.mark.parametrize("text", WRONG)
def test_text_that_is_no_ground_is_refused(text, tmp_path):
    with pytest.raises(ValueError, match=WRONG[text]):
        terrain_from(text)
    file = tmp_path / "wrong.json"
    file.write_text('{"stairs": {"rise": 1e9}}')
    with pytest.raises(ValueError, match=r"wrong\.json: .*rise must be"):
        terrain_from(file)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"height_std": -0.01}, "height_std"), ({"slope_std": math.nan}, "slope_std"),
        ({"repeats": "yes"}, "repeats"), ({"rises": (0.0, 0.1)}, "2 rises for 1 slopes"),
        ({"rises": ()}, "rises"), ({"slopes": (2.0,)}, "slopes"),
    ],
)  # fmt: skip
def test_fields_of_ground_are_checked(fields, message):
    with pytest.raises(ValueError, match=message):
        Terrain(**fields)
    with pytest.raises(ValueError, match="3 heights for 2 slopes of footholds"):
        footholds([0.0, 0.1, 0.2], [0.0, 0.1])


def test_contacts_are_summed_along_the_footholds_own_slopes():
    walker = replace(WALKERS["lab"], gravity=3.0)
    ground = np.array([[0.0, 0.01, 0.1], [0.1, -0.02, -0.15], [-0.05, 0.3, 0.4]])
    lengths, here, expected = np.array([0.4, 0.5, 9.0]), 0.0 + 0.0j, [0.0 + 0.0j]
    for (tilt, rise, turn), length in list(zip(ground, lengths, strict=True))[:-1]:
        up = rise * 0.81 + 0.2 * (1.0 - math.cos(turn))
        here += complex(
            length * math.cos(tilt) + up * math.sin(tilt),
            up * math.cos(tilt) - length * math.sin(tilt),
        )
        expected.append(here)
    np.testing.assert_allclose(contacts(walker, ground, lengths), expected, rtol=1e-14)


def test_survivors_are_those_whose_every_stride_ends_in_a_heelstrike():
    gait = find_gait("lab", 0.036)
    walker, ground = gait.walker, rough(height_std=0.006)
    units = walker.units
    left = survivors(
        Walkers(walker=walker, tolerance=1e-8), units.to_dimensionless(gait.state), 0.036, ground,
        walkers=25, strides=6, seed=3,
    )  # fmt: skip
    keys = np.random.default_rng(3).integers(2**64, size=25, dtype=np.uint64)
    made = []
    for key in keys:
        state, count = gait.state, 0
        for place in range(6):
            slope, rise, turn = ground.ground(key, place)
            end = stride(
                walker, 0.036 + slope, state, height_change=rise * units.length, slope_change=turn,
                tolerance=1e-8,
            )  # fmt: skip
            if end.outcome.name != "HEELSTRIKE":
                break
            state, count = end.state, count + 1
        made.append(count)
    expected = [25, *(sum(count > i for count in made) for i in range(6))]
    assert left.tolist() == expected
    assert 25 >= left[1] > left[-1]


def test_gaits_are_sorted_by_their_step_and_each_is_of_its_kind():
    gaits = find_gaits("E", 0.01)
    assert [gait.kind for gait in gaits] == ["long", "short"]
    assert gaits[0].stance_angle > gaits[1].stance_angle
    for kind, gait in zip(("long", "short"), gaits, strict=True):
        np.testing.assert_allclose(find_gait("E", 0.01, kind).state, gait.state, rtol=1e-10)
        assert gait.beyond_fold == (kind == "short")
    assert find_gaits("lab", 0.001) == [] and find_gaits("E", -0.01) == []
    guesses = np.array([gait.state * 1.001 for gait in gaits])
    both = find_gaits("E", 0.01, guess=guesses)
    np.testing.assert_allclose([g.state for g in both], [g.state for g in gaits], rtol=1e-10)
    (second,) = find_gaits("E", 0.01, guess=guesses[1])
    np.testing.assert_allclose(second.state, gaits[1].state, rtol=1e-10)


def test_a_gait_of_three_strides_has_each_of_its_states_once():
    gait = find_gait("D", 0.0125, period=3)
    states = [gait.state]
    for _ in range(3):
        states.append(stride("D", 0.0125, states[-1], tolerance=1e-12).state)
    np.testing.assert_allclose(states[3], states[0], rtol=1e-9)
    np.testing.assert_allclose(gait.cycle.state, states[1:], rtol=1e-8)
    product = np.eye(3)
    for state in states[:3]:
        product = gpw.stride_jacobian("D", 0.0125, state) @ product
    known = sorted(np.abs(np.linalg.eigvals(product)), reverse=True)
    np.testing.assert_allclose(np.abs(gait.multipliers), known, atol=1e-8)
    assert gait.violation < 1e-11
    # A gait of one stride is none of three.
    assert all(x.period == 3 for x in find_gaits("D", 0.0125, period=3))


NOT_FOUND = {
    "no long-step gait of period 1 for walker 'E' at slope 0.02 rad under Actuation": lambda: (
        find_gait(stride_map("E", 0.02, controller=Actuation(hip_torque=-9.0)))
    ),
    "without `guess=` the search begins at starts of its own": lambda: find_gait(
        "lab", 0.001, guess=find_gait("lab", 0.036).state
    ),
    "period 5 for walker 'lab' at slope 0.036 rad.*`doubling_cascade` locates where": lambda: (
        find_gait("lab", 0.036, period=5)
    ),
}


@pytest.mark.parametrize("message", NOT_FOUND)
def test_a_search_that_fails_says_of_what_and_what_to_do(message):
    with pytest.raises(GaitNotFound, match=message) as raised:
        NOT_FOUND[message]()
    assert "\n" not in str(raised.value) and ". " not in str(raised.value)


DESIGNS = {
    "no quantity 'beauty'": dict(objective="beauty"),
    "constraints must map": dict(constraints=[("speed", 1.0)]),
    "must be a value or two": dict(constraints={"speed": (1.0, 2.0, 3.0)}),
    "needs a value, or a lowest": dict(constraints={"speed": (None, None)}),
    "speed cannot lie from 2 to 1": dict(constraints={"speed": (2.0, 1.0)}),
    "highest value only": dict(constraints={"spectral_radius": 0.5}),
    "parameters must be different names": dict(parameters=["hip_mass", "hip_mass"]),
    "cannot vary 'knees'": dict(parameters=["knees"]),
    "bounds must be a pair .* for each of the 1 parameters": dict(bounds=[(0, 1), (0, 1)]),
    "hip_mass is 0 to begin with: give finite bounds": dict(bounds=[(0.1, 1.0)]),
    "lowest hip_mass": dict(bounds=[("a", 1.0)]),
    "knee_margin is of walkers with knees": dict(constraints={"knee_margin": (0.1, None)}),
    "a spectral radius is made least without a bound": dict(
        objective="spectral_radius", maximize=True
    ),
    "maximize must be": dict(maximize=1),
    "iterations must be": dict(iterations=0),
}


@pytest.mark.parametrize("message", DESIGNS)
def test_a_design_s_wrong_argument_is_named(message):
    asked = dict(objective="speed", parameters=["hip_mass"], bounds=[(0.0, 1.0)], slope=0.01)
    with pytest.raises(ValueError, match=message):
        optimize_walker("E", **(asked | DESIGNS[message]))


def test_a_design_s_values_are_those_of_its_gaits_before_and_after():
    design = optimize_walker(
        "E", "speed", ["hip_mass", "shank_com"], [(0.0, 0.3), (0.4, 0.5)], slope=0.01,
        constraints={"step_length": (None, 0.43), "total_mass": (0.9, 1.3)}, maximize=True,
        iterations=20,
    )  # fmt: skip
    assert design.objective == "speed" and design.walker == design.gait.walker
    assert list(design.values) == ["speed", "step_length", "total_mass"]
    for name, values in design.values.items():
        for gait, value in zip((design.start, design.gait), values, strict=True):
            of = gait.walker if name == "total_mass" else gait
            assert value == pytest.approx(getattr(of, name), rel=1e-6), name
    assert design.gait.speed > design.start.speed
    assert design.start.walker == WALKERS["E"] and design.gait.slope == 0.01
    assert 0.0 <= design.walker.hip_mass <= 0.3 and 0.4 <= design.walker.shank_com <= 0.5
    assert design.tried >= 2


def test_footholds_that_are_tilted_alike_are_a_slope():
    tilted = gpw.stride_map("lab", 0.0, terrain=gpw.Terrain(slopes=(0.036,)))
    np.testing.assert_allclose(
        gpw.find_gait(tilted).state, gpw.find_gait("lab", 0.036).state, rtol=1e-9
    )


def test_walkers_with_held_knees_are_near_others_of_their_kind():
    held = gpw.tune(gpw.as_walker({"preset": "lab", "knees": "held"}))
    assert gpw.nearest_gait(held, 0.036, keep="slope").walker.knees == "held"
