"""The Python code of the documentation runs."""

import os
import re
import subprocess
import sys
import tomllib
from importlib.util import find_spec
from pathlib import Path

import pytest

import gym_passive_walker as gpw
from tests.docs.printed import Printed

DOCS = Path(__file__).parents[2]


PAGES = sorted(
    str(page.relative_to(DOCS))
    for page in [DOCS / "README.md", *(DOCS / "docs").glob("*.md")]
    if "```python" in page.read_text() and not page.name.startswith(("extending", "howto"))
)  # these have tests of their own

HOW_TO = sorted((DOCS / "docs").glob("howto*.md"))

RECIPES = {
    section.partition("\n")[0]: "\n".join(re.findall(r"```python\n(.*?)```", section, re.S))
    for page in HOW_TO
    for section in re.split(r"^## ", page.read_text(), flags=re.M)[1:]
    if "```python" in section
}
"""The code of each section of the how-to, by its title."""

NEEDS = {
    "import torch": "torch",
    "stable_baselines3": "stable_baselines3",
    "torchrl": "torchrl",
    ".onnx": "onnxruntime",
    "RecordVideo": "moviepy",
}
"""Libraries of extras, by a word in the recipes that need them."""


@pytest.mark.parametrize("page", HOW_TO, ids=lambda page: page.stem)
def test_each_recipe_is_in_the_list_of_goals(page):
    head, *sections = re.split(r"^## (.+)$", page.read_text(), flags=re.M)
    anchors = [re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in sections[::2]]
    assert [anchor for anchor in anchors if f"(#{anchor})" not in head] == []


@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # torchrl warns of what it uses itself
@pytest.mark.parametrize("recipe", RECIPES)
def test_a_recipe_runs_by_itself(recipe, monkeypatch, tmp_path, capsys):
    code = RECIPES[recipe]
    for word, library in NEEDS.items():
        if word in code:
            pytest.importorskip(library)
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    monkeypatch.chdir(tmp_path)
    Printed().run(code, recipe)


@pytest.mark.parametrize("page", PAGES)
def test_the_code_on_a_page_runs_from_top_to_bottom(page, monkeypatch, tmp_path, capsys):
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    monkeypatch.chdir(tmp_path)  # some write files
    blocks = re.findall(r"```python\n(.*?)```", (DOCS / page).read_text(), re.S)
    if "gpw.sweep(" in "".join(blocks):
        pytest.importorskip("pyarrow")
    for learner in ("torch", "stable_baselines3"):  # a large extra; pages without it run anywhere
        if re.search(rf"(import|from) {learner}\b", "".join(blocks)):
            pytest.importorskip(learner)
    Printed().run("\n".join(blocks), page)


@pytest.mark.parametrize(
    ("comment", "right"),
    [
        ("0.757 s, 0.389 m", True), ("0.756 s, 0.389 m", False), ("39 % of them", True),
        ("2, below 3", True), ("below 1", False), ("1.99 and 0.39", False), ("no float32", True),
        ("mean, and its 95 % interval", True),
        ("2.0, then 3", False), ("0.7", False), ("0.8", True), ("-0.757", False),
    ],
)  # fmt: skip
def test_a_number_beside_a_print_is_one_that_is_printed(comment, right, capsys):
    code = f"for x in (0.75684, 2):\n    print(\n        x, 0.38915\n    )  # {comment}\n"
    if right:
        Printed().run(code, "page")
    else:
        with pytest.raises(AssertionError, match=r"is not printed, but 0\.75684 0\.38915"):
            Printed().run(code, "page")


@pytest.mark.slow
def test_the_code_of_a_sweep_is_a_plain_script(tmp_path):
    pytest.importorskip("pyarrow")
    page = (DOCS / "docs" / "scaling.md").read_text()
    script = tmp_path / "feet.py"
    script.write_text("\n".join(re.findall(r"```python\n(.*?)```", page, re.S)))
    done = subprocess.run(
        [sys.executable, script], cwd=tmp_path, capture_output=True, text=True,
        env={**os.environ, "PYTHONPATH": str(DOCS)},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr


def test_the_how_to_shows_a_walker_that_has_no_gait(capsys):
    page = (DOCS / "docs" / "howto.md").read_text()
    (code,) = re.findall(r"```python\n(try:.*?)```", page, re.S)
    exec(compile(code, "howto.md", "exec"), {"gpw": gpw})
    assert "no long-step gait" in capsys.readouterr().out


def test_the_digest_of_the_how_to_is_the_one_that_its_code_prints(capsys):
    page = (DOCS / "docs" / "howto.md").read_text()
    version, digest = re.search(r"Version ([\d.]+) prints `(\w+)`", page).groups()
    exec(compile(RECIPES["Reproduce a result on another machine"], "howto.md", "exec"), {})
    assert capsys.readouterr().out.split() == [version, digest]


def test_the_citation_has_the_package_s_version():
    for page in ("CITATION.cff", "docs/citing.md"):
        (version,) = re.findall(r"^ *version *[:=] *{?([\d.]+)", (DOCS / page).read_text(), re.M)
        assert version == gpw.__version__, page


def test_the_classifiers_name_the_versions_of_python_that_nox_tests():
    project = tomllib.loads((DOCS / "pyproject.toml").read_text("utf-8"))["project"]
    named = re.findall(r"Python :: (3\.\d+)$", "\n".join(project["classifiers"]), re.M)
    tested = re.findall(r'\("(3\.\d+)", "highest"\)', (DOCS / "noxfile.py").read_text("utf-8"))
    assert named == tested != []
    assert project["requires-python"] == f">={named[0]}"


def test_each_fragment_of_the_changelog_is_of_a_kind_that_towncrier_prints():
    pytest.importorskip("towncrier")
    command = [sys.executable, "-m", "towncrier", "build", "--draft", "--version", "next"]
    done = subprocess.run(command, cwd=DOCS, capture_output=True, text=True, check=True)
    for fragment in (DOCS / "changelog.d").iterdir():
        assert fragment.read_text("utf-8").partition("\n")[0] in done.stdout, fragment.name


def test_the_new_names_of_former_modules_are_modules():
    table = (DOCS / "docs" / "api.md").read_text("utf-8").split("|---|---|---|\n")[1]
    for row in table.partition("\n\n")[0].splitlines():
        for name in re.findall(r"`([\w.]+)`", "|".join(row.split("|")[2:])):
            assert find_spec(f"gym_passive_walker.{name}"), name
