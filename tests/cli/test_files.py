"""A file that cannot be written or read is named in one sentence, and no partial file remains."""

import json

import pytest

import gym_passive_walker as gpw
from gym_passive_walker.apps.cli import main

WALK = "D 0.009 --strides 1"
LINES = {
    "simulate {walk} --out a-file/w.csv": ("a-file/w.csv", None),
    "simulate {walk} --out a-folder.csv": ("a-folder.csv", None),
    "strobe {walk} --out w.doc": ("'w.doc'", "matplotlib"),
    "strobe {walk} --out a-folder.csv": ("'a-folder.csv'", "matplotlib"),
    "video {walk} --slower 0.1 --out a-file/w.mp4": ("a-file/w.mp4", "moviepy"),
    "figures 4.6 --out a-file": ("a-file", "matplotlib"),
    "sweep sweep.json --out a-file": ("a-file", "pyarrow"),
    "sweep missing.json": ("missing.json", "pyarrow"),
    "sweep torn.json": ("torn.json", "pyarrow"),
    "play D --seconds 0.05 --policy a-policy": ("a-policy", "pygame"),
    "evaluate a-policy --episodes 1": ("a-policy", None),
    "evaluate a-folder.csv --episodes 1": ("a-folder.csv", None),
    "evaluate half-a-policy --episodes 1": ("half-a-policy", None),
    "gait torn.json 0.03": ("torn.json", None),
    "simulate D 0.009 --terrain torn.json": ("torn.json", None),
}  # fmt: skip


@pytest.fixture
def odd_files(tmp_path, monkeypatch):
    """A working folder with a file, a folder, truncated files and invalid policies."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    (tmp_path / "a-file").write_text("kept")
    (tmp_path / "a-folder.csv").mkdir()
    (tmp_path / "torn.json").write_text('{"analysis": "ga')
    swept = {"analysis": "gait", "given": {"walker": "D"}, "over": {"slope": [0.009]}}
    (tmp_path / "sweep.json").write_text(json.dumps(swept))
    shipped = gpw.envs.policies.policy_folder("level-ppo")
    for name, share in (("a-policy", 0.0), ("half-a-policy", 0.5)):
        (tmp_path / name).mkdir()
        for path in shipped.iterdir():
            whole = path.read_bytes()
            kept = whole[: int(share * len(whole))] if path.suffix == ".safetensors" else whole
            (tmp_path / name / path.name).write_bytes(kept)
    return tmp_path


def contents(folder):
    return {p: p.read_bytes() if p.is_file() else None for p in folder.rglob("*")}


@pytest.mark.parametrize("line", LINES)
def test_a_file_that_is_none_is_named_in_a_sentence(line, odd_files, capfd):
    words, library = LINES[line]
    if library:
        pytest.importorskip(library)
    before = contents(odd_files)
    try:
        status = main(line.format(walk=WALK).split())
    except SystemExit as end:  # of the parser
        status = end.code
    assert status == 2
    said = capfd.readouterr().err
    assert "error: " in said and words in said and "Traceback" not in said
    assert contents(odd_files) == before


MADE = {
    "simulate {walk} --out missing/w.csv": None,
    "simulate {walk} --out missing/w.npz": None,
    "strobe {walk} --out missing/w.png": "matplotlib",
    "video {walk} --slower 0.1 --out missing/w.gif": "moviepy",
    "robustness D --slope 0.009 --walkers 2 --strides 2 --out missing/r.pdf": "matplotlib",
    "play D --seconds 0.05 --picture missing/p.png": "pygame",
    "play D --seconds 0.05 --video missing/f.gif": "moviepy",
}


@pytest.mark.parametrize("line", MADE)
def test_a_folder_that_is_missing_is_made(line, odd_files):
    if MADE[line]:
        pytest.importorskip(MADE[line])
    assert main(line.format(walk=WALK).split()) == 0
    (made,) = (odd_files / "missing").iterdir()
    assert made.name == line.split("/")[-1] and made.stat().st_size > 0


@pytest.mark.parametrize("place", ["a-file/t.csv", "a-folder.csv"])
def test_a_table_that_cannot_be_written_raises_what_the_system_says(place, odd_files):
    before = contents(odd_files)
    walk = gpw.simulate("D", 0.009, gpw.find_gait("D", 0.009).state)
    with pytest.raises(OSError, match=place):
        walk.to_csv(odd_files / place)
    assert contents(odd_files) == before
