"""The page of names lists all public names, and the page on architecture all packages."""

import ast
import importlib
import os
import pkgutil
import re
from importlib.util import find_spec
from pathlib import Path

import pytest

import gym_passive_walker as gpw

ROOT = Path(__file__).parents[2]
API = (ROOT / "docs" / "api.md").read_text(encoding="utf-8")

PUBLIC = ("", ".modeling", ".render", ".torch", ".gpu", ".math", ".viewer", ".web")
"""Modules with public names in `__all__`, after the package's name."""


def need(name):
    """Skip a test of a name if its module needs a library that is not installed."""
    first, *rest = name.split(".")[1:] or [""]
    if first in ("torch", "trainers"):
        pytest.importorskip("torch")
    if first == "trainers":
        pytest.importorskip(rest[0])
    if first == "web" and rest == ["widget", "PlayerWidget"]:
        pytest.importorskip("anywidget")
    simulated = os.environ.get("NUMBA_ENABLE_CUDASIM") == "1"
    if first == "gpu" and not simulated and find_spec("numba_cuda") is None:
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


@pytest.mark.parametrize("page", ["docs/architecture.md", "docs/images/architecture.svg"])
def test_the_architecture_has_every_package(page):
    text = (ROOT / page).read_text(encoding="utf-8")
    for module in pkgutil.iter_modules(gpw.__path__):
        if module.ispkg:
            assert f"{module.name}/" in text, module.name
        elif page.endswith(".md") and not module.name.startswith("_"):
            assert f"`{module.name}`" in text, module.name
