"""Each shell command of the documentation is parsed, and the cheap ones are run."""

import argparse
import json
import re
import runpy
import shlex
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

from benchmarks import tables
from gym_passive_walker.apps.cli import main
from gym_passive_walker.pictures.figures import FIGURES
from tests.cli import test_commands
from tests.numbers import alike

ROOT = Path(__file__).parents[2]

PAGES = [
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    ROOT / "benchmarks" / "README.md",
    *sorted((ROOT / "docs").glob("*.md")),
]


def lines_of(page):
    blocks = re.findall(r"```(?:sh|bash|console)\n(.*?)```", page.read_text(), re.S)
    return [line for block in blocks for line in block.splitlines() if line.strip()]


COMMANDS = list(dict.fromkeys(line for page in PAGES for line in lines_of(page)))

INLINE = sorted(
    {
        " ".join(line.split())
        for page in [*PAGES, *sorted((ROOT / "docs" / "notebooks").glob("*.md"))]
        for line in re.findall(
            r"(?<!`)`((?:python|passive-walker) [^`]*)`(?!`)",
            re.sub(r"```.*?```", "", page.read_text(), flags=re.S),
        )
    }
)
"""Commands within sentences and tables."""

PARSE_NOTHING = (
    "benchmarks.gpu", "examples.own_tasks", "examples.stride_controllers",
    "examples.potential_shaping",
    "tests.control.test_matrix", "tests.everywhere", "tests.web.measure", "tests.words",
)  # fmt: skip
"""Modules that run without a parser, or only where there is a GPU."""

INCOMPLETE = r"python -c|.*(\.\.\.|…|\b[A-Z]{2,})"
"""How commands begin that are code, or that leave words to the reader."""

FILES = {
    name: content
    for page in PAGES
    for name, content in re.findall(
        r"`(\w+\.(?:json|yaml|py))`:\n\n```(?:json|yaml|python)\n(.*?)```", page.read_text(), re.S
    )
}
"""Files that a page prints, by their names."""

USERS_OWN = ("own.yaml", "sample.json")
"""Files that a page leaves to the user, or that a long command before writes."""

ONLY_PARSED = {
    r"passive-walker \w+ policy|python train\.py gait brisk": "test_tutorial trains it",
    r"passive-walker figures 4.* --out figures$": "test_figures draws each",
    r"passive-walker video": "videos take a minute",
    r"passive-walker sweep": "ten thousand tasks",
    r"passive-walker warmup": "compiles everything, which takes minutes",
    r"python train\.py(?! optimal --scene level +#| evaluate level-| gait )": "trains",
    r".*python3? -m (pytest|venv|pip|benchmarks|agents)": "installs, tests or measures for long",
    r".*pip install": "installs",
    r".*/python train\.py$": "trains for minutes",
    r"make": "installs, tests or trains",
}
"""Which commands are not run but only read by their own parser, and why."""


class Parsed(BaseException):
    """A command's own parser understood its arguments."""


def words_of(line):
    words = shlex.split(line, comments=True)
    while "=" in words[0]:  # a variable of the environment
        words = words[1:]
    return words


@pytest.fixture
def parse_only(monkeypatch):
    parse = argparse.ArgumentParser.parse_args

    def stop(self, *args, **options):
        parse(self, *args, **options)
        raise Parsed

    monkeypatch.setattr(argparse.ArgumentParser, "parse_args", stop)


def parse(words, config):
    """Let a command read its arguments, and do nothing."""
    program = Path(words[0]).name
    if program == "make":
        subprocess.run(["make", "-n", *words[1:]], cwd=ROOT, check=True, capture_output=True)
        return
    if program == "passive-walker":
        with pytest.raises(Parsed):
            main(words[1:])
        return
    if program == "pip":
        words = ["python", "-m", "pip", *words[1:]]
    if words[1:3] == ["-m", "pip"]:
        from pip._internal.commands import create_command

        create_command(words[3]).parse_args(words[4:])
        return
    if words[1:3] == ["-m", "pytest"]:
        config._parser.parse(words[3:])
        return
    if words[1:3] == ["-m", "agents.rllib"]:
        pytest.importorskip("ray")
    with pytest.MonkeyPatch.context() as patch, pytest.raises(Parsed):
        module = words[1] == "-m"
        patch.setattr(sys, "argv", words[2:] if module else words[1:])
        for name in (words[2], f"{words[2]}.__main__") if module else ():  # or runpy warns
            patch.delitem(sys.modules, name, raising=False)
        if module:
            runpy.run_module(words[2], run_name="__main__", alter_sys=True)
        else:
            runpy.run_path(str(ROOT / words[1]), run_name="__main__")


def _reason(line):
    return next((why for how, why in ONLY_PARSED.items() if re.match(how, line)), None)


@pytest.mark.parametrize("line", [line for line in COMMANDS if _reason(line)])
def test_a_long_command_is_understood_by_its_own_parser(line, parse_only, pytestconfig):
    for part in line.partition("#")[0].split("&&"):
        parse(words_of(part), pytestconfig)


@pytest.mark.parametrize("line", [line for line in INLINE if not re.match(INCOMPLETE, line)])
def test_a_command_in_a_sentence_is_understood_by_its_own_parser(line, parse_only, pytestconfig):
    words = words_of(line)
    if words[2:] and words[2] in PARSE_NOTHING:
        known = len(words) == 3 or line in tables.TABLES.values()  # see test_tables
        assert find_spec(words[2]) and known
    elif len(words) == 2 and words[0] == "passive-walker":
        words.append("--help")  # the sentence names the command alone
        with pytest.raises(SystemExit):
            parse(words, pytestconfig)
    else:
        parse(words, pytestconfig)


def _is_in_help(line):
    return shlex.join(words_of(line)[1:]) in test_commands.LINES  # where each is run


@pytest.mark.parametrize(
    "line", [line for line in COMMANDS if not _reason(line) and not _is_in_help(line)]
)
def test_a_short_command_does_what_it_says(line, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    for name, content in FILES.items():
        Path(name).write_text(content)
    words = words_of(line)
    if words[1:2] == ["play"] and "--seconds" not in words:
        words += ["--seconds", "0.1"]
    if words[0] == "python":
        assert words[1] == "train.py"
        train = pytest.importorskip("train")
        status = train.main(words[2:])
    else:
        assert words[0] == "passive-walker"
        status = main(words[1:])
    assert status == 0, capsys.readouterr().err


OUTPUTS = {
    " ".join(command.split()): output
    for page in PAGES
    for command, output in re.findall(
        r"`(passive-walker [^`]+)`(?:[^`]|`(?!``))*?:\n\n```text\n(.*?)```", page.read_text(), re.S
    )
}
"""What pages show as the output of a command that the sentence before names."""


@pytest.mark.parametrize("line", OUTPUTS)
def test_a_command_prints_what_its_page_shows(line, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(words_of(line)[1:]) == 0
    shown, printed = (
        text.strip().splitlines() for text in (OUTPUTS[line], capsys.readouterr().out)
    )
    for before, now in zip(shown, printed, strict=True):
        assert alike(before, now, 1e-3, 1e-6), f"{before}, now {now}"


def test_outputs_are_found():
    assert len(OUTPUTS) == 1


def test_each_figure_has_its_command():
    drawn = (line.split() for line in COMMANDS if line.startswith("passive-walker figures 4"))
    assert sorted({name for words in drawn for name in words if name[0] == "4"}) == sorted(FIGURES)


def test_each_reason_not_to_run_a_command_is_needed():
    for how in ONLY_PARSED:
        assert any(re.match(how, line) for line in COMMANDS), how


@pytest.mark.parametrize("line", COMMANDS)
def test_each_file_that_a_command_reads_is_there_or_printed(line):
    for word in words_of(line):
        if word.endswith((".json", ".yaml", ".txt")) and word not in USERS_OWN:
            assert word in FILES or (ROOT / word).exists(), f"nobody has {word}"


@pytest.mark.parametrize("line", COMMANDS)
def test_each_extra_that_a_command_installs_is_known(line):
    declared = (ROOT / "pyproject.toml").read_text()
    for group in re.findall(r"install .*\[([\w,-]+)\]", line):
        assert "gym-passive-walker[" not in line, "no index has the package"
        for name in group.split(","):
            assert re.search(rf"^{name} = \[", declared, re.M), name


def test_printed_files_are_valid():
    assert "mine.json" in FILES
    for name, content in FILES.items():
        if name.endswith(".json"):
            json.loads(content)
