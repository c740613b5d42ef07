"""A run's folder: checkpoints appear complete or not at all."""

import os
import time

import pytest

from agents import files
from agents.config import ConfigError
from gym_passive_walker.files import replacing


def test_a_folder_appears_whole_or_not_at_all(tmp_path):
    path = files.checkpoint_path(tmp_path, 100)
    with pytest.raises(RuntimeError), replacing(path) as aside:
        aside.mkdir()
        (aside / "half").touch()
        raise RuntimeError
    assert files.newest_checkpoint(tmp_path) is None
    with replacing(path) as aside:
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
