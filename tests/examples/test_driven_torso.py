"""Where a complex pair of multipliers crosses the unit circle, strides leave the limit cycle."""

import numpy as np
import pytest

import gym_passive_walker as gpw
from examples import driven_torso
from examples.driven_torso import DRIVEN_TORSO, SLOPE, width
from gym_passive_walker.gaits.branches.continuation import (
    Point,
    neimark_sacker_test,
    on_the_unit_circle,
)
from tests.own.oracle import Independent


@pytest.fixture(scope="module")
def branch():
    """Gaits as the damper of the torso weakens."""
    return gpw.parameter_family(DRIVEN_TORSO, "damping", 5e-4, 0.05, slope=SLOPE)


def test_the_pair_at_the_bifurcation_lies_on_the_unit_circle(branch):
    (at,) = branch.neimark_sackers
    there = gpw.find_gait(DRIVEN_TORSO.vary(damping=at), SLOPE)
    pair = there.multipliers[:2]
    np.testing.assert_allclose(np.abs(pair), 1.0, atol=1e-8)
    assert pair[0] == pair[1].conj() and abs(pair[0].imag) > 0.1
    np.testing.assert_array_equal(branch.stable, branch.value > at)
    assert branch.period_doublings == () and "Neimark-Sacker" in str(branch)


def test_the_multipliers_there_are_those_of_scipy_s_integration(branch):
    walker = DRIVEN_TORSO.vary(damping=branch.neimark_sackers[0])
    gait, independent = gpw.find_gait(walker, SLOPE), Independent(walker, SLOPE)
    shift, columns = 1e-5, []
    for change in shift * np.eye(6):
        after, before = (independent.stride(gait.state + way * change)[0] for way in (1.0, -1.0))
        columns.append((after - before) / (2.0 * shift))
    found = np.linalg.eigvals(np.array(columns).T)
    largest = found[np.argsort(-np.abs(found))][:2]
    np.testing.assert_allclose(np.abs(largest), 1.0, atol=1e-5)
    np.testing.assert_allclose(abs(largest[0].imag), abs(gait.multipliers[0].imag), atol=1e-5)


def test_the_closed_curve_of_strides_grows_as_a_square_root(branch):
    (at,) = branch.neimark_sackers
    assert width(1.05 * at) < 1e-9
    near, far = (width(share * at, strides=12_000) for share in (0.99, 0.96))
    assert 1e-3 < near < far
    assert (far / near) ** 2 == pytest.approx(4.0, rel=0.1)


def test_two_real_multipliers_with_a_product_of_1_are_no_bifurcation():
    below, above = (np.diag([2.0, half, 0.1]) for half in (0.499999, 0.500001))
    tests = [neimark_sacker_test(point(m)) for m in (below, above)]
    assert tests[0] * tests[1] < 0.0
    for real in ([2.0, 0.5, 0.1], [1.0, -1.0, 0.1]):
        assert not on_the_unit_circle(point(np.diag(real)))
    turn = np.array([[0.6, 0.8, 0.0], [-0.8, 0.6, 0.0], [0.0, 0.0, 0.3]])
    assert on_the_unit_circle(point(turn))
    signs = [np.sign(neimark_sacker_test(point(size * turn))) for size in (0.99, 1.01)]
    assert signs[0] != signs[1]


def point(derivative):
    """A gait with a derivative of the stride map."""
    return Point(np.zeros(1), np.zeros(1), derivative)


def test_a_picture_of_the_branch_marks_the_bifurcation(branch):
    (mark,) = [
        line for line in branch.plot().lines if line.get_marker() == "h" and len(line.get_xdata())
    ]
    np.testing.assert_allclose(mark.get_xdata(), branch.neimark_sackers, rtol=1e-12)


def test_the_example_prints_the_branch_its_widths_and_where_a_torus_is_born(capsys, monkeypatch):
    monkeypatch.setattr(driven_torso, "width", lambda damping: 10.0 * damping)
    driven_torso.main()
    first, *widths, last = capsys.readouterr().out.splitlines()
    family = gpw.parameter_family(DRIVEN_TORSO, "damping", 2e-4, 2.0, slope=SLOPE)
    assert first == str(family)
    dampings = ("0.0012", "0.0011", "0.0010", "0.0009")
    assert widths == [
        f"damping {damping}: stance angles within {10 * float(damping):.4f} rad"
        for damping in dampings
    ]
    assert last == f"a torus is born at {family.neimark_sackers[0]:.6f}"
    assert float(dampings[0]) > family.neimark_sackers[0] > float(dampings[-1])


def test_a_motor_at_the_torso_pushes_back_on_the_stance_leg_alone():
    body = DRIVEN_TORSO.body._replace(target=0.1, stiffness=3.0, damping=0.5)
    state = DRIVEN_TORSO.State(0.2, -0.3, 0.3, 0.0, 0.0, 0.4)
    stance, swing, torso = driven_torso.forces(body, state)
    assert torso == pytest.approx(-3.0 * 0.2 - 0.5 * 0.4) and (stance, swing) == (-torso, 0.0)
