"""What a page reads besides code: notes of modules, shared data, and files, as Python has them."""

import importlib
import json
import subprocess
from types import SimpleNamespace

import numpy as np
import pytest

import gym_passive_walker as gpw
from examples.five_links import FIVE_LINKS
from examples.torso import TORSO
from gym_passive_walker.devices import web
from gym_passive_walker.devices.web import container, page_data
from gym_passive_walker.envs.policies import DESCRIPTION, TENSORS, shipped_policies
from gym_passive_walker.gaits.scenes.scene import make_scene
from gym_passive_walker.gaits.scenes.starts import REFERENCE_SLOPES
from gym_passive_walker.models.equations.hybrid import Outcome
from tests.own.statements import DRIVEN, PROGRESSIVE

pytestmark = pytest.mark.slow  # a page's module takes a minute to compile

build = importlib.import_module(
    "gym_passive_walker.devices.web.build"
)  # of which `web.build` is a function
SYSTEMS = {"torso": TORSO, "driven": DRIVEN, "five": FIVE_LINKS, "progressive": PROGRESSIVE}


def leb(value):
    """An unsigned number in LEB128."""
    low, rest = value & 127, value >> 7
    return bytes([low | 128]) + leb(rest) if rest else bytes([low])


def text(word):
    return leb(len(word)) + word.encode()


def section(number, *entries):
    content = b"".join(entries)
    return bytes([number]) + leb(len(content)) + content


def notes(path):
    """The notes of a module: the text after the name of its own section."""
    content = path.read_bytes()
    return json.JSONDecoder().raw_decode(
        content[content.rindex(text("gym_passive_walker")) + 19 :].decode()
    )[0]


@pytest.mark.parametrize("name", SYSTEMS)
def test_a_module_of_a_system_has_its_names_its_start_and_its_lines(name, package):
    system, found = SYSTEMS[name], notes(package / "systems" / f"{name}.wasm")
    start, slope = system.start, 0.0
    if name == "five":  # built from a gait
        gait = gpw.find_gait(FIVE_LINKS, 0.05)
        start, slope = gait.state, 0.05
        assert not np.array_equal(start, system.start)
    assert found["system"] == system.name and found["body"] == system.body._asdict()
    assert tuple(found["state"]) == system.State._fields
    assert tuple(found["controls"]) == system.controls
    assert found["start"] == [*map(float, start)] and found["slope"] == slope
    lines = [len(line) for line in system.drawn(start)]
    assert found["lines"] == lines
    numbers = len(system.body) + 2 * system.coordinates + 2 * sum(lines)
    assert found["scratch"] == 8 * numbers
    assert found["outcomes"] == [outcome.name for outcome in Outcome]
    assert found["version"] == gpw.__version__ and found["uneven"] and found["pushed"]
    assert found["room"] == (8 if name == "five" else 3) >= system.coordinates
    assert found["locked"] == [True]


@pytest.mark.parametrize("kind", build.MODULES)
def test_a_module_of_a_kind_has_its_constants_and_the_options_of_the_engine(kind, package):
    found = notes(package / f"{kind}.wasm")
    names = {"kneed": "C", "straight": "A", "simplest": "D"}
    rules = found["rules"]
    assert found["kind"] == kind and found["version"] == gpw.__version__
    assert "tick" not in rules and "step_limit" not in rules and rules
    assert [float(each) for each in found["options"]] == [1e-6, 1e-8, 1e-10, 1e-12]
    for tolerance, options in found["options"].items():
        assert options[0] == float(tolerance) and len(options) == 5
    assert found["locked"] == ([False, True] if kind == "kneed" else [True])
    walker = gpw.WALKERS[names[kind]]
    assert walker.knees == (kind == "kneed") and walker.massless_legs == (kind == "simplest")
    end = container.data_end((package / f"{kind}.wasm").read_bytes())
    assert found["end"] == end > 0


@pytest.fixture(scope="module")
def data(package):
    return json.loads((package / "data.json").read_text(encoding="utf-8"))


@pytest.mark.parametrize("name", gpw.WALKERS)
def test_walkers_of_a_page_have_their_parameters_and_gaits_that_repeat(name, data):
    walker, found = gpw.WALKERS[name], data["walkers"][name]
    assert gpw.Walker(**found["parameters"]) == walker
    assert list(found["parameters"]) == [*data["parameters"], "knees"]
    assert found["about"] == gpw.models.walkers.ABOUT[name]
    slopes = [slope for slope, _ in found["gaits"]]
    assert slopes == sorted({*slopes}) and {*slopes} & {*REFERENCE_SLOPES}
    given = walker.units.to_own([state for _, state in found["gaits"]])
    for slope, state in zip(slopes, given, strict=True):
        after = gpw.stride(walker, slope, state).state
        np.testing.assert_allclose(after, state, atol=1e-6 * np.abs(state).max())


def test_policies_of_a_page_have_their_scenes_and_weights(data, package):
    shipped = shipped_policies()
    assert list(data["policies"]) == list(shipped)
    for name in shipped:
        policy, found = gpw.load_policy(name), data["policies"][name]
        assert make_scene(found["scene"]) == policy.scene
        described = json.loads((policy.folder / DESCRIPTION).read_text(encoding="utf-8"))
        for key, value in described["env"].items():
            assert found["scene"][key] == value, key
        assert found["algo"] == described["algo"]
        weights = (package / "policies" / f"{name}.safetensors").read_bytes()
        assert weights == (policy.folder / TENSORS).read_bytes()


def test_offsets_are_those_of_numpy():
    inner = np.dtype([("a", "f4"), ("b", "f8", (2, 3))], align=True)
    outer = np.dtype([("x", "u8"), ("many", "i8", (4,)), ("in", inner), ("y", "f8")], align=True)
    found = page_data._places(outer)
    base = outer.fields["in"][1]
    assert found == {
        "x": [0, "u8", 1],
        "many": [8, "i8", 4],
        "in": [base, "record", inner.itemsize],
        "in.a": [base, "f4", 1],
        "in.b": [base + inner.fields["b"][1], "f8", 6],
        "y": [outer.fields["y"][1], "f8", 1],
    }


@pytest.mark.parametrize("addresses", [(70_000, 8), (8, 70_000)])
def test_data_ends_behind_the_farthest_segment_whatever_their_order(addresses):
    segments = [b"\0\x41" + leb(at) + b"\x0b" + leb(300) + b"\7" * 300 for at in addresses]
    made = b"\0asm\1\0\0\0" + section(1, b"\0") + section(11, leb(2), *segments)
    assert container.data_end(made) == 70_300
    assert container.data_end(made[:8]) == 0
    assert [number for number, _ in container.sections(made)] == [1, 11]


def test_imports_of_each_kind_are_named():
    entries = [
        ("memory", b"\2\0\1"), ("bounded", b"\2\1\1" + leb(300)), ("pointer", b"\3\x7f\1"),
        ("table", b"\1\x70\0\1"), ("short", b"\1\x70\1\1\2"), ("call", b"\0" + leb(200)),
    ]  # fmt: skip
    content = [text("env") + text(name) + kind for name, kind in entries]
    made = b"\0asm\1\0\0\0" + section(2, leb(len(entries)), *content)
    assert container.imports(made) == [name for name, _ in entries]


@pytest.mark.parametrize("size", [1, 100, 122, 123, 128, 16_384])
def test_an_export_s_name_may_have_any_length(size):
    """The lengths of its name and of its section have one byte below 128."""
    table = leb(1) + b"\0\0" + leb(5) + text("f" * size)
    linking = b"\2\x08" + leb(len(table)) + table
    parts = section(10, b"code") + section(0, text("linking"), linking)
    made = container.module(b"\0asm\1\0\0\0" + parts, ("f" * size,), {})
    (exported,) = (content for number, content in container.sections(made) if number == 7)
    assert exported == leb(1) + text("f" * size) + b"\0\5"


def test_a_module_exports_what_is_asked_for_before_its_code():
    symbols = [
        b"\1\0" + text("numbers") + b"\0\0\5",  # data
        b"\0\x10\0",  # a function that is imported, without a name
        b"\0\0\2" + text("second"),
        b"\0\0\1" + text("first"),
        b"\3\0\4",  # a section
        b"\0\0" + leb(300) + text("third"),
    ]
    table = leb(len(symbols)) + b"".join(symbols)
    linking = b"\2" + b"\5" + leb(3) + b"\1\2\3" + b"\x08" + leb(len(table)) + table
    parts = [section(1, b"types"), section(3, b"functions"), section(12, b"\1"),
             section(10, b"code"), section(0, text("linking"), linking),
             section(0, text("other"), b"names")]  # fmt: skip
    made = container.module(b"\0asm\1\0\0\0" + b"".join(parts), ("third", "first"),
                            {"notes": b"{}", "more": b"[]"})  # fmt: skip
    found = list(container.sections(made))
    assert [number for number, _ in found] == [1, 3, 7, 12, 10, 0, 0]
    expected = leb(2) + text("third") + b"\0" + leb(300) + text("first") + b"\0" + leb(1)
    assert found[2][1] == expected
    assert [content for _, content in found[5:]] == [text("notes") + b"{}", text("more") + b"[]"]
    with pytest.raises(KeyError):
        container.module(b"\0asm\1\0\0\0" + b"".join(parts), ("fourth",), {})


@pytest.mark.parametrize("name", ["", "a/b", "../up", "a b", "a.wasm", "ä/"])
def test_a_name_of_a_system_is_that_of_a_file(name, tmp_path):
    with pytest.raises(ValueError, match="systems must map names to systems"):
        web.build(tmp_path, TORSO)
    with pytest.raises(ValueError, match=r"must be letters, digits, '-' and '_'"):
        web.build(tmp_path / "there", {name: TORSO})
    with pytest.raises(ValueError, match=r"systems\['walker'\] must be a gpw.System or a gait"):
        web.build(tmp_path / "there", {"walker": gpw.WALKERS["C"]})
    assert not (tmp_path / "there").exists()


def test_a_gait_of_a_page_is_passive_and_on_smooth_ground(tmp_path):
    held = gpw.stride_map(DRIVEN, 0.03, controller={DRIVEN.controls[0]: 1e-4})
    for strides in (held, gpw.stride_map(TORSO, 0.03, terrain=gpw.stairs(0.001))):
        with pytest.raises(ValueError, match=r"systems\['x'\] must be a passive gait on smooth"):
            web.build(tmp_path, {"x": gpw.find_gait(strides)})


def test_what_was_compiled_is_not_compiled_again_and_fills_any_folder(
    package, tmp_path, monkeypatch
):
    def never(*_):
        pytest.fail("a module was compiled once more")

    monkeypatch.setattr(build, "_compile", never)
    place = web.build(str(tmp_path / "new" / "place"), {"torso": TORSO, "heavy-1": TORSO})
    names = {path.relative_to(package) for path in package.rglob("*")}
    found = {path.relative_to(place) for path in place.rglob("*") if path.is_file()}
    own = {path for path in found if path.parts[0] == "systems"}
    assert found - own <= names and {path.stem for path in own} == {"torso", "heavy-1"}
    for path in found - own | {path for path in own if path.stem == "torso"}:
        assert (place / path).read_bytes() == (package / path).read_bytes(), path
    heavy = web.build(tmp_path, {"heavy": TORSO.vary(torso=0.2)}) / "systems" / "heavy.wasm"
    assert notes(heavy)["body"]["torso"] == 0.2  # the code is that of the lighter one


@pytest.mark.parametrize(
    ("printed", "said"), [("first\nlast words\n", "last words"), ("", "no message")]
)
def test_an_error_of_the_compiler_is_its_last_line(printed, said, monkeypatch):
    calls = []

    def failed(command, **options):
        calls.append((command, options["env"]))
        return SimpleNamespace(returncode=1, stderr=printed)

    monkeypatch.setattr(subprocess, "run", failed)
    with pytest.raises(web.WebError, match=f"cannot be compiled: {said}$"):
        build._compile("wide")
    ((command, environment),) = calls
    assert command[-1] == "wide"
    assert environment["NUMBA_CPU_NAME"] == "generic"
