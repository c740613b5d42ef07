"""Every field that an analysis returns has the walker's own units: a walker in others is the same.

Lengths, masses and gravity are multiplied by different numbers. Each field then changes by the
product that its unit says, and dimensionless ones stay.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gym_passive_walker import (
    WALKERS,
    Actuation,
    basin_of_attraction,
    bifurcation_diagram,
    collision_matrix,
    crisis,
    doubling_cascade,
    find_gait,
    find_gaits,
    foot_velocity,
    gait_family,
    largest_push,
    lyapunov_exponents,
    parameter_family,
    reality_check,
    simulate,
    stride_jacobian,
    stride_map,
)
from gym_passive_walker.gaits.control.baselines import LinearFeedback
from gym_passive_walker.gaits.control.feedback import powered_gait
from gym_passive_walker.gaits.measures import Dimensionless

LENGTH, MASS, GRAVITY = 2.3, 1.7, 0.6
TIME = (LENGTH / GRAVITY) ** 0.5
SPEED, TORQUE = LENGTH / TIME, MASS * GRAVITY * LENGTH
RATES = np.array([1.0, 1.0, 1.0, 1.0 / TIME, 1.0 / TIME, 1.0 / TIME])

SPRUNG = replace(WALKERS["lab"], hip_stiffness=0.05, hip_friction=0.002, knee_stiffness=0.01)
E_SPRUNG = replace(WALKERS["E"], hip_stiffness=0.01, hip_friction=0.002)
PLAIN = {"lab": WALKERS["lab"], "sprung": SPRUNG, "E": E_SPRUNG, "D": WALKERS["D"]}
SLOPES = {"lab": 0.036, "sprung": 0.04, "E": 0.012, "D": 0.009}

UNITS = {"gravity": GRAVITY, "hip_stiffness": TORQUE, "knee_stiffness": TORQUE}
UNITS |= {"hip_friction": TORQUE * TIME, "foot_angle": 1.0, "hip_torque": TORQUE, "slope": 1.0}
UNITS |= {"ankle_torque": TORQUE, "push_off": MASS * SPEED}
UNITS |= {f"{part}_mass": MASS for part in ("hip", "thigh", "shank")}


def unit(name: str) -> float:
    """By how much a number of that name changes."""
    return UNITS.get(name, LENGTH)


def in_others(walker):
    """The walker in other units; of one without leg mass no spring is meant."""
    names = [name for name in vars(walker) if name not in ("knees", "title")]
    return replace(walker, **{name: getattr(walker, name) * unit(name) for name in names})


OTHER = {name: in_others(walker) for name, walker in PLAIN.items()}
BOTH = [("lab", "long"), *((name, kind) for name in "ED" for kind in ("long", "short"))]


def same(found, known, size=1.0, rel=1e-8):
    np.testing.assert_allclose(found, np.asarray(known) * size, rtol=rel, atol=rel * 1e-3)


@pytest.fixture(scope="module")
def gaits():
    """Gaits in both units."""
    return {
        (name, kind): [find_gait(w[name], SLOPES[name], kind) for w in (PLAIN, OTHER)]
        for name, kind in [*BOTH, ("sprung", "long")]
    }


def flat(value, name=""):
    """Numbers of a dimensionless result, with their names."""
    if isinstance(value, Dimensionless):
        for each in set(dir(value)) - LINKS:
            yield from flat(getattr(value, each), f"{name}.{each}")
    elif isinstance(value, tuple):
        names = getattr(value, "_fields", range(len(value)))
        for each, part in zip(names, value, strict=True):
            yield from flat(part, f"{name}.{each}")
    elif isinstance(value, float | complex | np.ndarray):
        yield name, np.asarray(value)


LINKS = {"walker", "stride_map", "controller", "readings", "passed", "point", "terrain",
         "violation", "multipliers_error", "ends", "folds", "halts"}  # fmt: skip
"""Attributes that are no quantities, those of a varied one, and errors of rounding."""


def alike(known, found, rel=1e-7):
    """Check that results of a walker in two systems of units have the units of one table."""
    known, found = (dict(flat(x.dimensionless)) for x in (known, found))
    assert known.keys() == found.keys()
    for name, value in known.items():
        atol = rel * 1e-3
        if np.asarray(value).dtype.kind == "U":
            assert [*found[name]] == [*value], name
            continue
        np.testing.assert_allclose(found[name], value, rtol=rel, atol=atol, err_msg=name)


@pytest.mark.parametrize(("name", "kind"), [*BOTH, ("sprung", "long")])
def test_a_gait_its_strides_and_all_its_measures(name, kind, gaits):
    plain, other = gaits[name, kind]
    alike(plain, other, rel=1e-6)
    same(foot_velocity(other), foot_velocity(plain), SPEED, rel=1e-6)
    same(other.speed, plain.speed, SPEED)
    same(other.stride.gravity_work, plain.stride.gravity_work, TORQUE)


@pytest.mark.parametrize("name", PLAIN)
def test_the_collision_matrix(name):
    for angle in (0.0, 0.2, -0.1):
        found, known = (collision_matrix(w[name], angle) for w in (OTHER, PLAIN))
        np.testing.assert_allclose(found, MASS * known, rtol=1e-10, atol=1e-12)


@pytest.mark.parametrize("name", PLAIN)
def test_each_column_of_the_stride_map_s_derivative(name, gaits):
    """By the state, the slope, each actuator and each parameter, which may change all units."""
    names = ["slope", "state", "hip_torque", "push_off"]
    names += ["thigh_length", "gravity", "hip_mass", "hip_stiffness", "hip_friction"]
    if name != "D":
        names += ["shank_mass", "shank_com", "foot_radius", "thigh_gyration", "foot_angle"]
        names += ["ankle_torque"] * (PLAIN[name].foot_radius == 0.0)
    names += ["knee_stiffness"] * PLAIN[name].knees
    if name == "D":
        names = [x for x in names if not x.startswith("hip_") or x == "hip_mass"]
    plain, other = gaits[name, "long"]
    held = {"push_off": 0.01 * plain.walker.total_mass}
    if name != "D":
        held["hip_torque"] = 0.01
    moved = {each: value * unit(each) for each, value in held.items()}
    known = stride_jacobian(plain, wrt=names, **held)
    found = stride_jacobian(other, wrt=names, **moved)
    rates = np.array([1.0, *[1.0 / TIME] * (len(known) - 1)])
    columns = np.concatenate([rates if x == "state" else [unit(x)] for x in names])
    assert known.shape == (len(rates), len(columns))
    np.testing.assert_allclose(
        found, known * rates[:, None] / columns, rtol=1e-7, atol=1e-9 * np.abs(found).max()
    )


@pytest.mark.parametrize("name", ["lab", "D"])
def test_a_basin_and_the_largest_perturbations(name):
    known, found = (
        basin_of_attraction(w[name], SLOPES[name], resolution=12, strides=40)
        for w in (PLAIN, OTHER)
    )
    alike(known, found, rel=1e-6)
    assert len(known.gaits) == 1
    ratios = (0.3, 1.4)
    angles, rates = [0.2, 0.3], np.array([-1.5, -0.8])
    known, found = (
        basin_of_attraction(
            w[name], SLOPES[name], stance_angles=angles, stance_rates=rates * size, ratios=ratios
        )
        for w, size in ((PLAIN, 1.0), (OTHER, 1.0 / TIME))
    )
    np.testing.assert_array_equal(found.strides, known.strides)
    same(found.stance_rate, rates / TIME)
    found, known = (largest_push(w[name], SLOPES[name]) for w in (OTHER, PLAIN))
    for way in ("forward", "backward"):
        same(getattr(found, way), getattr(known, way), 1.0 / TIME, rel=1e-6)
        same(getattr(found.dimensionless, way), getattr(known.dimensionless, way), rel=1e-6)


def test_walks_over_slopes_and_their_exponents():
    start = find_gait("D", 0.0125).state * np.array([1.01, 1.01, 1.01, 1.0, 1.0, 1.0])
    asked = dict(n_transient=20, n_recorded=5, longest_period=2)
    for sweep in (False, True):
        known, found = (
            bifurcation_diagram(w["D"], [0.0125, 0.009], start=start * size, sweep=sweep, **asked)
            for w, size in ((PLAIN, 1.0), (OTHER, RATES))
        )
        alike(known, found)
    known, found = (
        lyapunov_exponents(w["D"], [0.0125], start=start * size, n_transient=0, strides=20, count=2)
        for w, size in ((PLAIN, 1.0), (OTHER, RATES))
    )
    same(found, known, rel=1e-6)
    asked = dict(strides=50, walkers=2, accuracy=1e-4)
    known, found = (
        crisis(w["D"], 0.0125, 0.023, start=start * size, **asked)
        for w, size in ((PLAIN, 1.0), (OTHER, RATES))
    )
    assert 0.0185 < found < 0.021 and abs(found - known) < 5e-4


def test_families_over_the_slope_a_length_a_mass_and_gravity():
    families = [gait_family(w["lab"], 0.03, 0.04) for w in (PLAIN, OTHER)]
    for name in ("shank_length", "hip_mass", "gravity", "shank_gyration"):
        ranges = {"hip_mass": (0.0, 0.1)}.get(name) or tuple(
            share * getattr(PLAIN["lab"], name) for share in (0.99, 1.01)
        )
        families += [
            parameter_family(w["lab"], name, *(x * size for x in ranges), slope=0.036)
            for w, size in ((PLAIN, 1.0), (OTHER, unit(name)))
        ]
    for known, found in zip(families[::2], families[1::2], strict=True):
        size = unit(known.parameter)
        assert len(found) == len(known) and found.parameter == known.parameter
        alike(known, found, rel=1e-6)
        same(found.value, known.value, size, rel=1e-6)
        same([end.value for end in found.ends], [end.value for end in known.ends], size)


@pytest.mark.parametrize("part", ["hip_torque", "push_off", "ankle_torque"])
def test_a_family_over_an_actuator(part):
    high = {"hip_torque": 0.02, "push_off": 0.02, "ankle_torque": 0.005}[part]
    known, found = (
        parameter_family(w["E"], part, 0.0, high * size, slope=0.012)
        for w, size in ((PLAIN, 1.0), (OTHER, unit(part)))
    )
    assert len(found) == len(known)
    same(found.value, known.value, unit(part), rel=1e-6)
    same(found.state, known.state, RATES, rel=1e-6)


def test_doublings_are_at_the_same_slopes():
    known, found = (doubling_cascade(w["D"], 0.012, 0.018, doublings=2) for w in (PLAIN, OTHER))
    same(found.slopes, known.slopes, rel=1e-9)
    same(found.gaits[1].state, known.gaits[1].state, RATES, rel=1e-5)


@pytest.mark.parametrize("name", ["lab", "sprung", "E"])
def test_forces_impulses_and_clearances(name, gaits):
    known, found = (reality_check(gait) for gait in gaits[name, "long"])
    alike(known, found, rel=1e-6)
    same(found.kneestrike_impulse.normal_impulse, known.kneestrike_impulse.normal_impulse,
         MASS * SPEED, rel=1e-6)  # fmt: skip
    np.testing.assert_allclose(
        found.columns()["scaled"], known.columns()["scaled"], rtol=1e-6, atol=1e-9
    )


def test_torques_that_are_found():
    for slope in (-0.002, 0.0):
        known, found = (powered_gait(w["E"], slope) for w in (PLAIN, OTHER))
        alike(known, found, rel=1e-6)
    plain, other = (
        LinearFeedback({"walker": w["lab"], "slope": 0.036, "control": "stride"})
        for w in (PLAIN, OTHER)
    )
    same(other.closed_loop, plain.closed_loop, rel=1e-6)
    same(other.rows, plain.rows, rel=1e-6)


def test_states_and_times_of_a_walk():
    asked = dict(samples=7)
    known, found = (
        simulate(w["sprung"], 0.04, find_gait(w["sprung"], 0.04).state, 2, **asked)
        for w in (PLAIN, OTHER)
    )
    alike(known, found, rel=1e-6)
    same(found.times, known.times, TIME, rel=1e-7)


def test_gaits_under_actuation():
    held = Actuation.dimensionless(hip_torque=0.01, push_off=0.01)
    known, found = (
        find_gaits(stride_map(w["E"], 0.01, controller=held))[0] for w in (PLAIN, OTHER)
    )
    alike(known, found)
    assert known.hip_cost > known.net_hip_cost > 0.0 and known.push_off_cost > 0.0
    same(found.dimensionless.controller, known.dimensionless.controller)
