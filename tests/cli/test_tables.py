"""Numbers in printed tables equal those of Python, to the printed digits."""

import re

import numpy as np
import pytest

import gym_passive_walker as gpw
from gym_passive_walker.apps.cli import main


def printed(capsys, words):
    """Rows of the first table that a command prints, each a list of cells."""
    assert main(words.split()) == 0
    lines = capsys.readouterr().out.splitlines()
    rows = [re.split(r"\s{2,}", line.strip()) for line in lines[: ([*lines, ""]).index("")]]
    return rows[0], rows[1:]


def column(rows, place):
    return np.array([float(row[place]) for row in rows])


def test_a_family_s_table_has_its_gaits_and_the_largest_modulus(capsys):
    _, rows = printed(capsys, "family D 0.013 0.016")
    family = gpw.gait_family("D", 0.013, 0.016)
    names = ("slope", "stance_angle", "step_period", "step_length", "speed", "froude_speed")
    for place, name in enumerate(names):
        np.testing.assert_allclose(column(rows, place), getattr(family, name), rtol=1e-5)
    largest = np.abs(family.multipliers).max(axis=1)
    np.testing.assert_allclose(column(rows, 6), largest, rtol=1e-5)
    assert [row[7] == "yes" for row in rows] == family.stable.tolist()
    assert not family.stable.all() and largest.max() > 1.0  # the multiplier there is negative


def test_a_bifurcation_diagram_s_table_has_the_range_of_angles(capsys):
    _, rows = printed(capsys, "bifurcation D 0.012 0.0175 --slopes 3 --n-transient 301")
    slopes = np.linspace(0.012, 0.0175, 3)
    diagram = gpw.bifurcation_diagram("D", slopes, n_transient=301, n_recorded=64)
    np.testing.assert_allclose(column(rows, 0), slopes, rtol=1e-5)
    angles = diagram.stance_angle
    np.testing.assert_allclose(column(rows, 1), angles.min(axis=1), rtol=1e-5)
    np.testing.assert_allclose(column(rows, 2), angles.max(axis=1), rtol=1e-5)
    assert angles[2, -1] < angles[2].max()  # the greatest is not the last
    assert [row[3] for row in rows] == [f"period {n}" for n in diagram.period]


@pytest.mark.parametrize(
    ("options", "units"), [([], "s m m/s rad/s"), (["--dimensionless"], "√(l/g) l √(gl) √(g/l)")]
)
@pytest.mark.parametrize(("name", "slope"), [("lab", 0.036), ("C", 0.03)])
def test_a_gait_s_listing_has_its_measures(name, slope, options, units, capsys):
    assert main(["gait", name, str(slope), *options]) == 0
    first = capsys.readouterr().out.split("\n\n")[0].splitlines()[1:]
    said = dict(re.split(r"\s{2,}", line.strip(), maxsplit=1) for line in first)
    gait = gpw.find_gait(name, slope)
    gait = gait.dimensionless if options else gait
    time, length, speed, rate = (unit.replace("gl", "g l") for unit in units.split())
    for label, value in {
        "stance angle (rad)": gait.stance_angle,
        f"step period ({time})": gait.step_period,
        f"step length ({length})": gait.step_length,
        f"speed ({speed})": gait.speed,
        "speed / √(g l)": gait.froude_speed,
        "cost of transport": gait.cost_of_transport,
    }.items():
        assert float(said[label]) == pytest.approx(value, rel=1e-7), label
    assert said["stable"] == ("yes" if gait.stable else "no")
    states = [float(x) for x in said[f"section state (rad, {rate})"].split(",")]
    np.testing.assert_allclose(states, gait.state, rtol=1e-7)


def test_a_walk_s_table_has_its_strides(capsys):
    start = [0.25, -0.25, -0.25, -1.06, -0.35, -1.5]
    _, rows = printed(capsys, "simulate lab 0.036 --strides 3 --state " + " ".join(map(str, start)))
    state = np.array(start)
    for row in rows:
        found = gpw.stride("lab", 0.036, state, tolerance=1e-12)
        numbers = [float(cell) for cell in row[1:8]]
        expected = [
            state[0], found.duration, found.step_length, found.kneestrike_time,
            found.kneestrike_loss, found.heelstrike_loss, 0.0,
        ]  # fmt: skip
        np.testing.assert_allclose(numbers, expected, rtol=1e-4, atol=1e-9)
        assert row[8] == found.outcome.name.lower() == "heelstrike"
        state = found.state
