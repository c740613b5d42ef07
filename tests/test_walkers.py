"""Parameters of walkers: validation, presets, tuning, interpolation and assembly."""

from __future__ import annotations

import copy
import json
import math
import pickle
from dataclasses import FrozenInstanceError, asdict, fields, replace

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

import gym_passive_walker as gpw
from gym_passive_walker import (
    WALKERS,
    Part,
    Walker,
    WalkerError,
    assemble,
    interpolate,
    lab_walker_from_parts,
    tune,
    tuning_errors,
)
from gym_passive_walker.models.walkers import as_walker, combine, describe, name_of
from gym_passive_walker.models.walkers.presets import is_walker
from gym_passive_walker.models.walkers.walker import varied
from tests.equations.bodies import Bodies
from tests.equations.examples import random_walker

NUMBERS = [field.name for field in fields(Walker) if field.name != "knees"]
LAB = WALKERS["lab"]


@pytest.mark.parametrize("name", NUMBERS)
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_every_parameter_is_finite(name, value):
    with pytest.raises(WalkerError, match=f"{name} must be finite, not {value}"):
        replace(LAB, **{name: value})


@pytest.mark.parametrize("name", NUMBERS)
@pytest.mark.parametrize("value", [None, "long", [1.0, 2.0]])
def test_every_parameter_is_a_number(name, value):
    with pytest.raises(WalkerError, match=f"{name} must be a number"):
        replace(LAB, **{name: value})


@pytest.mark.parametrize("value", ["3", b"3", True, 1j])
def test_what_only_looks_like_a_number_is_none(value):
    with pytest.raises(WalkerError, match="shank_mass must be a number, not"):
        replace(LAB, shank_mass=value)


def test_a_misspelt_parameter_is_answered_with_the_nearest():
    with pytest.raises(
        WalkerError, match=r"no thigh_len \(thigh_length\?\); it has thigh_length, "
    ):
        Walker(thigh_len=0.35, thigh_mass=2.0, shank_length=0.46, shank_mass=1.0)
    with pytest.raises(WalkerError, match=r"no foot_angel \(foot_angle\?\), colour; it has"):
        replace(LAB, foot_angel=0.1, colour="red")


@pytest.mark.parametrize("segment", ["thigh", "shank"])
@pytest.mark.parametrize("measure", ["com", "offset", "gyration"])
def test_a_mass_farther_from_its_joint_than_two_legs_is_a_slip(segment, measure):
    """17 for 0.17."""
    name, two_legs = f"{segment}_{measure}", 2.0 * LAB.leg_length
    assert getattr(replace(LAB, **{name: two_legs}), name) == two_legs
    for value in (17.0, -17.0)[: 1 if measure == "gyration" else 2]:
        with pytest.raises(
            WalkerError, match=f"{name} must be at most two leg lengths, 1.62, .* {value}"
        ):
            replace(LAB, **{name: value})


@pytest.mark.parametrize(
    "parts", [3, None, [3], [Part("1", 0.1)], [Part(1.0, None)], [(1.0,)], [Part(1.0, 0.1, 0, -1)]]
)
def test_what_is_no_part_makes_no_segment(parts):
    with pytest.raises(
        WalkerError, match=r"a segment is a list of Part|mass and inertia of a part"
    ):
        combine(parts)


@pytest.mark.parametrize("knees", [1, 0, None, "yes"])
def test_knees_are_there_or_not(knees):
    with pytest.raises(WalkerError, match="knees must be True, False or 'held'"):
        replace(LAB, knees=knees)


@pytest.mark.parametrize("name", ["thigh_length", "shank_length", "gravity"])
def test_lengths_and_gravity_are_positive(name):
    with pytest.raises(WalkerError, match=f"{name} must be positive, not 0.0"):
        replace(LAB, **{name: 0.0})


@pytest.mark.parametrize("radius", [-0.01, 0.46, 0.5])
def test_the_foots_centre_is_below_the_knee(radius):
    with pytest.raises(WalkerError, match=f"foot_radius must lie .* it is {radius}"):
        replace(LAB, foot_radius=radius)


@pytest.mark.parametrize("angle", [0.84, -0.84, 2.0, 0.5 * math.pi, math.pi])
def test_the_shank_reaches_the_foots_centre(angle):
    """At the lab walker's lengths the sine of the angle must be below 0.26 / 0.35."""
    with pytest.raises(WalkerError, match=r"foot_angle .* must be below 0.83"):
        replace(LAB, foot_angle=angle)


@pytest.mark.parametrize("angle", [0.5 * math.pi, -0.5 * math.pi])
def test_no_foot_is_at_a_right_angle_however_long_the_shank(angle):
    with pytest.raises(WalkerError, match=r"must be below 1\.57"):
        replace(LAB, shank_length=3.0 * LAB.thigh_length, foot_angle=angle)


def test_a_walker_has_mass():
    with pytest.raises(WalkerError, match="a walker needs mass"):
        replace(WALKERS["D"], hip_mass=0.0)


@pytest.mark.parametrize("changes", [{"knees": True}, {"foot_radius": 0.1}])
def test_legs_without_mass_are_the_simplest_walkers_alone(changes):
    with pytest.raises(WalkerError, match="simplest walker, which has point feet and no knees"):
        replace(WALKERS["D"], **changes)


@pytest.mark.parametrize(
    "changes",
    [{"shank_mass": 0.0}, {"shank_com": 0.0, "shank_offset": 0.0, "shank_gyration": 0.0}],
)
def test_a_free_shank_resists_turning(changes):
    with pytest.raises(WalkerError, match="a free shank needs a moment of inertia"):
        replace(LAB, **changes)
    assert not replace(LAB, knees=False, **changes).knees


def test_a_swing_leg_resists_turning():
    at_the_hip = {"thigh_com": 0.0, "thigh_offset": 0.0, "thigh_gyration": 0.0}
    with pytest.raises(WalkerError, match="a swing leg needs a moment of inertia about the hip"):
        replace(LAB, knees=False, shank_mass=0.0, **at_the_hip)


def test_an_error_about_walkers_is_an_error_about_values():
    assert issubclass(WalkerError, ValueError)


def test_a_walker_does_not_change():
    with pytest.raises(FrozenInstanceError):
        LAB.gravity = 1.62


def test_parameters_become_floats():
    walker = replace(LAB, hip_mass=1, thigh_length=np.float32(0.5))
    assert type(walker.hip_mass) is float
    assert type(walker.thigh_length) is float


def test_walkers_of_the_same_parameters_are_the_same():
    assert replace(LAB) == LAB
    assert hash(replace(LAB)) == hash(LAB)
    assert pickle.loads(pickle.dumps(LAB)) == copy.deepcopy(LAB) == LAB
    assert replace(LAB, hip_mass=1.0) != LAB


def test_leg_length_mass_and_time_of_the_laboratorys_walker():
    assert LAB.leg_length == 0.81
    assert LAB.total_mass == pytest.approx(2.0 * (2.345 + 1.013))
    assert replace(LAB, hip_mass=0.5).total_mass == pytest.approx(2.0 * (2.345 + 1.013) + 0.5)
    assert LAB.time_unit == pytest.approx(math.sqrt(0.81 / 9.81))


@pytest.mark.parametrize("name", WALKERS)
def test_a_straight_leg_goes_from_hip_to_foot_centre(name):
    walker = WALKERS[name]
    foot = Bodies(walker, (0.0, 0.0, 0.0)).legs[0].foot
    assert foot.real == pytest.approx(0.0, abs=1e-16)
    assert foot.imag < 0.0
    reach = walker.shank_length - walker.foot_radius
    sides = walker.thigh_length * math.sin(walker.foot_angle), reach * math.sin(walker.shank_angle)
    assert sides[0] == pytest.approx(sides[1], rel=1e-15)


def test_only_d_has_legs_without_mass():
    assert [name for name, walker in WALKERS.items() if walker.massless_legs] == ["D"]


@pytest.mark.parametrize("name", ["B", "D", "E", "F"])
def test_masses_on_the_line_from_hip_to_foot_are_tuned_as_they_are(name):
    assert tuning_errors(WALKERS[name]) == (0.0, 0.0, 0.0)
    assert tune(WALKERS[name]) == WALKERS[name]


@pytest.mark.parametrize("name", ["A", "C"])
def test_the_table_is_tuned_to_its_two_digits(name):
    tuned = tune(WALKERS[name])
    assert tuned.thigh_offset == pytest.approx(WALKERS[name].thigh_offset, abs=5e-4)
    assert tuned.shank_offset == pytest.approx(WALKERS[name].shank_offset, abs=5e-4)
    assert 0.0 < max(abs(error) for error in tuning_errors(WALKERS[name])) < 1e-3


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("knees", [False, True])
def test_a_tuned_walker_stands_at_zero_slope(seed, knees):
    """Its centre of mass is over the contact; with knees, the shank hangs straight by itself."""
    walker = random_walker(np.random.default_rng(seed), knees=knees)
    for one in (walker, tune(walker)):
        standing = Bodies(one, (0.0, 0.0, 0.0))
        leg = standing.legs[0]
        moment = sum(m * z.real for m, z in zip(standing.masses, standing.centres, strict=True))
        errors = tuning_errors(one)
        ahead = moment / one.total_mass / one.leg_length
        assert errors.static_equilibrium == pytest.approx(ahead, abs=1e-14)
        assert errors.collinearity == errors.static_equilibrium
        under_knee = (leg.shank - leg.knee).real / one.leg_length if knees else 0.0
        assert errors.shank_under_knee == pytest.approx(under_knee, abs=1e-14)
    np.testing.assert_allclose(tuning_errors(tune(walker)), 0.0, atol=1e-15)
    assert abs(tuning_errors(walker).static_equilibrium) > 1e-4


@pytest.mark.parametrize("name", ["A", "C", "lab", "lab-straight"])
def test_tuning_moves_the_two_offsets_and_nothing_else(name):
    before, after = asdict(WALKERS[name]), asdict(tune(WALKERS[name]))
    changed = {key for key in before if before[key] != after[key]}
    assert changed == {"thigh_offset", "shank_offset"}
    assert tune(tune(WALKERS[name])) == tune(WALKERS[name])


def test_a_thigh_without_mass_cannot_balance_an_angled_foot():
    light = replace(LAB, thigh_mass=0.0)
    with pytest.raises(WalkerError, match="thigh's mass"):
        tune(light)
    np.testing.assert_allclose(tuning_errors(tune(replace(light, foot_angle=0.0))), 0.0, atol=1e-15)


def test_a_blend_goes_from_one_walker_to_the_other():
    a, b = tune(LAB), LAB
    assert interpolate(a, b, 0.0) == a
    assert interpolate(a, b, 1.0) == b
    beyond = interpolate(a, b, 1.5)
    assert beyond.thigh_offset == pytest.approx(1.5 * b.thigh_offset - 0.5 * a.thigh_offset)


def test_a_blend_detunes_in_proportion():
    """Tuning errors of walkers that differ in their offsets are linear in them (Fig. 4.8)."""
    whole = np.array(tuning_errors(LAB))
    part = np.array(tuning_errors(interpolate(tune(LAB), LAB, 0.3)))
    np.testing.assert_allclose(part, 0.3 * whole, rtol=0.0, atol=1e-15)


def test_a_blend_of_knees_and_none_is_refused():
    with pytest.raises(WalkerError, match="knees"):
        interpolate(WALKERS["A"], WALKERS["C"], 0.5)


def test_a_blend_that_is_no_walker_is_refused():
    with pytest.raises(WalkerError):
        interpolate(WALKERS["E"], WALKERS["F"], 10.0)
    for fraction in (math.nan, "half", None, True):
        with pytest.raises(ValueError, match="fraction must be"):
            interpolate(WALKERS["E"], WALKERS["F"], fraction)


def test_the_laboratorys_parts_make_the_captions_walker():
    """Figure 4.3 lumps half the hip's mass with each thigh and rounds."""
    walker = lab_walker_from_parts()
    half_hip = Part(mass=0.5 * walker.hip_mass, com=0.0)
    thigh = combine(
        [
            half_hip,
            Part(
                mass=walker.thigh_mass,
                com=walker.thigh_com,
                offset=walker.thigh_offset,
                inertia=walker.thigh_mass * walker.thigh_gyration**2,
            ),
        ]
    )
    lumped = replace(
        walker,
        hip_mass=0.0,
        thigh_mass=thigh.mass,
        thigh_com=thigh.com,
        thigh_offset=thigh.offset,
        thigh_gyration=math.sqrt(thigh.inertia / thigh.mass),
    )
    for name in NUMBERS:
        assert getattr(lumped, name) == pytest.approx(getattr(LAB, name), abs=5.1e-4), name


def test_the_appendix_defines_the_angles_of_the_foot():
    """Etat and etaf of subsection 4.10.1: together they are the angle of the straight knee."""
    walker = lab_walker_from_parts()
    expected = math.atan(0.26 * math.sin(0.228) / (0.26 * math.cos(0.228) + 0.35))
    assert walker.foot_angle == pytest.approx(expected, rel=1e-15)
    assert walker.foot_angle + walker.shank_angle == pytest.approx(0.228, rel=1e-14)


PARTS = st.lists(
    st.builds(
        Part,
        mass=st.floats(0.01, 10.0),
        com=st.floats(-2.0, 2.0),
        offset=st.floats(-2.0, 2.0),
        inertia=st.floats(0.0, 5.0),
    ),
    min_size=1,
    max_size=5,
)


@given(parts=PARTS)
def test_combined_parts_keep_mass_first_and_second_moments(parts):
    whole = combine(parts)

    def moments(pieces):
        return [
            sum(p.mass for p in pieces),
            sum(p.mass * p.com for p in pieces),
            sum(p.mass * p.offset for p in pieces),
            sum(p.inertia + p.mass * (p.com**2 + p.offset**2) for p in pieces),
        ]

    np.testing.assert_allclose(moments([whole]), moments(parts), rtol=1e-12, atol=1e-12)


@given(parts=PARTS)
def test_it_does_not_matter_in_which_order_parts_are_combined(parts):
    assume(len(parts) > 1)
    stepwise = parts[0]
    for part in parts[1:]:
        stepwise = combine([stepwise, part])
    np.testing.assert_allclose(stepwise, combine(parts[::-1]), rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("parts", [[], [Part(mass=0.0, com=0.1)]])
def test_a_segment_of_nothing_is_refused(parts):
    with pytest.raises(WalkerError, match="need some mass"):
        combine(parts)


def test_assembled_shanks_are_where_the_workbench_had_them():
    """Down along the straight leg from the knee, and forward of it."""
    walker = assemble(
        thigh=[Part(mass=2.0, com=0.1, offset=-0.01, inertia=0.02)],
        shank=[Part(mass=1.0, com=0.2, offset=0.03, inertia=0.01)],
        thigh_length=0.4,
        shank_length=0.5,
        foot_radius=0.15,
        knee_angle=0.2,
        hip_mass=0.7,
        knees=False,
        gravity=1.62,
    )
    upright = walker.foot_angle  # puts the thigh's own line along the vertical
    leg = Bodies(walker, (upright, upright, upright)).legs[0]
    assert leg.thigh == pytest.approx(complex(0.01, -0.1))
    assert leg.knee == pytest.approx(-0.4j)
    assert leg.shank == pytest.approx(complex(0.03, -0.6))
    assert (walker.thigh_mass, walker.shank_mass, walker.hip_mass) == (2.0, 1.0, 0.7)
    assert (walker.knees, walker.gravity) == (False, 1.62)
    assert walker.thigh_mass * walker.thigh_gyration**2 == pytest.approx(0.02)
    assert walker.shank_mass * walker.shank_gyration**2 == pytest.approx(0.01)


def test_a_name_stands_for_its_walker():
    assert as_walker("lab") is LAB
    assert as_walker(LAB) is LAB
    with pytest.raises(WalkerError, match=r"no walker 'nobody': .* A, B, C, D, E, F, lab"):
        as_walker("nobody")


@pytest.mark.parametrize("name", ["Walker", "WALKERS", "tune", "interpolate", "stride", "Outcome"])
def test_the_package_offers_its_public_names(name):
    assert name in gpw.__all__
    assert hasattr(gpw, name)


def test_a_walker_is_called_by_the_title_in_its_file_or_else_by_the_file_s_name(tmp_path):
    for words, title in (('"preset": "C", "title": "ours"', "ours"), ('"preset": "C"', "mine")):
        (tmp_path / "mine.json").write_text(f"{{{words}}}")
        assert name_of(as_walker(tmp_path / "mine.json")) == title


NEVER_NEGATIVE = ["thigh_mass", "shank_mass", "hip_mass", "thigh_gyration", "shank_gyration"]
NEVER_NEGATIVE += ["hip_stiffness", "hip_friction", "knee_stiffness"]


def anything(seed, knees=True):
    """A walker without a parameter at its default."""
    random = np.random.default_rng(seed)
    springs = dict(zip(NEVER_NEGATIVE[5:], random.uniform(0.1, 2.0, 3), strict=True))
    walker = replace(random_walker(random, knees=knees), **springs)
    values = {name: getattr(walker, name) or 0.1 * random.uniform(0.1, 1.0) for name in NUMBERS}
    return Walker(knees=knees, **(values | {"gravity": random.uniform(1.0, 20.0)}))


@pytest.mark.parametrize("name", NUMBERS)
def test_a_parameter_below_zero_is_refused_by_name_if_it_cannot_be(name):
    walker, below = anything(1, knees=False), {name: -1e-3}
    positive = ("thigh_length", "shank_length", "gravity")
    expected = {
        **{each: f"{each} must be positive, not -0.001" for each in positive},
        **{each: f"{each} must not be negative, but is -0.001" for each in NEVER_NEGATIVE},
        "foot_radius": f"foot_radius must lie from 0 to below the shank's length "
        f"{walker.shank_length}, .*; it is -0.001",
    }
    if name in expected:
        with pytest.raises(WalkerError, match=f"^{expected[name]}$"):
            replace(walker, **below)
        if name not in positive:
            assert getattr(replace(walker, **{name: 0.0}), name) == 0.0
    else:
        assert getattr(replace(walker, **below), name) == -1e-3


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_the_foot_s_angle_is_limited_on_both_sides(sign):
    walker = replace(LAB, thigh_length=0.3, foot_radius=0.21)
    limit = math.asin(0.25 / 0.3)
    inside = replace(walker, foot_angle=sign * (limit - 1e-9))
    assert math.copysign(1.0, inside.shank_angle) == sign
    with pytest.raises(WalkerError, match=rf"foot_angle .* must be below {limit:.6g} rad"):
        replace(walker, foot_angle=sign * (limit + 1e-9))


@pytest.mark.parametrize("knees", [True, False])
def test_a_walker_s_text_makes_it_and_omits_defaults(knees):
    walker = anything(2, knees)
    names = {"Walker": Walker}
    assert eval(repr(walker), names) == walker
    for name in NUMBERS:
        assert f"{name}={getattr(walker, name)!r}" in repr(walker)
    assert ("knees=False" in repr(walker)) is not knees
    for preset in WALKERS.values():
        assert eval(repr(preset), names) == preset
        assert "gravity" not in repr(preset) and "hip_stiffness" not in repr(preset)


@pytest.mark.parametrize("knees", [True, False, "held"])
def test_facts_of_a_walker_are_all_its_parameters_to_six_digits(knees):
    walker = anything(3, knees=knees)
    expected = {name: f"{getattr(walker, name):.6g}" for name in NUMBERS} | {"knees": str(knees)}
    assert walker.facts() == expected


def test_springs_friction_and_gravity_are_between_those_of_both_walkers():
    a, b = anything(4), anything(5)
    part = interpolate(a, b, 0.25)
    for name in NUMBERS:
        assert getattr(a, name) != getattr(b, name), name
        between = 0.75 * getattr(a, name) + 0.25 * getattr(b, name)
        assert getattr(part, name) == pytest.approx(between, rel=1e-14), name
    for knees in (True, False):
        assert interpolate(anything(4, knees), anything(5, knees), 0.5).knees is knees


def test_presets_have_every_number_of_the_source():
    point = {"thigh_length": 0.5, "shank_length": 0.5, "knees": False}
    lab = {"thigh_length": 0.35, "thigh_mass": 2.345, "thigh_gyration": 0.099, "thigh_com": 0.091}
    lab |= {"shank_length": 0.46, "shank_offset": 0.025, "shank_mass": 1.013, "foot_radius": 0.2}
    lab |= {"shank_gyration": 0.197, "shank_com": 0.17, "foot_angle": 0.097}
    c = lab | {"thigh_offset": -0.023, "thigh_gyration": 0.1882, "thigh_com": 0.084}
    c |= {"shank_offset": 0.022, "shank_gyration": 0.1226}
    e = point | {"thigh_mass": 0.4, "shank_mass": 0.1, "shank_com": 0.5}
    expected = {
        "A": c | {"knees": False},
        "B": e | {"foot_radius": 0.2},
        "C": c,
        "D": point | {"thigh_mass": 0.0, "shank_mass": 0.0, "hip_mass": 1.0},
        "E": e,
        "F": e | {"thigh_mass": 0.45, "shank_mass": 0.05},
        "lab": lab,
        "lab-straight": lab | {"knees": False},
    }
    assert list(WALKERS) == list(expected)
    for name, values in expected.items():
        for parameter, value in asdict(WALKERS[name]).items():
            default = {"knees": True, "gravity": 9.81}.get(parameter, 0.0)
            assert value == values.get(parameter, default), (name, parameter)


def test_a_title_belongs_to_the_copy_and_makes_no_other_walker():
    named = LAB.titled("mine")
    assert (named.title, LAB.title, type(named)) == ("mine", "", Walker)
    assert named == LAB and hash(named) == hash(LAB) and name_of(named) == "mine"
    assert name_of(tune(named)) == "mine (tuned)" and tune(named) == tune(LAB)


def test_walkers_without_a_title_are_called_by_preset_tuning_or_kind():
    for name, walker in WALKERS.items():
        assert name_of(replace(walker)) == name
        assert describe(replace(walker)) == f"walker {name!r}"
    assert name_of(replace(tune("C"))) == name_of(tune("C")) == "C (tuned)"
    assert describe(tune("C")) == str(tune("C"))
    assert describe(LAB.titled("x")) == "walker 'x'"
    for walker, kind in (
        (replace(LAB, hip_mass=1.0), "kneed, leg length 0.81, mass 7.716"),
        (replace(LAB, hip_mass=1.0, knees=False), "straight-legged, leg length 0.81, mass 7.716"),
        (replace(WALKERS["D"], hip_mass=2.0), "simplest, leg length 1, mass 2"),
    ):
        assert name_of(walker) == kind


def test_a_mapping_of_a_preset_changes_it_and_stays_as_it_is():
    given_ = {"preset": "lab", "foot_radius": 0.15, "title": "round"}
    before = dict(given_)
    walker = as_walker(given_)
    assert walker == replace(LAB, foot_radius=0.15) and walker.title == "round"
    assert given_ == before
    assert as_walker({"preset": "E"}).title == ""
    whole = asdict(anything(6))
    assert as_walker(whole) == anything(6)


@pytest.mark.parametrize(
    ("mapping", "message"),
    [
        ({"preset": "nobody"}, "no preset 'nobody': choose from A, B, C, D, E, F, lab"),
        ({"preset": ["lab"]}, r"no preset \['lab'\]"),
        ({"preset": "lab", "title": 3}, "a walker's title must be text, not 3"),
        ({"foot_radius": 0.2}, r"no walker .*thigh_length.*change a preset, one of A, B"),
        ({"preset": "lab", "hip_mass": -1.0}, "hip_mass must not be negative"),
    ],
)
def test_mappings_and_files_that_make_no_walker_are_refused(mapping, message, tmp_path):
    with pytest.raises(WalkerError, match=f"^{message}"):
        as_walker(mapping)
    file = tmp_path / "given.json"
    file.write_text(json.dumps(mapping))
    with pytest.raises(WalkerError, match=rf"given\.json: {message}"):
        as_walker(file)


def test_a_file_that_holds_no_mapping_is_refused(tmp_path):
    (tmp_path / "list.json").write_text("[1, 2]")
    with pytest.raises(WalkerError, match=r"list\.json must name a walker's parameters"):
        as_walker(tmp_path / "list.json")
    (tmp_path / "broken.json").write_text("{")
    with pytest.raises(WalkerError, match=r"no walker: .*broken\.json"):
        as_walker(str(tmp_path / "broken.json"))


def test_which_values_are_forms_of_a_walker(tmp_path):
    (tmp_path / "mine.json").write_text('{"preset": "C"}')
    (tmp_path / "policy.onnx").write_text("")
    (tmp_path / "policy.ZIP").write_text("")
    for value in (
        LAB,
        "lab",
        {"preset": "lab"},
        tmp_path / "mine.json",
        str(tmp_path / "mine.json"),
    ):
        assert is_walker(value), value
    for value in ("nobody", None, 3, tmp_path, tmp_path / "policy.onnx", tmp_path / "policy.ZIP"):
        assert not is_walker(value), value


def test_a_walker_with_other_values_has_all_its_own_besides():
    walker = anything(7)
    for name in NUMBERS:
        value = 1.01 * getattr(walker, name)
        other = walker.with_parameters(**{name: value})
        assert asdict(other) == asdict(walker) | {name: value}
        attributes = vars(varied(walker, {name: value}))
        assert attributes == asdict(walker) | {name: value, "massless_legs": False}
    assert varied(WALKERS["D"], {}).massless_legs
    with pytest.raises(WalkerError, match="hip_stiffness"):
        walker.with_parameters(hip_stiffness=-1.0)


def test_the_massless_and_those_whose_mass_is_in_one_segment():
    for thigh, shank in ((0.0, 1.0), (1.0, 0.0)):
        walker = replace(LAB, knees=False, thigh_mass=thigh, shank_mass=shank)
        assert not walker.massless_legs and walker.total_mass == 2.0


@pytest.mark.parametrize("name", ["thigh_length", "shank_length", "foot_radius", "knee_angle"])
@pytest.mark.parametrize("value", [math.nan, math.inf, "x"])
def test_measured_legs_have_numbers(name, value):
    measures = {"thigh_length": 0.35, "shank_length": 0.46, "foot_radius": 0.2, "knee_angle": 0.2}
    part = [Part(1.0, 0.1, 0.0, 0.01)]
    with pytest.raises(ValueError, match=name):
        assemble(part, part, **(measures | {name: value}))


def test_the_laboratory_s_parts_are_those_of_the_appendix():
    walker = lab_walker_from_parts()
    thigh = [(0.9868 + 0.8, 0.116, 0.0181), (0.1718, 0.029845, 0.0)]
    mass = sum(m for m, _, _ in thigh)
    com = sum(m * c for m, c, _ in thigh) / mass
    inertia = sum(i + m * (c - com) ** 2 for m, c, i in thigh)
    assert walker.thigh_mass == pytest.approx(mass) and walker.thigh_com == pytest.approx(com)
    assert walker.thigh_gyration == pytest.approx(math.sqrt(inertia / mass))
    assert walker.shank_gyration == pytest.approx(math.sqrt(0.03923 / 1.013))
    assert (walker.hip_mass, walker.foot_radius, walker.gravity) == (0.773, 0.2, 9.81)
    assert walker.knees and walker.thigh_offset == 0.0


def test_each_part_is_checked_for_mass_and_inertia():
    for bad in (Part(-1e-3, 0.1), Part(1.0, 0.1, 0.0, -1e-3)):
        with pytest.raises(WalkerError, match="mass and inertia of a part must not be negative"):
            combine([Part(1.0, 0.1), bad])
    assert combine([Part(0.0, 9.0), Part(1.0, 0.1)]) == Part(1.0, 0.1)
