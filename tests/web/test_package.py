"""The package of a page: its size, what it refuses, its policies."""

import json
import re
import subprocess
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import gym_passive_walker as gpw
from gym_passive_walker.devices.web.build import MODULES, PACKAGE
from gym_passive_walker.gaits.scenes.scene import make_scene

COMPRESSED = """
import { readFileSync } from "node:fs";
import { brotliCompressSync } from "node:zlib";
const sizes = process.argv.slice(1).map((name) => brotliCompressSync(readFileSync(name)).length);
console.log(JSON.stringify(sizes));
"""


def test_a_compressed_module_has_at_most_60_kilobytes(node, package):
    names = [str(package / f"{kind}.wasm") for kind in MODULES]
    command = [node, "--input-type=module", "-e", COMPRESSED, *names]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert max(json.loads(done.stdout)) <= 60_000


def luminance(color):
    """Relative luminance of a colour, as WCAG 2 defines it."""
    parts = [int(color[i : i + 2], 16) / 255.0 for i in (1, 3, 5)]
    linear = [x / 12.92 if x <= 0.04045 else ((x + 0.055) / 1.055) ** 2.4 for x in parts]
    return float(np.dot(linear, [0.2126, 0.7152, 0.0722]))


def themes():
    """Colours of the player in each of its themes, by name."""
    rules = re.findall(r"\.pw \{(.*?)\}", (PACKAGE / "player.css").read_text(), re.S)
    found = [dict(re.findall(r"--pw-(\w+): (#\w{6})", rule)) for rule in rules]
    return [colors for colors in found if colors]


def test_colours_of_all_themes_have_the_contrast_of_wcag():
    assert len(themes()) == 3  # light, and dark by the system or by the page
    for colors in themes():
        ground = luminance(colors.pop("background"))
        for name, color in colors.items():
            light, dark = sorted((luminance(color), ground), reverse=True)
            least = {"text": 4.5, "mark": 4.5, "line": 1.0}.get(name, 3.0)
            assert (light + 0.05) / (dark + 0.05) >= least, name


@pytest.mark.parametrize(
    "given",
    [
        {"preset": "C", "gravity": -1.5},
        {"preset": "C", "thigh_mass": -0.5},
        {"preset": "C", "foot_radius": 0.75},
        {"preset": "C", "foot_angle": 1.25},
        {"preset": "C", "thigh_com": 12.5},
        {"preset": "C", "shank_mass": 0.0},
        {"preset": "C", "foot_raduis": 0.1},
        {"preset": "D", "hip_mass": 0.0},
        {"preset": "D", "foot_radius": 0.1},
        {"preset": "B", "thigh_mass": 0.5, "shank_mass": 0.0, "thigh_com": 0.0},
        {"preset": "C", "knees": 1.5},
        {"preset": "C", "gravity": "much"},
    ],
)
def test_a_walker_that_cannot_be_is_refused_in_pythons_words(run, given):
    (said,) = run({"what": "refusal", "walker": given, "scene": {}})
    with pytest.raises(gpw.WalkerError) as error:
        gpw.as_walker(given)
    assert said == f"WalkerError: {error.value}"


def test_a_walker_of_held_knees_is_refused_in_a_page(run):
    (said,) = run({"what": "refusal", "walker": {"preset": "C", "knees": "held"}, "scene": {}})
    assert said == "WalkerError: knees='held' is not for pages: knees must be True or False there"


@pytest.mark.parametrize(
    "given",
    [
        {"tick": 0.0},
        {"control": "often"},
        {"energy": "some"},
        {"actions": ["hip", "hip"]},
        {"actions": ["ankle"]},
        {"max_hip_torque": -1.5},
        {"pushes": {"rate": 1.5}},
        {"pushes": {"rate": 1.5, "impulse": 20.5}},
        {"observation_noise": -0.5},
        {"action_delay": -1.5},
        {"command": [0.5, 0.25]},
        {"reset_noise_scale": 1.5},
        {"end_on_toe_stub": 1.5},
        {"terrain_lookahead": 2},
        {"slop": 0.1},
    ],
)
def test_a_scene_that_cannot_be_is_refused_as_in_python(run, given):
    (said,) = run({"what": "refusal", "walker": "C", "scene": given})
    with pytest.raises(ValueError) as error:
        make_scene({"walker": "C", **given})
    name, _, message = said.partition(": ")
    assert name == "SceneError"
    if "slop" not in given:  # the page has fewer arguments to list
        assert message == str(error.value)


PROTOTYPE = ("toString", "constructor", "__proto__", "hasOwnProperty")
REFUSED = [
    *(
        call
        for name in PROTOTYPE
        for call in (
            ["walkers", "create", name],
            ["walkers", "create", {"preset": name}],
            ["walkers", "create", "C", name],
            ["walkers", "create", "C", {name: 1}],
            ["walkers", "create", "C", {"energy": name}],
            ["walkers", "create", "C", {"tolerance": name}],
            ["walkers", "create", "C", {"terrain": {name: {}}}],
            ["walkers", "loadPolicy", name],
            ["walk", "reset", {name: 1}],
            ["walk", "strideFrom", [0] * 6, {name: 1}],
            ["walk", "strideFrom", [0] * 6, {"tolerance": name}],
            ["own", "change", {"body": {name: 1}}],
            ["own", "reset", None, {name: 1}],
        )
    ),
    ["walkers", "create", "C", {}, {"reed": 1}],
    ["walkers", "create", "C", {"walker": "A"}],
    ["walkers", "create", {"preset": "C", "title": "mine"}],
    ["walkers", "create", {"preset": "C", "gravity": None}],
    ["walkers", "create", "C", {"pushes": 5}],
    ["walkers", "create", "C", {"pushes": True}],
    ["walkers", "create", "C", {"step_limit": "many"}],
    ["walkers", "create", "C", {"terrain": {"rough": {}}}],
    ["walkers", "create", "C", {"terrain": {"rough": {"height": 0.1}}}],
    ["walkers", "create", "C", {"terrain": {"rough": None}}],
    ["walkers", "create", "C", {"terrain": {"stairs": {"rise": 0.0, "strides": 3}}}],
    ["walkers", "create", "C", {"terrain": {"footholds": {"heights": 0.1}}}],
    ["walkers", "create", "C", {"terrain": {"rises": [0.0], "slopes": [0.0], "height": 1}}],
    ["walkers", "create", "C", {"terrain": {"rises": ["0"], "slopes": [0.0]}}],
    ["walkers", "loadPolicy", "level-ppo", {"reed": 1}],
    ["walkers", "createSystem", "torso", {"slop": 0.03}],
    ["walkers", "createSystem", "../torso"],
    ["walkers", "createSystem", "torso", {"tolerance": "toString"}],
    ["walk", "reset", {"noize": False}],
    ["walk", "reset", {"noise": "no"}],
    ["walk", "reset", {"seed": -1}],
    ["walk", "reset", {"seed": 2**65}],
    ["walk", "reset", 3],
    ["walk", "strideFrom", [0] * 6, {"torque": 0.1}],
    ["walk", "strideFrom", [0] * 6, {"hip_torque": "0.1"}],
    ["walk", "strideFrom", [0] * 6, {"tolerance": 1e-7}],
    ["walk", "findGait", {"tolerance": 1e-8}],
    ["walk", "findGait", {"tries": "many"}],
    ["walk", "findGait", {"guess": [1, 2]}],
    ["walk", "change", {"slope": 0.1}],
    ["walk", "change", {"scene": {"walker": "A"}}],
    ["walk", "joints", [0, 1]],
    ["walk", "render", None, {"colours": {}}],
    ["walk", "render", None, {"colors": {"sky": "#fff"}}],
    ["own", "change", {"body": {"fin": 1}}],
    ["own", "change", {"scene": {}}],
    ["own", "reset", None, {"state": 1}],
    ["own", "strideFrom", [0] * 6, {"hip_torque": 0.1}],
    ["own", "strideFrom", [0] * 6, {"end": "late"}],
    ["own", "findGait", {"hip_torque": 0.1}],
    ["own", "step", "long"],
    ["own", "render", None, {"colors": {"sky": "#fff"}}],
    ["policy", "predict", [0.0] * 7],
]


def test_calls_take_no_name_of_a_prototype_and_refuse_what_they_would_ignore(run):
    (found,) = run({"what": "refusals", "system": "torso", "calls": REFUSED})
    for call, said in zip(REFUSED, found, strict=True):
        assert said and not said.startswith(("TypeError", "RangeError", "ReferenceError")), call


def test_entries_of_an_argument_s_prototype_are_not_read(run):
    calls = [
        ["walk", "reset", {"inherits": {"seed": "no seed"}}],
        ["walk", "strideFrom", [0] * 6, {"inherits": {"hip_torque": "much"}}],
        ["walkers", "create", "C", {"inherits": {"slope": "steep", "walker": "none"}}],
        ["walkers", "create", {"preset": "C", "inherits": {"gravity": "much"}}],
        ["own", "change", {"inherits": {"slope": "steep"}}],
    ]
    (found,) = run({"what": "refusals", "system": "torso", "calls": calls})
    assert found == [None] * len(calls)


@pytest.mark.parametrize("name", ["level-ppo", "steep-sac", "rough-ppo"])
def test_a_policys_actions_are_pythons_up_to_single_precision(run, name):
    policy = gpw.load_policy(name)
    count = 8 + 2 * policy.scene.terrain_lookahead
    observations = np.random.default_rng(0).normal(0.0, 0.3, (100, count))
    (found,) = run({"what": "policy", "name": name, "observations": observations.tolist()})
    assert np.array(found) == pytest.approx(policy.predict(observations)[0], abs=2e-5)


@pytest.fixture
def again(monkeypatch):
    """A function that makes the files of the package without reading them from the cache."""
    build = import_module("gym_passive_walker.devices.web.build")
    kept: dict[str, bytes] = {}
    monkeypatch.setattr(build, "cache", SimpleNamespace(found=kept.get, keep=kept.__setitem__))
    return build.files


def test_two_builds_of_the_package_are_equal(package, again, monkeypatch):
    monkeypatch.setitem(again.__globals__, "modules", dict)
    assert len(made := again()) > 10
    assert [name for name, text in made.items() if (package / name).read_bytes() != text] == []


@pytest.mark.parametrize(
    "name", ["_version.py", "gaits/find/search.py", "gaits/scenes/starts.json"]
)
def test_data_are_made_again_after_a_change_of_a_source(name, again, tmp_path, monkeypatch):
    made = iter([{"version": "1"}, {"version": "2"}])
    monkeypatch.setitem(again.__globals__, "_SOURCES", tmp_path)
    monkeypatch.setitem(again.__globals__, "page_data", SimpleNamespace(of_all=lambda: next(made)))
    data, source = again.__globals__["data"], tmp_path / name
    source.parent.mkdir(parents=True, exist_ok=True)
    source.write_text("1")
    assert data() == data() == b'{"version":"1"}'
    source.write_text("2")
    assert data() == data() == b'{"version":"2"}'


def test_modules_say_the_version_that_wrote_them(package, monkeypatch):
    build = import_module("gym_passive_walker.devices.web.build")
    before = build.modules()
    monkeypatch.setattr(build.page_data, "__version__", "0.0.0")
    for name, module in build.modules().items():
        assert b'"version":"0.0.0"' in module and module != before[name]


def test_an_interrupted_build_leaves_no_cut_file(tmp_path, monkeypatch):
    build = import_module("gym_passive_walker.devices.web.build")
    monkeypatch.setattr(build, "files", lambda: {"kneed.wasm": b"whole"})
    build.build(tmp_path)
    write = Path.write_bytes

    def stop(path, content):
        write(path, content[:3])
        raise KeyboardInterrupt

    monkeypatch.setattr(Path, "write_bytes", stop)
    with pytest.raises(KeyboardInterrupt):
        build.build(tmp_path)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == {"kneed.wasm": b"whole"}


@pytest.mark.slow
def test_two_builds_of_the_modules_are_equal(package, again):
    modules = {name: text for name, text in again().items() if name.endswith(".wasm")}
    assert len(modules) == len(MODULES)
    assert [name for name, text in modules.items() if (package / name).read_bytes() != text] == []
