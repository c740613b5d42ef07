"""What makes no sense is refused with a sentence, whichever function it is given to."""

import numpy as np
import pytest

import gym_passive_walker as gpw
from tests.equations.examples import LONG_GAITS

STATE = LONG_GAITS["lab"].state
AT_A_SLOPE = {
    "find_gait": lambda slope: gpw.find_gait("E", slope),
    "find_gaits": lambda slope: gpw.find_gaits("E", slope),
    "nearest_gait": lambda slope: gpw.nearest_gait("E", slope),
    "gait_family, lowest": lambda slope: gpw.gait_family("E", slope, 0.1),
    "gait_family, highest": lambda slope: gpw.gait_family("E", 0.01, slope),
    "parameter_family": lambda slope: gpw.parameter_family("E", "hip_mass", 0, 0.1, slope=slope),
    "stride_jacobian": lambda slope: gpw.stride_jacobian("lab", slope, STATE),
    "reality_check": lambda slope: gpw.reality_check("lab", slope, STATE),
    "bifurcation_diagram": lambda slope: gpw.bifurcation_diagram("E", slope),
    "lyapunov_exponents": lambda slope: gpw.lyapunov_exponents("E", slope),
    "crisis": lambda slope: gpw.crisis("D", slope, 0.02),
    "basin_of_attraction": lambda slope: gpw.basin_of_attraction("E", slope),
    "largest_push": lambda slope: gpw.largest_push("E", slope),
    "collision_matrix": lambda angle: gpw.collision_matrix("E", angle),
}
OF_A_WALKER = {
    "find_gait": lambda walker: gpw.find_gait(walker, 0.01),
    "find_gaits": lambda walker: gpw.find_gaits(walker, 0.01),
    "nearest_gait": lambda walker: gpw.nearest_gait(walker, 0.01),
    "gait_family": lambda walker: gpw.gait_family(walker, 0.01, 0.02),
    "stride_jacobian": lambda walker: gpw.stride_jacobian(walker, 0.036, STATE),
    "reality_check": lambda walker: gpw.reality_check(walker, 0.036, STATE),
    "collision_matrix": lambda walker: gpw.collision_matrix(walker, 0.1),
    "tune": gpw.tune,
    "tuning_errors": gpw.tuning_errors,
    "interpolate": lambda walker: gpw.interpolate("C", walker, 0.5),
}


UPRIGHT = 0.5 * np.pi


@pytest.mark.parametrize("slope", [np.nan, np.inf, 2.0, UPRIGHT, -UPRIGHT, "steep", None], ids=str)
@pytest.mark.parametrize("what", AT_A_SLOPE)
def test_a_senseless_slope_is_refused(what, slope):
    with pytest.raises(ValueError, match="must be"):
        AT_A_SLOPE[what](slope)


@pytest.mark.parametrize("what", [w for w in AT_A_SLOPE if "diagram" not in w and "lyap" not in w])
def test_several_slopes_are_refused_where_one_is_asked_for(what):
    with pytest.raises(ValueError, match="must be one number"):
        AT_A_SLOPE[what]([0.01, 0.02])


@pytest.mark.parametrize("what", [w for w in AT_A_SLOPE if w != "collision_matrix"])
def test_no_walk_down_an_upward_slope_is_promised(what):
    try:
        found = AT_A_SLOPE[what](-0.01)
    except (gpw.GaitNotFound, ValueError):
        return
    assert what in ("stride_jacobian", "reality_check") or found == [] or found.slope > 0.0


@pytest.mark.parametrize("walker", ["Z", "", None, 3, {}], ids=repr)
@pytest.mark.parametrize("what", OF_A_WALKER)
def test_an_unknown_walker_is_refused_with_the_known_names(what, walker):
    with pytest.raises(gpw.WalkerError, match=r"no walker .* lab-straight"):
        OF_A_WALKER[what](walker)


@pytest.mark.parametrize("walker", ["E", "F"])
def test_a_search_that_finds_nothing_ends_and_a_gentler_slope_has_a_gait(walker):
    with pytest.raises(gpw.GaitNotFound):
        gpw.parameter_family(walker, "foot_radius", 0.0, 0.1, slope=1.0)
    near = gpw.nearest_gait(walker, 1.0)
    assert 0.4 < near.slope < 0.9
    assert gpw.find_gaits(walker, 0.99 * near.slope)


def test_the_edge_of_a_push_is_found_to_the_last_digits():
    finest, fine = (gpw.largest_push("E", 0.008, strides=3, accuracy=a) for a in (1e-15, 1e-9))
    assert finest.forward == pytest.approx(fine.forward, rel=1e-8)
    assert finest.backward == pytest.approx(fine.backward, rel=1e-8)


def test_walkers_may_be_named_wherever_they_are_taken():
    assert gpw.tune("C") == gpw.tune(gpw.WALKERS["C"])
    assert gpw.interpolate("C", "lab", 1.0) == gpw.WALKERS["lab"]
    assert gpw.tuning_errors("lab") == gpw.tuning_errors(gpw.WALKERS["lab"])


AT_A_STATE = {
    "stride_jacobian": lambda *at: gpw.stride_jacobian(*at),
    "reality_check": lambda *at: gpw.reality_check(*at),
    "bifurcation_diagram": lambda walker, slope, state: gpw.bifurcation_diagram(
        walker, [slope], start=state, n_transient=0, n_recorded=33
    ),
    "lyapunov_exponents": lambda walker, slope, state: gpw.lyapunov_exponents(
        walker, [slope], start=state, strides=1, n_transient=0
    ),
    "crisis": lambda walker, slope, state: gpw.crisis(walker, slope, slope + 0.01, start=state),
    "find_gaits": lambda walker, slope, state: gpw.find_gaits(walker, slope, guess=state),
    "points_at": lambda walker, slope, state: gpw.stride_map(walker, slope).points_at(state),
}


@pytest.mark.parametrize("name, slope", [("lab", 0.036), ("D", 0.009)])
@pytest.mark.parametrize("what", AT_A_STATE)
def test_a_state_off_the_section_is_refused_where_one_on_it_is_asked_for(what, name, slope):
    gait = gpw.find_gait(name, slope)
    walk = gpw.simulate(gait, strides=1, samples=5).states
    for state in (walk[2], walk[-1], gait.state * [0, 0, 0, 1, 1, 1]):
        with pytest.raises(ValueError, match=r"just after heelstrike: its stance angle is posit"):
            AT_A_STATE[what](name, slope, state)


@pytest.mark.parametrize("name, slope", [("lab", 0.036), ("D", 0.009), ("A", 0.03)])
def test_the_velocity_of_the_landing_foot_needs_a_state_before_heelstrike(name, slope):
    gait = gpw.find_gait(name, slope)
    walk = gpw.simulate(gait, strides=1, samples=5).states
    np.testing.assert_allclose(
        gpw.foot_velocity(name, walk[-1]), gpw.foot_velocity(gait), rtol=1e-6, atol=1e-8
    )
    for state in (gait.state, walk[2], np.stack([walk[-1], gait.state])):
        with pytest.raises(ValueError, match=r"^state must be just before heelstrike, with a neg"):
            gpw.foot_velocity(name, state)
