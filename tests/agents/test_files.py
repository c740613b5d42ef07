"""A run's folder: checkpoints appear complete or not at all."""

import os
import time

import numpy as np
import pytest

from agents import files
from agents.config import ConfigError
from gym_passive_walker._tools.files import replacing


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


def test_checkpoints_are_ordered_by_steps_and_older_and_unfinished_ones_are_removed(tmp_path):
    paths = [files.checkpoint_path(tmp_path, n) for n in (5, 70, 900, 2000, 12_345_678_901)]
    for path in paths:
        path.mkdir(parents=True)
    checkpoints = tmp_path / "checkpoints"
    left = checkpoints / ".000000009999.17"  # by a kill
    left.mkdir()
    (checkpoints / "999999999999").touch()  # not a folder
    assert files.newest_checkpoint(tmp_path) == paths[-1]
    files.drop_older_checkpoints(paths[3])
    assert sorted(path for path in checkpoints.iterdir() if path.is_dir()) == paths[3:]


def test_a_given_folder_is_used_if_it_is_new_or_empty(tmp_path):
    deep = tmp_path / "a" / "b"
    assert files.new_run(deep, "unused") == deep and deep.is_dir()
    assert files.new_run(deep, "unused") == deep
    (deep / "anything").touch()
    for taken in (deep, deep / "anything"):
        with pytest.raises(ConfigError, match=f"{taken} contains a run.*--resume {taken}.*--out"):
            files.new_run(taken, "unused")


def test_the_first_free_number_is_taken(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert files.new_run(None, "lab-sac") == files.RUNS / "lab-sac-1"
    for name in ("lab-sac-3", "lab-ppo-2"):
        (files.RUNS / name).mkdir(parents=True)
    assert files.new_run(None, "lab-sac") == files.RUNS / "lab-sac-2"
    assert files.new_run(None, "lab-sac") == files.RUNS / "lab-sac-4"


def test_the_latest_run_is_told_by_its_newest_file_and_has_a_configuration(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ConfigError, match="no run"):
        files.latest_run()
    for age, name in ((50, "older"), (100, "written"), (1, "no-run")):
        run = files.new_run(None, name)
        if name != "no-run":
            (run / files.CONFIG).touch()
        (run / "model.zip").touch()
        for path in (*run.iterdir(), run):
            os.utime(path, (time.time() - age,) * 2)
    assert files.latest_run().name == "older-1"
    os.utime(files.RUNS / "written-1" / "model.zip")
    assert files.latest_run().name == "written-1"


def test_any_error_of_reading_names_the_file_and_its_reason(tmp_path):
    path = tmp_path / "some.json"
    with pytest.raises(ConfigError, match=r"some\.json is damaged.*config\.yml \(odd thing\)"):
        with files.reading(path):
            raise RuntimeError("odd\nthing")
    with pytest.raises(ConfigError, match=r"^mine$"), files.reading(path):
        raise ConfigError("mine")
    with pytest.raises(KeyboardInterrupt), files.reading(path):
        raise KeyboardInterrupt
    for read in (files.read_json, files.read_arrays):
        with pytest.raises(ConfigError, match=r"some\.json is damaged"):
            read(path)


def test_arrays_are_read_whole_and_pickles_are_not(tmp_path):
    path, numbers = tmp_path / "some.npz", {"a": np.arange(3.0), "b": np.eye(2, dtype=bool)}
    np.savez(path, **numbers)
    found = files.read_arrays(path)
    assert found.keys() == numbers.keys()
    assert all(np.array_equal(found[name], array) for name, array in numbers.items())
    np.savez(path, a=np.array([None]))
    with pytest.raises(ConfigError, match="damaged"):
        files.read_arrays(path)
    np.save(tmp_path / "one.npy", numbers["a"])
    with pytest.raises(ConfigError, match="not an NPZ file"):
        files.read_arrays(tmp_path / "one.npy")
