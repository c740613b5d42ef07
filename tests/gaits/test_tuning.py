"""Walkers that can walk at vanishing slopes (Fig. 4.7), and what de-tuning does (Fig. 4.8)."""

from dataclasses import replace

import numpy as np
import pytest

from gym_passive_walker import (
    WALKERS,
    GaitNotFound,
    Walker,
    find_gait,
    gait_family,
    interpolate,
    tune,
    tune_to_walk,
    tuning_errors,
)
from gym_passive_walker.gaits.branches.continuation import KNEE_MEETS_HEEL, TANGENTIAL

TUNED, LAB = tune(WALKERS["C"]), WALKERS["lab"]


@pytest.mark.parametrize("name", ["A", "B", "C", "D", "E", "F"])
def test_tuning_meets_all_four_conditions(name):
    assert np.abs(tuning_errors(tune(WALKERS[name]))).max() < 1e-16


def test_the_lab_walker_fails_the_conditions_and_says_by_how_much():
    errors = tuning_errors(LAB)
    assert errors.shank_under_knee == pytest.approx(-0.003239, abs=1e-6)
    assert abs(errors.collinearity) > 0.01
    assert tuning_errors(WALKERS["lab-straight"]).shank_under_knee == 0.0


def test_the_table_s_walkers_are_tuned_to_their_printed_digits():
    for name in "AC":
        assert 1e-6 < np.abs(tuning_errors(WALKERS[name])).max() < 1e-3


def test_an_untuned_walker_needs_a_slope_and_a_tuned_one_none():
    # About 0.016 with straight legs and 0.02 with knees (section 4.5.2).
    for name, least in (("lab-straight", 0.0153621), ("lab", 0.0191229)):
        family = gait_family(name, 0.01, 0.05)
        assert family.slope.min() == pytest.approx(least, abs=1e-4)
        assert family.folds[0] == pytest.approx(least, abs=1e-7)
    assert find_gait(TUNED, 1e-8).cost_of_transport < 2e-8


def test_a_tuned_walker_takes_longer_steps_than_an_untuned_one():
    for tuned, untuned in (("C", "lab"), ("A", "lab-straight")):
        for slope in (0.025, 0.04):
            a, b = find_gait(tune(WALKERS[tuned]), slope), find_gait(untuned, slope)
            assert a.stance_angle > b.stance_angle
            assert a.froude_speed > b.froude_speed


HEAVY = Walker(
    thigh_length=0.40, thigh_mass=5.0, thigh_com=0.2, thigh_gyration=0.1,
    shank_length=0.45, shank_mass=3.0, shank_com=0.2, shank_gyration=0.15,
    hip_mass=10.0, foot_radius=0.15, foot_angle=0.15,
)  # fmt: skip
SPREAD = ("thigh_com", "thigh_gyration", "shank_com", "shank_gyration")


@pytest.mark.parametrize(("walker", "slope"), [(LAB, 0.036), (HEAVY, 0.03)], ids=["lab", "heavy"])
def test_a_walker_that_tuning_would_stop_is_tuned_so_that_it_walks(walker, slope):
    assert find_gait(walker, slope).stable
    with pytest.raises(GaitNotFound):
        find_gait(tune(walker), slope)
    gait = tune_to_walk(walker, slope)
    assert np.abs(tuning_errors(gait.walker)).max() < 1e-15
    assert np.abs(gait.multipliers[0]) == pytest.approx(0.8, rel=1e-5)
    assert find_gait(gait.walker, slope).stance_angle == pytest.approx(gait.stance_angle, rel=1e-9)
    # Nothing else than how mass is spread over thigh and shank has changed.
    offsets = {name: getattr(walker, name) for name in ("thigh_offset", "shank_offset")}
    kept = {name: getattr(walker, name) for name in SPREAD}
    assert replace(gait.walker, **kept, **offsets) == walker
    # Nearer to what `tune` alone gives, the walk is not as stable.
    nearer = tune(interpolate(gait.walker, tune(walker), 3e-4))
    assert np.abs(find_gait(nearer, slope, guess=gait.state).multipliers[0]) > 0.801


def test_a_tuned_walker_that_walks_needs_no_more():
    for name, slope in (("A", 0.02), ("lab-straight", 0.03), ("D", 0.009)):
        assert tune_to_walk(name, slope).walker == tune(WALKERS[name])


def test_a_tuned_walker_that_is_less_stable_than_asked_is_tuned_further():
    tuned = find_gait(tune(WALKERS["A"]), 0.02)
    radius = 0.95 * np.abs(tuned.multipliers[0])
    gait = tune_to_walk("A", 0.02, radius=radius)
    assert np.abs(gait.multipliers[0]) <= radius * (1.0 + 1e-6)
    assert np.abs(tuning_errors(gait.walker)).max() < 1e-15


def test_where_no_tuned_walker_walks_it_is_said():
    with pytest.raises(GaitNotFound, match="no tuned walker near walker 'lab'"):
        tune_to_walk("lab", -0.01)


def merged(fraction):
    """Whether the long-step family turns back into the short-step one on moderate slopes."""
    family = gait_family(interpolate(TUNED, LAB, fraction), 0.05, 0.16)
    return family.slope.max() < 0.15


@pytest.mark.slow
def test_de_tuning_separates_the_gaits_then_merges_and_splits_them():
    # (a) tuned: both gaits reach zero slope. (b), (c): neither does, and the curves are apart.
    for fraction in (0.1, 0.4, 0.7):
        walker = interpolate(TUNED, LAB, fraction)
        long, short = gait_family(walker, 1e-4, 0.1), gait_family(walker, 1e-4, 0.1, "short")
        assert 0.0 < long.folds[0] < short.slope.min()
        # At a tenth of the way the foot comes down tangentially at slope 0.004508, just before the
        # knee would strike with the foot on the ground, at 0.00448.
        assert short.ends[0].reason == (TANGENTIAL if fraction == 0.1 else KNEE_MEETS_HEEL)
    # (e) they meet: at 72 % of the way, at slope 0.099, and part into a lower and an upper curve.
    apart, together = 0.70, 0.75
    while together - apart > 1e-3:
        middle = 0.5 * (apart + together)
        apart, together = (apart, middle) if merged(middle) else (middle, together)
    assert apart == pytest.approx(0.7238, abs=2e-3)
    lower = gait_family(interpolate(TUNED, LAB, together), 0.05, 0.3)
    upper = gait_family(interpolate(TUNED, LAB, together), 0.12, 0.3)
    assert max(lower.folds) == pytest.approx(0.099, abs=3e-3)
    assert min(upper.slope) > 0.099 or min(upper.folds) == pytest.approx(0.099, abs=3e-3)
    # (f) wholly de-tuned, the upper curve still exists, at slopes beyond the document's plot.
    above = gait_family(LAB, 0.1, 0.3)
    assert above.folds == pytest.approx((0.16372248,), abs=1e-6)
    with pytest.raises(GaitNotFound):
        find_gait(LAB, 0.1)
