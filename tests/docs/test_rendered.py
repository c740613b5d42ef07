"""Pages that a command writes are the same each time, and those of the present sources."""

import inspect
import os
import re
import subprocess
import sys
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import pytest

from gym_passive_walker._tools.shown import picture

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def render():
    spec = spec_from_file_location("render", ROOT / "docs" / "render.py")
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def built(folder, *words, seed):
    """Files that a process of its own writes into a folder, by name."""
    command = [sys.executable, "docs/render.py", "--out", str(folder), *words]
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "PYTHONHASHSEED": str(seed)}
    subprocess.run(command, cwd=ROOT, env=environment, check=True, capture_output=True)
    return {path.name: path.read_bytes() for path in folder.rglob("*.*")}


def test_two_builds_of_the_pages_are_equal_and_tracked_ones_are_up_to_date(render, tmp_path):
    for library in ("torch", "skrl", "torchrl", "rsl_rl", "anywidget"):
        pytest.importorskip(library)
    pages = built(tmp_path, "--notebooks", seed=1)
    for make in (render.environment, render.commands, render.reference):
        assert pages.pop(f"{make.__name__}.md").decode() == make()
    assert not pages
    for make in (render.environment, render.commands):
        tracked = (ROOT / "docs" / f"{make.__name__}.md").read_text(encoding="utf-8")
        assert tracked == make(), "run python docs/render.py --notebooks"


@pytest.mark.slow
def test_two_builds_of_notebooks_are_equal(tmp_path):
    names = ("simplest-walker", "your-own-machine")  # all of them take minutes
    for library in ("nbclient", "ipykernel"):
        pytest.importorskip(library)
    first, second = (
        built(tmp_path / str(seed), "--notebooks", *names, seed=seed) for seed in (1, 2)
    )
    assert first == second
    assert sum(name.endswith(".ipynb") for name in first) == len(names)


def test_the_reference_lists_each_plot_with_the_options_of_its_class(render):
    text = render.reference()
    anchor = re.search(r"^### `(.*Shown\.plot)`$", text, re.M)[1].lower().replace(".", "")
    ours = [of for of in picture.registry if of.__module__.startswith("gym_passive_walker.")]
    assert len(ours) > 9
    for of in ours:
        entry = re.search(rf"^### class `{of.__name__}`\n(.*?)(?=^### )", text, re.M | re.S)[1]
        row = rf"^\| \[`plot\((.*)\)`\]\(#{anchor}\) \| (.+) \|$"
        ((call, _),) = re.findall(row, entry, re.M)
        options = list(inspect.signature(picture.dispatch(of)).parameters)[1:]
        assert all(option in call for option in options), call
