"""Scaling of steps with slope: the powers of section 4.6.3, and the transitions between them."""

import numpy as np
import pytest

from gym_passive_walker import WALKERS, find_gait, gait_family, parameter_family, tune
from validation.scaling import CUBE_ROOT, exponent_crossings, local_exponents, transition_slope


def exponents(name, kind, slope=1e-7):
    family = gait_family(tune(WALKERS[name]), 0.5 * slope, 2.0 * slope, kind, resolution=0.2)
    local = local_exponents(family)
    return np.array([local.stance_angle, local.speed]).mean(axis=1)


@pytest.mark.parametrize("name", ["A", "B", "E", "F"])
def test_long_steps_grow_with_the_cube_root_and_short_steps_in_proportion(name):
    assert exponents(name, "long") == pytest.approx(1 / 3, abs=1e-3)
    assert exponents(name, "short") == pytest.approx(1.0, abs=1e-3)


@pytest.mark.parametrize("kind", ["long", "short"])
def test_both_gaits_of_the_simplest_walker_grow_with_the_cube_root(kind):
    assert exponents("D", kind) == pytest.approx(1 / 3, abs=1e-3)


def test_a_tuned_kneed_walker_s_long_step_turns_from_the_cube_root_to_proportion():
    family = gait_family(tune(WALKERS["C"]), 1e-7, 0.05)
    (turn,) = exponent_crossings(family)
    assert turn == pytest.approx(1.5e-4, rel=0.05)  # "extremely small ground-slopes"
    local = local_exponents(family)
    assert local.stance_angle[0] == pytest.approx(1.0, abs=1e-3)
    at = np.interp(np.log(0.01), np.log(local.slope), local.stance_angle)
    assert at == pytest.approx(1 / 3, abs=0.04)


def test_where_exponents_cross_does_not_hang_on_how_finely_a_family_is_followed():
    found = [
        exponent_crossings(gait_family("E", 1e-5, 0.02, "short", resolution=resolution))
        for resolution in (0.2, 0.03)
    ]
    assert found[0] == pytest.approx(found[1], rel=2e-3) and len(found[0]) == 1


def test_the_exponent_is_the_slope_of_the_family_in_logarithms():
    family = gait_family("E", 1e-3, 0.02, "short")
    local = local_exponents(family)
    i = len(family) // 2
    slope, step = family.slope[i], 1e-3
    for measure, exponent in (("stance_angle", local.stance_angle), ("speed", local.speed)):
        values = [
            np.log(getattr(find_gait("E", slope * np.exp(k * step), "short"), measure))
            for k in (-2, -1, 1, 2)
        ]
        difference = (8.0 * (values[2] - values[1]) - (values[3] - values[0])) / (12.0 * step)
        assert exponent[i] == pytest.approx(difference, abs=1e-9)


def test_transition_slopes_are_near_the_three_halves_power_of_the_foot_s_share():
    shares = {"E": 0.1 / 0.8, "F": 0.05 / 0.9}
    slopes = {name: transition_slope(name) for name in shares}
    ratio = slopes["E"] / slopes["F"]
    assert ratio == pytest.approx((shares["E"] / shares["F"]) ** 1.5, rel=0.12)
    for name, share in shares.items():
        assert 0.1 < slopes[name] / share**1.5 < 0.3


def test_the_transition_lies_where_the_local_exponent_changes():
    for name in ("E", "F"):
        (half,) = exponent_crossings(gait_family(name, 1e-6, 0.1, "short"))
        assert 0.5 < half / transition_slope(name) < 1.0


def test_the_ratio_of_transition_slopes_does_not_depend_on_the_cube_root_line():
    plain = transition_slope("E") / transition_slope("F")
    other = transition_slope("E", cube_root=2.0) / transition_slope("F", cube_root=2.0)
    assert other == pytest.approx(plain, rel=1e-12)
    steeper = transition_slope("E", cube_root=2.0) / transition_slope("E")
    assert steeper == pytest.approx((2.0 / CUBE_ROOT) ** 1.5, rel=1e-12)


def test_exponents_of_something_else_than_slope_are_refused():
    with pytest.raises(ValueError, match="over slopes"):
        local_exponents(parameter_family("E", "hip_mass", 0.0, 0.1, slope=0.01))
    doubled = gait_family("D", 0.0155, 0.0165, start=find_gait("D", 0.016, period=2))
    with pytest.raises(ValueError, match="period-one"):
        local_exponents(doubled)
