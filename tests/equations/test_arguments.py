"""Validation of arguments: bounds, kinds, messages, and conversions of units."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from examples.five_links import FIVE_LINKS
from examples.torso import TORSO
from gym_passive_walker._tools import arguments
from gym_passive_walker._tools.arguments import number, real_array, unknown, whole
from gym_passive_walker.models import units
from gym_passive_walker.models.walkers import PARAMETERS, WALKERS

INF, NAN = math.inf, math.nan
BOUNDS = {
    "any": ({}, [-1e300, 0, 5, np.float32(2.0), np.array(3)], [INF, -INF, NAN], "finite number"),
    "least": ({"least": 2.0}, [2, 2.5, 1e9], [1.999, -3.0, NAN], "number from 2 on"),
    "above": ({"above": 0.0}, [1e-300, 7], [0.0, -1e-9, NAN], "number above 0"),
    "most": ({"most": 3.0}, [3, -9], [3.0001, NAN], "number up to 3"),
    "both": ({"least": 0.5, "most": 4.0}, [0.5, 4], [0.49, 4.1, INF], "number from 0.5 to 4"),
    "half open": ({"above": 0.0, "most": 1.0}, [1.0, 1e-9], [0.0, 1.1], "number above 0 up to 1"),
    "infinite": ({"above": 0.0, "most": INF}, [INF, 3.0], [0.0, -INF, NAN], "number above 0"),
}


@pytest.mark.parametrize("name", BOUNDS)
def test_a_number_has_its_bounds_and_a_refusal_says_which(name):
    bounds, right, wrong, words = BOUNDS[name]
    for value in right:
        found = number(value, "friction", **bounds)
        assert type(found) is float and found == value
    for value in [*wrong, "1", b"1", True, None, [1.0, 2.0], 1j, np.array([1.0])]:
        with pytest.raises(ValueError, match=r"^friction must be ") as refused:
            number(value, "friction", **bounds)
        said = str(refused.value)
        assert said.endswith(f"not {value!r}"[:200])
        if isinstance(value, float):
            assert f" {words}" in said.replace("finite number", "number") or words in said


def test_a_whole_number_has_its_bounds_and_a_refusal_names_the_one_that_is_passed():
    for value in (3, 7, 5.0, np.int64(4), np.float64(6.0)):
        found = whole(value, "strides", 3, 7)
        assert type(found) is int and found == value
    for value, limit in (
        (2, "from 3 on"), (-1, "from 3 on"), (8, "from 3 to 7"), (4.5, "from 3 on"),
        (True, "from 3 on"), ("5", "from 3 on"), (None, "from 3 on"), (NAN, "from 3 on"),
        (INF, "from 3 on"),
    ):  # fmt: skip
        with pytest.raises(ValueError, match=f"^strides must be a whole number {limit}, not "):
            whole(value, "strides", 3, 7)
    with pytest.raises(ValueError, match="from 1 on, not 0"):
        whole(0, "strides")
    assert whole(1_000_000_000, "strides") == 1_000_000_000
    with pytest.raises(ValueError, match="from 1 to 1000000000"):
        whole(1_000_000_001, "strides")


def test_seeds_booleans_tolerances_and_kinds():
    assert arguments.seed_number(0) == 0
    assert arguments.seed_number(2**128 - 1) == 2**128 - 1
    for value in (-1, 2**128, 0.5, True, None):
        with pytest.raises(ValueError, match=r"^terrain_seed must be a whole number"):
            arguments.seed_number(value, "terrain_seed")
    for value in (True, False, np.True_):
        assert arguments.boolean(value, "json") is bool(value)
    for value in (0, 1, "True", None):
        with pytest.raises(ValueError, match=r"^json must be True or False, not "):
            arguments.boolean(value, "json")
    for value in (1e-15, 1e-8, 0.1):
        assert arguments.check_tolerance(value) == value
    for value in (0.9e-15, 0.11, 0.0, -1.0, NAN):
        with pytest.raises(
            ValueError, match=r"^tolerance must be a (finite )?number from 1e-15 to 0\.1, not "
        ):
            arguments.check_tolerance(value)
    assert [arguments.gait_kind(kind) for kind in ("long", "short")] == ["long", "short"]
    for value in ("Long", "", None, 1, ["long"]):
        with pytest.raises(ValueError, match=r'^kind must be "long" or "short", not '):
            arguments.gait_kind(value)
    assert arguments.instance(3, int, "walk", "simulate(...)") == 3
    with pytest.raises(ValueError, match=r"^walk must be a int, such as simulate\(\.\.\.\), not '"):
        arguments.instance("3", int, "walk", "simulate(...)")


@pytest.mark.parametrize(
    "value", [True, [True, False], "1", ["1"], [1j], [b"1"], [[1.0], [1.0, 2.0]], None, [10**400],
              np.array(["2020"], "M8")],
)  # fmt: skip
def test_an_array_holds_real_numbers_alone(value):
    with pytest.raises(ValueError, match=r"^torques must be a number or an array"):
        real_array(value, "torques", "a number or an array")


@pytest.mark.parametrize("value", [[1.0, INF], [NAN], -INF])
def test_an_array_of_numbers_is_finite(value):
    with pytest.raises(ValueError, match=r"^torques must be numbers, all finite, not "):
        real_array(value, "torques", "numbers")


def test_an_array_keeps_its_shape_and_becomes_double():
    for given in (3, [[1, 2], [3, 4]], np.float32(1.5), np.zeros((0, 6))):
        found = real_array(given, "x", "numbers")
        assert found.dtype == np.float64 and found.shape == np.shape(given)
        np.testing.assert_array_equal(found, given)


def test_slopes_are_between_the_vertical_ones_and_downhill_where_walkers_need_it():
    steep = np.nextafter(0.5 * np.pi, 0.0)
    np.testing.assert_array_equal(arguments.check_slope([-steep, steep]), [-steep, steep])
    for slope in (0.5 * np.pi, -0.5 * np.pi, [0.1, 2.0]):
        with pytest.raises(ValueError, match="slope must be an angle in rad between -pi/2 and"):
            arguments.check_slope(slope)
    assert arguments.one_slope(np.float32(0.5)) == 0.5
    for slope in ([0.1], "0.1", True, None):
        with pytest.raises(ValueError, match=r"^steepness must be one number"):
            arguments.one_slope(slope, "steepness")
    np.testing.assert_array_equal(arguments.several_slopes(0.1, "slopes"), [0.1])
    np.testing.assert_array_equal(
        arguments.several_slopes([0.0, -0.1], "slopes", downhill=False), [0, -0.1]
    )
    for slopes in ([], [[0.1]], [0.1, 0.0], [-0.1]):
        with pytest.raises(ValueError, match=r"^slopes must be one or more angles in rad above 0"):
            arguments.several_slopes(slopes, "slopes")
    with pytest.raises(ValueError, match=r"angles in rad, in one row"):
        arguments.several_slopes([], "slopes", downhill=False)


@pytest.mark.parametrize(
    ("model", "words"),
    [
        (None, r"\[stance, thigh, shank angle, then their rates\]: shape \(6,\) or \(n, 6\)"),
        (TORSO, r"\[stance, swing, torso, .*, torso_rate\]: shape \(6,\) or \(n, 6\)"),
        (FIVE_LINKS, r"\[shin, .*\]: shape \(10,\) or \(n, 10\)"),
    ],
)
def test_states_have_the_numbers_of_their_walker(model, words):
    size = 6 if model is None else model.size
    for shape in ((size,), (3, size), (2, 3, size), (0, size)):
        assert arguments.check_state(np.ones(shape), of=model).shape == shape
    for shape in ((), (size - 1,), (size, size + 1)):
        with pytest.raises(ValueError, match=f"^start must be {words}, not"):
            arguments.check_state(np.ones(shape), "start", model)


def test_unknown_names_are_answered_with_similar_ones():
    known = ("thigh_mass", "hip_mass", "gravity")
    assert unknown(known, known, "a walker") is None
    said = unknown(["hip_mas", "gravity", "zzz"], known, "a walker")
    assert said == "a walker has no hip_mas (hip_mass?), zzz; it has thigh_mass, hip_mass, gravity"


def test_values_in_messages_are_short_and_always_there():
    class Silent:
        def __repr__(self):
            raise RuntimeError

    assert arguments.shown(Silent()) == "a Silent"
    text = arguments.shown("a" * 150 + "b" * 150)
    assert len(text) == 205 and text.startswith("'aaa") and text.endswith("bbb'")
    assert arguments.shown("c" * 198) == repr("c" * 198)


# Units


def changed(name):
    """A preset with other units of time, mass and length."""
    return replace(WALKERS[name], gravity=3.7)


@pytest.mark.parametrize("name", WALKERS)
def test_units_are_those_of_leg_mass_and_gravity(name):
    walker = changed(name)
    length = walker.thigh_length + walker.shank_length
    mass = 2 * walker.thigh_mass + 2 * walker.shank_mass + walker.hip_mass
    time = math.sqrt(length / 3.7)
    found = walker.units
    expected = {
        "length": length, "time": time, "energy": mass * 3.7 * length, "rate": 1 / time,
        "force": mass * 3.7, "impulse": mass * math.sqrt(3.7 * length),
        "speed": math.sqrt(3.7 * length),
        "torque": 3.7 * length * (1.0 if walker.massless_legs else mass),
    }  # fmt: skip
    for key, value in expected.items():
        assert getattr(found, key) == pytest.approx(value, rel=1e-14), key
    kinds = expected | {"angle": 1.0, "mass": mass, "gravity": 3.7}
    kinds["friction"] = kinds["torque"] * time
    for parameter, kind in units.KINDS.items():
        assert units.unit_of(walker, parameter) == pytest.approx(kinds[kind], rel=1e-14), parameter
    symbols = {"angle": "rad", "length": "l", "mass": "m", "gravity": "g", "time": "√(l/g)",
               "speed": "√(g l)", "torque": "(m g l)", "energy": "(m g l)",
               "friction": "(m l √(g l))", "impulse": "(m √(g l))", "force": "(m g)",
               "power": "(m g √(g l))", "rate": "√(g/l)", "twist": "(m l √(g l))"}  # fmt: skip
    assert {kind: symbol for kind, (symbol, _) in units.UNITS.items()} == symbols


@pytest.mark.parametrize("shape", [(6,), (4, 6), (2, 3, 6), (8,), (5, 4)])
def test_states_become_dimensionless_by_their_rates_and_return(shape):
    given = np.random.default_rng(1).normal(size=shape)
    found = changed("lab").units
    half = shape[-1] // 2
    scaled = found.to_dimensionless(given)
    np.testing.assert_array_equal(scaled[..., :half], given[..., :half])
    np.testing.assert_allclose(scaled[..., half:], given[..., half:] * found.time)
    np.testing.assert_allclose(found.to_own(scaled), given, rtol=1e-15)
    scaled[...] = 0.0  # a result is the caller's own
    np.testing.assert_allclose(found.to_dimensionless(given)[..., half:],
                               given[..., half:] * found.time)  # fmt: skip


def test_each_of_several_walkers_has_its_own_unit_of_time():
    times = np.array([0.5, 1.0, 2.0])
    many = units.Units(np.ones(3), times, np.ones(3), np.ones(3))
    states = np.random.default_rng(2).normal(size=(3, 6))
    for index, time in enumerate(times):
        one = units.Units(1.0, float(time), 1.0, 1.0)
        np.testing.assert_array_equal(
            many.to_dimensionless(states)[index], one.to_dimensionless(states[index])
        )
        np.testing.assert_array_equal(many.to_own(states)[index], one.to_own(states[index]))


@pytest.mark.parametrize("name", ["lab", "C", "D", "A"])
def test_the_growth_of_units_is_their_logarithmic_derivative(name):
    walker = changed(name)
    for parameter in PARAMETERS:
        value = getattr(walker, parameter)
        step = 1e-6 * max(abs(value), 0.1)
        if value < step and parameter != "foot_angle":
            continue  # at a bound
        more, less = (
            units.Units.of(replace(walker, **{parameter: value + sign * step}))
            for sign in (1.0, -1.0)
        )
        found = units.growth(walker, parameter)
        for key in ("length", "time", "energy", "torque"):
            expected = math.log(getattr(more, key) / getattr(less, key)) / (2.0 * step)
            assert getattr(found, key) == pytest.approx(expected, abs=2e-8), (parameter, key)


def test_proportions_are_parameters_in_their_units_in_the_order_of_the_names():
    walker = changed("lab")
    names = ("hip_mass", "foot_angle", "thigh_com", "hip_stiffness")
    found = units.proportions(walker, names)
    assert found == [getattr(walker, name) / units.unit_of(walker, name) for name in names]
    assert set(units.PROPORTIONS) == set(PARAMETERS) - {"gravity"}
