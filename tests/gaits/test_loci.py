"""Loci of bifurcations in two parameters pass where single families have their bifurcations."""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
import pytest

import gym_passive_walker as gpw
from examples.driven_torso import DRIVEN_TORSO, SLOPE
from gym_passive_walker.gaits.branches.locus import BOUND, CLOSED, PAIR_MEETS, bifurcation_locus
from tests.gaits.test_any_parameter import COMPASSES, FIRST_DOUBLINGS, hip

LAB = gpw.WALKERS["lab"]


@pytest.fixture(scope="module")
def lab():
    """Gaits of the walker of the laboratory over the slope: two folds, two doublings."""
    return gpw.gait_family(LAB, 0.003, 0.15)


@pytest.fixture(scope="module")
def torso():
    """Gaits of a driven torso over its damping, with a Neimark-Sacker point."""
    return gpw.parameter_family(DRIVEN_TORSO, "damping", 1e-4, 0.05, slope=SLOPE)


@pytest.fixture(scope="module")
def torus(torso):
    return bifurcation_locus(torso, torso.neimark_sackers[0], "slope", 0.5 * SLOPE, 2.0 * SLOPE)


@pytest.fixture(scope="module")
def lengths(lab):
    """Folds of the walker of the laboratory over slope and shank length."""
    return [bifurcation_locus(lab, x, "shank_length", 0.3, 0.6, resolution=0.02) for x in lab.folds]


def kinds(locus):
    return [kind for kind, _ in locus.special]


def test_a_compass_doubles_its_period_where_an_independent_program_says():
    family = gpw.gait_family(COMPASSES, 0.03, 0.12)
    locus = bifurcation_locus(family, family.period_doublings[0], "hip_mass", 2.5, 50.0)
    slopes = dict(zip(locus.values[:, 1].round(9), locus.values[:, 0], strict=True))
    for mass, slope in FIRST_DOUBLINGS.items():
        assert slopes[mass] == pytest.approx(slope, abs=1e-12)
    assert {end.reason for end in locus.ends} == {BOUND}
    assert locus.bounds_stable_gaits.all()


@pytest.mark.parametrize(
    "parameter, low, high", [("foot_radius", 0.1, 0.3), ("shank_mass", 0.7, 1.4)]
)
def test_loci_agree_with_families_at_single_values(lab, parameter, low, high):
    for name in ("folds", "period_doublings"):
        for at in getattr(lab, name):
            locus = bifurcation_locus(lab, at, parameter, low, high)
            for i in range(0, len(locus), 20):
                slope, value = locus.values[i]
                walker = LAB.with_parameters(**{parameter: value})
                near = gpw.gait_family(
                    walker, 0.9 * slope, 1.1 * slope,
                    start=gpw.find_gait(walker, 1.002 * slope, guess=locus.state[i])
                    if name == "period_doublings" else None,
                )  # fmt: skip
                assert min(np.abs(np.subtract(getattr(near, name), slope))) < 1e-9 * slope


def test_each_point_of_a_locus_is_a_gait_at_the_bifurcation(lab, torus):
    doublings = bifurcation_locus(lab, lab.period_doublings[1], "foot_radius", 0.15, 0.25)
    for locus, index in ((doublings, 0), (torus, 1)):
        for i in range(0, len(locus), 5):
            if index == 0:
                walker = LAB.with_parameters(foot_radius=locus.values[i, 1])
            else:
                walker = DRIVEN_TORSO.vary(damping=locus.values[i, 0])
            gait = gpw.find_gait(walker, locus.slope[i], guess=locus.state[i])
            np.testing.assert_allclose(gait.state, locus.state[i], atol=1e-9)
            if index == 0:
                assert np.abs(gait.multipliers + 1.0).min() < 1e-8
            else:
                modulus = np.abs(gait.multipliers[gait.multipliers.imag > 0.0])
                assert np.abs(modulus - 1.0).min() < 1e-8


def test_folds_and_doublings_meet_at_the_same_fold_flip(lab, lengths):
    """Two systems of equations have the point in common, and both multipliers."""
    fold = lengths[0]
    for at in lab.period_doublings:
        doubling = bifurcation_locus(lab, at, "shank_length", 0.3, 0.6)
        assert [end.reason for end in doubling.ends] == [CLOSED, CLOSED]
        np.testing.assert_allclose(doubling.values[0], doubling.values[-1], atol=0.01)
        places = [
            sorted(values for kind, values in locus.special if kind == "fold-flip")
            for locus in (fold, doubling)
        ]
        assert len(places[0]) == 2
        np.testing.assert_allclose(*places, rtol=1e-10)


def test_two_folds_meet_in_a_cusp(lengths):
    """Slopes between the folds of single walkers grow as the power 3/2 of the distance to it."""
    fold = lengths[1]
    ((kind, (slope, length)),) = fold.special
    assert kind == "cusp"
    gaps = []
    for share in (1e-4, 4e-4):
        walker = LAB.with_parameters(shank_length=(1.0 + share) * length)
        near = int(np.argmin(np.abs(fold.values[:, 1] - walker.shank_length)))
        start = gpw.find_gait(walker, 0.998 * fold.values[near, 0], guess=fold.state[near])
        family = gpw.gait_family(walker, 0.9 * slope, 1.1 * slope, start=start, resolution=0.01)
        gaps.append(np.ptp(family.folds))
    assert gaps[1] / gaps[0] == pytest.approx(4.0**1.5, rel=0.08)


def test_neimark_sacker_points_agree_with_families_of_other_slopes(torus):
    for i in (3, len(torus) // 2, -4):
        damping, slope = torus.values[i]
        near = gpw.parameter_family(
            DRIVEN_TORSO.vary(damping=1.1 * damping), "damping", 0.5 * damping, 2.0 * damping,
            slope=slope,
        )  # fmt: skip
        assert min(np.abs(np.subtract(near.neimark_sackers, damping))) < 1e-9 * damping


def test_strong_resonances_are_turns_by_a_third_and_a_quarter(torus):
    found = dict(torus.special)
    for kind, turn in (("1:3", 1.0 / 3.0), ("1:4", 0.25)):
        damping, slope = found[kind]
        near = torus.state[int(np.argmin(np.abs(torus.values[:, 0] - damping)))]
        gait = gpw.find_gait(DRIVEN_TORSO.vary(damping=damping), slope, guess=near)
        pair = gait.multipliers[np.argmin(np.abs(gait.multipliers - np.exp(2j * np.pi * turn)))]
        assert pair == pytest.approx(np.exp(2j * np.pi * turn), abs=1e-7)


def test_a_locus_of_pairs_ends_where_they_become_real(torso):
    """It turns sharply on the way, where two loci nearly cross."""
    locus = bifurcation_locus(torso, torso.neimark_sackers[0], "stiffness", 1.6, 2.0)
    (end,) = (end for end in locus.ends if end.reason == PAIR_MEETS)
    assert end.values == dict(locus.special)["1:1"]
    last = locus.multipliers[[0, -1]]
    assert np.sort(np.abs(last - 1.0).max(axis=0))[0] < 1.0
    assert min(np.sort(np.abs(each - 1.0))[1] for each in last) < 1e-3


def test_a_locus_is_a_table_and_a_picture(lab, lengths, tmp_path):
    fold = lengths[1]
    assert "fold" in repr(fold) and "cusp at slope 0.0193001" in repr(fold)
    columns = fold.columns()
    assert [*columns][:3] == ["slope", "shank_length", "stance_angle"]
    assert columns["multiplier_1_real"].shape == (len(fold),)
    fold.to_csv(tmp_path / "fold.csv")
    ax = lengths[0].plot()
    assert fold.plot(ax) is ax
    labels = [text.get_text() for text in ax.get_legend().get_texts()]
    assert sorted(labels) == ["1:1 resonance", "cusp", "fold", "fold-flip"]
    plt.close(ax.figure)


def test_what_has_no_locus_is_refused_in_one_sentence(lab):
    def locus(family=lab, at=lab.folds[0], parameter="foot_radius", low=0.1, high=0.3, **options):
        return bifurcation_locus(family, at, parameter, low, high, **options)

    for message, given in {
        "at must be slope at a bifurcation.*not 0.05: it has a fold at 0.0191": {"at": 0.05},
        "must be another than 'slope'": {"parameter": "slope"},
        "no parameter 'radius' to vary": {"parameter": "radius"},
        "foot_radius of this family is 0.2: give low <= 0.2 <= high": {"low": 0.25},
        "give low < high": {"high": 0.1},
        "gpw.gait_family and gpw.parameter_family": {"family": "lab"},
        "resolution": {"resolution": 0.0},
        "the range leaves what a walker can be": {"high": 0.9},
    }.items():
        with pytest.raises(ValueError, match=message):
            locus(**given)
    made = gpw.parameter_family(hip, "mass", 8.0, 12.0)
    feedback = gpw.stride_map(controller=lambda seen: 0.0 * seen[:, :1], scene="lab")
    for family in (made, replace(lab, stride_map=feedback)):
        at = (*family.folds, *family.period_doublings)[0]
        with pytest.raises(ValueError, match="a locus needs exact derivatives"):
            locus(family=family, at=at)
