"""Forces, energies, powers and the centre of mass of a walk obey mechanics, over time."""

import csv
import re
from dataclasses import replace
from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import scipy.io
from hypothesis import given
from hypothesis import strategies as st
from numpy.polynomial import Chebyshev
from numpy.polynomial.chebyshev import chebpts1

import gym_passive_walker as gpw
from examples.torso import TORSO
from gym_passive_walker.gaits.look import series
from gym_passive_walker.gaits.look.series import SERIES, look_at
from gym_passive_walker.gaits.measures import SYMBOLS, UNIT_OF
from tests.own.statements import COMPASS, DRIVEN

SLOPES = {"A": 0.03, "B": 0.03, "C": 0.02, "D": 0.009, "E": 0.009, "F": 0.009, "lab": 0.036}
SPRUNG = replace(
    gpw.WALKERS["C"], hip_stiffness=0.3, hip_friction=0.02, knee_stiffness=0.02
)  # fmt: skip
STIFF = replace(gpw.WALKERS["E"], hip_stiffness=0.5, hip_friction=0.01)
E = gpw.WALKERS["E"].units
PUSHED = {"hip_torque": 0.01 * E.torque, "ankle_torque": 0.002 * E.energy,
          "push_off": 0.03 * E.impulse}  # fmt: skip
STEPS = gpw.footholds([0.0, -0.002, -0.001], [0.0, 0.002, 0.001])
NODES = chebpts1(64)
MANY_NODES = chebpts1(160)
"""Nodes of a phase; the torso swings quickly on its spring."""


@cache
def start(name):
    return gpw.find_gait(name, SLOPES[name]).state


@cache
def walks(name):
    """Two strides off any gait, at a tolerance of rounding."""
    if name == "torso":
        return gpw.simulate(TORSO, 0.03, np.array(TORSO.start), 2, tolerance=1e-13)
    if name == "driven":
        held = gpw.stride_map(
            controller=lambda seen: np.full((len(seen), 1), 0.1),
            scene={"system": DRIVEN, "slope": 0.03, "control": "stride"},
        )
        return gpw.simulate(held, 0.03, np.array(DRIVEN.start), 2, tolerance=1e-13)
    if name == "sprung":
        return gpw.simulate(SPRUNG, 0.04, 1.01 * start("C"), 2, tolerance=1e-13)
    if name == "held":
        walker = replace(gpw.WALKERS["lab"], knees="held")
        state = gpw.find_gait(walker, 0.036).state
        return gpw.simulate(walker, 0.036, state, 2, tolerance=1e-13)
    if name == "pushed":
        state = 1.01 * start("E")
        return gpw.simulate(STIFF, 0.009, state, 2, tolerance=1e-13, **PUSHED)
    state = start(name) * np.where(np.arange(6) < 3, 1.0, 1.01)
    return gpw.simulate(name, SLOPES[name], state, 2, tolerance=1e-13)


WALKS = (*SLOPES, "held", "torso", "driven", "sprung", "pushed")


def parts(walk):
    """The walk at Chebyshev nodes of each phase, the number of its stride, and its ends."""
    taken, began = walk.taken, np.cumsum([0.0, *walk.taken.duration])
    first = np.unique(walk.stride_index, return_index=True)[1]
    nodes = MANY_NODES if walk.walker is TORSO else NODES
    for k in range(len(taken.outcome)):
        knee = taken.kneestrike_time[k]
        edges = [0.0, *([knee] if knee > 0.0 else []), taken.duration[k]]
        for a, b in pairwise(edges):
            times = 0.5 * (a + b) + 0.5 * (b - a) * nodes
            every = np.tile(times, (len(first), 1))
            seen = look_at(walk._map, walk.slope, walk.states[first], walk._ground, every)
            states, angle = walk.units.to_own(seen.states[k]), walk.states[first[k], 0]
            controls = walk.walker.controls
            yield replace(
                walk, times=began[k] + times, states=states,
                contact_x=walk.contact_x[first[k]] + walk.walker.foot_radius
                * (angle - states[:, 0]),
                contact_y=np.zeros(len(nodes)), tilts=np.zeros(len(nodes)),
                stride_index=np.full(len(nodes), k), phases=seen.stages[k],
                torques=seen.controls[k, :, : len(controls)] * walk.walker.control_units,
            ), k, (began[k] + a, began[k] + b)  # fmt: skip


def over(part, ends, values):
    """The series through values at the nodes of a part of a walk."""
    return Chebyshev.fit(part.times, values, len(values) - 1, domain=ends)


def mass(walk):
    return walk.weight / walk.walker.gravity


@pytest.mark.parametrize("name", WALKS)
def test_energy_changes_by_work_and_losses_alone(name):
    walk = walks(name)
    unit, lost, work, before = walk.units.energy, 0.0, 0.0, None
    strikes = walk.strikes
    for part, _, ends in parts(walk):
        powers = part.powers.sum(axis=1) - part.friction_power
        spent = over(part, ends, powers).integ(lbnd=ends[0])
        gained = np.cos(walk.slope) * part.com_y - np.sin(walk.slope) * part.com_x
        energy = part.kinetic_energy + part.spring_energy + walk.weight * gained
        lost = strikes.loss[strikes.times < ends[0] + 1e-6].sum()
        total = (energy + lost - work - spent(part.times)) / unit
        before = total[0] if before is None else before
        np.testing.assert_allclose(total, before, rtol=0.0, atol=1e-11)
        work += spent(ends[1])
    assert len(strikes) and before is not None
    if name in ("driven", "pushed", "sprung"):
        assert abs(work) / unit > 1e-5  # there is something to account for


@pytest.mark.parametrize("name", WALKS)
def test_the_force_is_mass_times_acceleration_of_the_centre_of_mass(name):
    walk = walks(name)
    inner = slice(6, -6)  # differences of samples lose digits at the ends
    for part, _, ends in parts(walk):
        for axis, (force, pull) in enumerate(
            ((part.tangential_force, np.sin(walk.slope)), (part.normal_force, -np.cos(walk.slope)))
        ):
            place, speed = part.centre_of_mass[:, axis], part.centre_of_mass_velocity[:, axis]
            moved = over(part, ends, place).deriv()(part.times)[inner]
            np.testing.assert_allclose(moved, speed[inner], rtol=0.0, atol=1e-10 * walk.units.speed)
            needed = mass(walk) * over(part, ends, speed).deriv()(part.times)
            carried = force + walk.weight * pull
            off = np.abs(needed - carried)[inner].max()
            assert off < 1e-10 * walk.weight
            given = over(part, ends, carried).integ(lbnd=part.times[0])(part.times)
            gained = mass(walk) * (speed - speed[0])
            assert np.abs(given - gained).max() < 1e-11 * walk.units.impulse


@pytest.mark.parametrize("name", WALKS)
def test_impulses_are_the_changes_of_momentum(name):
    walk, last, changes = walks(name), None, []
    for part, _, ends in parts(walk):
        fits = [over(part, ends, each) for each in part.centre_of_mass_velocity.T]
        if last is not None:
            changes.append((ends[0], [fit(ends[0]) - x for fit, x in zip(fits, last, strict=True)]))
        last = [fit(ends[1]) for fit in fits]
    strikes = walk.strikes
    assert {"kneestrike"} <= {*strikes.kinds} or not walk.walker.knees
    assert ("push-off" in strikes.kinds) == (name == "pushed")
    for time, change in changes:
        there = np.isclose(strikes.times, time, rtol=1e-12)
        given = strikes.tangential_impulse[there].sum(), strikes.normal_impulse[there].sum()
        off = np.abs(given - mass(walk) * np.array(change)).max()
        assert off < 1e-10 * walk.units.impulse


@pytest.mark.parametrize("name", ["A", "C", "D", "lab", "driven"])
def test_extremes_of_a_reality_check_are_those_of_the_series(name):
    walk = walks(name)
    walker = walk._map.with_tolerance(1e-13) if name == "driven" else walk.walker
    check = gpw.reality_check(walker, walk.slope, walk.states[0], strides=2)
    seen = {"normal_force": [], "friction": [], "stance_knee_torque": [], "swing_knee_torque": []}
    heights = []
    for part, k, ends in parts(walk):
        times = np.linspace(*ends, 4001)
        fits = {quantity: over(part, ends, getattr(part, quantity))(times) for quantity in
                ("normal_force", "tangential_force", "stance_knee_torque", "swing_knee_torque",
                 "foot_clearance")}  # fmt: skip
        seen["normal_force"].append(fits["normal_force"])
        seen["friction"].append(np.abs(fits["tangential_force"] / fits["normal_force"]))
        seen["stance_knee_torque"].append(fits["stance_knee_torque"])
        if part.phases[0] == 1:
            seen["swing_knee_torque"].append(fits["swing_knee_torque"])
        first = walk.taken.duration[:k].sum()
        share = (times - first) / walk.taken.duration[k]
        heights.append(fits["foot_clearance"][(share > 0.3) & (share < 0.8)])
    lines = {quantity: np.concatenate(values) for quantity, values in seen.items() if values}
    extremes = {
        "least_normal_force": lines["normal_force"].min(),
        "greatest_normal_force": lines["normal_force"].max(),
        "stance_friction": lines["friction"].max(),
    }
    strikes = walk.strikes
    heels = strikes.kinds == "heelstrike"
    needed = np.abs(strikes.tangential_impulse / strikes.normal_impulse)[heels].max()
    extremes["heelstrike_impulse"] = needed
    if walk.walker.knees:
        knees = strikes.stance_knee_impulse
        extremes |= {quantity: lines[quantity].min()
                     for quantity in ("stance_knee_torque", "swing_knee_torque")}  # fmt: skip
        extremes |= {"stance_knee_at_kneestrike": knees[strikes.kinds == "kneestrike"].min(),
                     "stance_knee_at_heelstrike": knees[heels].min()}  # fmt: skip
    if name != "driven":
        extremes["clearance"] = np.concatenate(heights).min()
    for quantity, value in extremes.items():
        found = getattr(check, quantity)
        found = getattr(found, "needed_friction", found).value
        assert found == pytest.approx(value, rel=1e-6, abs=1e-7), quantity


@given(
    st.sampled_from([*sorted(SLOPES), "compass"]), st.floats(0.98, 1.02), st.floats(0.98, 1.02),
    st.integers(1, 3),
)  # fmt: skip
def test_passive_walks_keep_their_energy_but_for_losses(name, angle, rates, strides):
    walker, slope, begin = name, SLOPES.get(name, 0.03), COMPASS.start
    if name == "compass":
        walker = COMPASS
    else:
        begin = start(name)
    state = np.array(begin) * np.repeat([angle, rates], len(begin) // 2)
    walk = gpw.simulate(walker, slope, state, strides, samples=20, tolerance=1e-13)
    strikes = walk.strikes
    lost = [strikes.loss[strikes.times <= time].sum() for time in walk.times]
    total = (walk.mechanical_energy + lost) / walk.units.energy
    np.testing.assert_allclose(total, total[0], rtol=0.0, atol=1e-11)
    assert np.all(strikes.loss > 0.0) and not walk.powers.any()
    assert np.all(np.diff(strikes.times) > 0.0)
    assert walk.dimensionless.normal_force.max() < 2.0


@pytest.mark.parametrize(
    "walker, terrain",
    [("lab", gpw.rough(0.002, 0.01)), ("A", STEPS),
     ("level-ppo", None), ("push-off-ppo", None), ("level-ppo", gpw.rough(0.001, 0.002))],
)  # fmt: skip
def test_each_stride_has_its_balance_on_any_ground_and_under_a_policy(walker, terrain):
    walks = walker if walker in SLOPES else gpw.stride_map(controller=walker)
    slope, state = (SLOPES[walker], start(walker)) if walker in SLOPES else (None, None)
    walk = gpw.simulate(walks, slope, state, 4, terrain=terrain, terrain_seed=2, tolerance=1e-12)
    taken, first = walk.taken, np.unique(walk.stride_index, return_index=True)[1]
    assert len(first) > 2
    gained = np.diff(walk.mechanical_energy[first])
    works = taken.hip_work + taken.ankle_work + taken.push_off_work
    lost = taken.kneestrike_loss + taken.heelstrike_loss + taken.friction_loss
    count = len(gained)
    np.testing.assert_allclose(
        gained, (works - lost)[:count], rtol=0.0, atol=1e-10 * walk.units.energy
    )
    height = np.diff(walk.potential_energy[first])
    np.testing.assert_allclose(
        height, -taken.gravity_work[:count], rtol=0.0, atol=1e-10 * walk.units.energy
    )
    strikes, turned = walk.strikes, -1j * walk.tilts[first]
    jumps = walk.centre_of_mass_velocity[first[1:]] - walk.centre_of_mass_velocity[first[1:] - 1]
    for k, jump in enumerate(jumps):
        here, given = strikes.stride_index == k, 0.0
        for kind, frame in (("push-off", k), ("heelstrike", k + 1)):
            there = here & (strikes.kinds == kind)
            along = strikes.tangential_impulse[there].sum()
            given += (along + 1j * strikes.normal_impulse[there].sum()) * np.exp(turned[frame])
        found = mass(walk) * (jump[0] + 1j * jump[1])
        assert abs(given - found) < 1e-8 * walk.units.impulse


def test_upright_legs_have_the_centre_of_mass_of_their_masses():
    for name in ("B", "D", "E", "F"):
        walker, walk = gpw.WALKERS[name], walks(name)
        upright = replace(
            walk, states=np.zeros((1, 6)), times=np.zeros(1), contact_x=np.zeros(1),
            contact_y=np.zeros(1), tilts=np.zeros(1),
        )  # fmt: skip
        thigh = walker.leg_length - walker.thigh_com
        shank = walker.shank_length - walker.shank_com
        legs = 2.0 * (walker.thigh_mass * thigh + walker.shank_mass * shank)
        height = (legs + walker.hip_mass * walker.leg_length) / walker.total_mass
        assert upright.com_y[0] == pytest.approx(height, rel=1e-12)


def test_nothing_is_computed_that_is_not_asked_for(monkeypatch):
    def never(*_):
        raise AssertionError("asked for")

    for name in ("forces", "centre_of_mass", "clearance_of"):
        monkeypatch.setattr(series, name, never)
    walk = gpw.simulate("D", 0.009, start("D"), 2, samples=5)
    assert len(walk) == 10 and repr(walk) and walk.plot is not None
    for name in ("normal_force", "com_x", "foot_clearance", "strikes"):
        with pytest.raises(AssertionError, match="asked for"):
            getattr(walk, name)


def test_a_walk_that_falls_has_its_forces_and_no_impact(tmp_path):
    for name in ("D", "lab"):
        walk = gpw.simulate(name, SLOPES[name], [0.3, -0.3, -0.3, -0.1, 0.0, 0.0], 3, samples=7)
        assert walk.ending == "fell backward" and np.isfinite(walk.normal_force).all()
        assert "heelstrike" not in walk.strikes.kinds and len(walk.taken.outcome) == 1
        lost = np.nan_to_num(walk.taken.kneestrike_loss).sum()
        energy = walk.mechanical_energy / walk.units.energy
        assert energy[-1] - energy[0] == pytest.approx(-lost / walk.units.energy, abs=1e-8)
        walk.strikes.to_csv(tmp_path / "strikes.csv")


def test_columns_are_those_that_the_walker_has():
    every = {name for names in SERIES.values() for name in names}
    assert every | {"hip_power", "ankle_power"} <= walks("lab").columns().keys()
    knees = {"stance_knee_torque", "swing_knee_torque"}
    assert {*walks("E").columns()} & every == every - knees
    assert {*walks("torso").columns()} & every == every - knees - {"hip_joint_torque"}
    assert "hip_power" in walks("driven").columns()
    for column in walks("lab").columns().values():
        assert column.shape == (len(walks("lab")),)
    assert np.isnan(walks("E").stance_knee_torque).all()


def test_the_hip_joint_carries_actuator_spring_and_friction():
    walk = walks("pushed")
    opened = walk.states[:, 1] - walk.states[:, 0], walk.states[:, 4] - walk.states[:, 3]
    expected = PUSHED["hip_torque"] - 0.5 * opened[0] - 0.01 * opened[1]
    np.testing.assert_allclose(walk.hip_joint_torque, expected, rtol=1e-12)


def test_the_glossary_has_each_quantity_with_its_unit():
    text = (Path(__file__).parents[2] / "docs" / "glossary.md").read_text(encoding="utf-8")
    for of, names in ((series.OverTime, sum(SERIES.values(), ())), (series.Strikes, ("loss",))):
        for name in names:
            row = re.search(rf"^\| `{name}` \| (.*) \| (.*)\.", text, re.M)
            assert row and row[1] == SYMBOLS[UNIT_OF[name]], name
            if of is series.OverTime:
                about = " ".join(getattr(of, name).__doc__.replace(", (n,)", "").split())
                assert about.startswith(row[2].partition(";")[0]), name


READERS = {
    ".csv": lambda path: dict(zip(*_rows(path), strict=True)),
    ".npz": lambda path: dict(np.load(path)),
    ".mat": lambda path: scipy.io.loadmat(path, simplify_cells=True),
    ".parquet": lambda path: _parquet(path),
}


def _rows(path):
    with path.open(newline="", encoding="utf-8") as file:
        head, *rows = csv.reader(file)
    return [name.partition(" (")[0] for name in head], np.array(rows).T


def _parquet(path):
    from pyarrow import parquet

    table = parquet.read_table(path)
    return {name: table[name].to_numpy() for name in table.column_names}


@pytest.mark.parametrize("ending", READERS)
def test_tables_read_back_the_same_in_every_format(ending, tmp_path):
    lab = walks("lab")
    gait = gpw.find_gait("lab", 0.036)
    for table in (lab, lab.strikes, gait, gpw.measures(gait)):
        path = tmp_path / f"table{ending.upper()}"
        table.save(path)
        found, known = READERS[ending](path), table.columns()
        assert [*known] == [name for name in found if name in known]
        for name, column in known.items():
            if column.dtype.kind in "fi":
                values = np.atleast_1d(found[name]).astype(float)
                np.testing.assert_array_equal(values, column, err_msg=name)
            elif column.dtype.kind == "U":
                assert [str(each) for each in np.atleast_1d(found[name])] == [*column]


def test_units_stand_in_the_header_and_beside_the_columns(tmp_path):
    family = gpw.gait_family("D", 0.008, 0.01)
    family.to_csv(tmp_path / "f.csv")
    head = (tmp_path / "f.csv").read_text("utf-8").splitlines()[0].split(",")
    wanted = {"slope (rad)", "step_length (m)", "step_period (s)", "speed (m/s)",
              "stance_rate (rad/s)", "cost_of_transport", "kind"}  # fmt: skip
    assert wanted <= {*head}
    units = family.to_dataframe(["kind", "speed"]).attrs["units"]
    assert units == {"speed": "m/s"}
    family.save(tmp_path / "f.mat")
    found = scipy.io.loadmat(tmp_path / "f.mat", simplify_cells=True)
    assert found["units"]["step_length"] == "m" and {*found["kind"]} == {"long"}
    family.save(tmp_path / "f.parquet", ["speed"])
    from pyarrow import parquet

    schema = parquet.read_schema(tmp_path / "f.parquet")
    assert schema.names == ["speed"] and schema.field("speed").metadata == {b"unit": b"m/s"}
    assert walks("torso").column_units() == {}


def test_columns_are_chosen_by_name_and_others_are_refused(tmp_path):
    walk = walks("D")
    walk.to_csv(tmp_path / "w.csv", ["time", "normal_force"])
    assert (tmp_path / "w.csv").read_text("utf-8").startswith("time (s),normal_force (N)\n")
    for write in (walk.to_dataframe, lambda columns: walk.save(tmp_path / "x.csv", columns)):
        with pytest.raises(ValueError, match=r"this table has no normal_forces \(normal_force\?\)"):
            write(columns=["normal_forces"])
    with pytest.raises(ValueError, match="one column or more"):
        walk.to_csv(tmp_path / "x.csv", [])
    with pytest.raises(ValueError, match=r"ends in \.csv, \.mat, \.npz or \.parquet, not 'x\.xls'"):
        walk.save("x.xls")
    (tmp_path / "a-file").write_text("kept")
    for ending in READERS:
        with pytest.raises(OSError, match="a-file"):
            walk.save(tmp_path / "a-file" / f"w{ending}")
    assert {each.name for each in tmp_path.iterdir()} == {"w.csv", "a-file"}


def test_a_walk_is_drawn_by_what_it_has():
    from matplotlib.figure import Figure

    ax = Figure().subplots()
    assert walks("lab").plot("forces", ax=ax) is ax and walks("lab").plot(ax, of="energy") is ax
    line = walks("lab").plot("forces", ax=Figure().subplots()).lines[0].get_ydata()
    drawn = line[np.isfinite(line)]
    np.testing.assert_array_equal(drawn, walks("lab").normal_force / walks("lab").weight)
    with pytest.raises(
        ValueError, match=r"walker 'lab' is drawn by angles, forces, .* not by 'heat'"
    ):
        walks("lab").plot("heat")
    for of in SERIES:
        if of == "torques":
            with pytest.raises(ValueError, match="not by 'torques'"):
                walks("torso").plot(of)
        else:
            assert walks("torso").plot(of, ax=Figure().subplots()).has_data()
