"""Progress reports of long work."""

import io
import os
import time
from types import SimpleNamespace

import numpy as np
import pytest

import gym_passive_walker as gpw
from gym_passive_walker._tools import progress as module
from gym_passive_walker._tools.progress import compiling, progress


class Terminal(io.StringIO):
    """Standard error that claims to be a terminal, or not."""

    def isatty(self):
        """Whether this is a terminal."""
        return True


@pytest.fixture(scope="module", autouse=True)
def _compiled():
    """Compile the code of these tests, so that no notice of it appears."""
    gpw.gait_family("D", 0.005, 0.01)


@pytest.fixture
def terminal(monkeypatch):
    """A terminal on which each bar appears at once."""
    seen = Terminal()
    monkeypatch.setattr(module, "sys", SimpleNamespace(stderr=seen))
    monkeypatch.setattr(module, "_UNSEEN", 0.0)
    monkeypatch.setattr(module, "_PACE", 0.0)
    return seen


def pictures(seen):
    """Successive contents of the line."""
    return [text.rstrip() for text in seen.getvalue().split("\r")[1:]]


def test_a_bar_grows_and_goes(terminal):
    with progress("strides", 4) as taken:
        for _ in range(4):
            taken()
    *bars, last, home = pictures(terminal)
    assert [bar.split(",")[0] for bar in bars] == [
        f"strides [{'#' * 5 * n:-<20}] {n}/4" for n in (1, 2, 3, 4)
    ]
    assert last == home == ""


def test_work_within_work_stands_on_the_same_line(terminal):
    with progress("figures", 2) as drawn:
        with progress("gaits") as followed:
            followed(3)
        drawn()
    assert pictures(terminal)[0].startswith(f"figures [{'-' * 20}] 0/2, gaits 3, ")


def test_work_that_fails_leaves_nothing_on_the_line(terminal):
    with pytest.raises(KeyError), progress("strides", 2) as taken:
        taken()
        raise KeyError
    with progress("others", 2) as taken:
        taken()
    assert "strides" not in pictures(terminal)[-3]


def test_short_work_shows_nothing(terminal, monkeypatch):
    monkeypatch.setattr(module, "_UNSEEN", 60.0)
    gpw.gait_family("D", 0.005, 0.01)
    assert terminal.getvalue() == ""


def test_long_work_shows_how_far_it_is(terminal):
    gpw.gait_family("D", 0.005, 0.01)
    gpw.bifurcation_diagram("D", [0.005, 0.01], n_transient=5, n_recorded=40)
    said = terminal.getvalue()
    assert "gaits along a curve" in said and "strides [" in said and "strides kept [" in said


def test_without_a_terminal_there_are_no_bars(monkeypatch, capfd):
    monkeypatch.setattr(module, "_UNSEEN", 0.0)
    monkeypatch.setattr(module, "_PACE", 0.0)
    gpw.gait_family("D", 0.005, 0.01)
    assert capfd.readouterr() == ("", "")


def test_without_a_terminal_long_work_writes_a_line_every_minute(monkeypatch):
    log, clock = io.StringIO(), iter(np.arange(200.0))
    monkeypatch.setattr(module, "_LINE", module._Line())
    monkeypatch.setattr(module, "sys", SimpleNamespace(stderr=log))
    monkeypatch.setattr(module, "time", SimpleNamespace(monotonic=lambda: next(clock)))
    with progress("tasks", 150) as done:
        for _ in range(150):
            done(note="1/s")
    lines = log.getvalue().splitlines()
    assert [line.split("] ")[1] for line in lines] == ["60/150, 1/s, 60 s", "120/150, 1/s, 120 s"]


def test_long_compiling_is_announced_once_with_its_seconds(monkeypatch, capsys):
    monkeypatch.setattr(module, "_UNSAID", 0.05)
    with compiling("the kernel advance"):
        time.sleep(0.3)
    said = capsys.readouterr().err
    assert said.count("the kernel advance") == 1 and said.endswith(" s\n")
    assert 0.2 < float(said.split()[-2]) < 5.0


def test_quick_compiling_is_not_announced(capsys):
    with compiling("the kernel advance"):
        pass
    assert capsys.readouterr().err == ""


def test_a_bar_says_how_it_goes_and_none_where_the_terminal_is_anothers(terminal, monkeypatch):
    with progress("tasks", 4) as advance:
        advance(note="3/s, 1 failed")
    assert any("1/4, 3/s, 1 failed, " in text for text in pictures(terminal))
    before = terminal.getvalue()
    monkeypatch.setattr(module._LINE, "hushed", False)
    module.disable_progress()
    with progress("tasks", 4) as advance:
        advance()
    assert terminal.getvalue() == before


def test_work_of_one_part_has_no_bar_beside_others(terminal):
    with progress("one", 1) as alone:
        alone(0.0)
        assert terminal.getvalue() == ""
        with progress("many", 3) as inner:
            inner()
    assert pictures(terminal)[0].startswith("many [") and "one" not in terminal.getvalue()


def test_a_bar_is_full_at_most_and_counts_what_was_done(terminal):
    with progress("tasks", 4) as done:
        done(2.5)
        done(3)
    first, second, *_ = pictures(terminal)
    assert first.startswith("tasks [############--------] 2.5/4, ")
    assert second.startswith(f"tasks [{'#' * 20}] 5.5/4, ")


def test_a_bar_is_no_longer_than_the_terminal(terminal, monkeypatch):
    monkeypatch.setattr(
        module.shutil, "get_terminal_size", lambda *_, **__: os.terminal_size((30, 24))
    )
    with progress("a name that is much longer than the line", 4) as done:
        done()
        shorter = len(terminal.getvalue())
        done(note="a note")
    lines = terminal.getvalue().split("\r")[1:]
    assert all(len(line) in (0, 29) for line in lines) and shorter == 30
    assert lines[0] == "a name that is much longer than the line"[:29]


@pytest.fixture
def clock(monkeypatch):
    """A clock that is set by hand, and a line of its own."""
    now = SimpleNamespace(seconds=100.0)
    monkeypatch.setattr(module, "_LINE", module._Line())
    monkeypatch.setattr(module, "time", SimpleNamespace(monotonic=lambda: now.seconds))
    return now


def test_a_bar_appears_two_seconds_after_the_outermost_work_began(clock, monkeypatch):
    seen = Terminal()
    monkeypatch.setattr(module, "sys", SimpleNamespace(stderr=seen))
    with progress("outer", 3) as outer:
        clock.seconds += 1.99
        outer()
        assert seen.getvalue() == ""
        with progress("inner", 9) as inner:
            clock.seconds += 0.02
            inner()
            assert pictures(seen)[0].startswith("outer [") and ", inner [" in pictures(seen)[0]
            assert pictures(seen)[0].endswith(", 2 s")
            before = seen.getvalue()
            clock.seconds += 0.05  # too soon for another
            inner()
            assert seen.getvalue() == before
            clock.seconds += 0.06
            inner()
            assert "] 3/9, 2 s" in pictures(seen)[-1]
            before = seen.getvalue()
        assert seen.getvalue() == before  # the outer work goes on
    assert pictures(seen)[-2:] == ["", ""]


@pytest.mark.parametrize("terminal_or_log", ["terminal", "log"])
def test_while_others_work_the_line_is_shown_anew(terminal_or_log, clock, monkeypatch):
    seen = Terminal() if terminal_or_log == "terminal" else io.StringIO()
    monkeypatch.setattr(module, "sys", SimpleNamespace(stderr=seen))
    with progress("tasks", 5) as done:
        done(2)
        clock.seconds += 61.0
        module.show()
        assert "] 2/5, 61 s" in seen.getvalue()
        length = len(seen.getvalue())
        clock.seconds += 30.0
        module.show()
        assert (len(seen.getvalue()) > length) == (terminal_or_log == "terminal")
    module.show()  # no work, no line


def test_a_later_work_in_a_log_is_reported_a_minute_after_it_began(clock, monkeypatch):
    log = io.StringIO()
    monkeypatch.setattr(module, "sys", SimpleNamespace(stderr=log))
    for name in ("first", "second"):
        with progress(name, 5) as done:
            for _ in range(13):
                clock.seconds += 5.0
                done(0.25)
        clock.seconds += 500.0
    assert [line.split(" [")[0] for line in log.getvalue().splitlines()] == ["first", "second"]
    assert all(line.endswith("3/5, 60 s") for line in log.getvalue().splitlines())


def test_without_standard_error_nothing_is_shown(clock, monkeypatch):
    monkeypatch.setattr(module, "sys", SimpleNamespace(stderr=None))
    with progress("tasks", 5) as done:
        clock.seconds += 100.0
        done()
    module._tell("nothing")


def test_one_compilation_within_another_is_reported_once(monkeypatch):
    heard = []
    monkeypatch.setattr(module, "COMPILING", [heard.append])
    with compiling("a kernel"), compiling("its equations"):
        assert heard == [True]
    assert heard == [True, False]
