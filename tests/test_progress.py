"""Progress reports of long work."""

import io
import re
import sys
import time
from types import SimpleNamespace

import numpy as np
import pytest

import gym_passive_walker as gpw
from gym_passive_walker._tools import progress as module
from gym_passive_walker._tools.progress import compiling, progress


class Terminal(io.StringIO):
    """Standard error that claims to be a terminal."""

    def isatty(self):
        """Whether this is a terminal."""
        return True


@pytest.fixture(scope="module", autouse=True)
def _compiled():
    """Compile the code of these tests, so that no notice of it appears."""
    gpw.gait_family("D", 0.005, 0.01)


@pytest.fixture(autouse=True)
def _alone(monkeypatch):
    """No work but that of a test."""
    monkeypatch.setattr(module, "_STATE", module._State())


@pytest.fixture
def clock(monkeypatch):
    """A clock that is set by hand."""
    now = SimpleNamespace(seconds=100.0)
    monkeypatch.setattr(module, "time", SimpleNamespace(monotonic=lambda: now.seconds))
    return now


@pytest.fixture
def terminal(monkeypatch):
    """A terminal on which each bar appears at once."""
    seen = Terminal()
    monkeypatch.setattr(module, "sys", SimpleNamespace(stderr=seen, modules={}))
    monkeypatch.setattr(module, "_UNSEEN", 0.0)
    monkeypatch.setattr(module, "_PACE", 0.0)
    return seen


def bars(seen):
    """Successive bars, without their time: texts between returns of the cursor."""
    texts = re.split(r"\r|\n|\x1b\[A", seen.getvalue())
    return [text.partition(" [")[0] for text in texts if text.strip()]


def test_a_bar_grows_and_goes(terminal):
    with progress("strides", 4) as taken:
        for _ in range(4):
            taken()
    shown = [bar.split("|") for bar in bars(terminal)]
    assert [(name, count) for name, _, count in shown] == [
        ("strides: ", f" {n}/4") for n in range(5)
    ]
    lengths = [len(bar.strip(" ")) for _, bar, _ in shown]
    assert lengths[0] == 0 and np.all(np.diff(lengths) > 0)
    assert terminal.getvalue().rpartition("[")[2].partition("\r")[2].strip() == ""


def test_work_within_work_has_a_bar_of_its_own(terminal):
    with progress("figures", 2) as drawn:
        with progress("gaits") as followed:
            followed(3)
        drawn()
    named = [bar.partition("|")[0] for bar in bars(terminal)]
    assert named == ["figures: ", "gaits: 0", "figures: ", "gaits: 3", "figures: "]


def test_work_that_fails_leaves_no_bar(terminal):
    with pytest.raises(KeyError), progress("strides", 2) as taken:
        taken()
        raise KeyError
    before = len(terminal.getvalue())
    with progress("others", 2) as taken:
        taken()
    assert "strides" not in terminal.getvalue()[before:]


def test_a_bar_has_notes_and_counts_parts_of_the_work(terminal, clock):
    with progress("tasks", 4) as done:
        done(2.5, note="3/s, 1 failed")
        clock.seconds += 61.0  # no line is written beside it
        done(3)
    assert "| 2.5/4 [00:00, 3/s, 1 failed]" in terminal.getvalue()
    assert bars(terminal)[-1].endswith(" 5.5/4") and "61 s" not in terminal.getvalue()


def test_work_of_one_part_has_no_bar_beside_others(terminal):
    with progress("one", 1) as alone:
        alone(0.0)
        assert terminal.getvalue() == ""
        with progress("many", 3) as inner:
            inner()
    assert bars(terminal)[0].startswith("many: ") and "one" not in terminal.getvalue()


def test_long_work_shows_how_far_it_is(terminal):
    gpw.gait_family("D", 0.005, 0.01)
    gpw.bifurcation_diagram("D", [0.005, 0.01], n_transient=5, n_recorded=40)
    names = {bar.partition(":")[0] for bar in bars(terminal)}
    assert {"gaits along a curve", "strides", "strides kept"} <= names


def test_short_work_shows_nothing(terminal, monkeypatch):
    monkeypatch.setattr(module, "_UNSEEN", 60.0)
    with progress("outer", 2) as outer, progress("inner", 2) as inner:
        inner()
        outer()
    assert terminal.getvalue() == ""


@pytest.mark.parametrize("hushed", ["by another's terminal", "without standard error"])
def test_no_bar_is_drawn_where_none_can_be_seen(hushed, terminal, clock, monkeypatch):
    if hushed == "without standard error":
        monkeypatch.setattr(module.sys, "stderr", None)
    else:
        module.disable_progress()
    with progress("tasks", 4) as done:
        clock.seconds += 100.0
        done()
    assert terminal.getvalue() == ""
    module._tell("")


@pytest.mark.parametrize("reason", ["log", "no tqdm", "notebook without widgets"])
def test_without_bars_long_work_writes_a_line_every_minute(reason, clock, monkeypatch):
    seen = Terminal() if reason == "no tqdm" else io.StringIO()
    modules = {"ipykernel.zmqshell": None} if "notebook" in reason else {}
    monkeypatch.setattr(module, "sys", SimpleNamespace(stderr=seen, modules=modules))
    monkeypatch.setattr(module, "find_spec", lambda _: None)
    if reason == "no tqdm":
        monkeypatch.setitem(sys.modules, "tqdm.auto", None)
    with progress("one", 1), progress("tasks", 150) as done:
        for _ in range(150):
            clock.seconds += 1.0
            done(note="1/s")
        with progress("others") as others:
            clock.seconds += 31.0
            others(2.5)
    assert seen.getvalue().splitlines() == [
        "tasks 60/150, 1/s, 60 s",
        "tasks 120/150, 1/s, 120 s",
        "tasks 150/150, 1/s, others 2.5, 181 s",
    ]


def test_while_others_work_the_line_is_written_again(clock, monkeypatch):
    monkeypatch.setattr(module, "sys", SimpleNamespace(stderr=(log := io.StringIO()), modules={}))
    with progress("tasks", 5) as done:
        done(2)
        for _ in range(3):
            clock.seconds += 31.0
            module.show()
    module.show()  # no work, no line
    assert log.getvalue() == "tasks 2/5, 62 s\n"


def test_a_later_work_in_a_log_is_reported_a_minute_after_it_began(clock, monkeypatch):
    monkeypatch.setattr(module, "sys", SimpleNamespace(stderr=(log := io.StringIO()), modules={}))
    for name in ("first", "second"):
        with progress(name, 5) as done:
            for _ in range(13):
                clock.seconds += 5.0
                done(0.25)
        clock.seconds += 500.0
    assert log.getvalue() == "first 3/5, 60 s\nsecond 3/5, 60 s\n"


IN_A_NOTEBOOK = """
from gym_passive_walker._tools import progress as module
module._UNSEEN, module._PACE = 1e-9, 0.0  # seconds
with module.progress("tasks", 3) as done:
    done(note="one")
    bar = module._STATE.works[0].bar
print(type(bar.container).__name__, bar.container.children[2].value, bar.container.comm)
"""


def test_a_notebook_has_a_bar_that_goes_although_its_work_ends_early():
    nbclient, nbformat = pytest.importorskip("nbclient"), pytest.importorskip("nbformat")
    book = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(IN_A_NOTEBOOK)])
    nbclient.NotebookClient(book, kernel_name="python3").execute()
    bar, printed = book.cells[0].outputs
    assert "application/vnd.jupyter.widget-view+json" in bar.data
    assert printed.text.replace("\u2007", " ") == "TqdmHBox  1/3 [00:00, one] None\n"


def test_long_compiling_is_announced_once_with_its_seconds(monkeypatch, capsys):
    monkeypatch.setattr(module, "_UNSAID", 0.05)
    with compiling("the kernel advance"):
        time.sleep(0.3)
    said = capsys.readouterr().err
    assert said.count("the kernel advance") == 1 and said.endswith(" s\n")
    assert 0.2 < float(said.split()[-2]) < 5.0


def test_a_notice_takes_the_place_of_bars(terminal, monkeypatch):
    monkeypatch.setattr(module, "_UNSAID", 0.05)
    with progress("outer", 2), progress("inner", 2) as inner:
        with compiling("the kernel advance"):
            time.sleep(0.3)
        inner()
    before, notice, after = terminal.getvalue().partition("gym_passive_walker compiles")
    assert re.search(r"\r +\r\n\r +\r\x1b\[A\Z", before) and "0.3 s\n" in notice + after
    assert "outer: " in after and "inner: " in after


def test_quick_compiling_is_not_announced(capsys):
    with compiling("the kernel advance"):
        pass
    assert capsys.readouterr().err == ""


def test_one_compilation_within_another_is_reported_once(monkeypatch):
    heard = []
    monkeypatch.setattr(module, "COMPILING", [heard.append])
    with compiling("a kernel"), compiling("its equations"):
        assert heard == [True]
    assert heard == [True, False]
