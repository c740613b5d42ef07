"""A sweep that fails keeps what was finished, and can be resumed."""

import errno
import json
import os
import signal
import subprocess
import sys
import time
from collections import Counter, deque
from pathlib import Path

import numpy as np
import pytest

import gym_passive_walker as gpw
from examples.rimless_wheel import RIMLESS_WHEEL
from gym_passive_walker.apps.cli import main
from gym_passive_walker.apps.sweeps import run
from gym_passive_walker.apps.sweeps.store import DONE, FAILED, TIMED_OUT
from gym_passive_walker.apps.sweeps.version import version
from gym_passive_walker.apps.sweeps.workers import Workers
from tests.sweeps.odd import odd_sweep, same

pytest.importorskip("pyarrow")


def on_a_full_disk(path, data, write=Path.write_bytes):
    """Write a file; half of one of the dataset."""
    if ".parquet" in path.name:
        write(path, bytes(data)[: len(data) // 2])
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    return write(path, data)


def test_ten_thousand_tiny_tasks_are_ten_thousand_rows(odd):
    found = odd_sweep("square", odd / "out", 10_000, workers=2, seed=4)
    columns = found.columns()
    assert columns["task"].tolist() == list(range(10_000)) and found.failures == 0
    assert columns["square"].tolist() == [x * x for x in range(10_000)]
    assert set(columns["version"]) == {version("odd_tasks:square")} and set(columns["seed"]) == {4}
    assert columns["word"][3] == "3 4" and columns["odd"].dtype == bool


def test_a_worker_that_is_killed_is_replaced_and_its_task_done_again(odd):
    options = {"given": {"times": 1, "folder": str(odd)}, "workers": 2}
    killed = odd_sweep("dies", odd / "out", 12, **options)
    assert (odd / "lives").read_text() == "x" and killed.failures == 0
    same(killed, odd_sweep("dies", odd / "whole", 12, **options))


def test_a_task_that_always_takes_its_process_with_it_is_a_row(odd):
    given = {"times": 9, "folder": str(odd)}
    found = odd_sweep("dies", odd / "out", 8, given=given, workers=2)
    columns = found.columns()
    assert [*columns["status"]] == [FAILED if x == 5 else DONE for x in range(8)]
    assert "exit code -9" in columns["error"][5] and found.failures == 1
    assert (odd / "lives").read_text() == "x" * 2  # it is tried twice


@pytest.mark.parametrize(("over", "at"), [("times", 0), ("time_out", 5)])
def test_tasks_that_were_sent_to_a_lost_worker_are_done_in_their_order(over, at, odd):
    """Short tasks are sent several at a time; only the running one is lost."""
    pool = Workers("odd_tasks:square", 1, None)
    try:
        (worker,) = pool._pool
        waiting = deque([(9, {"x": 9})])
        worker.tasks.extend((number, {"x": number}) for number in range(at, at + 3))
        if over == "times":
            worker.process.kill()
            assert pool._lost(worker, waiting, Counter()) is None
            assert [number for number, _ in waiting] == [0, 1, 2, 9]
        else:
            pool._replace(worker, waiting)
            assert [number for number, _ in waiting] == [6, 7, 9]
        assert pool._pool[0] is not worker and not pool._pool[0].tasks
    finally:
        pool.close()


def test_a_task_that_hangs_or_fails_is_a_row_and_stops_no_other(odd):
    columns = odd_sweep("hangs", odd / "out", 6, time_out=0.5).columns()
    assert [*columns["status"]] == [DONE, DONE, TIMED_OUT, FAILED, DONE, DONE]
    assert columns["error"][2] == "given up after 0.5 s"
    assert columns["error"][3] == "ValueError: three is too many"
    assert np.isnan(columns["square"][[2, 3]]).all() and columns["square"][5] == 25


def test_compilation_is_reported_once_and_does_not_count_towards_the_time_out(odd, capfd):
    columns = odd_sweep("compiles", odd / "out", 2, time_out=0.5, workers=2).columns()
    assert [*columns["status"]] == [DONE, TIMED_OUT] and columns["seconds"][0] > 1.5
    assert capfd.readouterr().err.count("compiles a test, this once ...") <= 1


@pytest.mark.slow
def test_a_sweep_compiles_what_its_tasks_use(tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    over, given = {"slope": [0.009]}, {"walker": "D"}
    assert gpw.sweep("gait", tmp_path / "out", over=over, given=given, workers=1).failures == 0
    made = {path.name.split("-")[0] for path in tmp_path.glob("gym_passive_walker/*/*.o")}
    assert made == {"simplest", "newton.eliminate", "run.integrate"}


def test_results_of_another_kind_are_an_error_in_their_row(odd):
    found = odd_sweep("changeable", odd / "out", [1, 2, 0])
    assert found.failures == 1
    said = "it found cube (int64), where others found square (int64)"
    assert found.columns()["error"][2] == said


@pytest.mark.parametrize("sent", [signal.SIGKILL, signal.SIGINT], ids=["killed", "Ctrl-C"])
def test_a_sweep_that_was_stopped_does_the_rest_alone_and_ends_as_if_it_had_not(odd, sent):
    (odd / "kept").mkdir()
    over, given = {"x": list(range(120))}, {"folder": str(odd)}
    text = json.dumps({"analysis": "odd_tasks:noted", "over": over, "given": given})
    (odd / "kept.json").write_text(text)
    words = ["sweep", str(odd / "kept.json"), "--trust"]
    command = [sys.executable, "-m", "gym_passive_walker", *words]
    # A process in the background of a shell ignores Ctrl-C, and so would its children.
    usual = signal.signal(signal.SIGINT, signal.default_int_handler)
    process = subprocess.Popen([*command, "--workers", "2"], stderr=subprocess.PIPE, text=True)
    signal.signal(signal.SIGINT, usual)
    journal, deadline = odd / "kept" / "journal.jsonl", time.monotonic() + 120.0
    while not (journal.exists() and journal.read_text().count("\n") >= 10):
        assert process.poll() is None and time.monotonic() < deadline
        time.sleep(0.01)
    process.send_signal(sent)
    said = process.communicate()[1]
    assert process.returncode == (130 if sent == signal.SIGINT else -signal.SIGKILL)
    assert ("tasks are kept in" in said and "to continue" in said) == (sent == signal.SIGINT)
    time.sleep(0.5)  # for workers that nobody watches any more to leave
    begun = (odd / "noted").read_text().count("\n")
    assert 10 <= begun < 120
    kept = [line for line in journal.read_text().splitlines() if line.endswith("}")]
    kept = {row["task"] for row in map(json.loads, kept) if "task" in row}
    assert main([*words, "--workers", "1", "--json"]) == 0
    # Done twice is only what had not come back.
    done = [int(line.split()[0]) for line in (odd / "noted").read_text().splitlines()]
    assert set(done) == set(range(120))
    assert len(kept) >= 9 or sent == signal.SIGINT  # which has put them into rows
    assert all(done.count(task) == 1 for task in kept)
    stopped = run.SweepResult(odd / "kept", 120, 0)
    whole = gpw.sweep(json.loads(text), odd / "whole", trust=True, workers=1)
    same(stopped, whole)


def test_what_failed_is_done_once_more_if_that_is_asked_for_and_nothing_else(odd):
    given = {"times": 2, "folder": str(odd)}
    first = odd_sweep("dies", odd / "out", 8, given=given)
    assert first.failures == 1 and first.columns()["status"][5] == FAILED
    kept = odd_sweep("dies", odd / "out", 8, given=given)
    assert kept.failures == 1 and (odd / "lives").read_text() == "xx"
    again = odd_sweep("dies", odd / "out", 8, given=given, retry=True)
    before, after = first.columns(), again.columns()
    assert again.failures == 0 and [*after["square"]] == [x * x for x in range(8)]
    others = np.arange(8) != 5
    np.testing.assert_array_equal(before["seconds"][others], after["seconds"][others])


def test_a_full_disk_loses_nothing_finished(odd, monkeypatch):
    given = {"folder": str(odd)}
    with monkeypatch.context() as patch:
        patch.setattr(Path, "write_bytes", on_a_full_disk)
        with pytest.raises(OSError, match=r"No space left on device.*free some space.*to continue"):
            odd_sweep("noted", odd / "out", 9, given=given)
    assert not list((odd / "out" / "rows").iterdir())
    found = odd_sweep("noted", odd / "out", 9, given=given)
    assert (odd / "noted").read_text().count("\n") == 9  # nothing was done again
    assert found.columns()["square"].tolist() == [x * x for x in range(9)]
    assert not list((odd / "out").glob("*.aside"))


def test_a_sweep_of_another_version_or_description_is_refused_or_branches(odd):
    """A branch has the name of the folder and of its digest."""
    odd_sweep("square", odd / "out", 12)
    for x, other, entry in ((12, {"seed": 9}, "seed"), (5, {}, "over")):
        said = f"holds a sweep with another {entry}: give another folder, or use a new folder"
        with pytest.raises(ValueError, match=said):
            odd_sweep("square", odd / "out", x, **other)
    beside = odd_sweep("square", odd / "out", 5, branch=True)
    assert beside.folder == odd / f"out-{beside.description().digest[:8]}"
    assert len(beside.columns()["x"]) == 5
    again = odd_sweep("square", odd / "out", 12, branch=True)
    assert again.folder == odd / "out" and len(again.columns()["x"]) == 12
    (odd / "odd_tasks.py").write_text((odd / "odd_tasks.py").read_text() + "# another\n")
    with pytest.raises(ValueError, match="was computed by version"):
        odd_sweep("square", odd / "out", 12)


def test_a_folder_of_other_things_is_left_alone(odd):
    with pytest.raises(ValueError, match="does not contain a sweep"):
        odd_sweep("square", odd, 12)


def test_gaits_are_the_same_by_one_worker_and_by_two(tmp_path):
    described = {
        "analysis": "gait", "over": {"slope": [0.02, 0.03, 0.04], "walker": ["C", "E"]},
    }  # fmt: skip
    found = [gpw.sweep(described, tmp_path / str(n), workers=n) for n in (1, 2)]
    same(*found)
    assert all(each.failures == 0 for each in found)
    assert found[0].columns()["stance_angle"][2] == gpw.find_gait("C", 0.03).stance_angle


@pytest.mark.slow
def test_on_a_disk_that_fills_up_nothing_finished_is_lost(odd):
    """A disk of 300 kB, in a place of its own that ends with the processes that see it."""
    disk = odd / "disk"
    disk.mkdir()
    much = {"analysis": "odd_tasks:square", "over": {"x": list(range(5000))}}
    (odd / "much.json").write_text(json.dumps(much))
    sweep = f"{sys.executable} -m gym_passive_walker sweep {odd}/much.json --trust --out {disk}/out"
    script = (
        f"mount -t tmpfs -o size=300k none {disk} || exit 77\n"
        f"{sweep} --workers 1; echo first $?\n"
        f"cp {disk}/out/journal.jsonl {odd}/before\n"
        f"mount -o remount,size=30m {disk}\n"
        f"{sweep} --workers 1 --json && cp -r {disk}/out {odd}/kept"
    )
    alone = ["unshare", "--user", "--map-root-user", "--mount", "sh", "-c", script]
    try:
        reported = subprocess.run(alone, capture_output=True, text=True, timeout=300)
    except FileNotFoundError:
        pytest.skip("there is no unshare here")
    if reported.returncode in (1, 77) and "first" not in reported.stdout:
        pytest.skip(f"no disk of one's own here: {reported.stderr}")
    said = reported.stderr
    assert "No space left on device" in said and "repeat the call to continue" in said
    assert reported.returncode == 0 and "first 0" not in reported.stdout
    columns = run.SweepResult(odd / "kept", 5000, 0).columns()
    assert columns["square"].tolist() == [x * x for x in range(5000)]
    whole = [line for line in (odd / "before").read_text().splitlines() if line.endswith("}")]
    before = [json.loads(line) for line in whole]
    assert 100 < len(before) < 5000
    assert all(columns["seconds"][row["task"]] == row["seconds"] for row in before)


OWN = """
from dataclasses import replace
from examples.rimless_wheel import RIMLESS_WHEEL

WHEEL = RIMLESS_WHEEL
NUMBER = 3

def steep():
    return {"system": WHEEL, "slope": 0.08, "max_stride_time": 9.0}
"""


def test_a_system_and_a_scene_of_one_s_own_are_swept_by_their_names(odd):
    (odd / "own_things.py").write_text(OWN)
    gaits = {
        "analysis": "gait", "over": {"slope": [0.07, 0.08], "walker": ["own_things:WHEEL"]},
    }  # fmt: skip
    swept = gpw.sweep(gaits, odd / "gaits", trust=True, workers=1)
    expected = [gpw.find_gait(RIMLESS_WHEEL, slope).step_period for slope in (0.07, 0.08)]
    assert swept.columns()["step_period"] == pytest.approx(expected)
    assert swept.columns()["version"][0] != version("gait")  # the module's source counts
    assert swept.plot(x="slope", y="step_period", by="found")
    walks = {
        "analysis": "evaluation", "over": {"scene": ["own_things:steep", "lab"]},
        "given": {"controller": "passive", "episodes": 2},
    }  # fmt: skip
    rows = gpw.sweep(walks, odd / "walks", trust=True, workers=1).columns()
    assert set(rows["status"]) == {"done"}
    code = (gaits, "walker 'own_things:WHEEL'"), (walks, "scene 'own_things:steep'")
    for content, what in code:
        with pytest.raises(ValueError, match=f"the {what} is code that is not the package's"):
            gpw.sweep(content, odd / "refused")


@pytest.mark.parametrize(
    ("walker", "said"),
    [
        (RIMLESS_WHEEL, "name the system 'rimless wheel' as \"module:NAME\""),
        ("own_things:NUMBER", "the walker 'own_things:NUMBER' must be a System, not 3"),
        ("own_things:NONE", "the name 'own_things:NONE' cannot be found"),
        ("nowhere:WHEEL", "the name 'nowhere:WHEEL' cannot be found: No module named 'nowhere'"),
    ],
)
def test_what_is_no_system_is_refused_by_one_sentence(walker, said, odd):
    (odd / "own_things.py").write_text(OWN)
    with pytest.raises(ValueError, match=said):
        gpw.sweep("gait", odd / "out", over={"slope": [0.08]}, given={"walker": walker}, trust=True)
