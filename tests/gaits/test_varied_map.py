"""Families of whatever a function varies: gains, commands, terrain, several parameters at once."""

import numpy as np
import pytest

import gym_passive_walker as gpw
from gym_passive_walker.gaits.branches.varied_map import VariedMap
from gym_passive_walker.gaits.control.baselines import LinearFeedback, StrideFeedback
from gym_passive_walker.gaits.stride_map import StrideMap

LAB, SLOPE = gpw.as_walker("lab"), 0.036


def shank(offset: float) -> StrideMap:
    """Stride map of the lab walker with another offset of its shanks."""
    return gpw.stride_map(LAB.with_parameters(shank_offset=offset), SLOPE)


def downstairs(height: float) -> StrideMap:
    """Stride map of the lab walker down stairs."""
    return gpw.stride_map(LAB, SLOPE, terrain=gpw.stairs(-height))


def test_a_diagram_over_stairs_settles_on_the_gaits_of_each_height():
    found = gpw.bifurcation_diagram(
        downstairs, [0.001, 0.002], parameter="height", n_transient=100, n_recorded=33
    )
    assert found.period.tolist() == [1, 1]
    gaits = [gpw.find_gait(downstairs(height)) for height in (0.001, 0.002)]
    np.testing.assert_allclose(
        found.stance_angle[:, -1], [gait.stance_angle for gait in gaits], rtol=1e-9
    )


def test_the_cost_of_a_family_under_a_controller_is_that_of_its_gaits():
    """Work that motors take up is paid for, too."""

    def driven(share):
        torque = -share * LAB.units.torque
        return gpw.stride_map(LAB, SLOPE, controller=gpw.Actuation(hip_torque=torque))

    family = gpw.parameter_family(driven, "share", 1e-4, 5e-4, resolution=0.5)
    costs = [family[k].cost_of_transport for k in range(len(family))]
    np.testing.assert_allclose(family.cost_of_transport, costs, rtol=1e-9)
    assert np.min(costs) > np.sin(SLOPE)


def test_a_function_gives_the_family_that_the_parameter_itself_gives():
    own = gpw.parameter_family(LAB, "shank_offset", 0.02, 0.028, slope=SLOPE)
    made = gpw.parameter_family(shank, "offset", 0.02, 0.028)
    assert made.parameter == "offset" and made.ends == own.ends
    assert "offset" in made.columns() and "shank_offset" not in made.columns()
    for value in (0.021, 0.025):
        near = np.argmin(np.abs(made.value - value))
        gait = gpw.find_gait(shank(made.value[near]))
        np.testing.assert_allclose(made.state[near], gait.state, rtol=1e-9)
        np.testing.assert_allclose(made.multipliers[near], gait.multipliers, atol=1e-7)
        assert made.step_period[near] == pytest.approx(gait.step_period, rel=1e-9)
        assert made.step_length[near] == pytest.approx(gait.step_length, rel=1e-9)
    np.testing.assert_allclose(
        np.interp(0.024, made.value, made.speed), np.interp(0.024, own.value, own.speed), rtol=1e-4
    )


def test_stairs_are_followed_from_level_steps_on():
    family = gpw.parameter_family(downstairs, "height", 0.0, 0.004)
    assert (family.value[0], family.value[-1]) == (0.0, 0.004)
    smooth, steep = gpw.find_gait(LAB, SLOPE), gpw.find_gait(downstairs(0.004))
    np.testing.assert_allclose(family.state[0], smooth.state, rtol=1e-8)
    np.testing.assert_allclose(family.state[-1], steep.state, rtol=1e-8)
    np.testing.assert_allclose(family.multipliers[-1], steep.multipliers, atol=1e-6)


def test_a_gain_changes_the_multipliers_of_a_gait_but_not_the_gait():
    own = LinearFeedback("level")

    def scaled(gain: float) -> StrideMap:
        controller = StrideFeedback("scaled", own.scene, own.point, own.actions, gain * own.rows)
        return gpw.stride_map(controller=controller)

    family = gpw.parameter_family(scaled, "gain", 0.0, 1.0)
    assert (family.value[0], family.value[-1]) == (0.0, 1.0)
    np.testing.assert_allclose(family.state, np.tile(own.gait.state, (len(family), 1)), rtol=1e-7)
    wanted = np.linalg.eigvals(own.closed_loop)
    np.testing.assert_allclose(
        np.sort_complex(family.multipliers[-1]), np.sort_complex(wanted), atol=1e-6
    )
    constant = own.gait.controller
    passive = gpw.find_gait(gpw.stride_map("C", 0.0, controller=constant), guess=own.gait.state)
    np.testing.assert_allclose(
        np.sort_complex(family.multipliers[0]), np.sort_complex(passive.multipliers), atol=1e-6
    )


@pytest.mark.parametrize("slope", [None, 0.04])
def test_sizes_and_slopes_may_vary_together(slope):
    def larger(size: float) -> StrideMap:
        return gpw.stride_map(
            LAB.with_parameters(
                thigh_length=size * LAB.thigh_length, thigh_mass=size * LAB.thigh_mass
            ),
            0.03 + 0.01 * (size - 1.0),
        )

    family = gpw.parameter_family(larger, "size", 1.0, 1.1, slope=slope)
    expected = 0.03 + 0.01 * (family.value - 1.0) if slope is None else np.full(len(family), slope)
    np.testing.assert_allclose(family.slope, expected, rtol=1e-14)
    last = gpw.find_gait(larger(1.1), slope)
    np.testing.assert_allclose(family.state[-1], last.state, rtol=1e-8)
    assert family.speed[-1] == pytest.approx(last.speed, rel=1e-8)


def test_derivatives_by_the_value_are_those_of_the_parameter():
    gait, values = gpw.find_gait(LAB, SLOPE), np.array([0.021, 0.026, 0.0279999])
    made = VariedMap(walker=LAB, parameter="o", values=values, make=shank, bounds=(0.02, 0.028))
    own = gpw.stride_map(LAB, SLOPE).with_parameter("shank_offset", values)
    points = np.repeat(gait.point.values, 3, axis=0) * [[1.0], [1.01], [0.99]]
    found, by_found = made.linearize(points, SLOPE, strides=2, by=("state", "o"))
    wanted, by_wanted = own.linearize(points, SLOPE, strides=2, by=("state", "shank_offset"))
    for name in ("ends", "durations", "lengths", "lost", "supplied", "imbalance"):
        value, derivative = getattr(wanted, name), getattr(by_wanted, name)
        np.testing.assert_allclose(getattr(found, name), value, rtol=1e-9, atol=1e-11)
        size = np.abs(derivative).max()
        np.testing.assert_allclose(getattr(by_found, name), derivative, atol=2e-4 * size)
    np.testing.assert_array_equal(found.outcomes, wanted.outcomes)


def test_beyond_its_range_a_map_is_continued_linearly():
    asked = []

    def make(value: float) -> StrideMap:
        asked.append(value)
        return shank(value)

    points = np.repeat(gpw.find_gait(LAB, SLOPE).point.values, 3, axis=0)
    values = np.array([0.028, 0.0281, 0.0282])
    made = VariedMap(walker=LAB, parameter="o", values=values, make=make, bounds=(0.02, 0.028))
    ends = made.apply(points, SLOPE).ends
    np.testing.assert_allclose(ends[2] - ends[1], ends[1] - ends[0], rtol=1e-6)
    assert 0.02 <= min(asked) and max(asked) <= 0.028


@pytest.mark.parametrize(
    ("make", "parameter", "low", "high", "message"),
    [
        (shank, "slope", 0.02, 0.028, "must be a name"),
        (shank, 3, 0.02, 0.028, "must be a name"),
        (shank, "offset", 0.028, 0.028, "low < high"),
        (shank, "offset", float("nan"), 0.028, "low"),
        (lambda x: x, "offset", 0.0, 1.0, "must return a stride map or a walker"),
        (lambda x: gpw.stride_map(LAB), "offset", 0.0, 1.0, "slope"),
        (lambda x: shank(x - 9.0), "offset", 0.0, 1.0, "the function of offset failed at 0"),
        (lambda x: gpw.stride_map("lab" if x < 0.5 else "E", 0.03), "x", 0.0, 1.0, "coordinates"),
    ],
)
def test_what_no_family_can_be_made_of_is_refused(make, parameter, low, high, message):
    with pytest.raises(ValueError, match=message):
        gpw.parameter_family(make, parameter, low, high)


def test_a_range_without_a_gait_is_said_to_have_none():
    with pytest.raises(gpw.GaitNotFound, match=r"at any of 9 values from 1 to 1\.5"):
        gpw.parameter_family(lambda x: gpw.stride_map("E", x), "x", 1.0, 1.5)


def test_torques_are_held_as_by_the_maps_of_the_function():
    policy = gpw.load_policy("level-ppo")
    held = {}
    for name, controller in (("policy", policy), ("passive", None)):
        own = gpw.stride_map("C", 0.0, controller=controller)
        made = VariedMap(
            walker=own.walker, parameter="x", values=np.array([0.5]), bounds=(0.0, 1.0),
            make=lambda x, own=own: own,
        )  # fmt: skip
        held[name] = made.hold
        assert made.hold == own.hold
    assert held["policy"] == policy.scene.tick and held["passive"] == np.inf


@pytest.mark.parametrize("name", ["size", "gravity"])
def test_a_family_of_larger_and_larger_walkers_has_the_units_of_each(name):
    """Also where the name of what varies is one of the walker's parameters."""

    def larger(size):
        return gpw.stride_map(LAB.with_parameters(thigh_length=size * LAB.thigh_length), SLOPE)

    family = gpw.parameter_family(larger, name, 1.0, 1.05)
    for k in (0, -1):
        assert family.froude_speed[k] == pytest.approx(family[k].froude_speed, rel=1e-9)
        assert family.kind[k] == family[k].kind


def test_maps_of_different_numbers_of_footholds_are_no_family():
    def waves(height):
        return gpw.stride_map(LAB, 0.035, terrain=gpw.waves(height, 3))

    with pytest.raises(ValueError, match="maps that repeat after as many strides are needed"):
        gpw.parameter_family(waves, "height", 0.0, 0.0005)
