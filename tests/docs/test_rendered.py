"""Generated pages equal those of the present sources."""

import json
import re
import subprocess
import sys
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import pytest

from tests import words

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


def test_prose_has_no_words_to_avoid_and_no_long_sentences():
    assert [fault for path in words.files() for fault in words.faults(path)] == []


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("A walker who falls.", "'who'"),
        ("People who read `who` in\n```\nwhose\n```\n", None),
        ("It begins anew.", "'anew'"),
        (" ".join(["word"] * 31) + ".", "31 words"),
        (" ".join(["word"] * 30) + ".", None),
    ],
)
def test_words_and_long_sentences_are_found(text, said, tmp_path, monkeypatch):
    monkeypatch.setattr(words, "ROOT", tmp_path)
    page = tmp_path / "page.md"
    page.write_text(text, encoding="utf-8")
    found = list(words.faults(page))
    assert (said in found[0]) if said else not found, found


@pytest.mark.parametrize(
    "text",
    ["x = 1  # told by the caller", 'raise ValueError(f"{x} is told")', '"""It is told."""'],
    ids=["comment", "message", "docstring"],
)
def test_words_of_comments_messages_and_docstrings_are_found(text, tmp_path, monkeypatch):
    monkeypatch.setattr(words, "ROOT", tmp_path)
    module = tmp_path / "module.py"
    module.write_text(text, encoding="utf-8")
    (found,) = words.faults(module)
    assert "'told'" in found
