"""What a command prints for programs is what Python returns under the same options."""

import importlib
import json
import shlex
from contextlib import nullcontext
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import gym_passive_walker as gpw
from gym_passive_walker.apps.cli import main
from gym_passive_walker.apps.cli.report import Report, listing, plain, record, table
from gym_passive_walker.gaits.scenes.scene import make_scene
from gym_passive_walker.models.equations.hybrid import Outcome

MINE = {"preset": "C", "hip_mass": 0.5}
HEAVY = replace(gpw.WALKERS["C"], hip_mass=0.5)
GAIT = ("kind", "period", "stance_angle", "state", "step_period", "step_length", "speed")
GAIT += ("froude_speed", "cost_of_transport", "multipliers", "stable")


@pytest.fixture
def answer(capsys, tmp_path, monkeypatch):
    """Data and text of a command, in a folder with a walker's file."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.json").write_text(json.dumps(MINE))

    def run(words):
        assert main([*shlex.split(words), "--json"]) == 0
        data = json.loads(capsys.readouterr().out)
        assert main(shlex.split(words)) == 0
        return data, capsys.readouterr().out

    return run


def attributes(found, names):
    return {name: plain(getattr(found, name)) for name in names}


@pytest.mark.parametrize(
    ("words", "walker", "slope", "drive", "period"),
    [
        ("C 0.03", "C", 0.03, {}, 1),
        ("mine.json 0.03 --tune", gpw.tune(HEAVY), 0.03, {}, 1),
        ("E 0.01 --torque 0.001 --push-off 0.002", "E", 0.01,
         {"hip_torque": 0.001, "push_off": 0.002}, 1),
        ("D 0.016 --period 2", "D", 0.016, {}, 2),
    ],
)  # fmt: skip
def test_gaits_are_those_that_python_finds(words, walker, slope, drive, period, answer):
    data, text = answer(f"gait {words}")
    actuated = gpw.stride_map(walker, slope, controller=gpw.Actuation(**drive) if drive else None)
    gaits = gpw.find_gaits(actuated, period=period)
    assert data == [attributes(gait, GAIT) for gait in gaits]
    assert len(gaits) == (1 if period > 1 else 2)
    parts = text.strip("\n").split("\n\n")
    assert len(parts) == len(gaits)
    for gait, part in zip(gaits, parts, strict=True):
        title = part.splitlines()[0]
        assert title.startswith(f"{gait.kind}-step gait of ")
        assert title.endswith(f" at slope {slope:g} rad, period {gait.period}")
        assert " under " not in title
        assert f"  {gait.stance_angle:.8g}\n" in part


def test_a_gait_under_a_controller_is_called_by_the_controller_s_name(answer):
    data, text = answer("gait C 0.03 --controller level-ppo")
    gait = gpw.find_gait(gpw.stride_map("C", 0.03, controller="level-ppo"))
    assert data == [attributes(gait, GAIT)]
    assert " under level-ppo at slope 0.03 rad" in text.splitlines()[0]


@pytest.mark.parametrize(
    ("words", "kind", "drive", "reasons"),
    [
        ("D 0.013 0.016", "long", {}, 2),
        ("D 0.013 0.016 --kind short", "short", {}, 2),
        ("D 0.008 0.009 --ankle-torque 0.0005", "long", {"ankle_torque": 0.0005}, 2),
    ],
)
def test_a_family_is_that_of_python(words, kind, drive, reasons, answer):
    data, text = answer(f"family {words}")
    low, high = map(float, words.split()[1:3])
    actuated = gpw.stride_map("D", controller=gpw.Actuation(**drive) if drive else None)
    family = gpw.gait_family(actuated, low, high, kind)
    for name in ("slope", "stance_angle", "step_period", "step_length", "speed", "froude_speed"):
        assert data["gaits"][name] == getattr(family, name).tolist(), name
    assert data["gaits"]["stable"] == family.stable.tolist()
    assert data["folds"] == list(family.folds)
    assert data["period_doublings"] == list(family.period_doublings)
    ends = [(end["value"], end["reason"]) if isinstance(end, dict) else tuple(end)
            for end in data["ends"]]  # fmt: skip
    assert ends == [(end.value, end.reason) for end in family.ends] and len(ends) == reasons
    assert all(end.reason in text for end in family.ends)


def test_a_bifurcation_diagram_is_that_of_python(answer):
    data, text = answer("bifurcation D 0.015 0.03 --slopes 4 --n-transient 120 --n-recorded 36")
    found = gpw.bifurcation_diagram(
        "D", np.linspace(0.015, 0.03, 4), n_transient=120, n_recorded=36
    )
    assert data == attributes(found, ("slope", "period", "walks", "stance_angle"))
    rows = text.splitlines()[1:]
    assert ["a fall" in row for row in rows] == [not on for on in found.walks]
    assert {*found.walks.tolist()} == {True, False}


def test_walkers_that_repeat_no_stride_have_no_period(answer):
    _, text = answer("bifurcation D 0.0185 0.0186 --slopes 1 --n-transient 40 --n-recorded 34")
    found = gpw.bifurcation_diagram("D", [0.0185], n_transient=40, n_recorded=34)
    assert found.walks[0] and not found.period[0]
    assert text.splitlines()[1].endswith("no period up to 32")


def test_a_basin_is_that_of_python_and_its_table_counts_each_end(answer):
    data, text = answer("basin D 0.009 --resolution 14 --strides 40")
    found = gpw.basin_of_attraction("D", 0.009, resolution=14, strides=40)
    names = ("slope", "stance_angle", "stance_rate", "settled", "strides")
    assert {name: data[name] for name in names} == attributes(found, names)
    assert data["gaits"] == [attributes(gait, GAIT) for gait in found.gaits]
    title, _, *rows = text.splitlines()
    angles, rates = found.stance_angle, found.stance_rate
    assert title == (
        f"stance angles {angles.min():.4g} to {angles.max():.4g} rad, "
        f"stance rates {rates.min():.4g} to {rates.max():.4g} rad/s"
    )
    ends = {"a fall": -2, "no gait yet": -1}
    fell = np.sum(found.settled == min(found.settled.min(), -1))
    counts = {}
    for row in rows:
        name, count, share = row.rsplit(maxsplit=2)
        counts[name] = int(count)
        assert float(share) == pytest.approx(int(count) / 14**2, rel=1e-5)
    assert sum(counts.values()) == 14**2 and len(counts) <= len(ends) + len(found.gaits)
    assert counts["a fall"] == fell == np.sum(~found.walks)
    for index, gait in enumerate(found.gaits):
        if np.any(found.settled == index):
            name = f"the {gait.kind}-step gait, {gait.stance_angle:.6g} rad"
            assert counts[name] == np.sum(found.settled == index)
    assert list(counts.values()) == sorted(counts.values(), reverse=True)


def test_a_gait_of_two_strides_in_a_basin_is_called_by_its_period(answer):
    data, text = answer("basin D 0.016 --resolution 12 --strides 200")
    (gait,) = data["gaits"]
    assert gait["period"] == 2 and 0 in np.ravel(data["settled"])
    assert f"the long-step gait, {gait['stance_angle']:.6g} rad, period 2  " in text


@pytest.mark.parametrize(("kind", "friction"), [("long", 0.8), ("short", 0.3)])
def test_a_check_is_that_of_python(kind, friction, answer):
    data, text = answer(f"check C 0.03 --kind {kind} --friction {friction}")
    check = gpw.reality_check(gpw.find_gait("C", 0.03, kind), friction=friction)
    assert data == plain({"holds": check.holds, "passed": check.passed, "found": check})
    assert text == f"{check}\n"


def test_robustness_is_that_of_python(answer):
    data, text = answer("robustness D --slope 0.009 --walkers 30 --strides 30 --roughness 2e-4 "
                        "--seed 4")  # fmt: skip
    found = gpw.robustness("D", slope=0.009, walkers=30, strides=30, roughness=2e-4, seed=4)
    names = ("slope", "step_length", "step_period", "roughness", "sensitivity", "step_up")
    names += ("step_down", "initial_error", "recovered", "recovered_error", "recovery")
    assert {name: data[name] for name in names} == attributes(found, names)
    lasting = found.first_passage
    assert data["first_passage"] == plain(lasting.mean)
    assert data["first_passage_error"] == plain(lasting.error)
    assert data["first_passage_interval"] == plain(lasting.interval)
    assert (data["falls"], data["strides"]) == (lasting.falls, lasting.strides) and lasting.falls
    assert data["push_phases"] == list(found.columns()["push_phases"])
    for name in ("push_forward", "push_backward"):
        assert data[name] == plain(getattr(found, name))
    facts, pushes = text.split("\n\n")
    for fact, said in found.facts().items():
        assert said in facts, fact
    head, *rows = pushes.splitlines()
    assert head.split("  ")[0] == "push at (periods)"
    assert head.index("forward") < head.index("backward")
    values = [[float(x.replace("-", "nan") if x == "-" else x) for x in row.split()]
              for row in rows]  # fmt: skip
    expected = [*zip(*found.columns().values(), strict=True)]
    np.testing.assert_allclose(values, expected, rtol=1e-5)


def test_a_gauntlet_is_that_of_python(answer):
    data, text = answer("gauntlet steep-ppo --walkers 3")
    found = gpw.gauntlet("steep-ppo", walkers=3)
    low, high = found.score_interval
    assert (data["controller"], data["score"]) == (found.controller_name, plain(found.score))
    assert (data["low"], data["high"]) == (plain(low), plain(high)) and data["low"] < data["high"]
    for name, values in found.columns().items():
        assert [row[name] for row in data["tests"]] == plain(values), name
    assert text == f"{found}\n"


@pytest.mark.parametrize("words", ["", "--scene level --slope 0.01 --walker B --seed 3"])
def test_an_evaluation_is_that_of_python(words, answer):
    data, text = answer(f"evaluate steep-ppo --episodes 2 {words}")
    changes = {"scene": "level", "slope": 0.01, "walker": "B"} if words else {"scene": "steep"}
    found = gpw.evaluate("steep-ppo", make_scene(**changes), episodes=2, seed=3 if words else 1000)
    rows = [
        row | {"least_cost": found.least_cost[name]}
        for name, made in found.walks.items()
        for row in made.rows(name, digits=None)
    ]
    assert data == plain(rows) and text == f"{found}\n"
    assert [row["agent"] for row in rows][::2] == [*found.walks]
    title = text.splitlines()[0]
    assert title.startswith("steep-ppo, ") and title.endswith("; 2 episodes")
    if words:
        assert "slope 0.01 rad" in title


@pytest.mark.parametrize("words", ["", "--kind short", "--push-off 0.02", "--torque 0.05"])
def test_a_walk_starts_on_the_passive_gait_of_its_kind(words, answer):
    (first, *_), _ = answer(f"simulate C 0.03 --strides 2 {words}")
    gait = gpw.find_gait("C", 0.03, "short" if "short" in words else "long")
    assert first["stance_angle"] == gait.stance_angle
    push = 0.02 * ("push" in words)
    torque = 0.05 * ("torque" in words)
    held = gpw.stride("C", 0.03, gait.state, push_off=push, hip_torque=torque)
    for name in ("duration", "step_length", "kneestrike_time", "kneestrike_loss"):
        assert first[name] == pytest.approx(getattr(held, name), rel=1e-12), name
    assert first["heelstrike_loss"] == pytest.approx(held.heelstrike_loss, rel=1e-12)
    assert first["hip_work"] == pytest.approx(held.hip_work, abs=1e-15)


def test_the_strides_of_a_walk_are_counted_from_1_to_the_last(answer):
    rows, text = answer("simulate lab 0.036 --strides 3")
    assert [row["stride"] for row in rows] == [1, 2, 3] and len(text.splitlines()) == 4
    falls, _ = answer("simulate lab 0.036 --strides 9 --terrain stairs:rise=0.02")
    assert [row["outcome"] == "HEELSTRIKE" for row in falls][:-1] == [True] * (len(falls) - 1)
    assert falls[-1]["outcome"] != "HEELSTRIKE" and len(falls) < 9


@pytest.mark.parametrize("samples", [2, 17])
def test_a_walk_s_file_has_the_samples_that_are_asked_for(samples, answer, tmp_path):
    rows, text = answer(f"simulate C 0.036 --strides 3 --samples {samples} --out w.NPZ")
    start = gpw.find_gait("C", 0.036).state
    walk = gpw.simulate("C", 0.036, start, 3, samples=samples)
    with np.load(tmp_path / "w.NPZ") as arrays:
        for name, values in walk.columns().items():
            np.testing.assert_array_equal(arrays[name], values, err_msg=name)
        assert list(arrays) == list(walk.columns()) and len(arrays["time"]) == 3 * samples
    assert text.endswith("\n\nsaved w.NPZ\n") and len(rows) == 3


def test_a_sweep_reports_where_its_rows_are(answer, tmp_path):
    pytest.importorskip("pyarrow")
    content = {"analysis": "gait", "given": {"walker": "lab"}, "over": {"slope": [0.036, 9.0]}}
    (tmp_path / "two.json").write_text(json.dumps(content))
    data, text = answer("sweep two.json --out there --workers 1")
    assert data == {"tasks": 2, "failures": 1, "folder": "there", "rows": "there/rows"}
    assert text.startswith("swept two.json\n") and "failures  1\n" in text
    assert [*(tmp_path / "there" / "rows").iterdir()]


def test_the_warm_up_compiles_each_piece_once_and_counts_them(monkeypatch, capsys):
    warmup = importlib.import_module("gym_passive_walker.apps.cli.warmup")
    done, shown = [], []

    class Counted:
        def __init__(self, what, total):
            shown.append((what, total))

        def __enter__(self):
            return lambda: shown.append(len(done))

        def __exit__(self, *_):
            pass

    now = iter([10.0, 12.25, 20.0, 21.0])
    monkeypatch.setattr(warmup, "pieces", lambda: iter("abc"))
    monkeypatch.setattr(warmup, "compile_piece", done.append)
    monkeypatch.setattr(
        warmup, "ProcessPoolExecutor", lambda: nullcontext(SimpleNamespace(map=map))
    )
    monkeypatch.setattr(warmup, "progress", Counted)
    monkeypatch.setattr(warmup.time, "monotonic", lambda: next(now))
    assert main(["warmup"]) == 0
    assert capsys.readouterr().out == "everything is compiled, after 2.2 s\n"
    assert done == [0, 1, 2] and shown == [("pieces compiled", 3), 1, 2, 3]
    assert main(["warmup", "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == {"seconds": 1.0}


def test_a_report_writes_each_kind_of_value():
    rows = [
        {"name": "a", "slope": 0.0123456789, "stable": True, "outcome": Outcome.HEELSTRIKE},
        {"name": "longer", "slope": -1.0, "stable": np.False_, "outcome": Outcome.FELL_BACKWARD},
    ]
    assert table(rows).splitlines() == [
        "name    slope (rad)  stable      ends with",
        "a         0.0123457     yes     heelstrike",
        "longer           -1      no  fell backward",
    ]
    said = listing("title", {
        "speed": 0.123456789012, "step_length": np.nan, "ratios": (1.0, 2.5), "none": (),
        "root": 0.25 - 0.5j, "real": 2.0 + 0.0j, "word": "x", "on": False,
    })  # fmt: skip
    lines = [line.rsplit("  ", 1) for line in said.splitlines()[1:]]
    assert said.startswith("title\n  speed (m/s)") and len({len(one) for one, _ in lines}) == 1
    assert [value for _, value in lines] == [
        "0.12345679", "-", "1, 2.5", "none", "0.25-0.5i", "2", "x", "no",
    ]  # fmt: skip


def test_a_report_is_plain_json():
    stride = gpw.stride("lab", 0.036, gpw.find_gait("lab", 0.036).state)
    assert plain(stride) == {name: plain(value) for name, value in stride._asdict().items()}
    assert plain(gpw.WALKERS["C"]) == vars(gpw.WALKERS["C"])
    found = plain({1: 0.5 + 2.0j, "e": Outcome.HEELSTRIKE, "n": None, "i": np.int64(3),
                   "b": np.array([True, False]), "x": {2.0},
                   "z": np.array([1j, np.nan])})  # fmt: skip
    assert found == {"1": [0.5, 2.0], "e": "HEELSTRIKE", "n": None, "i": 3, "b": [True, False],
                     "x": [2.0], "z": [[0.0, 1.0], [None, 0.0]]}  # fmt: skip
    assert type(found["i"]) is int and found["b"][0] is True
    assert record(stride, ("duration", "outcome")) == {
        "duration": stride.duration, "outcome": stride.outcome,
    }  # fmt: skip
    assert list(record(stride, ("outcome", "duration"))) == ["outcome", "duration"]
    assert Report("a", 1).files == {}


def test_export_writes_a_network_of_the_sizes_that_it_reports(answer, tmp_path):
    onnx = pytest.importorskip("onnx")
    data, text = answer("export steep-ppo there.onnx")
    graph = onnx.load(tmp_path / "there.onnx").graph
    (given,), (found,) = graph.input, graph.output
    sizes = [each.type.tensor_type.shape.dim[1].dim_value for each in (given, found)]
    assert [data["observation"], data["action"]] == sizes and sizes[0] != sizes[1]
    assert (data["policy"], data["algorithm"]) == ("steep-ppo", "PPO")
    assert f"observation  float32 (n, {sizes[0]})\n" in text and "saved there.onnx" in text


@pytest.mark.parametrize(
    ("words", "status"),
    [
        ("gait lab -0.01", 1),
        ("check lab -0.01", 1),
        ("simulate lab -0.01", 1),
        ("gait lab 0.036 --period 0", 2),
        ("gait C 0.0 --controller level-ppo --torque 0.1", 2),
        ("robustness lab", 2),
        ("export lqr p.onnx", 2),
        ("export level-ppo p.txt", 2),
        ("export level-ppo p.onnx --slope 0.02", 2),
        ("export level-ppo p.onnx --timestep 0.001", 2),
        ("export level-ppo p.onnx --unit-length 1", 2),
        ("export level-ppo p.onnx --unit-mass 1", 2),
        ("export lab p.xml --trust", 2),
        ("export lab p.urdf --timestep 0.001", 2),
        ("scene nowhere", 2),
        ("walkers", 0),
        ("", 0),
    ],
)
def test_the_status_says_how_a_command_ended(words, status, capsys):
    try:
        assert main(shlex.split(words)) == status
    except SystemExit as end:
        assert end.code == status
    said = capsys.readouterr()
    last = "".join(said.err.splitlines()[-1:])  # notices of long work come before it
    assert bool(said.out) == (status == 0) and last.startswith("error: ") == (status > 0)
