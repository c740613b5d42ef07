"""Files appear whole or not at all."""

import os
import subprocess
import sys
import time

import pytest

from agents import files
from agents.config import ConfigError


def test_a_file_is_replaced_at_once(tmp_path):
    target = tmp_path / "model.zip"
    target.write_text("old")
    with files.replacing(target) as aside:
        aside.write_text("new")
        assert target.read_text() == "old" and aside.suffix == ".zip"
    assert target.read_text() == "new"
    assert list(tmp_path.iterdir()) == [target]


def test_a_failure_leaves_the_old_file_and_no_other(tmp_path):
    target = tmp_path / "model.zip"
    target.write_text("old")
    with pytest.raises(RuntimeError), files.replacing(target) as aside:
        aside.write_text("half")
        raise RuntimeError
    assert target.read_text() == "old"
    assert list(tmp_path.iterdir()) == [target]


def test_a_folder_appears_whole_or_not_at_all(tmp_path):
    path = files.checkpoint_path(tmp_path, 100)
    with pytest.raises(RuntimeError), files.replacing(path) as aside:
        aside.mkdir()
        (aside / "half").touch()
        raise RuntimeError
    assert files.newest_checkpoint(tmp_path) is None
    with files.replacing(path) as aside:
        aside.mkdir()
        (aside / "whole").touch()
    assert files.newest_checkpoint(tmp_path) == path and (path / "whole").exists()


def test_what_a_kill_left_unfinished_is_passed_over_and_removed(tmp_path):
    for steps in (900, 2000):  # though 9 comes after 2
        files.checkpoint_path(tmp_path, steps).mkdir(parents=True)
    left = tmp_path / "checkpoints" / ".000000009999.17"
    left.mkdir()
    newest = files.newest_checkpoint(tmp_path)
    assert newest == files.checkpoint_path(tmp_path, 2000)
    files.drop_older_checkpoints(newest)
    assert list((tmp_path / "checkpoints").iterdir()) == [newest]


KILLED = """
import os, signal, sys
from pathlib import Path
from agents import files
with files.replacing(Path(sys.argv[1])) as aside:
    aside.write_text("half")
    os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.mark.skipif(os.name == "nt", reason="no process is asked whether it lives")
def test_what_killed_writers_left_goes_when_the_file_is_written_again(tmp_path):
    target = tmp_path / "model.zip"
    subprocess.run([sys.executable, "-c", KILLED, str(target)], check=False)
    (left,) = tmp_path.iterdir()
    mine = tmp_path / f".model.{os.getpid()}.zip"  # of an earlier process of the same number
    mine.mkdir()
    others = [tmp_path / name for name in (f".model.{os.getppid()}.zip", ".model.old.zip")]
    for path in others:
        path.touch()
    with files.replacing(target) as aside:
        aside.write_text("whole")
    assert not left.exists() and target.read_text() == "whole"
    assert sorted(tmp_path.iterdir()) == sorted([target, *others])


def test_what_cannot_be_written_is_told_by_its_own_name(tmp_path):
    (tmp_path / "file").touch()
    target = tmp_path / "file" / "new"
    with pytest.raises(OSError, match="File exists") as told, files.replacing(target):
        pass
    assert told.value.filename == str(target)


def test_new_runs_are_numbered(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names = [files.new_run(None, "level-ppo").name for _ in range(3)]
    assert names == ["level-ppo-1", "level-ppo-2", "level-ppo-3"]


def test_a_folder_that_is_taken_is_refused(tmp_path):
    (tmp_path / "anything").touch()
    with pytest.raises(ConfigError, match="--resume"):
        files.new_run(tmp_path, "level-ppo")


def test_the_latest_run_is_the_one_written_last(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ConfigError, match="no run"):
        files.latest_run()
    for age, name in ((10, "second"), (500, "first")):
        run = files.new_run(None, name)
        (run / files.CONFIG).touch()
        for path in (run / files.CONFIG, run):
            os.utime(path, (time.time() - age,) * 2)
    assert files.latest_run().name == "second-1"
