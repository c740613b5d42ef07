"""How programs print and end."""

import ast
import io
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import gym_passive_walker as gpw
from gym_passive_walker._tools import console

ROOT = Path(__file__).parents[1]
SOURCES = [ROOT / "train.py"]
for folder in ("gym_passive_walker", "agents", "benchmarks", "examples", "validation"):
    SOURCES += sorted((ROOT / folder).glob("**/*.py"))


def output(monkeypatch, encoding, errors="strict"):
    """Standard output of an encoding."""
    written = io.BytesIO()
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(written, encoding, errors=errors))
    return written


@pytest.mark.parametrize(
    ("encoding", "printed"),
    [
        ("ascii", b"speed / sqrt(g l), slope, ?, m/s^2, caf?"),
        ("latin-1", "speed / sqrt(g l), slope, ?, m/s², café".encode("latin-1")),
        ("utf-8", "speed / √(g l), γ, 歩, m/s², café".encode()),
    ],
)
def test_what_an_encoding_lacks_is_printed_in_plain_forms(encoding, printed, monkeypatch):
    written = output(monkeypatch, encoding)
    assert console.run(lambda: print("speed / √(g l), γ, 歩, m/s², café", end="")) == 0
    assert written.getvalue() == printed


def test_an_error_handler_of_the_users_own_stays(monkeypatch):
    written = output(monkeypatch, "ascii", "backslashreplace")
    console.run(lambda: print("√", end=""))
    assert written.getvalue() == rb"\u221a"


@pytest.mark.parametrize(
    "environment",
    [
        {"PYTHONIOENCODING": "ascii"},
        {"PYTHONIOENCODING": "latin-1"},
        {"LC_ALL": "C", "PYTHONUTF8": "0"},
    ],
    ids=str,
)
@pytest.mark.parametrize("program", [("-m", "gym_passive_walker", "gait", "lab", "0.036")])
def test_nothing_computed_is_lost_where_output_is_not_utf_8(program, environment):
    done = subprocess.run(
        [sys.executable, *program], env=os.environ | environment, cwd=ROOT, capture_output=True
    )
    assert done.returncode == 0
    assert b"speed / sqrt(g l)" in done.stdout and b"stable" in done.stdout


def test_every_program_prints_in_any_encoding():
    begins = re.compile(r'^if __name__ == "__main__":\n((?: {4}.*\n)+)', re.MULTILINE)
    programs = {
        path.relative_to(ROOT).as_posix(): path.read_text(encoding="utf-8") for path in SOURCES
    }
    programs = {name: text for name, text in programs.items() if begins.search(text)}
    # One prints JSON for another process, with whichever package is there; others print nothing.
    silent = {
        "benchmarks/regress_work.py",
        "gym_passive_walker/gaits/scenes/starts.py",
        "gym_passive_walker/devices/web/bookkeeping.py",
    }
    assert silent < programs.keys() and len(programs) > 20
    safe = (
        "console.run(",
        "console.print_in_any_encoding()",
        "command(__doc__",
        "from gym_passive_walker.apps.cli import main",
    )
    unsafe = {name for name, text in programs.items() if not any(said in text for said in safe)}
    assert unsafe == silent


def _text_files(tree):
    """Calls that open, read or write a file as text, each with whether it names an encoding."""
    for call in ast.walk(tree):
        if not isinstance(call, ast.Call):
            continue
        function = call.func
        name = getattr(function, "attr", getattr(function, "id", ""))
        owner = getattr(getattr(function, "value", None), "id", None)
        if owner in ("os", "Image", "tarfile", "zipfile", "webbrowser"):
            continue
        given = [*call.args, *(word.value for word in call.keywords)]
        words = [each.value for each in given if isinstance(each, ast.Constant)]
        named = "utf-8" in words or "utf8" in words
        if name in ("read_text", "write_text"):
            yield call, named
        elif name == "open" and not any(str(word) in ("rb", "wb", "ab", "xb") for word in words):
            yield call, named


def test_files_of_text_are_utf_8_on_every_machine():
    unnamed = [
        f"{path.relative_to(ROOT)}:{call.lineno}"
        for path in SOURCES
        for call, named in _text_files(ast.parse(path.read_text(encoding="utf-8")))
        if not named
    ]
    assert unnamed == []


INTERRUPTED = """
import importlib.abc, os, signal, sys
class Finder(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path, target=None):
        if name == "numpy":
            os.kill(os.getpid(), signal.SIGINT)
sys.meta_path.insert(0, Finder())
signal.signal(signal.SIGINT, signal.default_int_handler)
sys.argv[0] = "/usr/bin/" + sys.argv[1]
try:
    import gym_passive_walker
except BaseException as error:
    raise SystemExit(type(error).__name__)
"""


@pytest.mark.skipif(os.name == "nt", reason="Windows sends Ctrl-C to consoles, not to processes")
@pytest.mark.parametrize(
    ("program", "status", "said"),
    [
        ("passive-walker", 130, "stopped"),
        ("train.py", 130, "stopped"),
        ("mine.py", 1, "KeyboardInterrupt"),
    ],
)
def test_ctrl_c_while_loading_ends_this_projects_programs_in_a_line(program, status, said):
    line = [sys.executable, "-c", INTERRUPTED, program]
    done = subprocess.run(line, cwd=ROOT, capture_output=True, text=True)
    assert (done.returncode, done.stderr.strip()) == (status, said)


def test_ctrl_c_ends_a_command_in_a_line(capsys):
    def stop():
        raise KeyboardInterrupt

    assert console.run(stop, name="a program: ") == 130
    assert capsys.readouterr().err == "\na program: stopped\n"


def test_without_compilation_the_package_says_what_is_in_its_way():
    done = subprocess.run(
        [sys.executable, "-c", "import gym_passive_walker.engine.compiler"],
        env=os.environ | {"NUMBA_DISABLE_JIT": "1"}, cwd=ROOT, capture_output=True, text=True,
    )  # fmt: skip
    assert done.stderr.splitlines()[-1].startswith("ImportError") and "unset it" in done.stderr


@pytest.mark.parametrize("size", [0, 1, 199, 200, 201, 5000])
def test_a_long_text_keeps_its_beginning_and_its_end(size):
    text = "".join(chr(97 + i % 26) for i in range(size))
    found = console.cut(text)
    if size <= 200:
        assert found == text
    else:
        assert found == f"{text[:100]} ... {text[size - 100 :]}"


def test_an_error_of_a_file_is_its_name_and_the_system_s_words():
    for error, said in (
        (OSError(28, "No space left on device", "a.csv"), "a.csv: No space left on device"),
        (OSError(28, "No space left on device"), "No space left on device"),
        (OSError("torn"), "torn"),
        (ValueError("slope must be"), "slope must be"),
        (OSError(2, "No such file", b"a.csv"), "a.csv: No such file"),
        (OSError(36, "too long", "x" * 500), f"{'x' * 100} ... {'x' * 100}: too long"),
    ):
        assert console.sentence(error) == said


@pytest.mark.parametrize(
    ("error", "status"),
    [
        (None, 0), (3, 3), (0, 0), (gpw.GaitNotFound("none"), 1), (ValueError("wrong"), 2),
        (FileNotFoundError(2, "gone", "f"), 5), (KeyboardInterrupt(), 130), (BrokenPipeError(), 0),
    ],
)  # fmt: skip
def test_each_error_has_its_status_and_results_come_before_it(error, status, capsys, monkeypatch):
    monkeypatch.setattr(console, "forget_output", lambda: None)
    refusals = {gpw.GaitNotFound: 1, ValueError: 2, OSError: 5}

    def work():
        print("found")
        if isinstance(error, BaseException):
            raise error
        return error

    assert console.run(work, name="p: ", refusals=refusals, stopped="ended") == status
    said = capsys.readouterr()
    assert said.out == "found\n"
    expected = {1: "p: error: none\n", 2: "p: error: wrong\n", 5: "p: error: f: gone\n"}
    assert said.err == expected.get(status, "\np: ended\n" if status == 130 else "")
    with pytest.raises(KeyError):
        console.run(lambda: {}["x"], refusals=refusals)


def test_errors_of_files_alone_are_refusals_by_default(capsys):
    def work(error):
        raise error

    assert console.run(lambda: work(OSError(28, "full", "f"))) == 2
    assert capsys.readouterr().err == "error: f: full\n"
    with pytest.raises(ValueError, match="mine"):
        console.run(lambda: work(ValueError("mine")))
