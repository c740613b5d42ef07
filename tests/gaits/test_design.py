"""Walkers designed by gradient do best among their neighbours, and walk as they are said to."""

from dataclasses import replace

import numpy as np
import pytest

import gym_passive_walker as gpw
from examples.torso import TORSO
from gym_passive_walker import WALKERS, GaitNotFound, find_gait, optimize_walker, tune
from gym_passive_walker.gaits.branches.sensitivity import place_near, sensitivity
from gym_passive_walker.gaits.design.objectives import QUANTITIES
from tests.own.statements import DRIVEN

MOVED = ("thigh_com", "shank_com", "thigh_offset", "shank_offset", "foot_radius")
BOUNDS = ((0.05, 0.15), (0.1, 0.25), (-0.05, 0.02), (0.0, 0.05), (0.1, 0.3))
TUNED = tune("C")


def about(walker, names, share):
    """Bounds by a share of each of a walker's parameters to either side."""
    return [tuple(getattr(walker, name) * (1.0 + s) for s in (-share, share)) for name in names]


def neighbours(design, parameters, bounds, share=0.01):
    """Gaits of walkers and on slopes a little way off, as far as bounds allow, at random."""
    random = np.random.default_rng(5)
    for _ in range(20):
        moved, slope = {}, design.gait.slope
        for name, (low, high) in zip(parameters, bounds, strict=True):
            here = slope if name == "slope" else getattr(design.walker, name)
            moved[name] = np.clip(here + share * (high - low) * random.uniform(-1, 1), low, high)
        slope = float(moved.pop("slope", slope))
        walker = replace(design.walker, **moved)
        yield find_gait(walker, slope, guess=design.gait.state)


def settles(gait, strides=60):
    """Whether a walk pushed off the gait comes back to it, stride by stride in the engine."""
    state = gait.state * np.array([1.0, 1.0, 1.0, 1.01, 0.99, 0.99])
    for _ in range(strides):
        state = gpw.stride(gait.walker, gait.slope, state).state
    return np.allclose(state, gait.state, rtol=1e-6)


def test_the_least_cost_of_transport_at_a_speed():
    parameters, bounds = ("slope", *MOVED), ((0.002, 0.05), *BOUNDS)
    design = optimize_walker(
        "lab", "cost_of_transport", parameters, bounds, slope=0.036,
        constraints={"froude_speed": 0.18, "clearance": (0.005, None)},
    )  # fmt: skip
    gait = design.gait
    assert design.converged
    assert design.start.stance_angle == find_gait("lab", 0.036).stance_angle
    assert gait.froude_speed == pytest.approx(0.18, rel=1e-6)
    assert gait.cost_of_transport == pytest.approx(np.sin(gait.slope), rel=1e-9)
    assert gait.cost_of_transport < 0.62 * design.start.cost_of_transport
    assert design.values["cost_of_transport"][1] == pytest.approx(gait.cost_of_transport)
    check = gpw.reality_check(gait.walker, gait.slope, gait.state)
    assert check.clearance.value == pytest.approx(0.005, rel=1e-4)
    assert settles(gait)
    # Other walkers of this speed and foot clearance cost more.
    compared = 0
    for other in neighbours(design, parameters, bounds, share=0.002):
        clear = gpw.reality_check(other.walker, other.slope, other.state).clearance.value
        if other.froude_speed >= 0.18 and clear >= 0.005:
            assert other.cost_of_transport > gait.cost_of_transport
            compared += 1
    assert compared > 2


def test_the_smallest_spectral_radius_at_a_slope():
    design = optimize_walker("lab", "spectral_radius", MOVED, BOUNDS, slope=0.036)
    before, after = (np.abs(gait.multipliers) for gait in (design.start, design.gait))
    assert design.converged
    assert after[0] < 0.5 * before[0]
    # At such an optimum several multipliers are as large.
    assert np.count_nonzero(after > after[0] - 1e-6) > 1
    assert design.values["spectral_radius"] == pytest.approx((before[0], after[0]))
    assert settles(design.gait, strides=15)
    for other in neighbours(design, MOVED, BOUNDS):
        assert np.abs(other.multipliers[0]) >= after[0] - 1e-9


def test_the_steepest_slope_that_is_still_walked_stably():
    names = ("thigh_mass", "shank_mass", "thigh_com", "foot_radius")
    parameters, bounds = ("slope", *names), ((0.02, 0.5), *about(TUNED, names, 0.1))
    design = optimize_walker(
        TUNED, "slope", parameters, bounds, slope=0.05, maximize=True,
        constraints={"spectral_radius": (None, 1.0), "total_mass": TUNED.total_mass},
    )  # fmt: skip
    assert design.walker.total_mass == pytest.approx(TUNED.total_mass, rel=1e-9)
    np.testing.assert_allclose(design.gait.multipliers[0], -1.0, atol=1e-6)
    # There, and not before, the new walker's gait doubles its period.
    family = gpw.gait_family(design.walker, 0.02, 0.12)
    assert family.period_doublings[0] == pytest.approx(design.gait.slope, rel=1e-6)
    assert gpw.gait_family(TUNED, 0.02, 0.12).period_doublings[0] < 0.8 * design.gait.slope
    walks = gpw.bifurcation_diagram(
        design.walker, design.gait.slope + np.array([-1e-3, 1e-3]), n_transient=1500, n_recorded=64
    )
    assert walks.period.tolist() == [1, 2]


def test_a_design_without_anything_to_gain_stays_where_it_is():
    first = optimize_walker("lab", "spectral_radius", MOVED, BOUNDS, slope=0.036)
    again = optimize_walker(first.walker, "spectral_radius", MOVED, BOUNDS, slope=0.036)
    assert again.values["spectral_radius"][1] == pytest.approx(
        first.values["spectral_radius"][1], rel=1e-5
    )


def test_lengths_scale_as_they_must():
    # A passive gait's period grows with the root of the leg length, whatever the walker.
    design = optimize_walker(
        "D", "leg_length", ["thigh_length", "shank_length"], [(0.1, 2.0), (0.1, 2.0)],
        slope=0.009, constraints={"step_period": 1.7},
    )  # fmt: skip
    before = design.start
    assert design.walker.leg_length == pytest.approx((1.7 / before.step_period) ** 2, rel=1e-6)


def test_what_cannot_be_met_is_said():
    with pytest.raises(GaitNotFound, match="meets the constraints"):
        optimize_walker(
            "lab", "slope", ["slope"], [(0.03, 0.04)], slope=0.036,
            constraints={"speed": 2.0}, iterations=10,
        )  # fmt: skip


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"objective": "beauty"}, "no quantity 'beauty' to design by: choose from spectral_radius"),
        ({"constraints": {"beauty": 1.0}}, "no quantity 'beauty'"),
        ({"parameters": ["colour"]}, "cannot vary 'colour' of this walker: choose from slope"),
        ({"parameters": "foot_radius"}, "a list of them"),
        ({"parameters": ["foot_radius", "foot_radius"]}, "different names"),
        (
            {"bounds": [(0.1, 0.3), (0.0, 1.0)]},
            "bounds must be a pair .* for each of the 1",
        ),
        ({"bounds": [(0.25, 0.3)]}, "foot_radius is 0.2 to begin with"),
        ({"bounds": [(0.1, np.inf)]}, "a finite number|finite bounds"),
        ({"constraints": {"speed": (0.3, 0.2)}}, "give the lowest first"),
        ({"constraints": {"speed": (None, None)}}, "speed needs a value"),
        ({"constraints": {"spectral_radius": 0.5}}, "highest value only"),
        ({"objective": "spectral_radius", "maximize": True}, "made least without a bound"),
        ({"walker": "D", "parameters": ["foot_radius"]}, "choose from slope, thigh_length"),
        ({"iterations": 0}, "iterations must be a whole number"),
    ],
)
def test_a_design_that_makes_no_sense_is_refused(arguments, message):
    given = {
        "walker": "lab",
        "objective": "cost_of_transport",
        "parameters": ["foot_radius"],
        "bounds": [(0.1, 0.3)],
        "slope": 0.036,
    }
    with pytest.raises(ValueError, match=message):
        optimize_walker(**{**given, **arguments})


def test_quantities_on_waves_are_those_of_the_mean_stride():
    waves = gpw.stride_map("lab", 0.036, terrain=gpw.waves(0.0005, 3))
    for name in ("step_length", "step_period", "speed", "cost_of_transport"):
        design = optimize_walker(waves, name, ["slope"], [(0.0355, 0.0365)], iterations=2)
        assert design.values[name][1] == pytest.approx(getattr(design.gait, name), rel=1e-9)
    for name in ("knee_margin", "clearance"):
        with pytest.raises(ValueError, match=f"{name} is of gaits that repeat after one stride"):
            optimize_walker(waves, name, ["slope"], [(0.0355, 0.0365)])


def test_the_gait_of_a_straight_walker_has_no_knee_margin():
    with pytest.raises(ValueError, match="knee_margin is of walkers with knees"):
        optimize_walker(
            WALKERS["A"], "knee_margin", ["foot_radius"], [(0.1, 0.3)], slope=0.02, maximize=True
        )


def test_bounds_with_walkers_that_have_no_gait_are_named():
    with pytest.raises(
        gpw.GaitNotFound, match="came to values of leg with which no gait of system"
    ):
        gpw.optimize_walker(TORSO, "speed", ("leg",), [(-0.2, 0.15)], slope=0.03, iterations=40)


def test_the_spectral_radius_changes_with_a_slope_of_zero():
    pushed = gpw.stride_map("D", 0.0, controller=gpw.Actuation(push_off=0.05))
    design = optimize_walker(
        pushed, "cost_of_transport", ["slope"], [(-0.002, 0.01)],
        constraints={"spectral_radius": (None, 0.9)}, iterations=5,
    )  # fmt: skip
    assert np.abs(design.gait.multipliers[0]) < 0.9


@pytest.mark.parametrize("name", ["stance_angle", "clearance"])
def test_quantities_of_a_system_have_the_derivatives_of_its_gaits(name):
    def at(slope):
        gait = find_gait(DRIVEN, slope)
        return sensitivity(place_near(gait.stride_map, slope, gait.point.search[0]), ("slope",))

    step = 1e-5
    above, below = (QUANTITIES[name](at(0.03 + way * step))[0] for way in (1.0, -1.0))
    found = QUANTITIES[name](at(0.03))[1]
    assert found == pytest.approx((above - below) / (2.0 * step), rel=1e-6)
