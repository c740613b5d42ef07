"""Sizes of a system up to its limits, pictures, positions and copies."""

import math
from collections import namedtuple
from dataclasses import replace

import numpy as np
import pytest

import gym_passive_walker as gpw
from examples.five_links import FIVE_LINKS
from examples.torso import TORSO
from gym_passive_walker.engine.own import mechanics, statement
from gym_passive_walker.models.equations import straight
from tests.own.statements import COMPASS, DRIVEN, PROGRESSIVE, Legs, links
from tests.own.test_equations import stated

ALL = [COMPASS, DRIVEN, TORSO, PROGRESSIVE, FIVE_LINKS]
IDS = ["compass", "driven", "torso", "progressive", "five links"]


def with_coordinates(count):
    """A compass with masses that slide along the normal above its hip."""
    names = ["stance", "swing", *(f"slide_{i}" for i in range(count - 2))]
    kind = namedtuple("Wide", [*names, *(f"{name}_rate" for name in names)])

    def masses(body, state):
        hip = links(body, state)[0]
        rest = [gpw.Link(0.01, hip.x, hip.y + 0.1 + each) for each in state[2:count]]
        return [*links(body, state), *rest]

    return replace(
        COMPASS, State=kind, links=masses, start=(*COMPASS.start[:2], *[0.0] * (count - 2),
        *COMPASS.start[2:], *[0.0] * (count - 2)),
        relabel=lambda b, s: (s.swing, s.stance, *s[2:count]),
    )  # fmt: skip


def with_controls(count):
    names = [f"torque_{i}" for i in range(count)]
    kind = namedtuple("Many", names)
    return replace(COMPASS, Control=kind, travel=lambda s: kind(*[s.swing - s.stance] * count))


def with_parameters(count):
    kind = namedtuple("Long", ["hip", "leg", *(f"more_{i}" for i in range(count - 2))])
    return replace(COMPASS, body=kind(*Legs(), *[1.0] * (count - 2)))


def with_counts(count):
    """A system with so many falls, counts and controls."""
    less = count - len(DRIVEN.falls) - len(DRIVEN.controls)
    return replace(DRIVEN, counts=[COMPASS.counts[0]] * less)


@pytest.mark.parametrize(
    ("sized", "most", "said"),
    [
        (with_coordinates, 8, "1 to 8 coordinates"),
        (with_controls, 8, "at most 8 controls"),
        (with_parameters, 24, "24 parameters"),
        (with_counts, 15, "16 controls, falls and counts together"),
    ],
)
def test_a_system_may_be_as_large_as_its_limit_and_no_larger(sized, most, said):
    assert sized(most).name == "compass"
    with pytest.raises(gpw.StatementError, match=said):
        sized(most + 1)


@pytest.mark.parametrize("limit", [0.0, -1.0, math.nan, math.inf])
def test_a_limit_of_a_control_is_a_positive_number_and_names_a_control(limit):
    with pytest.raises(gpw.StatementError, match="limits of system"):
        replace(DRIVEN, limits={"hip": limit})
    with pytest.raises(gpw.StatementError, match="has no control 'knee': choose from hip"):
        replace(DRIVEN, limits={"knee": 1.0})
    with pytest.raises(gpw.StatementError, match="choose from none"):
        replace(COMPASS, limits={"hip": 1.0})


@pytest.mark.parametrize("mass", [0.0, -1.0, math.nan])
def test_the_mass_of_given_equations_is_positive(mass):
    body = straight.SYSTEM.Body(*[0.5] * len(straight.SYSTEM.Body._fields))
    with pytest.raises(gpw.StatementError, match="mass of system"):
        gpw.System.of(straight.SYSTEM, body, centre=lambda b, s: (0.0, 1.0), mass=mass)
    with pytest.raises(TypeError, match="no argument counts"):
        gpw.System.of(straight.SYSTEM, body, centre=lambda b, s: (0.0, 1.0), counts=())


@pytest.mark.parametrize("system", ALL, ids=IDS)
def test_a_system_without_a_pose_is_drawn_as_its_masses_from_the_foot(system):
    state = system.start
    bare = replace(system, pose=None)
    masses = [gpw.Link(*each) for each in bare.links(bare.body, bare.State(*state))]
    lines = bare.drawn(state)
    assert len(lines) == len(masses)
    for line, mass in zip(lines, masses, strict=True):
        np.testing.assert_allclose(line, [(0.0, 0.0), (float(mass.x), float(mass.y))])
    total = sum(mass.mass for mass in masses)
    centre = [sum(m.mass * float(at) for m, at in zip(masses, way, strict=True)) / total
              for way in ([m.x for m in masses], [m.y for m in masses])]  # fmt: skip
    np.testing.assert_allclose(bare.centre_of_mass(state), centre, rtol=1e-12)
    assert bare.total_mass == pytest.approx(total, rel=1e-12)


def test_given_equations_without_a_pose_are_drawn_from_the_foot_to_the_centre():
    system = stated("straight")
    state = np.linspace(0.1, -0.2, 2 * system.coordinates)
    (line,) = system.drawn(state)
    np.testing.assert_allclose(line, [(0.0, 0.0), system.centre_of_mass(state)])
    assert abs(line[1][1]) > 0.1


def test_a_body_varies_by_name_and_is_checked_as_the_first_one_is():
    for wrong, said in (
        ({"hip": -5.0}, "negative mass"), ({"leg": 0.0}, "without inertia"),
        ({"knee": 1.0}, "has no knee"),
    ):  # fmt: skip
        with pytest.raises(gpw.StatementError, match=said):
            COMPASS.vary(**wrong)
    heavy = COMPASS.vary(hip=1.0, leg=0.2)
    assert heavy.body == Legs(1.0, 0.2) and COMPASS.body == Legs()
    assert heavy.total_mass == pytest.approx(1.4) and heavy.start == COMPASS.start
    assert heavy.hybrid is COMPASS.hybrid  # the equations are compiled once


@pytest.mark.parametrize("system", ALL, ids=IDS)
def test_coordinates_with_both_feet_down_keep_the_first_and_touch_the_ground(system):
    count = system.coordinates
    near = np.array(system.start[:count]) * np.linspace(0.5, 1.3, 7)[:, None]
    found = system.with_both_feet_down(near)
    np.testing.assert_array_equal(found[:, 0], near[:, 0])
    for row in found:
        height = system.landing(system.body, system.State(*row, *np.zeros(count)))[1]
        assert abs(float(height)) < 1e-12
    assert np.abs(found - near).max() < 0.1
    np.testing.assert_allclose(system.with_both_feet_down(found), found, atol=1e-12)
    np.testing.assert_allclose(system.exchanged(system.exchanged(found)), found)


def random_matrix(size, seed=0):
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(size, size))
    return root @ root.T + size * np.eye(size)


def upper(matrix):
    return tuple(matrix[np.triu_indices(len(matrix))].tolist())


Three = namedtuple("Three", "a b c a_rate b_rate c_rate")


@pytest.mark.parametrize("way", [(1.0, -1.0, 0.0), (0.3, 0.5, -2.0)])
def test_a_stop_takes_the_energy_of_the_motion_that_it_ends(way):
    matrix, rates = random_matrix(3), np.array([0.7, -1.2, 0.4])
    strike = statement.stop_of(
        lambda body, state: upper(matrix),
        lambda body, state: way[0] * state.a + way[1] * state.b + way[2] * state.c,
    )
    found = strike(Legs(), Three(0.1, 0.2, 0.3, *rates), 0.0, gpw.modeling.Ground(0.0, 1.0))
    after = np.array(found.after[3:], float)
    assert found.after[:3] == (0.1, 0.2, 0.3)
    assert np.dot(way, after) == pytest.approx(0.0, abs=1e-12)
    impulse = matrix @ (after - rates)  # along the stop alone
    np.testing.assert_allclose(np.cross(impulse, way), 0.0, atol=1e-12)
    energies = [0.5 * v @ matrix @ v for v in (rates, after)]
    assert float(found[1]) == pytest.approx(energies[0] - energies[1], rel=1e-12)
    energy = statement.kinetic_energy_of(lambda body, state: upper(matrix))
    assert energy(Legs(), Three(0, 0, 0, *rates)) == pytest.approx(energies[0], rel=1e-12)


@pytest.mark.parametrize("free", [1, 2, 3])
def test_the_last_coordinates_of_a_phase_move_with_the_last_link(free):
    matrix, given = random_matrix(3, 1), np.array([0.4, -0.9, 1.3])
    ties = np.zeros((3, free))
    for i in range(3):
        ties[i, min(i, free - 1)] = 1.0
    expected = np.linalg.solve(ties.T @ matrix @ ties, ties.T @ given)
    found = statement.accelerations_of(
        lambda body, state: upper(matrix), lambda *_: tuple(given.tolist()), free
    )(Legs(), Three(*range(6)), namedtuple("Free", "")(), gpw.modeling.Ground(0.0, 1.0))
    np.testing.assert_allclose(np.array(found, float), expected, rtol=1e-12)
    tied = statement.tied(Three(*range(6)), free)
    np.testing.assert_array_equal(tied[:3], ties @ np.arange(free))
    np.testing.assert_array_equal(tied[3:], ties @ np.arange(3, 3 + free))


@pytest.mark.parametrize("size", [1, 2, 4, 8])
def test_symmetric_systems_are_solved(size):
    matrix, right = random_matrix(size, 2), np.arange(1.0, size + 1.0)
    entries = {(i, j): matrix[i, j] for i in range(size) for j in range(i, size)}
    np.testing.assert_allclose(
        mechanics.solve_positive(dict(entries), right), np.linalg.solve(matrix, right), rtol=1e-10
    )
