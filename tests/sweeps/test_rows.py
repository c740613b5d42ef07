"""Columns, rows and pictures of sweeps, from rows that are written without workers."""

import json
import math
import sys
from collections import deque
from dataclasses import fields, replace
from types import SimpleNamespace

import numpy as np
import pytest

import gym_passive_walker as gpw
from gym_passive_walker._tools import console
from gym_passive_walker.apps.sweeps import lock, run, store, workers
from gym_passive_walker.apps.sweeps.description import RESERVED, Description
from gym_passive_walker.apps.sweeps.lock import locked
from gym_passive_walker.apps.sweeps.quantities import label, sizes
from gym_passive_walker.apps.sweeps.store import DONE, FAILED, TIMED_OUT, Store
from gym_passive_walker.apps.sweeps.tasks import flat
from gym_passive_walker.apps.sweeps.workers import Pace, TaskOutcome, Workers
from tests.sweeps.odd import odd_sweep

parquet = pytest.importorskip("pyarrow.parquet")

LAB = gpw.WALKERS["lab"]
LARGE = gpw.Walker(**{**vars(gpw.WALKERS["D"]), "thigh_length": 2.0, "shank_length": 2.0,
                      "hip_mass": 3.0, "gravity": 16.0})  # fmt: skip


def written(folder, description, rows, order=None):
    """A sweep with given results; None is a failed task."""
    kept = Store(folder, description, "1")
    for task in order or range(len(rows)):
        results = rows[task]
        status, error = (DONE, None) if results is not None else (FAILED, f"error {task}")
        row = {**description.tasks[task], "task": task, "status": status, "error": error}
        kept.add({**row, "seconds": 0.25 * task}, results or {})
    kept.flush(last=True)
    kept.close()
    return run.SweepResult(folder, len(rows), sum(row is None for row in rows))


FOUR = Description(analysis="gait", over={"slope": [0.01, 0.02, 0.03, 0.04]},
                   given={"walker": LAB}, seed=7)  # fmt: skip
FOUND = [
    {"found": True, "step_length": 0.81, "multiplier": 0.5},
    None,
    {"found": False, "step_length": math.nan, "multiplier": -0.25},
    {"found": True, "step_length": 1.62, "multiplier": 1},
]


@pytest.mark.parametrize("order", [(0, 1, 2, 3), (2, 1, 3, 0)])
def test_columns_are_in_their_order_and_rows_in_that_of_the_tasks(order, tmp_path):
    found = written(tmp_path / "out", FOUR, FOUND, order)
    columns = found.columns()
    before, after = ["task", "sweep", "version", "seed"], ["status", "error", "seconds"]
    assert list(columns) == [*before, "walker", "slope", *after, *FOUND[0]]
    assert {*before, *after} == {*RESERVED}
    assert columns["task"].tolist() == [0, 1, 2, 3] and set(columns["seed"]) == {7}
    assert columns["slope"].tolist() == [0.01, 0.02, 0.03, 0.04]
    assert columns["seconds"].tolist() == [0.0, 0.25, 0.5, 0.75]
    assert columns["status"].tolist() == [DONE, FAILED, DONE, DONE]
    assert columns["error"].tolist() == [None, "error 1", None, None]
    np.testing.assert_array_equal(columns["step_length"], [0.81, np.nan, np.nan, 1.62])
    np.testing.assert_array_equal(columns["multiplier"], [0.5, np.nan, -0.25, 1.0])
    assert columns["found"].tolist() == [True, None, False, True]
    assert set(columns["version"]) == {"1"} and set(columns["sweep"]) == {FOUR.digest}
    assert gpw.Walker(**json.loads(columns["walker"][3])) == LAB
    assert found.description() == FOUR and found.description().tasks == FOUR.tasks
    assert found.facts() == {"tasks": "4", "failures": "1", "folder": str(tmp_path / "out")}


@pytest.mark.parametrize(
    ("values", "kind"),
    [
        ([1, 2], "int64"), ([1.5, 2.0], "double"), ([1, 2.5], "double"), ([2.5, 1], "double"),
        ([True, False], "bool"), ([True, 2], "string"), (["C", "E"], "string"),
        (["C", 1.0], "string"), ([[1, 2], [3]], "string"), ([None, 1.0], "string"),
    ],
)  # fmt: skip
def test_a_parameter_has_the_type_that_holds_all_its_values(values, kind, tmp_path):
    description = Description(analysis="a:b", over={"x": values})
    found = written(tmp_path / "out", description, [{"y": 1}, {"y": 2}])
    (path,) = (tmp_path / "out" / "rows").iterdir()
    schema = parquet.read_schema(path)
    assert str(schema.field("x").type) == kind and str(schema.field("y").type) == "int64"
    expected = values
    if kind == "string":
        expected = [v if v is None or isinstance(v, str) else json.dumps(v) for v in values]
    assert found.columns()["x"].tolist() == expected


@pytest.mark.parametrize(
    ("first", "second", "fits"),
    [
        (1.5, 2, True), (1, 2.5, False), (True, 1, False), (1.5, True, False), ("a", 1, False),
        ("a", "b", True),
    ],
)  # fmt: skip
def test_only_integers_fit_a_column_of_another_type(first, second, fits, tmp_path):
    description = Description(analysis="a:b", over={"x": [1, 2, 3]})
    found = written(tmp_path / "out", description, [{"y": first}, {"y": second}, {"y": first}])
    columns = found.columns()
    assert columns["status"].tolist() == [DONE, DONE if fits else FAILED, DONE]
    assert columns["y"][0] == columns["y"][2] == first
    assert (columns["y"][1] == second) if fits else "others found y" in columns["error"][1]


def test_a_result_named_like_a_column_has_its_own_and_loses_neither(tmp_path):
    description = Description(analysis="a:b", over={"x": [0.25, 0.5]})
    found = {"status": "odd", "x": True, "x_found": 3, "seconds": 60.0}
    columns = written(tmp_path / "out", description, [found, found]).columns()
    assert columns["x"].tolist() == [0.25, 0.5] and columns["x_found"].tolist() == [True] * 2
    assert columns["x_found_found"].tolist() == [3, 3]
    assert columns["status"].tolist() == [DONE] * 2
    assert columns["status_found"].tolist() == ["odd"] * 2
    assert columns["seconds_found"].tolist() == [60.0] * 2 and columns["seconds"][1] < 60.0


def test_workers_that_never_start_end_a_sweep_in_one_sentence():
    hopeless = Workers("gait", 0, None)
    process = SimpleNamespace(join=lambda: None, exitcode=1)
    dead = SimpleNamespace(process=process, tasks=[], ready=False)
    hopeless._stillborn = workers.STILLBORN - 1
    assert console.run(lambda: hopeless._lost(dead, deque(), {})) == 2


def test_a_parameter_named_results_has_its_column(tmp_path):
    description = Description(analysis="a:b", over={"results": [5, 6], "x": [1, 2]}, how="list")
    kept = Store(tmp_path / "out", description, "1")
    run._work(Alone(), kept, [*enumerate(description.tasks)])
    kept.flush(last=True)
    kept.close()
    columns = run.SweepResult(tmp_path / "out", 2, 1).columns()
    assert columns["results"].tolist() == [5, 6] and columns["y"][0] == 1


def test_rows_of_several_files_and_of_the_journal_are_one_table(tmp_path, monkeypatch):
    """A file is written at a number of rows; what a kill leaves in the journal follows."""
    description = Description(analysis="a:b", over={"x": list(range(7))})
    monkeypatch.setattr(store, "_ROWS", 3)
    kept = Store(tmp_path / "out", description, "1")
    for task in (6, 0, 3, 5, 1, 2, 4):
        row = {"task": task, "x": task, "seed": 0, "status": DONE, "error": None, "seconds": 1.0}
        kept.add(row, {"y": 10 * task})
    kept.close()
    rows, journal = tmp_path / "out" / "rows", tmp_path / "out" / "journal.jsonl"
    assert len([*rows.iterdir()]) == 2
    assert [json.loads(line)["task"] for line in journal.read_text().splitlines()] == [4]
    again = Store(tmp_path / "out", description, "1")
    assert again.done == dict.fromkeys(range(7), DONE)
    again.close()
    assert len([*rows.iterdir()]) == 3 and not journal.read_text()
    columns = run.SweepResult(tmp_path / "out", 7, 0).columns()
    assert columns["y"].tolist() == [10 * x for x in range(7)]


def test_a_row_is_written_to_a_file_after_a_time_also_if_rows_are_few(tmp_path, monkeypatch):
    now = [100.0]
    monkeypatch.setattr(store.time, "monotonic", lambda: now[0])
    kept = Store(tmp_path / "out", FOUR, "1")
    parts = []
    for task, later in enumerate((1.0, 18.0, 2.0, 19.0)):
        now[0] += later
        row = {**FOUR.tasks[task], "task": task, "status": DONE, "error": None, "seconds": 1.0}
        kept.add(row, FOUND[0])
        parts.append(len([*(tmp_path / "out" / "rows").iterdir()]))
    kept.close()
    assert parts == [0, 0, 1, 1]


@pytest.mark.parametrize("retry", [False, True])
@pytest.mark.parametrize("failed", [FAILED, TIMED_OUT])
@pytest.mark.parametrize("kept_in", ["rows", "journal"])
def test_what_failed_in_any_way_is_left_for_another_try_alone(
    kept_in, failed, retry, tmp_path, monkeypatch
):
    description = Description(analysis="a:b", over={"x": [1, 2]})
    first = Store(tmp_path / "out", description, "1")
    for task, status in enumerate((failed, DONE)):
        row = {"task": task, "x": task + 1, "seed": 0, "status": status, "seconds": 1.0}
        first.add({**row, "error": None}, {"y": 1} if status == DONE else {})
    if kept_in == "rows":
        first.flush(last=True)
    first.close()
    if retry:  # and is killed before the other rows are in a file again
        with monkeypatch.context() as patch:
            patch.setattr(Store, "flush", lambda _: None)
            Store(tmp_path / "out", description, "1", retry=True).close()
        assert not [*(tmp_path / "out" / "rows").iterdir()]
    again = Store(tmp_path / "out", description, "1", retry=retry)
    assert again.done == ({1: DONE} if retry else {0: failed, 1: DONE})
    again.close()


@pytest.fixture(params=["POSIX", "Windows"])
def locks(request, monkeypatch):
    """The locks of a system; those of Windows by a stand-in for its module."""
    if request.param == "POSIX":
        return
    flock, exclusive = lock.fcntl.flock, lock.fcntl.LOCK_EX | lock.fcntl.LOCK_NB

    def locking(number, way, count):
        assert (way, count) == ("at once", 1)
        try:
            flock(number, exclusive)
        except BlockingIOError:
            raise PermissionError(13, "Permission denied") from None

    monkeypatch.setattr(lock, "fcntl", None)
    windows = SimpleNamespace(locking=locking, LK_NBLCK="at once")
    monkeypatch.setitem(sys.modules, "msvcrt", windows)


def test_a_folder_is_locked_until_its_sweep_ends(tmp_path, locks):
    first = Store(tmp_path / "out", FOUR, "1")
    with pytest.raises(ValueError, match="another process uses the sweep"):
        Store(tmp_path / "out", FOUR, "1")
    first.close()
    Store(tmp_path / "out", FOUR, "1").close()
    with locked(tmp_path / "one"), locked(tmp_path / "other"):
        with pytest.raises(BlockingIOError), locked(tmp_path / "one"):
            pass
    with locked(tmp_path / "one"):
        pass


@pytest.mark.parametrize("text", ["ü ☃ 漢", 'a "quoted"\nline', "\\u00fc", ""])
def test_text_of_any_kind_returns_as_it_was(text, tmp_path):
    description = Description(analysis="a:b", over={"x": [text, text + "2"]})
    columns = written(tmp_path / "out", description, [{"y": text}, None]).columns()
    assert columns["x"].tolist() == [text, text + "2"] and columns["y"].tolist() == [text, None]
    assert description == run.SweepResult(tmp_path / "out", 2, 1).description()


@pytest.mark.parametrize("library", ["pandas", "polars", "duckdb"])
def test_other_readers_leave_missing_numbers_out_of_means_and_of_the_first_rows(library, tmp_path):
    module = pytest.importorskip(library)
    found = [0.25, math.nan, 0.75, 0.5]  # and a task that failed
    rows = [*({"speed": speed, "recovery": math.inf} for speed in found), None]
    description = Description(analysis="a:b", over={"x": list(range(5))})
    swept = written(tmp_path / "out", description, rows)
    folder = swept.folder / "rows"
    match library:
        case "pandas":
            speeds = module.read_parquet(folder)["speed"]
            seen = speeds.mean(), [*speeds.nlargest(2)], int(speeds.isna().sum())
        case "polars":
            speeds = module.read_parquet(folder / "*.parquet")["speed"]
            seen = speeds.mean(), [*speeds.top_k(2).sort(descending=True)], speeds.null_count()
        case _:
            columns = "avg(speed), list(speed order by speed desc)[:2], count(*) - count(speed)"
            (seen,) = module.sql(f"select {columns} from '{folder}/*.parquet'").fetchall()
    assert seen == (0.5, [0.75, 0.5], 2)
    assert swept.columns()["recovery"].tolist()[:4] == [math.inf] * 4
    np.testing.assert_array_equal(swept.columns()["speed"], [*found, math.nan])


# Pictures.


def pictured(tmp_path, by, **options):
    found = written(tmp_path / "out", FOUR, FOUND)
    return found.plot(x="slope", y="step_length", by=by, **options)


def test_a_picture_by_a_boolean_has_a_marker_for_each_value_and_for_failures(tmp_path):
    ax = pictured(tmp_path, "found")
    drawn = {each.get_label(): each.get_offsets() for each in ax.collections}
    assert list(drawn) == ["found: 2", "not found: 1", "failed: 1"]
    yes, no, failed = (np.ma.filled(each, np.nan) for each in drawn.values())
    np.testing.assert_allclose(yes, [(0.01, 1.0), (0.04, 2.0)])  # leg lengths
    assert np.isnan(no).all() and np.isnan(failed).all()  # without a step length
    colours = {tuple(each.get_facecolors()[0]) for each in ax.collections}
    assert len(colours) == 3
    assert [text.get_text() for text in ax.get_legend().get_texts()] == list(drawn)


def test_a_picture_by_a_number_has_its_colours_and_a_bar(tmp_path):
    ax = pictured(tmp_path, "multiplier")
    points, failed = ax.collections
    np.testing.assert_allclose(points.get_offsets().compressed(), [0.01, 1.0, 0.04, 2.0])
    np.testing.assert_allclose(points.get_array(), [0.5, -0.25, 1.0])
    assert failed.get_offsets().mask.all()
    assert failed.get_label() == "failed: 1"
    assert ax.get_xlabel() == label("slope") != ax.get_ylabel() == "step length / l"


@pytest.mark.parametrize("by", ["step_length", "slope", "multiplier"])
def test_a_bar_of_colours_has_the_label_and_the_unit_of_its_column(by, tmp_path):
    found = written(tmp_path / "out", FOUR, FOUND)
    ax = found.plot(x="slope", y="multiplier", by=by)
    points, _ = ax.collections
    _, bar = ax.figure.axes
    assert bar.get_ylabel() == label(by)
    values = np.delete(found.columns()[by].astype(float), 1) / (0.81 if by == "step_length" else 1)
    np.testing.assert_allclose(np.ma.filled(points.get_array(), np.nan), values)


def test_a_failed_task_is_drawn_where_its_parameters_are(tmp_path):
    found = written(tmp_path / "out", FOUR, FOUND)
    points, failed = found.plot(x="seconds", y="slope", by="multiplier").collections
    np.testing.assert_allclose(points.get_offsets(), [(0.0, 0.01), (0.5, 0.03), (0.75, 0.04)])
    np.testing.assert_allclose(failed.get_offsets(), [(0.25, 0.02)])


def test_a_picture_goes_on_the_axes_that_are_given_or_in_a_new_figure(tmp_path):
    pyplot = pytest.importorskip("matplotlib.pyplot")
    _, (first, second) = pyplot.subplots(1, 2)
    found = written(tmp_path / "out", FOUR, FOUND)
    assert found.plot(first, x="slope", y="step_length", by="found") is first
    assert len(first.collections) == 3 and not second.collections
    own = [found.plot(x="slope", y="step_length", by="found").figure.number for _ in range(2)]
    assert len({first.figure.number, *own}) == 3
    for name in ("x", "y", "by"):
        asked = {"x": "slope", "y": "step_length", "by": "found"} | {name: "slop"}
        with pytest.raises(ValueError, match=r"slop \(slope\?\)"):
            found.plot(**asked)


UNITS = {
    "thigh_length": (0, 1, 0), "thigh_offset": (0, 1, 0), "thigh_mass": (1, 0, 0),
    "thigh_gyration": (0, 1, 0), "thigh_com": (0, 1, 0), "shank_length": (0, 1, 0),
    "shank_offset": (0, 1, 0), "shank_mass": (1, 0, 0), "shank_gyration": (0, 1, 0),
    "shank_com": (0, 1, 0), "foot_radius": (0, 1, 0), "foot_angle": (0, 0, 0),
    "hip_mass": (1, 0, 0), "hip_stiffness": (1, 2, -2), "hip_friction": (1, 2, -1),
    "knee_stiffness": (1, 2, -2), "knees": (0, 0, 0), "gravity": (0, 0, 0),
    "hip_torque": (1, 2, -2), "ankle_torque": (1, 2, -2), "push_off": (1, 1, -1),
}  # fmt: skip
"""Powers of mass, length and time in the unit of a parameter; gravity keeps its own."""


def test_every_parameter_and_actuation_has_a_unit_here():
    parameters = [field.name for field in fields(gpw.Walker)]
    assert [*UNITS] == [*parameters, *gpw.Actuation._fields]


@pytest.mark.parametrize("name", UNITS)
@pytest.mark.parametrize("analysis", ["gait", "evaluation"])
def test_a_column_of_parameters_is_divided_by_each_walker_s_own_unit(name, analysis):
    walkers = [LAB, replace(LAB, hip_mass=2.0, gravity=1.62), replace(LAB, thigh_length=0.7)]
    if analysis == "evaluation" and name in gpw.Actuation._fields:
        return
    given = [{"walker": each, "slope": 0.03} for each in walkers]
    if analysis == "evaluation":
        given = [{**each, "controller": "level-ppo"} for each in given]
    powers = UNITS[name]
    expected = [
        each.total_mass ** powers[0] * each.leg_length ** powers[1] * each.time_unit ** powers[2]
        for each in walkers
    ]
    np.testing.assert_allclose(sizes(name, analysis, given), expected, rtol=1e-12)


def test_a_row_of_an_invalid_walker_has_no_unit_and_others_keep_theirs():
    given = [{"walker": "lab", "foot_radius": radius, "slope": 0.03} for radius in (0.1, 9.0, 0.2)]
    np.testing.assert_allclose(sizes("foot_radius", "gait", given), [0.81, np.nan, 0.81])


@pytest.mark.parametrize(
    ("name", "analysis", "own"),
    [("step_length", "gait", True), ("step_period", "gait", True),
     ("step_length", "optimal", False), ("push_off", "optimal", False),
     ("step_up", "robustness", False),
     ("push_forward", "robustness", False)],
)  # fmt: skip
def test_results_in_a_walker_s_own_units_are_those_of_gaits_alone(name, analysis, own):
    given = {"gait": {"walker": LARGE, "slope": 0.01},
             "optimal": {"walker": LARGE, "slope": 0.01, "speed": 0.1},
             "robustness": {"walker": LARGE, "slope": 0.01}}[analysis]  # fmt: skip
    (size,) = sizes(name, analysis, [given])
    assert size == (pytest.approx({"step_length": 4.0, "step_period": 0.5}[name]) if own else 1.0)


@pytest.mark.parametrize("on", [{"controller": "lab-ppo"}, {"scene": "lab", "controller": "lqr"}])
def test_the_walker_of_a_controller_or_of_a_scene_gives_the_units_of_a_gait(on):
    found = [sizes(name, "gait", [on])[0] for name in ("step_length", "step_period")]
    assert found == [LAB.leg_length, LAB.time_unit]


# Descriptions.

GAIT = {"analysis": "gait", "over": {"slope": [0.02, 0.03]}}


@pytest.mark.parametrize("name", [*RESERVED])
def test_no_parameter_takes_a_column_of_every_sweep_but_the_seed(name):
    for changes in ({"over": {name: [1, 2]}}, {"given": {name: 1}}):
        if name == "seed":
            assert {each["seed"] for each in Description.of(GAIT | changes).tasks} >= {1}
        else:
            with pytest.raises(ValueError, match=f"{name} is a column of every sweep"):
                Description.of(GAIT | changes)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"time_out": 0.0}, "time_out must be .*above 0"),
        ({"time_out": math.nan}, "time_out must be"),
        ({"time_out": "1"}, "time_out must be"),
        ({"seed": -1}, "seed must be a whole number"),
        ({"seed": 0.5}, "seed must be a whole number"),
        ({"how": "sobol", "samples": 0}, "samples must be"),
        ({"how": "sobol", "samples": 2.5}, "samples must be"),
        ({"how": "grid", "samples": 4}, "samples is the size"),
        ({"how": "list", "samples": 4}, "samples is the size"),
        ({"how": "latin-hypercube", "samples": None}, "samples is the size"),
        ({"how": "sobol", "samples": 4, "over": {"slope": [0.02, 0.02]}}, r"\[low, high\]"),
        ({"how": "sobol", "samples": 4, "over": {"slope": [0.0, 0.1, 0.2]}}, r"\[low, high\]"),
        ({"over": {"slope": []}}, "over a list of values"),
        ({"over": {"slope": "0.1"}}, "over a list of values"),
        ({"over": [0.1]}, "over must name values"),
        ({"given": [0.1]}, "given must name values"),
        ({"analysis": 3}, "analysis must be a name, not 3"),
        ({"sampels": 3}, "sampels \\(samples\\?\\)"),
        ({"over": {"slope": 0.1}}, "over a list of values"),
        ({"over": {}}, "over must name what varies"),
        ({"how": "random"}, "how must be one of"),
        ({"how": "sobol"}, "samples is the size"),
        ({"how": "sobol", "samples": 2, "over": {"slope": [2, 1]}}, r"\[low, high\]"),
        ({"how": "list", "over": {"a": [1], "b": [1, 2]}}, "a has 1, b has 2"),
        ({"given": {"slope": 2}}, "not in both"),
    ],
)
def test_an_entry_that_no_sweep_can_have_is_refused_by_its_name(changes, said):
    with pytest.raises(ValueError, match=said):
        Description.of(GAIT | changes)
    with pytest.raises(ValueError, match="needs an analysis, and `over`"):
        Description.of({"analysis": "gait"})


@pytest.mark.parametrize(
    "changes",
    [{"analysis": "family"}, {"over": {"slope": [0.03, 0.02]}}, {"how": "list"},
     {"given": {"kind": "short"}}, {"seed": 1}, {"time_out": 2.0},
     {"how": "sobol", "samples": 2}],
)  # fmt: skip
def test_a_digest_knows_each_entry(changes):
    one, other = Description.of(GAIT), Description.of(GAIT | changes)
    assert len(one.digest) == 16 and one.digest != other.digest
    content = dict(reversed(other.content.items()))
    assert Description.of(content).digest == other.digest


def test_values_of_an_array_are_those_of_a_list():
    arrays = {"slope": np.array([0.02, 0.03]), "period": np.arange(1, 3)}
    lists = {name: values.tolist() for name, values in arrays.items()}
    one, other = (Description(analysis="gait", over=over) for over in (arrays, lists))
    assert one.tasks == other.tasks and one.digest == other.digest
    assert all(type(each["period"]) is int for each in one.tasks)


@pytest.mark.parametrize("where", ["over", "given"])
def test_a_walker_s_file_is_kept_by_its_content(where, tmp_path):
    file = tmp_path / "mine.json"
    file.write_text('{"preset": "lab", "foot_radius": 0.21}')
    entry = {"walker": [str(file)] if where == "over" else str(file)}
    content = GAIT | {where: {**GAIT.get(where, {}), **entry}}
    found = Description.of(content)
    file.unlink()
    assert all(gpw.models.walkers.as_walker(each["walker"]) == replace(LAB, foot_radius=0.21)
               for each in found.tasks)  # fmt: skip


# Running.


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (np.float32(0.5), 0.5), (np.int64(3), 3), (np.bool_(True), True), (np.array([2.0]), 2.0),
        (2**63 - 1, 2**63 - 1), (-(2**63), -(2**63)), ("word", "word"),
    ],
)  # fmt: skip
def test_a_result_becomes_a_plain_value(value, expected):
    for row in (flat(value), flat({"value": value})):
        assert row == {"value": expected} and type(row["value"]) is type(expected)


@pytest.mark.parametrize("value", [2**63, -(2**63) - 1, None, [1], 1j, {}])
def test_a_result_that_no_column_holds_is_refused_by_its_name(value):
    with pytest.raises(TypeError, match=r"^y must"):
        flat({"x": 1, "y": value})


def test_tasks_are_sent_by_the_second_and_by_fair_shares():
    pace, waiting = Pace(2), deque((n, {}) for n in range(100))
    assert [n for n, _ in pace.take(waiting)] == [0]  # nothing is known yet
    for seconds in (0.1, 0.3):
        pace.note(TaskOutcome(0, DONE, None, seconds, {}))
    assert [n for n, _ in pace.take(waiting)] == [1, 2, 3, 4, 5]  # of 0.2 s each
    pace.note(TaskOutcome(0, DONE, None, 99.6, {}))
    assert [n for n, _ in pace.take(waiting)] == [6]
    fast, waiting = Pace(2), deque((n, {}) for n in range(10_000))
    fast.note(TaskOutcome(0, DONE, None, 0.0, {}))
    taken = [len(fast.take(waiting)) for _ in range(4)]
    assert taken == [2000, 2000, 1500, 1125]  # at most 2000, a quarter of what waits
    assert len(fast.take(deque([(0, {})]))) == 1


class Alone:
    """Does tasks in this process; the second fails."""

    closed = 0

    def outcomes(self, tasks):
        """Yield the outcome of each task."""
        for number, given in tasks:
            failed = number == 1
            found = {} if failed else {"y": given["x"]}
            yield TaskOutcome(number, FAILED if failed else DONE, None, 0.5, found)

    def close(self):
        """Count the calls."""
        self.closed += 1


def test_progress_counts_tasks_failures_and_the_time_that_is_left(tmp_path, monkeypatch):
    description = Description(analysis="a:b", over={"x": [5, 6, 7, 8]})
    now, notes, shown = iter([0.0, 2.0, 4.0, 6.0, 8.0]), [], []

    class Progress:
        def __enter__(self):
            return lambda note="": notes.append(note)

        def __exit__(self, *raised):
            pass

    def progress(what, total):
        shown.append((what, total))
        return Progress()

    kept, alone = Store(tmp_path / "out", description, "1"), Alone()
    monkeypatch.setattr(run, "progress", progress)
    monkeypatch.setattr(run.time, "monotonic", lambda: next(now))
    monkeypatch.setattr(store, "_SECONDS", math.inf)
    monkeypatch.setattr(store, "time", type("Clock", (), {"monotonic": staticmethod(lambda: 0.0)}))
    run._work(alone, kept, [*enumerate(description.tasks)])
    kept.flush(last=True)
    kept.close()
    assert shown == [("tasks", 4)] and alone.closed == 1
    assert notes == [f"0.5/s, {failed} failed, {left} s left"
                     for failed, left in ((0, 6), (1, 4), (1, 2), (1, 0))]  # fmt: skip
    columns = run.SweepResult(tmp_path / "out", 4, 1).columns()
    assert columns["x"].tolist() == [5, 6, 7, 8] and set(columns["seconds"]) == {0.5}
    np.testing.assert_array_equal(columns["y"], [5, np.nan, 7, 8])


def test_a_sweep_starts_no_more_workers_than_tasks_and_none_without_tasks(odd, monkeypatch):
    asked = []

    def made(analysis, count, time_out):
        asked.append((analysis, count, time_out))
        return Alone()

    monkeypatch.setattr(run, "Workers", made)
    for count in (2, 8):
        found = odd_sweep("square", odd / str(count), [1, 2, 3], time_out=2.5, workers=count)
        assert (found.tasks, found.failures, found.trust) == (3, 1, True)
    assert asked == [("odd_tasks:square", count, 2.5) for count in (2, 3)]
    odd_sweep("square", odd / "2", [1, 2, 3], time_out=2.5, workers=2)
    assert len(asked) == 2  # nothing is left
    odd_sweep("square", odd / "2", [1, 2, 3], time_out=2.5, workers=2, retry=True)
    assert asked[2:] == [("odd_tasks:square", 1, 2.5)]
    for wrong in ({"workers": 0}, {"workers": 1.5}, {"retry": 1}, {"branch": "no"}):
        with pytest.raises(ValueError, match=f"{next(iter(wrong))} must be"):
            odd_sweep("square", odd / "2", [1, 2, 3], **wrong)


def test_invalid_arguments_and_versions_leave_no_folder(tmp_path):
    for over in ({"slop": [0.02]}, {"slope": [0.02], "walker": ["nobody"]}):
        with pytest.raises(ValueError, match=r"slop \(slope\?\)|nobody"):
            gpw.sweep("gait", tmp_path / "out", over=over, given={"kind": "long"})
    assert not (tmp_path / "out").exists()


def test_a_sweep_that_is_stopped_reports_the_tasks_that_are_kept(odd, monkeypatch, capsys):
    class Stopped(Alone):
        def outcomes(self, tasks):
            yield from [*super().outcomes(tasks)][:2]
            raise KeyboardInterrupt

    monkeypatch.setattr(run, "Workers", lambda *_: Stopped())
    with pytest.raises(KeyboardInterrupt):
        odd_sweep("square", odd / "out", [1, 2, 3])
    assert f"2 of 3 tasks are kept in {odd / 'out'}; repeat" in capsys.readouterr().err
    assert store.read_columns(odd / "out")["task"].tolist() == [0, 1]


def test_a_task_that_raises_or_exits_reports_the_kind_and_the_words(odd):
    (odd / "odd_raises.py").write_text(
        "def raises(x):\n    if x: raise SystemExit('bye')\n    raise KeyError('k')\n"
    )
    for x, said in ((0, "KeyError: 'k'"), (1, "SystemExit: bye")):
        found = workers._done("odd_raises:raises", 3 + x, {"x": x, "seed": 4})
        assert (found.task, found.status, found.error) == (3 + x, FAILED, said)
        assert found.results == {} and 0.0 <= found.seconds < 10.0
    done = workers._done("odd_tasks:square", 2, {"x": 3, "seed": 4})
    assert (done.task, done.status, done.error) == (2, DONE, None)
    assert done.results == {"square": 9, "odd": True, "word": "3 4"}


def test_a_pool_waits_to_the_first_time_out_and_never_longer_than_a_report(monkeypatch):
    class Still:
        def __init__(self, since, tasks, ready=True):
            self.since, self.tasks, self.ready = since, tasks, ready
            self.pipe = type("Pipe", (), {"poll": staticmethod(lambda: False)})

    monkeypatch.setattr(workers.time, "monotonic", lambda: 103.0)
    pool = Workers("gait", 0, 4.0)
    old, idle, new = Still(100.0, [(1, {})]), Still(0.0, []), Still(102.5, [(2, {})])
    compiles = Still(0.0, [(3, {})], ready=False)
    pool._pool = [new, old, idle, compiles]
    assert pool._patience() == pytest.approx(1.0)
    assert [pool._overdue(each) for each in pool._pool] == [False] * 4
    monkeypatch.setattr(workers.time, "monotonic", lambda: 104.0)
    assert pool._patience() == 0.0
    assert [pool._overdue(each) for each in pool._pool] == [False, True, False, False]
    pool._time_out = None
    assert pool._patience() == 5.0 and not pool._overdue(old)


def test_no_process_of_a_closed_pool_works_on():
    pool = Workers("gait", 2, None)
    processes = [each.process for each in pool._pool]
    assert all(each.is_alive() for each in processes)
    pool.close()
    for each in processes:
        each.join(20.0)
    assert not any(each.is_alive() for each in processes)
