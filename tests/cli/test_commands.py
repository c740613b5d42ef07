"""Output of `passive-walker` for people and for programs.

python -m tests.cli.test_commands     Write what the examples of the help print to `examples.json`.
"""

import csv
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import textwrap
from contextlib import chdir, redirect_stdout
from dataclasses import asdict, fields, replace
from importlib.util import find_spec
from io import StringIO
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest

import gym_passive_walker as gpw
from gym_passive_walker.apps.cli import COMMANDS, main, parser
from gym_passive_walker.apps.cli.arguments import A_WALKER
from gym_passive_walker.apps.cli.report import plain
from gym_passive_walker.apps.cli.sweeps import sweep
from gym_passive_walker.apps.sweeps.description import Description
from gym_passive_walker.envs.evaluation.walks import TIME_LIMIT
from gym_passive_walker.envs.policies import policy_folder
from gym_passive_walker.models.walkers import ABOUT
from tests.numbers import alike

NAMES = [command.__name__ for command in COMMANDS]


@pytest.fixture
def reported(capsys):
    """Output of a command as JSON."""

    def run(*words):
        assert main([*map(str, words), "--json"]) == 0
        return json.loads(capsys.readouterr().out)

    return run


@pytest.fixture
def mine(tmp_path, monkeypatch):
    """A folder with a file of a walker, the laboratory's at half its size, and one more."""
    monkeypatch.chdir(tmp_path)
    lab = asdict(gpw.WALKERS["lab"])
    for name in lab:
        if name.endswith(("length", "offset", "gyration", "com", "radius")):
            lab[name] /= 2.0
    for name in ("mine.json", "heavier.json"):
        (tmp_path / name).write_text(json.dumps(lab))
    return tmp_path / "mine.json"


def examples(command):
    """Examples in a command's help, a list of words each."""
    lines = [line.strip() for line in command.__doc__.splitlines()]
    return [shlex.split(line)[1:] for line in lines if line.startswith("passive-walker ")]


def test_without_a_command_there_is_help(capsys):
    assert main([]) == 0
    said = capsys.readouterr().out
    assert all(f"\n    {name}" in said for name in NAMES)


@pytest.mark.parametrize("command", COMMANDS, ids=NAMES)
def test_each_command_has_help_with_examples_that_it_understands(command, mine, capsys):
    with pytest.raises(SystemExit) as end:
        main([command.__name__, "--help"])
    assert end.value.code == 0
    said = capsys.readouterr().out
    assert examples(command)
    for words in examples(command):
        assert words[0] == command.__name__ and shlex.join(words) in said
        parser().parse_args(words)


LINES = [shlex.join(words) for command in COMMANDS for words in examples(command)]
ENDLESS = [line for line in LINES if line.split()[0] == "play" and "--seconds" not in line]
"""Examples that serve a page until Ctrl-C."""
PRINTED = Path(__file__).with_name("examples.json")


def printed(line, folder):
    """Run an example of the help in a folder, and return what it prints."""
    (folder / "mine.json").write_text(re.search(r"{.*}", A_WALKER)[0])
    (folder / "lab.yaml").write_text(described_in_the_help())
    if "my-policy" in line:
        shutil.copytree(policy_folder("level-ppo"), folder / "my-policy")
        gpw.load_policy("level-ppo").to_onnx(folder / "my-policy.onnx")
    with redirect_stdout(StringIO()) as words:
        assert main(shlex.split(line)) == 0
    said = words.getvalue().replace(str(folder), "FOLDER")
    return re.sub(r"compiled, after [\d.]+ s", "compiled, after # s", said)


@pytest.mark.slow
@pytest.mark.parametrize("line", sorted({*LINES} - {*ENDLESS}))
def test_the_examples_of_the_help_print_what_they_did(line, tmp_path, monkeypatch):
    words = shlex.split(line)
    for library in {"sweep": ["pyarrow"], "figures": ["matplotlib"], "strobe": ["matplotlib"],
                    "video": ["moviepy"], "play": ["moviepy"],
                    "compare": ["mujoco"]}.get(words[0], []):  # fmt: skip
        pytest.importorskip(library)
    if "--ray" in words:
        pytest.importorskip("ray")
    if "my-policy" in line:
        pytest.importorskip("onnxruntime")
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    monkeypatch.chdir(tmp_path)
    before, now = json.loads(PRINTED.read_text("utf-8"))[line], printed(line, tmp_path)
    assert now and alike(before, now, 1e-3, 1e-6), f"{before}, now {now}"


def described_in_the_help():
    """The sweep in the help of the command."""
    return textwrap.dedent(sweep.__doc__.partition("lab.yaml contains:\n")[2])


def test_a_word_that_names_no_argument_of_the_command_stays_in_an_error():
    said = parser().by_option("choose one by slope=0.01, or by gravity=1.6")
    assert said == "choose one by slope=0.01, or by gravity=1.6"


def test_the_sweep_of_the_help_is_one():
    yaml = pytest.importorskip("yaml")
    assert len(Description.of(yaml.safe_load(described_in_the_help())).tasks) == 9


@pytest.mark.parametrize(
    ("words", "drive"),
    [
        ("--push-off 0.001", gpw.Actuation(push_off=0.001)),
        ("--torque 0.001", gpw.Actuation(hip_torque=0.001)),
        ("--ankle-torque 0.001", gpw.Actuation(ankle_torque=0.001)),
    ],
)
def test_gaits_and_families_have_the_motors_that_are_asked_for(words, drive, reported):
    gait, *_ = reported("gait", "E", 0.01, *words.split())
    assert (
        gait["stance_angle"]
        == gpw.find_gaits(gpw.stride_map("E", 0.01, controller=drive))[0].stance_angle
    )
    family = reported("family", "E", 0.01, 0.011, *words.split())["gaits"]
    exact = gpw.gait_family(gpw.stride_map("E", controller=drive), 0.01, 0.011)
    assert family["stance_angle"] == exact.stance_angle.tolist()


def test_programs_read_names_as_in_python_and_full_digits(reported, capsys):
    strides = reported("simulate", "D", 0.009, "--strides", 1)
    for name in strides[0].keys() - {"stride", "stance_angle"}:
        assert name in gpw.Stride._fields
    (row, *_) = reported("walkers")
    assert row["tuning_errors"] == gpw.tuning_errors(gpw.WALKERS[row["name"]])._asdict()
    family = reported("family", "D", 0.008, 0.01)["gaits"]
    assert all(hasattr(gpw.GaitFamily, name) or name in family_fields() for name in family)
    (walk, *_) = reported("evaluate", "steep-ppo", "--episodes", 1)
    assert walk["distance"] != round(walk["distance"], 6)


def family_fields():
    return {field.name for field in fields(gpw.GaitFamily)}


def test_a_passive_walker_needs_a_slope_and_the_command_says_by_which_option(capsys):
    assert main(["robustness", "lab"]) == 2
    assert "--slope" in capsys.readouterr().err


@pytest.mark.parametrize(
    "line",
    [
        "robustness D --slope 0.009 --out r.doc",
        "robustness D --slope 0.009 --out a-file/r.png",
        "robustness D --slope 0.009 --out a-folder.png",
        "simulate D 0.009 --out a-file/w.csv",
        "strobe D 0.009 --out a-file/w.png",
        "video D 0.009 --out a-file/w.gif",
        "video D 0.009 --out w.doc",
        "figures 4.6 9.9",
        "figures 4.6 --out a-file",
        "figures 4.6 --out a-file/f.pdf",
        "figures 4.6 --out f.doc",
    ],
)
def test_where_files_go_is_checked_before_anything_is_computed(line, tmp_path, monkeypatch, capsys):
    for library in ("matplotlib", "moviepy"):
        pytest.importorskip(library)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a-file").write_text("")
    (tmp_path / "a-folder.png").mkdir()

    def never(*_, **__):
        pytest.fail("something was computed")

    monkeypatch.setattr("gym_passive_walker.apps.cli.arguments.find_gait", never)
    monkeypatch.setattr("gym_passive_walker.apps.cli.disturbances.tried", never)
    monkeypatch.setattr("gym_passive_walker.pictures.figures.draw", never)
    assert main(line.split()) == 2
    assert "error: " in capsys.readouterr().err


def test_a_table_is_printed_whatever_happens_to_its_picture(monkeypatch, tmp_path, capsys):
    pytest.importorskip("matplotlib")

    def full(*_, **__):
        raise OSError(28, "No space left on device", "r.png")

    monkeypatch.setattr("gym_passive_walker.apps.cli.disturbances.save", full)
    words = f"D --slope 0.009 --walkers 2 --strides 2 --out {tmp_path / 'deep' / 'r.png'}"
    assert main(["robustness", *words.split()]) == 2
    said = capsys.readouterr()
    assert "push at (periods)" in said.out and "No space left" in said.err
    assert (tmp_path / "deep").is_dir()


def test_the_version_is_the_package_s(capsys):
    with pytest.raises(SystemExit) as end:
        main(["--version"])
    assert end.value.code == 0
    assert capsys.readouterr().out == f"passive-walker {gpw.__version__}\n"


def test_what_is_said_of_the_walkers_is_true(reported):
    rows = {row["name"]: row for row in reported("walkers")}
    assert list(rows) == list(gpw.WALKERS) == list(ABOUT)
    for name, walker in gpw.WALKERS.items():
        about = rows[name]["about"]
        if name not in ("F", "lab-straight"):  # their text refers to another walker
            assert ("straight legs" in about) == (not walker.knees)
            assert ("round feet" in about) == (walker.foot_radius > 0.0)
        if "tuned" in about:
            off = max(map(abs, gpw.tuning_errors(walker)))
            assert off > 1e-2 if "not tuned" in about else off < 1e-3


def test_tuning_errors_are_printed_whichever_sign_they_have(capsys):
    assert main(["walkers"]) == 0
    head, *rows = (re.split(r"\s{2,}", x.strip()) for x in capsys.readouterr().out.splitlines())
    column = head.index("off tuning (legs)")
    reported = {row[0]: float(row[column]) for row in rows if row[0] in gpw.WALKERS}
    assert list(reported) == list(gpw.WALKERS)
    errors = {name: gpw.tuning_errors(walker) for name, walker in gpw.WALKERS.items()}
    assert any(min(error) < -1e-3 for error in errors.values())
    for name, off in reported.items():
        assert off == pytest.approx(max(map(abs, errors[name])), rel=1e-3, abs=1e-12)


@pytest.mark.parametrize("suffix", ["json", "yaml"])
def test_a_walker_of_one_s_own_walks_by_the_laws_of_size(suffix, mine, reported):
    """At half the size, the angles are equal and the time is shorter by 1/√2."""
    file = mine
    if suffix == "yaml":
        yaml = pytest.importorskip("yaml")
        file = mine.with_suffix(".yaml")
        file.write_text(yaml.safe_dump(json.loads(mine.read_text())))
    (small,), (large,) = reported("gait", file, 0.036), reported("gait", "lab", 0.036)
    assert small["stance_angle"] == pytest.approx(large["stance_angle"], rel=1e-10)
    assert small["step_period"] == pytest.approx(large["step_period"] / np.sqrt(2.0), rel=1e-10)
    assert small["speed"] == pytest.approx(large["speed"] / np.sqrt(2.0), rel=1e-10)


def test_a_file_may_change_a_preset(mine, reported):
    mine.write_text('{"preset": "C", "hip_mass": 1.0}')
    gait, *_ = reported("gait", mine, 0.03, "--tune")
    heavy = gpw.tune(replace(gpw.WALKERS["C"], hip_mass=1.0))
    assert gait["stance_angle"] == gpw.find_gaits(heavy, 0.03)[0].stance_angle


@pytest.mark.parametrize("written", ["2e-1", "2E-1", ".2e0", "20.e-2", "+2e-01"])
def test_yaml_numbers_may_be_written_as_people_write_them(written, mine, reported):
    pytest.importorskip("yaml")
    file = mine.with_suffix(".yaml")
    file.write_text(f"preset: C\nfoot_radius: {written}\n", encoding="utf-8")
    gait, *_ = reported("gait", file, 0.03)
    round_foot = replace(gpw.WALKERS["C"], foot_radius=0.2)
    assert gait["stance_angle"] == gpw.find_gaits(round_foot, 0.03)[0].stance_angle


WRONG = {
    "gait nobody 0.03": "one of the names A, B, C",
    "gait lab": "required: SLOPE",
    "gait lab steep": "SLOPE: invalid float value: 'steep'",
    "gait lab 2": "between -pi/2 and pi/2",
    "gait lab 0.03 --period 0": "error: --period must be a whole number from 1 on",
    "gait lab 0.03 --perod 2": "passive-walker gait has no --perod (--period?); it has",
    "gait lab 0.03 7": "unrecognized arguments: 7",
    "gait labb 0.03": "no walker 'labb' (lab?)",
    "gait lab nan": "error: SLOPE must be an angle in rad",
    "gait lab 0.03 --torque nan": "error: --torque must be a number",
    "gait lab 0.03 --ankle-torque 1": "error: --ankle-torque needs point feet",
    "gait lab 0.03 --controller lqrr": "no controller 'lqrr' (lqr?): give a feedback",
    "gait lab 0.03 --controller lqr --scene levle": "no scene 'levle' (level?): give",
    "gait lab 0.03 --scene level": "--scene is that of a --controller, which is not given",
    "gait no.json 0.03": "no.json cannot be read: No such file",
    "gait torn.json 0.03": "torn.json cannot be read: Expecting",
    "gait list.json 0.03": "must name a walker's parameters",
    "gait four.json 0.03": "a walker has no legs; it has thigh_length",
    "gait light.json 0.03": "light.json: thigh_mass must not be negative",
    "family lab 0.1 0.01": "slopes must be 0 < LOW < HIGH, not 0.1, 0.01; only motors walk uphill: "
    "give a --controller",
    "family lab 0.01 3": "error: HIGH must be an angle in rad",
    "family lab 0.01 0.1 --kind lng": "--kind: the list of choices has no lng (long?); it has long",
    "bifurcation C 0.07 0.09 --slopes -3": "error: --slopes must be a whole number from 1 on",
    "bifurcation C 0.07 0.09 --slopes 1000000000000": "error: --slopes must be a whole number from",
    "bifurcation C nan 0.09": "error: LOW must be an angle in rad",
    "bifurcation C -0.07 0.09": "error: LOW and HIGH must be slopes above 0",
    "bifurcation C 0.07 0.09 --n-recorded 8": "--n-recorded must be above the longest",
    "basin lab 0.036 --resolution 0": "error: --resolution must be a whole number from 1 on",
    "robustness lab --slope 0.036 --roughness -1": "error: --roughness must be a number from 0",
    "gauntlet level-pp": "no policy 'level-pp' (level-ppo?): choose from",
    "gauntlet level-ppo --scene levl": "--scene: no scene 'levl' (level?)",
    "scene levle": "SCENE: no scene 'levle' (level?): give a Scene, a file, or one of level",
    "evaluate level-ppo --seed -1": "error: --seed must be a whole number from 0",
    "evaluate optimal --scene rough --slope 9": "error: --slope must be an angle in rad",
    "play lab 0.036 --seconds nan": "error: --seconds must be a finite number above 0",
    "play lab 0.036 --seconds 0": "error: --seconds must be a number above 0",
    "simulate lab 0.036 --out walk.txt": "ends in .csv, .mat, .npz or .parquet",
    "simulate lab 0.036 --strides 0": "--strides must be a whole number from 1 on",
    "simulate lab 0.036 --terrain sand": "terrain has no sand; it has rough, stairs",
    "simulate lab 0.036 --terrain rough:depth=1": "terrain rough has no depth; it has height_std",
    "simulate lab 0.036 --terrain rough:height_std=x": "takes numbers, not 'height_std=x'",
    "strobe lab 0.036 --terrain stairs:-0.01": "a terrain is written as rough:height_std",
    "video lab 0.036 --terrain {rough": "'{rough' cannot be read: Expecting",
    "evaluate level-ppo --terrain waves:height=1,strides=1": "strides must be a whole number from",
    "evaluate level-ppo --terrain list.json": "a terrain is a Terrain, None, or a mapping",
    "simulate lab 0.036 --terrain rough:height_std=1e-3 --terrain-seed -1": "error: "
    "--terrain-seed must be a whole number",
    "figures 9.9": "no figure '9.9' (4.9?): choose from 4.1",
    "figures 4.5 4.6 --out both.pdf": "both.pdf is one file, for one figure: name a folder",
    "figures 4.6 --out f.doc": "a picture's name must end in one of",
    "figures 4.6 --out light.json/f.pdf": "light.json",
    "figures 4.6 --size 8.5 0": "--size must be a number above 0, not 0",
    "table 4.3": "no table '4.3': choose from 4.1, 4.2",
    "video lab 0.036 --out walk.doc": "must end in .mp4 or .gif",
    "evaluate nobody": "no policy 'nobody': choose from",
    "compare lab": "by the controller 'passive', with walker='lab' or --walker lab",
    "evaluate level-ppo --episodes 0": "--episodes must be a whole number from 1 on",
    "fly": "COMMAND: the list of choices has no fly (family?); it has walkers",
    "evalute level-ppo": "COMMAND: the list of choices has no evalute (evaluate?); it has",
}


@pytest.mark.parametrize("line", WRONG)
def test_bad_input_is_answered_in_one_sentence(line, mine, capsys):
    if line.startswith("figures"):
        pytest.importorskip("matplotlib")
    if line.startswith("video"):
        pytest.importorskip("moviepy")
    (mine.parent / "torn.json").write_text("{'a")
    (mine.parent / "list.json").write_text("[1, 2]")
    (mine.parent / "four.json").write_text('{"preset": "lab", "legs": 4}')
    (mine.parent / "light.json").write_text('{"preset": "lab", "thigh_mass": -1}')
    try:
        status = main(line.split())
    except SystemExit as end:
        status = end.code
    said = capsys.readouterr()
    assert status == 2
    *before, sentence = said.err.splitlines()
    assert said.out == "" and sentence.startswith("error: ") and WRONG[line] in sentence
    assert all("compiles" in other for other in before)  # from an empty cache


@pytest.mark.parametrize(
    ("text", "terrain"),
    [
        ("rough:height_std=0.002,slope_std=0.004", gpw.rough(0.002, 0.004)),
        ("stairs:rise=-0.01", gpw.stairs(-0.01)),
        ("waves:height=0.01,strides=6", gpw.waves(0.01, 6)),
        ("footholds:heights=[0,-0.002],slopes=[0,0.01]", gpw.footholds([0, -0.002], [0, 0.01])),
        ('{"rough": {"height_std": 0.002}}', gpw.rough(0.002)),
        ("ground.json", gpw.stairs(0.002)),
    ],
)
def test_a_terrain_is_understood_however_it_is_written(text, terrain, mine):
    (mine.parent / "ground.json").write_text('{"stairs": {"rise": 0.002}}')
    for command in ("simulate", "strobe", "video"):
        assert parser().parse_args([command, "lab", "0.036", "--terrain", text]).terrain == terrain
    assert parser().parse_args(["evaluate", "level-ppo", "--terrain", text]).terrain == terrain


def test_a_walk_starts_on_the_gait_of_its_motors_where_there_is_no_passive_one(reported):
    words = ["D", 0.0, "--push-off", 0.05, "--dimensionless"]
    rows = reported("simulate", *words, "--strides", 3)
    gait = reported("gait", *words)[0]
    assert [row["duration"] for row in rows] == pytest.approx([gait["step_period"]] * 3, rel=1e-6)


def test_a_walk_over_rough_ground_is_printed_as_simulated(reported, mine):
    ground = ["--terrain", "rough:height_std=0.002,slope_std=0.005", "--terrain-seed", 3]
    rows = reported("simulate", "lab", 0.036, "--strides", 5, *ground, "--out", "walk.csv")
    state, terrain = gpw.find_gait("lab", 0.036).state, gpw.rough(0.002, 0.005)
    walk = gpw.simulate("lab", 0.036, state, 5, terrain=terrain, terrain_seed=3)
    assert [row["stance_angle"] for row in rows] == walk.states[::100, 0].tolist()
    with (mine.parent / "walk.csv").open() as file:
        heights = [float(row["contact_y (m)"]) for row in csv.DictReader(file)]
    assert heights == walk.contact_y.tolist()
    other = reported("simulate", "lab", 0.036, "--strides", 5, *ground[:-1], 4)
    assert other[1]["stance_angle"] != rows[1]["stance_angle"]


def test_a_walk_of_a_controller_that_looks_ahead_is_printed_as_simulated(reported):
    ground = ["--terrain", "rough:height_std=0.002", "--terrain-seed", 3]
    words = ["--controller", "rough-ppo", *ground, "--strides", 3]
    rows = reported("simulate", "C", 0.0, *words)
    strides = gpw.stride_map("C", 0.0, controller="rough-ppo")
    walk = gpw.simulate(strides, strides=3, terrain=gpw.rough(0.002), terrain_seed=3)
    assert strides.terrain_lookahead
    assert [row["duration"] for row in rows] == walk.taken.duration.tolist()
    assert [row["stance_angle"] for row in rows] == walk.states[::100, 0].tolist()


def test_where_there_is_no_gait_the_status_tells(capsys):
    assert main(["gait", "lab", "0.001"]) == 1
    said = capsys.readouterr()
    assert said.out == "" and said.err.count("\n") == 1
    assert "no long-step gait" in said.err and "gpw.nearest_gait" in said.err


def test_a_missing_library_is_named_before_anything_is_computed(monkeypatch, capsys):
    def never(*_, **__):
        pytest.fail("a gait was searched for")

    monkeypatch.setattr("gym_passive_walker.apps.cli.arguments.find_gait", never)
    for module, words in (
        ("matplotlib", "strobe lab 0.036"),
        ("matplotlib", "figures 4.6"),
        ("pygame", "video lab 0.036"),
    ):
        monkeypatch.setitem(sys.modules, module, None)
        assert main(words.split()) == 2
        said = capsys.readouterr().err
        assert f"needs {module}" in said and 'pip install "gym-passive-walker[' in said


def test_a_walk_that_falls_is_printed_to_its_end(reported):
    start = [0.3, -0.3, -0.3, -0.5, -0.5, -0.5]
    strides = reported("simulate", "lab", 0.036, "--state", *start)
    assert strides[-1]["outcome"] != "HEELSTRIKE" and strides[-1]["step_length"] is None


def test_csv_and_npz_hold_the_same_walk(reported, tmp_path):
    words = ["simulate", "D", 0.009, "--strides", 3, "--samples", 20]
    reported(*words, "--out", tmp_path / "walk.csv")
    reported(*words, "--out", tmp_path / "walk.npz")
    with (tmp_path / "walk.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    with np.load(tmp_path / "walk.npz") as arrays:
        assert list(arrays) == [name.partition(" (")[0] for name in rows[0]]
        for name, head in zip(arrays, rows[0], strict=True):
            assert arrays[name].tolist() == [float(row[head]) for row in rows]
        assert len(arrays["time"]) == 60 and np.all(np.diff(arrays["time"]) >= 0.0)
        assert arrays["stance_angle"][0] == gpw.find_gait("D", 0.009).stance_angle


def test_a_shipped_policy_walks_on_where_its_walker_would_not(reported):
    rows = reported("evaluate", "level-ppo", "--episodes", 3)
    endings = {agent: [row["ending"] for row in rows if row["agent"] == agent] for agent in
               ("level-ppo", "passive")}  # fmt: skip
    assert endings == {"level-ppo": [TIME_LIMIT] * 3, "passive": ["stubbed toe"] * 3}


def test_a_policy_may_drive_another_walker_on_another_slope(mine, reported):
    rows = reported("evaluate", "lab-ppo", "--walker", "A", "--slope", 0.02, "--episodes", 2)
    assert {row["slopes"] for row in rows} == {0.02} and rows[0]["distance"] > 10.0
    assert reported("evaluate", "passive", "--scene", "lab", "--walker", mine, "--episodes", 1)
    level = reported("evaluate", "passive", "--scene", "lab", "--slope", 0, "--episodes", 1)
    assert {row["slopes"] for row in level} == {0.0}


def test_a_strobe_picture_is_drawn(tmp_path, capsys):
    pytest.importorskip("matplotlib")
    path = tmp_path / "walk.png"
    assert main(["strobe", "D", "0.009", "--out", str(path)]) == 0
    assert path.read_bytes().startswith(b"\x89PNG")
    assert str(path) in capsys.readouterr().out


def test_a_film_lasts_as_long_as_its_walk(tmp_path):
    pytest.importorskip("pygame")
    pytest.importorskip("moviepy")
    from PIL import Image

    path = tmp_path / "walk.gif"
    words = ["video", "D", "0.009", "--strides", "2", "--slower", "0.5", "--out", str(path)]
    assert main(words) == 0
    lasts = 2.0 * gpw.find_gait("D", 0.009).step_period
    with Image.open(path) as video:
        assert video.n_frames == pytest.approx(0.5 * lasts * 30, abs=1.5)
        first = np.asarray(video.convert("L"))
        video.seek(video.n_frames - 1)
        assert np.any(first != np.asarray(video.convert("L")))


WALKS = """
import sys
import gymnasium as gym, numpy as np
import gym_passive_walker as gpw
from gym_passive_walker.engine import machine

heard = []
write = machine.object_code
machine.object_code = lambda module: heard.append(str(module)[:200]) or write(module)
for walker, slope in (("C", 0.03), ("A", 0.03), ("D", 0.009)):
    gait = gpw.find_gait(walker, slope)
    gpw.gait_family(walker, 0.9 * slope, slope)
    gpw.stride(walker, slope, np.tile(gait.state, (100, 1)))
    env = gym.make("PassiveWalker-v0", walker=walker, slope=slope)
    env.reset(seed=1)
    env.step(np.zeros(1))
    envs = gym.make_vec("PassiveWalker-v0", num_envs=50, walker=walker, control="stride",
                          slope=slope, domain_randomization={"max_hip_torque": (0.9, 1.1)})
    envs.reset(seed=1)
    for _ in range(5):
        envs.step(np.zeros((50, 1)))
gpw.parameter_family("lab", "gravity", 9.8, 9.82, slope=0.036)
gpw.optimal_gait("level", 0.15)
sys.exit(f"compiled: {heard}" if heard or "numba" in sys.modules else 0)
"""


ASKED = """
from gym_passive_walker.apps import build
from gym_passive_walker.engine import cache, machine

print(cache.cache_directory(), *map(machine._file, machine.asked_by(build.pieces())))
"""


@pytest.mark.slow
def test_a_warm_up_compiles_what_is_missing_and_nothing_compiles_after_it(tmp_path, capsys):
    """Of the cache of these tests, a cold one has what a warm-up asks for, but for three files."""

    def python(*words, **options):
        command = [sys.executable, *words]
        return subprocess.run(command, capture_output=True, text=True, check=False, **options)

    assert main(["warmup"]) == 0
    assert "everything is compiled" in capsys.readouterr().out
    folder, *asked = python("-c", ASKED).stdout.split()
    kernel = next(name for name in asked if name.startswith("newton.eliminate"))
    missing = {asked[0], kernel, asked[-1]}
    cold = tmp_path / "gym_passive_walker" / Path(folder).name
    cold.parent.mkdir(mode=0o700)
    cold.mkdir(mode=0o700)
    for name in {*asked} - missing:
        shutil.copy2(Path(folder) / name, cold)
    env = {**os.environ, "XDG_CACHE_HOME": str(tmp_path)}
    env.pop("NUMBA_CACHE_DIR", None)
    warm = python("-m", "gym_passive_walker", "warmup", env=env)
    assert "everything is compiled" in warm.stdout
    assert "gym_passive_walker compiles the kernel" in warm.stderr
    assert {file.name for file in cold.iterdir()} == {*asked}
    done = python("-c", WALKS, env=env)
    assert (done.returncode, done.stderr) == (0, "")


def test_a_reader_of_the_output_may_stop_reading():
    line = f"{sys.executable} -m gym_passive_walker walkers | head -c 1"
    done = subprocess.run(
        ["bash", "-c", f"set -o pipefail; {line}"], capture_output=True, text=True
    )
    assert done.stdout == "n" and "Traceback" not in done.stderr


def test_json_has_no_infinities():
    found = plain({"above": np.inf, "below": -np.inf, "all": np.array([0.5, np.nan, np.inf])})
    assert found == {"above": None, "below": None, "all": [0.5, None, None]}
    json.dumps(found, allow_nan=False)


if __name__ == "__main__":
    kept, found = json.loads(PRINTED.read_text("utf-8")), {}
    for line in sorted({*LINES} - {*ENDLESS}):
        if "--ray" in line and not find_spec("ray"):
            found[line] = kept[line]
            continue
        with TemporaryDirectory() as folder, chdir(folder):
            found[line] = printed(line, Path(folder))
    PRINTED.write_text(json.dumps(found, indent=0, ensure_ascii=False) + "\n", "utf-8")
