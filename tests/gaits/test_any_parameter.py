"""Diagrams, cascades, crises and exponents over any parameter agree with those over the slope."""

import numpy as np
import pytest

import gym_passive_walker as gpw
from examples.potential_shaping import COMPASS

COMPASSES = COMPASS.with_parameters(gravity=9.81)
"""Goswami's walker: legs of 5 kg with their masses in the middle."""

SIMPLEST = COMPASS.with_parameters(
    thigh_mass=0.0, shank_mass=0.0, shank_com=0.5, hip_mass=1.0, gravity=1.0
)
"""Legs without mass, with a place for it."""

FIRST_DOUBLINGS = {2.5: 0.093312534155095, 10.0: 0.076635631575613, 50.0: 0.064101717681918}
"""Slope by the mass of the hip, from an independent program."""


def hip(mass):
    return gpw.stride_map(COMPASSES.with_parameters(hip_mass=mass), 0.0766)


@pytest.mark.parametrize("mass", FIRST_DOUBLINGS)
def test_a_compass_doubles_its_period_where_an_independent_program_says(mass):
    walker = COMPASSES.with_parameters(hip_mass=mass)
    (slope,) = gpw.doubling_cascade(walker, 0.04, 0.12, doublings=1).values
    assert slope == pytest.approx(FIRST_DOUBLINGS[mass], abs=1e-13)


@pytest.mark.parametrize("began", [10.0, 12.0])
def test_at_that_slope_the_period_doubles_at_that_mass(began):
    """Also if the family begins at the doubling itself."""
    walker = COMPASSES.with_parameters(hip_mass=began)
    found = gpw.doubling_cascade(
        walker, 5.0, 20.0, parameter="hip_mass", slope=FIRST_DOUBLINGS[10.0], doublings=1
    )
    assert found.values == pytest.approx((10.0,), abs=1e-9)
    assert found.slopes == (FIRST_DOUBLINGS[10.0],)
    assert found.gaits[0].walker.hip_mass == found.values[0]
    assert "parameter hip_mass" in repr(found) and "rad" not in repr(found)


def test_a_cascade_over_a_torque_continues_that_over_the_slope():
    """Where the torque at the first doubling of a slope is held, that slope doubles first."""
    over = {"parameter": "hip_torque", "slope": 0.0145}
    torque, further = gpw.doubling_cascade("D", 0.0, 0.05, **over, doublings=2).values
    assert 0.0 < torque < further
    held = gpw.stride_map("D", 0.0145, controller=gpw.Actuation(hip_torque=torque))
    assert gpw.doubling_cascade(held, 0.01, 0.02, doublings=1).values == pytest.approx(
        (0.0145,), abs=1e-11
    )


@pytest.mark.parametrize("walker", [COMPASSES, hip], ids=["a walker", "a function"])
def test_settled_walks_and_exponents_are_those_of_each_walker(walker):
    masses, asked = [8.0, 12.0], {"n_transient": 60}
    over = {"parameter": "hip_mass" if walker is COMPASSES else "mass", "slope": 0.0766}
    if walker is hip:
        del over["slope"]
    walks = {"n_recorded": 40, "start": gpw.find_gait(hip(10.0)).state}
    diagram = gpw.bifurcation_diagram(walker, masses, **over, **asked, **walks)
    exponents = gpw.lyapunov_exponents(walker, masses, **over, **asked, strides=40)
    for i, mass in enumerate(masses):
        alone = gpw.bifurcation_diagram(hip(mass), [0.0766], **asked, **walks)
        np.testing.assert_allclose(diagram.stance_angle[i], alone.stance_angle[0], rtol=1e-9)
        np.testing.assert_allclose(diagram.state[i], alone.state[0], rtol=1e-9)
        known = gpw.lyapunov_exponents(hip(mass), [0.0766], **asked, strides=40)
        np.testing.assert_allclose(exponents[i], known[0], rtol=1e-5)
    assert diagram.slope.tolist() == [0.0766] * 2 and diagram.value.tolist() == masses
    assert list(diagram.columns())[:2] == [over["parameter"], "slope"]


def test_walks_of_a_function_may_begin_on_level_ground_and_go_on_on_stairs():
    def down(drop):
        return gpw.stride_map("lab", 0.036, terrain=gpw.stairs(-drop))

    drops, asked = [0.0, 0.003], {"n_transient": 30}
    found = gpw.bifurcation_diagram(down, drops, parameter="drop", **asked, n_recorded=33)
    exponents = gpw.lyapunov_exponents(down, drops, parameter="drop", **asked, strides=30)
    for i, drop in enumerate(drops):
        gait = gpw.find_gait(down(drop))
        np.testing.assert_allclose(found.state[i], gait.state, rtol=1e-6)
        assert exponents[i, 0] == pytest.approx(np.log(np.abs(gait.multipliers[0])), abs=0.05)


@pytest.mark.parametrize(
    ("held", "parameter", "high", "said"),
    [
        ({"push_off": 0.15}, "push_off", -0.1, "push_off must not be negative"),
        ({"push_off": 0.15}, "ankle_torque", 1e9, "high is too far from low"),
        ({"ankle_torque": 0.01}, "foot_radius", 0.3, "ankle_torque needs point feet"),
    ],
)
def test_a_crisis_is_sought_among_walkers_that_can_be(held, parameter, high, said):
    strides = gpw.stride_map(COMPASSES, 0.02, controller=gpw.Actuation(**held))
    with pytest.raises(ValueError, match=said):
        gpw.crisis(strides, strides.parameters[parameter], high, parameter=parameter, strides=1)


def test_a_crisis_in_the_torque_is_the_crisis_in_the_slope():
    asked = {"strides": 400, "walkers": 8, "accuracy": 1e-6}
    torque = gpw.crisis("D", 0.0, 0.05, parameter="hip_torque", slope=0.0185, **asked)
    held = gpw.stride_map("D", 0.0185, controller=gpw.Actuation(hip_torque=torque))
    slope = gpw.crisis(held, 0.0181, 0.02, **asked)
    assert slope == pytest.approx(0.0185, abs=1e-4)  # long transients hide a little of it


def test_a_function_is_asked_for_a_map_once_at_each_value():
    values = []

    def driven(torque):
        values.append(torque)
        return gpw.stride_map("D", 0.0185, controller=gpw.Actuation(hip_torque=torque))

    start = gpw.find_gait("D", 0.0185).state
    found = gpw.crisis(
        driven, 0.0, 0.05, parameter="torque", strides=200, walkers=4, accuracy=1e-3, start=start
    )
    assert 0.0 < found < 0.05
    assert len(values) < 5 + 2 * len(set(values))


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        ({"parameter": "mass", "slope": 0.036}, "no parameter 'mass' to vary"),
        ({"slope": 0.036}, "slope is that of walks over another parameter: omit it"),
        ({"parameter": "hip_mass", "slope": 0.036, "values": []}, "values must be"),
        ({"parameter": "hip_mass", "slope": 0.036, "values": [[1.0]]}, "values must be"),
        ({"parameter": "hip_mass", "slope": 0.036, "values": [-1.0]}, "hip_mass must not be"),
        ({"parameter": "hip_mass"}, "slope must be one number"),
        ({"walker": SIMPLEST, "parameter": "shank_mass", "slope": 0.01}, "its equations are not"),
    ],
)
def test_what_cannot_vary_is_refused(asked, said):
    for analysis in (gpw.bifurcation_diagram, gpw.lyapunov_exponents):
        with pytest.raises(ValueError, match=said):
            analysis(**{"walker": "lab", "values": [0.1], **asked})
