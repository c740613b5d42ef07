"""The page of names lists all public names, and the page on architecture all packages."""

import ast
import importlib
import inspect
import os
import pkgutil
import re
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

import gym_passive_walker as gpw

ROOT = Path(__file__).parents[2]
API = (ROOT / "docs" / "api.md").read_text(encoding="utf-8")

PUBLIC = (
    "", ".modeling", ".pictures", ".torch", ".gpu", ".math", ".apps.play", ".devices.web",
)  # fmt: skip
"""Modules with public names in `__all__`, after the package's name."""


def need(name):
    """Skip a test of a name if its module needs a library that is not installed."""
    first, *rest = name.split(".")[1:] or [""]
    if first == "torch":
        pytest.importorskip("torch")
        if rest[:1] == ["trainers"] and len(rest) > 1:
            pytest.importorskip(rest[1])
    if (first, *rest) == ("apps", "widget", "PlayerWidget"):
        pytest.importorskip("anywidget")
    simulated = os.environ.get("NUMBA_ENABLE_CUDASIM") == "1"
    if "gpu" in (first, *rest[:1]) and not simulated and find_spec("numba_cuda") is None:
        pytest.skip("there is neither the extra gpu nor numba's simulator")


INTERNAL = ("docs/extending.md",)
"""Pages about the inside of the package."""


def described():
    """Full names that the page of names describes."""
    module, names = "gym_passive_walker", []
    for kind, name in re.findall(r"^\.\. (?:py:)?(\w+):: ([\w.]+)", API, re.M):
        if kind == "currentmodule":
            module = name
        elif kind == "automodule":
            names += [name, *(f"{name}.{each}" for each in importlib.import_module(name).__all__)]
        elif kind.startswith("auto") or kind in ("data", "function"):
            names.append(name if name.startswith("gym_passive_walker") else f"{module}.{name}")
    return names


def find(name):
    """The object with a full name."""
    need(name)
    module, _, last = name.rpartition(".")
    return getattr(importlib.import_module(module), last)


@pytest.mark.parametrize("name", described())
def test_each_name_on_the_page_exists(name):
    assert find(name) is not None


def constants_in_docstrings():
    """Files of the package, and the constants that they name, as `engine.layout.RECORD`."""
    for path in sorted((ROOT / "gym_passive_walker").rglob("*.py")):
        text = path.read_text(encoding="utf-8")
        for name in re.findall(r"`(?:gym_passive_walker\.)?((?:\w+\.)+[A-Z][A-Z_\d]+)`", text):
            yield path.name, name


def test_each_constant_that_a_docstring_names_is_in_its_module():
    named = [*constants_in_docstrings()]
    assert len(named) > 20
    for path, name in named:
        module, _, constant = name.rpartition(".")
        places = (f"{module.replace('.', '/')}{end}" for end in (".py", "/__init__.py"))
        found = [each for place in places for each in (ROOT / "gym_passive_walker").rglob(place)]
        texts = [each.read_text(encoding="utf-8") for each in found]
        assert any(re.search(rf"\b{constant}\b", text) for text in texts), (path, name)


@pytest.mark.parametrize("suffix", PUBLIC)
def test_each_public_name_is_on_the_page(suffix):
    module = f"gym_passive_walker{suffix}"
    need(module)
    known, others = set(described()), []
    if suffix in (".torch", ".gpu"):  # some are described by the modules that define them
        others = [find(name) for name in known if name.startswith(f"{module}.")]
    if suffix == ".modeling":  # some are names of the package too
        others = [getattr(gpw, name) for name in gpw.__all__]
    for name in importlib.import_module(module).__all__:
        full = f"{module}.{name}"
        assert full in known or any(find(full) is other for other in others), full


def imported():
    """Full names that the Python code of pages imports from the package, and their pages."""
    for page in [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]:
        name = page.relative_to(ROOT).as_posix()
        if name in INTERNAL or "_build" in name or "_generated" in name:
            continue
        text = page.read_text(encoding="utf-8")
        for code in re.findall(r"```(?:python|py|\{code-cell\})\n(.*?)```", text, re.S):
            for node in ast.walk(ast.parse(code)):
                if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("gym_pass"):
                    yield from ((name, f"{node.module}.{alias.name}") for alias in node.names)


@pytest.mark.parametrize(("page", "name"), sorted(set(imported())))
def test_each_name_that_a_page_imports_is_on_the_page_of_names(page, name):
    known = described()
    if any(each.startswith(f"{name}.") for each in known):  # a module
        return
    assert name in known or any(find(each) is find(name) for each in known if name[-5:] in each)


@pytest.fixture
def rooms(monkeypatch):
    """The program that draws the rooms."""
    monkeypatch.syspath_prepend(ROOT / "docs")
    return importlib.import_module("rooms")


def test_the_rooms_are_drawn_as_their_modules_and_imports_are(rooms):
    assert rooms.page() == rooms.PAGE.read_text(encoding="utf-8")


def test_each_room_has_a_line_that_says_what_goes_in(rooms):
    described = re.findall(r"^\| `(\w+)/` \|.*\|.*\|$", rooms.PAGE.read_text("utf-8"), re.M)
    assert [*described] == [name for floor in reversed(rooms.floors()) for name in floor
                            if (Path(gpw.__path__[0]) / name / "__init__.py").exists()
                            and name != "control"]  # fmt: skip


def places():
    """Concepts and their places, as the page on architecture lists them."""
    text = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    part = text[text.index("## Where is what") : text.index("## Where to change what")]
    return re.findall(r"^\| ([^|`]*(?:`[^`]*`[^|`]*)*) \| `([\w.]+)` \|$", part, re.M)


def test_forty_concepts_have_a_place():
    assert len(places()) >= 40


@pytest.mark.parametrize(("concept", "place"), places())
def test_each_concept_is_where_the_table_says(concept, place):
    need(f"gym_passive_walker.{place}")
    found = pkgutil.resolve_name(f"gym_passive_walker.{place}")
    if inspect.isclass(found) or inspect.isfunction(found):
        assert f"{found.__module__}.{found.__qualname__}" == f"gym_passive_walker.{place}"


_IMPORTED = """
import sys
import gymnasium
before = set(sys.modules)
import gym_passive_walker as gpw
assert "PassiveWalker-v0" in gymnasium.registry
loaded = {name for name in set(sys.modules) - before}
rooms = {name.split(".")[1] for name in loaded if name.startswith("gym_passive_walker.")}
assert rooms <= {"_tools", "_version", "envs"}, rooms
assert not {"numba", "llvmlite", "scipy", "scipy.optimize"} & loaded, loaded
assert gpw.blend is gpw.interpolate
assert not hasattr(gpw, "nothing") and "find_gait" in dir(gpw)
"""


def test_an_import_registers_the_environments_and_loads_no_compiler_and_no_analysis():
    subprocess.run([sys.executable, "-c", _IMPORTED], check=True)


def test_a_module_that_lacks_a_library_says_so_and_is_not_called_unknown():
    program = """
import sys
sys.modules["numba_cuda"] = None
import gym_passive_walker as gpw
try:
    gpw.gpu
except ImportError as error:
    assert "[gpu]" in str(error), error
else:
    raise AssertionError("loaded")
"""
    alone = {name: value for name, value in os.environ.items() if name != "NUMBA_ENABLE_CUDASIM"}
    subprocess.run([sys.executable, "-c", program], check=True, env=alone)
