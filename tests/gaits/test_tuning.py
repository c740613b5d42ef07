"""Walkers that can walk at vanishing slopes (Fig. 4.7), and what de-tuning does (Fig. 4.8)."""

import numpy as np
import pytest

from gym_passive_walker import (
    WALKERS,
    GaitNotFound,
    blend,
    find_gait,
    gait_family,
    tune,
    tuning_errors,
)
from gym_passive_walker.gaits.ends import KNEE_MEETS_HEEL, TANGENTIAL

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


def merged(fraction):
    """Whether the long-step family turns back into the short-step one on moderate slopes."""
    family = gait_family(blend(TUNED, LAB, fraction), 0.05, 0.16)
    return family.slope.max() < 0.15


@pytest.mark.slow
def test_de_tuning_separates_the_gaits_then_merges_and_splits_them():
    # (a) tuned: both gaits reach zero slope. (b), (c): neither does, and the curves are apart.
    for fraction in (0.1, 0.4, 0.7):
        walker = blend(TUNED, LAB, fraction)
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
    lower = gait_family(blend(TUNED, LAB, together), 0.05, 0.3)
    upper = gait_family(blend(TUNED, LAB, together), 0.12, 0.3)
    assert max(lower.folds) == pytest.approx(0.099, abs=3e-3)
    assert min(upper.slope) > 0.099 or min(upper.folds) == pytest.approx(0.099, abs=3e-3)
    # (f) wholly de-tuned, the upper curve still exists, at slopes beyond the document's plot.
    above = gait_family(LAB, 0.1, 0.3)
    assert above.folds == pytest.approx((0.16372248,), abs=1e-6)
    with pytest.raises(GaitNotFound):
        find_gait(LAB, 0.1)
