"""Tables of results name the command and the commit that they were made with."""

import importlib
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import gym_passive_walker as gpw
from benchmarks import tables
from benchmarks.anywhere import interval
from tests.docs.test_names import need
from tests.docs.test_shell import parse, parse_only, words_of  # noqa: F401  (a fixture)

ROOT = Path(__file__).parents[2]
PAGES = sorted((ROOT / "docs").glob("*.md"))

MADE = {
    f"{page.stem}/{name}": text
    for page in PAGES
    for name, text in re.findall(
        r"<!-- (.+?) -->\n(.*?)<!-- end of \1 -->", page.read_text(encoding="utf-8"), re.S
    )
}
"""Texts between markers, by PAGE/NAME."""

BY_HAND = (
    "anywhere", "benchmarks", "learners", "scaling", "stability## Mutation tests", "training",
    "web",
)  # fmt: skip
"""Pages, or a page from a heading on, with tables of results that no command writes."""

CODE = {key: sorted(set(re.findall(r"`([^`\n]+)`", text))) for key, text in MADE.items()}
"""Code that is mentioned in each text."""


def test_each_marker_has_its_end():
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        begins = re.findall(r"<!-- (?!end of )(.+?) -->", text)
        assert begins == re.findall(r"<!-- end of (.+?) -->", text), page


def test_the_list_has_every_table_and_no_other():
    assert set(tables.TABLES) == set(MADE)


@pytest.mark.parametrize("command", sorted(set(tables.TABLES.values())))
def test_each_command_exists(command, parse_only, pytestconfig):  # noqa: F811
    if command == "python -m tests.control.test_matrix":
        importlib.import_module("tests.control.test_matrix")
        return
    if "benchmarks.gpu " in command:
        need("gym_passive_walker.devices.gpu")
        assert command.split()[-1] in importlib.import_module("benchmarks.gpu").PARTS
        return
    parse(words_of(command), pytestconfig)


@pytest.mark.parametrize("key", sorted(MADE))
def test_each_table_names_its_command_and_a_commit(key):
    text = MADE[key]
    if not text.strip() or "not yet measured" in text or key == "analyses/pairs":
        return
    command, commits = re.findall(r"^\*`(.+?)`.*?, (commits? `.*?)\*$", text, re.M)[-1]
    assert command == tables.TABLES[key]
    assert re.fullmatch(r"commits? `[0-9a-f]{7,}\+?`((, | and )`[0-9a-f]{7,}\+?`)*", commits)


@pytest.mark.parametrize("key", sorted(MADE))
def test_each_table_with_a_run_time_names_its_machine(key):
    text = MADE[key]
    if key == "agents/benchmark":  # made by several runs
        text = (ROOT / "docs" / "agents.md").read_text(encoding="utf-8")
    timed = re.search(r"(?<!['’])\b(?:[µnm]?s|seconds|minutes)\b", text.partition("\n*`")[0])
    if timed and "not yet measured" not in text:
        assert re.search(r"(EPYC|Xeon|Core|Ryzen|Apple|ARM|x86_64|aarch64)", text), timed[0]


@pytest.mark.parametrize("page", BY_HAND)
def test_each_table_of_results_that_is_written_by_hand_names_a_commit(page):
    name, mark, heading = page.partition("#")
    text = (ROOT / "docs" / f"{name}.md").read_text(encoding="utf-8")
    text = text[text.index(mark + heading) :]
    text = re.sub(r"<!-- (.+?) -->\n.*?<!-- end of \1 -->", "", text, flags=re.S)
    for table, rest in re.findall(r"((?:^\|.*\n)+)\n?(.*)", text, re.M):
        rows = table.splitlines()[2:]
        numbers = len(re.findall(r"\d\.\d|\d{2,}", "".join(rows)))
        if numbers >= max(6, len(rows)):
            assert re.fullmatch(r"\*.*commits? `[0-9a-f]{7,}`.*\*", rest), rows[0]


@pytest.mark.parametrize("key", sorted(CODE))
def test_each_module_and_public_name_in_a_table_exists(key):
    for code in CODE[key]:
        if re.fullmatch(r"gpw\.[\w.]+", code):
            assert hasattr(gpw, code.split(".")[1]), code
        elif re.fullmatch(r"[a-z_]+", code) and key == "design/tuned" and code != "heavy":
            assert hasattr(gpw, code), code
    packages = {path.name for path in (ROOT / "gym_passive_walker").iterdir() if path.is_dir()}
    for name in re.findall(r"(?<=[|`\s])((?:[a-z_]+\.)+[a-z_]+)(?=[|`\s])", MADE[key]):
        first, *rest = name.split(".")
        if first in packages:  # functions inside the package may have changed since the run
            importlib.import_module(f"gym_passive_walker.{first}.{rest[0]}")


def test_the_interval_of_a_percentile_is_narrower_with_more_bodies():
    draws = np.random.default_rng(1).normal(1.0, 0.2, 900)
    widths = []
    for count in (30, 900):
        low, high = (float(x) / 100.0 for x in re.findall(r"[\d.]+", interval(draws[:count], 50)))
        assert low < 1.0 < high
        widths.append(high - low)
    # The standard error of a normal sample's median is 1.253 σ / √n.
    assert widths[1] == pytest.approx(2 * 1.96 * 1.253 * 0.2 / 30.0, rel=0.2)
    assert widths[0] > 3.0 * widths[1]
    assert interval(draws[:0], 50) == ""


def test_the_list_is_printed_and_an_unknown_name_is_an_error(capsys, monkeypatch):
    monkeypatch.setattr(sys, "argv", ["tables"])
    assert tables.main() == 0
    printed = capsys.readouterr().out
    assert all(key in printed and command in printed for key, command in tables.TABLES.items())
    monkeypatch.setattr(sys, "argv", ["tables", "no such"])
    with pytest.raises(SystemExit):
        tables.main()
    assert "not in the list" in capsys.readouterr().err


def test_tables_are_made_again_by_their_commands(monkeypatch, capsys):
    ran = []

    def run(words, **_):
        ran.append(words)
        return subprocess.CompletedProcess(words, len(ran) - 1)

    monkeypatch.setattr(subprocess, "run", run)
    monkeypatch.setattr(sys, "argv", ["tables", "tick", "benchmarks/parts of a stride", "gauntlet"])
    assert tables.main() == 1  # the second fails, so that the third is not tried
    assert [words[1:] for words in ran] == [
        ["-m", "benchmarks.work_precision", "ticks"], ["-m", "benchmarks.performance", "strides"],
    ]  # fmt: skip


def test_each_command_of_a_group_exists_and_keeps_a_file_of_its_own(parse_only, pytestconfig):  # noqa: F811
    for steps in tables.GROUPS.values():
        commands = [step for step in steps if step not in tables.TABLES]
        assert all("/" not in step.split()[0] for step in commands)
        assert len({tables.record(command) for command in commands}) == len(commands)
        for command in commands:
            parse(words_of(command), pytestconfig)


def test_a_group_skips_what_the_present_code_made_and_goes_on_where_it_failed(
    tmp_path, monkeypatch, capsys
):
    git = ["git", "-c", "user.name=a", "-c", "user.email=a@b", "-C", str(tmp_path)]
    page, code = tmp_path / "docs" / "page.md", tmp_path / "agents" / "code.py"
    for path in (page, code):
        path.parent.mkdir()
    code.write_text("print('row')\n")
    (tmp_path / "fails.py").write_text("raise SystemExit(3)\n")

    def commits(text):
        code.write_text(text)
        subprocess.run([*git, "add", "."], check=True)
        subprocess.run([*git, "commit", "-qm", "a"], check=True)
        return tables.commit()

    subprocess.run(["git", "init", "-q", tmp_path], check=True)
    monkeypatch.setattr(tables, "DOCS", tmp_path / "docs")
    monkeypatch.setattr(tables, "RECORDS", tmp_path / "runs" / "tables")
    monkeypatch.setattr(tables, "TABLES", {"page/one": "python agents/code.py"})
    steps = ["python agents/code.py", "page/one", "python fails.py"]
    monkeypatch.setattr(tables, "GROUPS", {"all": steps})
    monkeypatch.setattr(sys, "argv", ["tables", "all"])
    first = commits("print('row')\n")

    def ran():
        assert tables.main() == 3  # the last step fails, so it is never made
        return [line[2:] for line in capsys.readouterr().out.splitlines() if line[:2] == "$ "]

    page.write_text("<!-- one -->\nold\n<!-- end of one -->\n*commit `abc`*\n")
    assert ran() == [steps[0], "python agents/code.py", steps[2]]
    assert tables.record(steps[0]).read_text() == f"row\n\n*`{steps[0]}`, commit `{first}`*\n"
    assert not tables.record(steps[2]).exists()
    page.write_text(f"<!-- one -->\n*`a`, commits `{first}` and `{first}`*\n<!-- end of one -->\n")
    assert ran() == [steps[2]]
    second = commits("print('other')\n")
    assert ran() == [steps[0], "python agents/code.py", steps[2]]  # the code has changed
    page.write_text(f"<!-- one -->\n*`a`, commits `{second}` and `{first}`*\n<!-- end of one -->\n")
    assert ran() == ["python agents/code.py", steps[2]]
    code.write_text("print('not committed')\n")
    assert ran() == [steps[0], "python agents/code.py", steps[2]]
    assert ran() == [steps[0], "python agents/code.py", steps[2]]  # its commit has a "+"


def test_a_table_is_written_between_its_markers(tmp_path, monkeypatch, capsys):
    page = tmp_path / "benchmarks.md"
    page.write_text("above\n<!-- tick -->\nold\n<!-- end of tick -->\nbelow\n")
    monkeypatch.setattr(tables, "commit", lambda: "1234567")
    tables.keep("tick", "new", page)
    made = "new\n\n*`python -m benchmarks.work_precision ticks`, commit `1234567`*"
    assert page.read_text() == f"above\n<!-- tick -->\n\n{made}\n\n<!-- end of tick -->\nbelow\n"
    tables.keep("another", "one", page)
    assert page.read_text().endswith("<!-- end of another -->\n")
    assert "new" in capsys.readouterr().out
