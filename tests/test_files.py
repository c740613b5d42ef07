"""Files appear complete or not at all."""

import os
import subprocess
import sys
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import gym_passive_walker as gpw
from gym_passive_walker._tools.files import prepare, remove, replacing
from gym_passive_walker._tools.loading import SUFFIXES
from gym_passive_walker.apps.cli import main

STATE = np.array([0.2, -0.2, -0.2, -0.2, -0.1, -0.1])
FULL = Path("/dev/full")


@pytest.fixture(scope="module")
def walk():
    return gpw.simulate("A", 0.03, STATE, samples=100)


@contextmanager
def files_of_at_most(size):
    """A process with a limit on the size of its files, as on a full disk."""
    resource = pytest.importorskip("resource", reason="limits of files are POSIX")
    usual = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, usual[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, usual)


def as_table(walk, path):
    walk.to_csv(path)


def as_picture(walk, path):
    pytest.importorskip("matplotlib")
    from gym_passive_walker.pictures.axes import panels, save

    save(panels()[0], path)


def as_film(walk, path):
    pytest.importorskip("moviepy")
    from gym_passive_walker.pictures.video import Video

    noise = np.random.default_rng(0).integers(0, 256, (64, 64, 3), np.uint8)
    with Video(path, (64, 64), 30) as video:
        for _ in range(10):
            video.write(noise)


WRITERS = {
    "walk.csv": as_table, "walk.png": as_picture, "walk.pdf": as_picture, "walk.svg": as_picture,
    "walk.mp4": as_film, "walk.gif": as_film,
}  # fmt: skip


@pytest.mark.parametrize("name", WRITERS)
def test_a_full_disk_leaves_what_was_there_and_no_half_file(name, walk, tmp_path):
    path = tmp_path / name
    path.write_text("old", encoding="utf-8")
    with files_of_at_most(100), pytest.raises(OSError) as refused:
        WRITERS[name](walk, path)
    assert refused.value.filename == str(path)
    assert path.read_text(encoding="utf-8") == "old" and list(tmp_path.iterdir()) == [path]
    WRITERS[name](walk, path)
    assert path.stat().st_size > 100 and list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("name", WRITERS)
def test_an_ending_in_capitals_is_the_same_ending(name, walk, tmp_path):
    path, usual = tmp_path / name.upper(), tmp_path / name
    for each in (path, usual):
        WRITERS[name](walk, each)
    assert sorted(tmp_path.iterdir()) == sorted([path, usual])
    assert path.read_bytes()[:4] == usual.read_bytes()[:4]


@pytest.mark.parametrize("ending", [".CSV", ".NPZ"])
def test_an_ending_in_capitals_is_known_to_the_command(ending, tmp_path, capsys):
    path, usual = tmp_path / f"walk{ending}", tmp_path / f"walk{ending.lower()}"
    state = " ".join(map(str, STATE))
    for each in (path, usual):
        assert main(f"simulate A 0.03 --state {state} --strides 1 --out {each}".split()) == 0
    capsys.readouterr()
    assert path.read_bytes()[:4] == usual.read_bytes()[:4]


WRITTEN = {
    ".json": '{"preset": "C", "foot_radius": 0.25}',
    ".yaml": "preset: C\nfoot_radius: 0.25\n",
    ".yml": "preset: C\nfoot_radius: 0.25\n",
    ".toml": 'preset = "C"\nfoot_radius = 0.25\n',
}


@pytest.mark.parametrize("ending", SUFFIXES)
@pytest.mark.parametrize("capitals", [str.lower, str.upper, str.title])
def test_a_walker_is_read_from_a_file_whatever_the_case_of_its_ending(ending, capitals, tmp_path):
    if ending.startswith(".y"):
        pytest.importorskip("yaml")
    path = tmp_path / f"walker{capitals(ending)}"
    path.write_text(WRITTEN[ending], encoding="utf-8")
    expected = replace(gpw.WALKERS["C"], foot_radius=0.25)
    assert gpw.as_walker(str(path)) == gpw.as_walker(path) == expected
    assert gpw.find_gait(str(path), 0.05).walker == expected


def test_a_film_that_is_given_up_leaves_no_file(tmp_path):
    pytest.importorskip("moviepy")
    from gym_passive_walker.pictures.video import Video

    with pytest.raises(RuntimeError), Video(tmp_path / "walk.mp4", (64, 64), 30) as video:
        video.write(np.zeros((64, 64, 3), np.uint8))
        raise RuntimeError
    assert list(tmp_path.iterdir()) == []


def test_a_link_stays_a_link(walk, tmp_path):
    target, link = tmp_path / "there.txt", tmp_path / "walk.csv"
    link.symlink_to(target)
    walk.to_csv(link)
    assert link.is_symlink() and target.read_text(encoding="utf-8").startswith("time (s),")


@pytest.mark.skipif(not FULL.exists(), reason="there is no device that is always full")
@pytest.mark.parametrize("ending", [".csv", ".npz"])
def test_what_was_computed_is_printed_although_the_disk_is_full(ending, tmp_path, capsys):
    path = tmp_path / f"walk{ending}"
    path.symlink_to(FULL)
    state = " ".join(map(str, STATE))
    assert main(f"simulate A 0.03 --state {state} --out {path}".split()) == 2
    said = capsys.readouterr()
    assert "duration (s)" in said.out and "saved" not in said.out
    assert said.err == f"error: {path}: No space left on device\n"
    assert FULL.is_char_device()


def test_a_file_is_replaced_at_once(tmp_path):
    target = tmp_path / "model.zip"
    target.write_text("old")
    with replacing(target) as aside:
        aside.write_text("new")
        assert target.read_text() == "old" and aside.suffix == ".zip"
    assert target.read_text() == "new"
    assert list(tmp_path.iterdir()) == [target]


def test_a_failure_leaves_the_old_file_and_no_other(tmp_path):
    target = tmp_path / "model.zip"
    target.write_text("old")
    with pytest.raises(RuntimeError), replacing(target) as aside:
        aside.write_text("half")
        raise RuntimeError
    assert target.read_text() == "old"
    assert list(tmp_path.iterdir()) == [target]


def aside_of(stem, process, folder):
    """A temporary path of a process."""
    return folder / f".{stem}.{process}-{'0' * 16}.zip"


@pytest.mark.parametrize("first", [0, 1])
def test_writers_of_one_file_in_one_process_do_not_disturb_each_other(first, tmp_path):
    """The file is that of the writer that ends last."""
    target, stacks = tmp_path / "model.zip", [ExitStack(), ExitStack()]
    written = [stack.enter_context(replacing(target)) for stack in stacks]
    for i, aside in enumerate(written):
        aside.write_text(str(i))
    for i in (first, 1 - first):
        stacks[i].close()
        assert target.read_text() == str(i)
    assert list(tmp_path.iterdir()) == [target]


@pytest.mark.parametrize(
    ("named", "as_target"),
    [("missing.json", False), (None, True), ("aside", True), ("inside", True), ("folder", True)],
)
def test_errors_of_other_files_keep_their_names(named, as_target, tmp_path):
    target = tmp_path / "walk.mp4"
    with pytest.raises(FileNotFoundError) as reported, replacing(target) as aside:
        names = {"aside": str(aside), "inside": str(aside / "a"), "folder": str(tmp_path)}
        raise FileNotFoundError(2, "No such file", names.get(named, named))
    assert reported.value.filename == (str(target) if as_target else named)


KILLED = """
import os, signal, sys
from pathlib import Path
from gym_passive_walker._tools.files import prepare, remove, replacing
with replacing(Path(sys.argv[1])) as aside:
    aside.write_text("half")
    os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.mark.skipif(os.name == "nt", reason="no process is asked whether it lives")
def test_what_killed_writers_left_goes_when_the_file_is_written_again(tmp_path):
    target = tmp_path / "model.zip"
    subprocess.run([sys.executable, "-c", KILLED, str(target)], check=False)
    (left,) = tmp_path.iterdir()
    mine = aside_of("model", os.getpid(), tmp_path)  # of an earlier process of the same number
    mine.mkdir()
    others = [aside_of("model", os.getppid(), tmp_path), tmp_path / f".model.{os.getpid()}.zip"]
    for path in others:
        path.touch()
    with replacing(target) as aside:
        aside.write_text("whole")
    assert not left.exists() and target.read_text() == "whole"
    assert sorted(tmp_path.iterdir()) == sorted([target, *others])


def test_a_file_that_cannot_be_written_is_named(tmp_path):
    (tmp_path / "file").touch()
    target = tmp_path / "file" / "new"
    with (
        pytest.raises(OSError, match=r"Not a directory|File exists") as reported,
        replacing(target),
    ):
        pass
    assert reported.value.filename == str(target)


def test_a_film_in_slow_motion_has_as_many_more_frames(tmp_path):
    pytest.importorskip("moviepy")
    pytest.importorskip("pygame")
    from gym_passive_walker.pictures.video import video

    state = gpw.find_gait("lab", 0.036).state
    frames = [
        video("lab", 0.036, state, tmp_path / "walk.gif", strides=1, slower=slower)
        for slower in (1.0, 2.0, 0.5)
    ]
    assert frames[1] == pytest.approx(2 * frames[0], abs=1)
    assert frames[2] == pytest.approx(0.5 * frames[0], abs=1)


def test_where_a_file_can_go_is_prepared_and_elsewhere_refused_by_its_name(tmp_path):
    place = tmp_path / "deep" / "deeper" / "w.csv"
    assert prepare(str(place)) == place and place.parent.is_dir() and not place.exists()
    with pytest.raises(IsADirectoryError) as refused:
        prepare(place.parent)
    assert refused.value.filename == str(place.parent)
    (tmp_path / "file").write_text("kept")
    assert prepare(tmp_path / "file").read_text() == "kept"
    with pytest.raises(OSError) as refused:
        prepare(tmp_path / "file" / "w.csv")
    assert refused.value.filename == str(tmp_path / "file" / "w.csv")


@pytest.mark.parametrize("there", [True, False])
def test_a_file_may_be_prepared_if_its_folder_can_be_written(there, tmp_path, monkeypatch):
    """Writers replace a file, so its folder counts: of a link, the folder of its target."""
    (tmp_path / "below").mkdir()
    place, target, asked = tmp_path / "w.csv", tmp_path / "below" / "there.csv", []
    place.symlink_to(target)
    if there:
        target.touch()
    monkeypatch.setattr(os, "access", lambda path, mode: asked.append((path, mode)))
    with pytest.raises(PermissionError) as refused:
        prepare(place)
    assert asked == [(target.parent, os.W_OK)]
    assert refused.value.filename == str(place)


@pytest.mark.skipif(not FULL.exists(), reason="there is no device")
def test_a_device_may_be_prepared_if_it_can_be_written(monkeypatch):
    asked = []
    monkeypatch.setattr(os, "access", lambda path, mode: not asked.append(path))
    assert prepare(FULL) == FULL and asked == [FULL]


@pytest.mark.parametrize("name", ["model[1].zip", "*.zip", "no ending", ".hidden"])
def test_signs_of_patterns_are_signs_of_names(name, tmp_path):
    other = aside_of("model1", os.getpid(), tmp_path)
    other.touch()
    with replacing(tmp_path / name) as aside:
        assert aside.name.endswith((tmp_path / name).suffix) and aside.parent == tmp_path
        aside.write_text("new")
    assert (tmp_path / name).read_text() == "new" and other.exists()
    assert len([*tmp_path.iterdir()]) == 2


@pytest.mark.skipif(os.name == "nt", reason="no process is asked whether it lives")
@pytest.mark.parametrize("name", ["model[1]", "a*b", "why?"])
def test_what_killed_writers_of_odd_names_left_goes_too(name, tmp_path):
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    left = aside_of(name, ended.pid, tmp_path)
    left.touch()
    with replacing(tmp_path / f"{name}.zip") as aside:
        aside.touch()
    assert [*tmp_path.iterdir()] == [tmp_path / f"{name}.zip"]


def test_the_ending_is_that_of_a_link_and_not_of_its_target(tmp_path):
    target, link = tmp_path / "model.bin", tmp_path / "link.zip"
    target.write_text("old")
    link.symlink_to(target)
    with replacing(link) as aside:
        assert aside.suffix == ".zip"
        aside.write_text("new")
    assert link.is_symlink() and target.read_text() == "new"


@pytest.mark.parametrize("error", [PermissionError, OverflowError])
def test_a_writer_that_cannot_be_asked_keeps_its_file(error, tmp_path, monkeypatch):
    def asked(*_):
        raise error

    left = aside_of("model", 12345, tmp_path)
    left.touch()
    monkeypatch.setattr(os, "kill", asked)
    with replacing(tmp_path / "model.zip") as aside:
        aside.touch()
    assert left.exists()


def test_what_is_removed_is_a_link_and_not_what_it_leads_to(tmp_path):
    folder = tmp_path / "folder"
    (folder / "below").mkdir(parents=True)
    (folder / "below" / "file").touch()
    link = tmp_path / "link"
    link.symlink_to(folder)
    for path in (link, tmp_path / "nothing"):
        remove(path)
    assert not link.is_symlink() and (folder / "below" / "file").exists()
    remove(folder)
    assert not folder.exists()
