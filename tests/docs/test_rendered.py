"""Generated pages equal those of the present sources."""

import inspect
import json
import re
import subprocess
import sys
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import pytest

from gym_passive_walker._tools.shown import picture

ROOT = Path(__file__).parents[2]
NOTEBOOKS = sorted((ROOT / "docs" / "notebooks").glob("*.md"))


@pytest.fixture(scope="module")
def render():
    spec = spec_from_file_location("render", ROOT / "docs" / "render.py")
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_environments_reference_and_the_list_of_names_are_current():
    for library in ("torch", "skrl", "torchrl", "rsl_rl", "anywidget"):
        pytest.importorskip(library)
    command = [sys.executable, "docs/render.py", "--check"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.parametrize("source", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_rendered_notebook_has_the_cells_of_its_source_and_their_outputs(source, render):
    rendered = ROOT / "docs" / "rendered" / f"{source.stem}.ipynb"
    book = json.loads(rendered.read_text(encoding="utf-8"))
    found = [(cell["cell_type"], "".join(cell["source"])) for cell in book["cells"]]
    stale = f"run python docs/render.py --notebooks {source.stem}"
    assert found == render.cells(source), stale
    for cell in book["cells"]:
        if cell["cell_type"] == "code" and re.search(r"\.plot\(|\bplt\.", "".join(cell["source"])):
            assert any("image/png" in out.get("data", {}) for out in cell["outputs"]), stale
        for output in cell.get("outputs", ()):
            assert output["output_type"] != "error", stale


def test_the_reference_lists_each_plot_with_the_options_of_its_class(render):
    text = render.reference()
    assert "### `shown.Shown.plot`" in text
    for of in set(picture.registry) - {object}:
        entry = re.search(rf"^### class `{of.__name__}`\n(.*?)(?=^### )", text, re.M | re.S)[1]
        row = r"^\| \[`plot\((.*)\)`\]\(#shownshownplot\) \| (.+) \|$"
        ((call, _),) = re.findall(row, entry, re.M)
        options = list(inspect.signature(picture.dispatch(of)).parameters)[1:]
        assert all(option in call for option in options), call
