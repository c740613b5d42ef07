"""Texts, tables and progress of analyses: each number is that of the object that it is about."""

from __future__ import annotations

import sys
from collections import defaultdict
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest

from gym_passive_walker import (
    WALKERS,
    basin_of_attraction,
    bifurcation_diagram,
    crisis,
    doubling_cascade,
    find_gait,
    gait_family,
    largest_push,
    lyapunov_exponents,
    parameter_family,
    reality_check,
    simulate,
)
from gym_passive_walker._tools.progress import progress
from gym_passive_walker.gaits.branches.bifurcation import BifurcationDiagram
from gym_passive_walker.gaits.branches.doubling import FEIGENBAUM
from gym_passive_walker.gaits.robust.basin import FELL, UNSETTLED, Basin

SIZED = replace(WALKERS["D"], thigh_length=1.4, shank_length=0.9, gravity=3.0, hip_mass=5.0)
"""The simplest walker in units in which no unit is one."""


@pytest.fixture(scope="module")
def basin():
    """Two gaits, falls, and walks that have not settled; more angles than rates."""
    angles, rates = np.linspace(0.19, 0.26, 5), np.linspace(-0.75, -0.6, 4)
    basin = basin_of_attraction("D", 0.0125, stance_angles=angles, stance_rates=rates, strides=60)
    settled = basin.settled.copy()
    settled[0, :2], settled[1, :3], settled[2, 4] = UNSETTLED, FELL, 1
    return replace(basin, settled=settled, gaits=basin.gaits[:1] * 2)


def test_facts_of_a_basin_are_the_shares_of_its_cells(basin):
    shares = {
        name: f"{100.0 * np.count_nonzero(basin.settled == value) / 20:.2f}%"
        for name, value in {
            "settles on gait 0": 0, "settles on gait 1": 1, "walks on unsettled": UNSETTLED,
            "falls": FELL,
        }.items()
    }  # fmt: skip
    assert basin.facts() == {
        "walker": "D",
        "slope": "0.0125 rad",
        "stance angles": "5 from 0.19 to 0.26 rad",
        "stance rates": "4 from -0.2395 to -0.1916 √(g/l)",
        **shares,
    }
    assert len(set(shares.values())) > 2


def test_rows_of_a_basin_are_its_cells(basin):
    columns = basin.columns()
    assert list(columns) == ["stance_angle", "stance_rate", "settled", "outcome", "strides"]
    cells = {
        (angle, rate): (basin.settled[i, j], basin.outcome[i, j], basin.strides[i, j])
        for i, rate in enumerate(basin.stance_rate)
        for j, angle in enumerate(basin.stance_angle)
    }
    assert len(columns["settled"]) == len(cells) == 20
    for angle, rate, *values in zip(*columns.values(), strict=True):
        assert tuple(values) == cells[angle, rate]


def test_facts_of_a_diagram():
    angles = np.array([[1.0, 2.0, 1.0, 2.0], [1.0] * 4, [np.nan] * 4, [3.0, 4.0, 5.0, 6.0]])
    slopes, periods = np.array([0.02, 0.03, 0.01, 0.05]), np.array([2, 1, 0, 0])
    diagram = BifurcationDiagram(
        WALKERS["C"],
        "slope",
        slopes,
        slopes,
        angles,
        periods,
        np.zeros((4, 6)),
        WALKERS["C"].units,
    )
    assert diagram.walks.tolist() == [True, True, False, True]
    assert diagram.facts() == {
        "walker": "C",
        "slopes": "4 from 0.01 to 0.05 rad",
        "walks at": "3",
        "strides kept": "4",
        "periods": "1, 2",
    }
    assert replace(diagram, period=np.zeros(4, int)).facts()["periods"] == "none"
    rows = diagram.columns()
    assert list(rows) == ["slope", "period", "stride", "stance_angle"]
    for k in range(16):
        i, j = divmod(k, 4)
        expected = (diagram.slope[i], diagram.period[i], j, angles[i, j])
        np.testing.assert_array_equal([rows[name][k] for name in rows], expected)


@pytest.fixture(scope="module")
def cascade():
    return doubling_cascade(SIZED, 0.012, 0.02, doublings=3)


def test_facts_and_rows_of_a_cascade(cascade):
    a, b, c = cascade.slopes
    assert cascade.ratios == pytest.approx(((b - a) / (c - b),))
    limit = c + (c - b) / (FEIGENBAUM - 1.0)
    assert cascade.limit == pytest.approx(limit)
    assert cascade.facts() == {
        "walker": "simplest, leg length 2.3, mass 5",
        "period doubles": f"1 at {a:.8g}, 2 at {b:.8g}, 4 at {c:.8g} rad",
        "limit": f"{limit:.8g} rad",
    }
    rows = cascade.columns()
    assert rows["period"].tolist() == [1, 2, 4] and rows["slope"].tolist() == [a, b, c]
    assert rows["stance_angle"].tolist() == [gait.state[0] for gait in cascade.gaits]
    one = replace(cascade, periods=(1,), values=(a,), gaits=cascade.gaits[:1])
    assert one.ratios == () and np.isnan(one.limit) and one.facts()["limit"] == "nan rad"
    two = replace(cascade, periods=(1, 2), values=(a, b), gaits=cascade.gaits[:2])
    assert two.limit == pytest.approx(b + (b - a) / (FEIGENBAUM - 1.0))


@pytest.mark.parametrize(
    ("of", "slope", "kind", "period"),
    [
        (SIZED, 0.009, "long", 1), (SIZED, 0.009, "short", 1), (SIZED, 0.016, "long", 2),
        ("lab", 0.036, "long", 1),
    ],
)  # fmt: skip
def test_facts_of_a_gait_are_dimensionless(of, slope, kind, period):
    gait = find_gait(of, slope, kind, period=period)
    walker, strides = gait.walker, gait.cycle
    length, time = np.sum(strides.step_length), np.sum(strides.duration)
    speed = length / time / np.sqrt(walker.gravity * (walker.thigh_length + walker.shank_length))
    lost = np.sum(strides.collision_loss) + np.sum(strides.friction_loss)
    weight = walker.gravity * (2.0 * walker.thigh_mass + 2.0 * walker.shank_mass + walker.hip_mass)
    largest = np.abs(gait.multipliers).max()
    assert gait.facts() == {
        "walker": "lab" if of == "lab" else "simplest, leg length 2.3, mass 5",
        "slope": f"{slope:.6g} rad",
        "step": kind,
        "period": str(period),
        "stance angle": f"{gait.state[0]:.6g} rad",
        "speed": f"{speed:.6g} √(g l)",
        "cost of transport": f"{lost / weight / length:.6g}",
        "largest multiplier": f"{largest:.6g}",
        "": "stable" if largest < 1.0 else "unstable",
    }
    assert len(strides.duration) == period
    assert gait.stride.duration == strides.duration[0]
    assert gait.step_length == pytest.approx(length / period, rel=1e-14)
    assert gait.step_period == pytest.approx(time / period, rel=1e-14)
    assert gait.stride.heelstrike_loss == strides.heelstrike_loss[0]
    for name in ("heelstrike_loss", "kneestrike_loss", "gravity_work"):
        assert getattr(gait, name) == pytest.approx(getattr(strides, name).mean(), rel=1e-14)


def test_a_family_prints_its_range_its_bifurcations_and_its_ends():
    family = gait_family("lab", 0.018, 0.3)
    low, high = family.ends
    assert family.facts() == {
        "walker": "lab",
        "gaits": f"{len(family.value)} of period 1, "
        f"{np.count_nonzero(np.abs(family.multipliers).max(axis=1) < 1.0)} stable",
        "slope": f"{min(family.slope):.6g} to {max(family.slope):.6g} rad",
        "folds": ", ".join(f"{x:.6g}" for x in family.folds),
        **(
            {"period doublings": ", ".join(f"{x:.6g}" for x in family.period_doublings)}
            if family.period_doublings
            else {}
        ),
        "halts": f"{family.halts[0]:.6g}",
        "ends": f"at {low.value:.6g} ({low.reason}) and at {high.value:.6g} ({high.reason})",
    }
    marks = dict(
        folds=(0.1, 0.2), period_doublings=(0.3,), neimark_sackers=(0.4, 0.5), halts=(0.6,)
    )
    facts = replace(family, **marks).facts()
    assert facts["folds"] == "0.1, 0.2" and facts["period doublings"] == "0.3"
    assert facts["Neimark-Sacker bifurcations"] == "0.4, 0.5" and facts["halts"] == "0.6"


def test_rows_of_a_family_are_its_gaits():
    family = parameter_family("E", "hip_torque", 0.0, 0.02, slope=0.012)
    rows, walker = family.columns(), WALKERS["E"]
    assert list(rows)[:2] == ["hip_torque", "slope"]
    np.testing.assert_array_equal(rows["hip_torque"], family.value)
    np.testing.assert_array_equal(rows["slope"], 0.012)
    speed = family.step_length / family.step_period
    np.testing.assert_allclose(rows["speed"], speed, rtol=1e-14)
    np.testing.assert_allclose(rows["froude_speed"], speed / np.sqrt(walker.gravity), rtol=1e-14)
    modulus = np.abs(family.multipliers).max(axis=1)
    np.testing.assert_array_equal(rows["largest_multiplier"], modulus)
    np.testing.assert_array_equal(rows["stable"], modulus < 1.0)
    for name in ("step_length", "step_period", "stance_angle"):
        np.testing.assert_array_equal(rows[name], getattr(family, name))
    assert "slope" == next(iter(gait_family("E", 0.01, 0.012).columns()))


def test_facts_of_a_walk_are_dimensionless_and_say_how_it_ended():
    state = find_gait(SIZED, 0.009).state
    walk = simulate(SIZED, 0.009, state, 3, samples=9)
    time, length = np.sqrt(2.3 / 3.0), 2.3
    distance = walk.contact_x[-1] - walk.contact_x[0]
    assert walk.facts() == {
        "walker": "simplest, leg length 2.3, mass 5",
        "slope": "0.009 rad",
        "strides": "3, the last ends heelstrike",
        "samples": str(len(walk.times)),
        "time": f"{walk.times[-1] / time:.6g} √(l/g)",
        "distance": f"{distance / length:.6g} l",
    }
    fall = simulate(SIZED, 0.009, [0.2, -0.2, -0.2, -0.01, 0.0, 0.0], 3)
    assert fall.facts()["strides"] == "1, the last ends fell backward" and len(fall.outcomes) == 1


@pytest.mark.parametrize("friction", [0.8, 0.05])
def test_rows_of_a_check_are_its_readings_in_both_units(friction):
    gait = find_gait("lab", 0.036)
    check = reality_check(gait, friction=friction)
    rows, walker = check.columns(), WALKERS["lab"]
    weight, length = walker.total_mass * walker.gravity, walker.leg_length
    time = np.sqrt(length / walker.gravity)
    units = {
        "l": length, "m g l": weight * length, "m l v": weight * length * time, "m g": weight,
        "m v": weight * time, "v": length / time, "rad": 1.0, "": 1.0,
    }  # fmt: skip
    np.testing.assert_allclose(
        rows["scaled"], rows["value"] / [units[name] for name in rows["unit"]], rtol=1e-13
    )
    of = dict(zip(rows["quantity"], zip(rows["value"], rows["time"], strict=True), strict=True))
    for quantity, field in {
        "swing foot's least clearance": "clearance",
        "stance knee's least torque": "stance_knee_torque",
        "impulse at kneestrike": "stance_knee_at_kneestrike",
        "impulse at heelstrike": "stance_knee_at_heelstrike",
        "swing knee's least torque": "swing_knee_torque",
        "least normal force": "least_normal_force",
        "greatest normal force": "greatest_normal_force",
        "needed between collisions": "stance_friction",
        "swing knee's least flexion": "knee_flexion",
        "old stance foot's velocity": "release_velocity",
        "its depth below the ground": "release_depth",
    }.items():
        np.testing.assert_array_equal(of[quantity], getattr(check, field), err_msg=quantity)
    knee, heel = check.kneestrike_impulse, check.heelstrike_impulse
    assert of["normal impulse at kneestrike"] == (knee.normal_impulse, knee.time)
    assert of["normal impulse at heelstrike"] == (heel.normal_impulse, heel.time)
    assert of["needed at kneestrike"] == tuple(knee.needed_friction)
    assert of["needed at heelstrike"] == tuple(heel.needed_friction)
    assert len(of) == 15
    assert check.passed["friction"] == (friction == 0.8)
    expected = {item: "ok" if check.passed[item] else "fails" for item in check.passed}
    facts = {"walker": "lab", "slope": "0.036 rad", "strides": "1", **expected}
    assert check.facts() == facts
    text = str(check)
    assert text.splitlines()[0] == (
        "1 stride of walker 'lab' at slope 0.036 rad, taking "
        f"{gait.dimensionless.step_period:.6g} √(l/g)"
    )
    assert text.endswith(f"friction up to {friction:g}")
    for quantity, (value, when) in of.items():
        line = next(x for x in text.splitlines()[2:] if quantity in x)
        words = line[50:].split()
        assert words[0] == f"{value:.4g}" and (words[1] == f"{when:.4g}" or np.isnan(value))


@pytest.fixture
def counted(monkeypatch):
    """Work that was announced, by name: how much of it, and how much has been reported done."""
    seen = defaultdict(list)

    @contextmanager
    def counting(what, total=None):
        entry = [total, 0.0]
        seen[what].append(entry)

        def done(amount=1.0, **_):
            entry[1] += amount

        yield done

    for name, module in list(sys.modules.items()):
        if name.startswith("gym_passive_walker") and getattr(module, "progress", 0) is progress:
            monkeypatch.setattr(module, "progress", counting)
    return seen


def test_progress_counts_all_work_once(counted):
    basin_of_attraction("D", 0.009, resolution=7)
    assert counted["cells of the basin"] == [[49, 49]]
    bifurcation_diagram("D", [0.009, 0.01, 0.012], n_transient=1, n_recorded=3, longest_period=2)
    assert counted["slopes"] == [[3, 3]] and counted["strides kept"] == [[3, 3]]
    bifurcation_diagram(
        "D", [0.009, 0.01], n_transient=0, n_recorded=3, longest_period=2, sweep=True
    )
    assert counted["slopes"][1:] == [[2, 2]] and counted["strides kept"][1:] == [[3, 3]] * 2
    lyapunov_exponents("D", 0.009, n_transient=0, strides=4)
    assert counted["strides averaged over"] == [[4, 4]]
    doubling_cascade("D", 0.012, 0.018, doublings=2)
    assert counted["period doublings"] == [[2, 2]]
    assert len(counted["gaits of period 2"]) == 1


def test_progress_of_walks_is_of_their_strides(counted):
    gait = find_gait("D", 0.009)
    largest_push(gait, strides=5)
    assert counted["ways to push"][0][0] == 2
    assert {total for total, _ in counted["strides until all have settled"]} == {5}
    assert max(done for _, done in counted["strides until all have settled"]) <= 5
    crisis("D", 0.012, 0.03, strides=50, walkers=2, accuracy=1e-3)
    ((total, tried),) = counted["slopes tried"]
    assert total is None and tried >= 1
    assert isinstance(basin_of_attraction("D", 0.009, resolution=2), Basin)
