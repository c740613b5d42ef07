"""Damaged files of a sweep are named and not changed, and computed rows are kept."""

import hashlib
import json
import os
import random
import shutil
import sys

import numpy as np
import pytest

import gym_passive_walker as gpw
from gym_passive_walker.apps.cli import main
from gym_passive_walker.apps.sweeps import store
from gym_passive_walker.apps.sweeps.description import Description
from gym_passive_walker.apps.sweeps.run import SweepResult
from gym_passive_walker.apps.sweeps.version import version
from tests.sweeps.conftest import ODD
from tests.sweeps.odd import odd_sweep

parquet = pytest.importorskip("pyarrow.parquet")


DESCRIBED = Description(analysis="odd_tasks:square", over={"x": list(range(9))})
SQUARES = [x * x for x in range(9)]


def squares(folder):
    """A sweep of nine tasks, or the rest of it."""
    return odd_sweep("square", folder / "out", 9)


@pytest.fixture(scope="module")
def swept(tmp_path_factory):
    """A finished sweep, and one that was killed with all its rows in the journal."""
    root = tmp_path_factory.mktemp("swept")
    (root / "odd_tasks.py").write_text(ODD)
    with pytest.MonkeyPatch.context() as during:
        during.syspath_prepend(str(root))
        during.setenv("PYTHONPATH", str(root), prepend=":")
        squares(root / "finished")
        during.setattr(store.Store, "flush", lambda *_, **__: None)
        squares(root / "stopped")
    sys.modules.pop("odd_tasks", None)
    assert not list((root / "stopped" / "out" / "rows").iterdir())
    return root


@pytest.fixture
def finished(odd, swept):
    """A folder with a copy of the finished sweep."""
    return shutil.copytree(swept / "finished", odd, dirs_exist_ok=True)


@pytest.fixture
def stopped(odd, swept):
    """A folder with a copy of the killed sweep."""
    return shutil.copytree(swept / "stopped", odd, dirs_exist_ok=True)


def whole(folder, before=None):
    """Assert that a sweep continues to its end, and repeats none of its tasks."""
    found = squares(folder).columns()
    assert found["square"].tolist() == SQUARES
    if before is not None:
        assert found["seconds"].tolist() == before


def seconds(folder):
    """Duration of each task, by the journal."""
    rows = map(json.loads, (folder / "out" / "journal.jsonl").read_text().splitlines())
    return [row["seconds"] for row in sorted(rows, key=lambda row: row["task"])]


def contents(folder):
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def refused(folder, said):
    """Assert that a sweep raises this error, and that its folder does not change."""
    before = contents(folder / "out")
    for _ in range(2):  # also by the process that was refused before
        with pytest.raises(ValueError, match=said):
            squares(folder)
    assert contents(folder / "out") == before


def text(said):
    return lambda path: path.write_text(said)


def changed(**entries):
    def change(path):
        path.write_text(json.dumps(json.loads(path.read_text()) | entries))

    return change


def lacking(name):
    def change(path):
        content = json.loads(path.read_text())
        del content[name]
        path.write_text(json.dumps(content))

    return change


def a_folder(path):
    path.unlink()
    path.mkdir()


def unreadable(path):
    path.chmod(0)
    if os.access(path, os.R_OK):
        path.chmod(0o600)
        pytest.skip("the superuser may read every file")


MANIFESTS = {
    "empty": (text(""), "sweep.json cannot be read .*restore a whole copy"),
    "half": (text('{"description": {"ana'), "sweep.json cannot be read"),
    "a list": (text("[1, 2]"), "sweep.json cannot be read .it is not a mapping.*whole copy"),
    "nested": (text("[" * 100_000), "sweep.json cannot be read"),
    "random": (lambda path: path.write_bytes(bytes(range(255, 0, -1))), "sweep.json cannot be"),
    "a folder": (a_folder, "sweep.json cannot be read .Is a directory.*whole copy"),
    "unreadable": (unreadable, "sweep.json cannot be read .Permission denied"),
    "no version": (lacking("version"), "it has no version"),
    "no digest": (lacking("sweep"), "it has no sweep"),
    "no description": (changed(description=[]), "it has no description"),
    "no columns": (lacking("columns"), "it has no columns"),
    "other columns": (changed(columns={"square": "colour"}), "it has no columns"),
    "columns in a row": (changed(columns=["square"]), "it has no columns"),
    "another digest": (changed(sweep="0" * 16), "sweep.json cannot be read .*another digest"),
    "another version": (changed(version="0.0.1"), "was computed by version 0.0.1, this is"),
}


@pytest.mark.parametrize("name", MANIFESTS)
def test_a_damaged_manifest_is_named_and_its_rows_can_still_be_read(name, finished):
    damage, said = MANIFESTS[name]
    damage(finished / "out" / "sweep.json")
    refused(finished, said)
    assert SweepResult(finished / "out", 9, 0).columns()["square"].tolist() == SQUARES


@pytest.mark.parametrize("content", [{"over": 3}, {"analysis": "gait", "over": {}}])
def test_a_description_that_is_none_is_refused_where_it_is_asked_for(content, finished):
    changed(description=content)(finished / "out" / "sweep.json")
    with pytest.raises(ValueError, match=r"sweep.json cannot be read .*over"):
        SweepResult(finished / "out", 9, 0).description()


def line(change):
    """Change the third line of a journal, which is a row."""

    def damage(path):
        lines = path.read_bytes().splitlines(keepends=True)
        row = json.loads(lines[2])
        row.pop("crc32")
        said = change(row)
        lines[2] = said if isinstance(said, bytes) else store._line(row)
        path.write_bytes(b"".join(lines))

    return damage


JOURNALS = {
    "torn in its midst": (line(lambda row: b'{"task": 3, "sta\n'), "line 3 of .*its checksum is"),
    "of another encoding": (
        lambda path: path.write_bytes(path.read_text().encode("utf-16")),
        "line 1 of .*checksum.*remove that line to repeat its task",
    ),
    "another sweep": (line(lambda row: row.update(sweep="0")), "line 3 .*it is of another sweep"),
    "another version": (line(lambda row: row.update(version="0")), "it is .*of another version"),
    "no results": (line(lambda row: row.pop("square") and None), "its results are not those"),
    "a folder": (a_folder, "journal.jsonl cannot be read .Is a directory.*move it elsewhere"),
    "unreadable": (unreadable, "journal.jsonl cannot be read .Permission denied"),
}  # fmt: skip


@pytest.mark.parametrize("name", JOURNALS)
def test_a_damaged_journal_is_named_with_its_line_and_loses_no_row(name, stopped):
    damage, said = JOURNALS[name]
    journal = stopped / "out" / "journal.jsonl"
    kept, before = journal.read_text(), seconds(stopped)
    damage(journal)
    refused(stopped, said)
    if journal.is_dir():
        journal.rmdir()
    journal.write_text(kept)
    whole(stopped, before)


@pytest.mark.parametrize("tear", [lambda rows: rows[:-9], lambda rows: rows + b"\0" * 50])
def test_a_torn_end_of_a_journal_costs_its_last_row_at_most(stopped, tear):
    journal, before = stopped / "out" / "journal.jsonl", seconds(stopped)
    last = json.loads(journal.read_text().splitlines()[-1])["task"]
    journal.write_bytes(tear(journal.read_bytes()))
    whole(stopped)
    after = SweepResult(stopped / "out", 9, 0).columns()["seconds"].tolist()
    assert [x for x in range(9) if after[x] != before[x]] in ([], [last])


def flipped(content, bit):
    """The content with one other bit."""
    return content[: bit // 8] + bytes([content[bit // 8] ^ 1 << bit % 8]) + content[bit // 8 + 1 :]


@pytest.mark.parametrize("damaged", ["part", "journal"])
def test_a_flipped_bit_is_an_error_or_leaves_the_rows_as_they_were(damaged, tmp_path):
    """Only the end of the journal's last line is a torn one: its task is repeated."""
    drawn = random.Random(1)
    described = Description(analysis="a:b", over={"x": [drawn.random() for _ in range(20)]})
    made = store.Store(tmp_path / "whole", described, "1")
    for task, given in enumerate(described.tasks):
        row = {**given, "task": task, "status": "done", "error": None, "seconds": drawn.random()}
        made.add(row, {"y": drawn.choice([drawn.random(), np.nan, np.inf]), "n": task, "ok": True})
    if damaged == "part":
        made.flush()
    made.close()
    (name,) = [*tmp_path.glob("whole/rows/*"), *tmp_path.glob("whole/journal.jsonl")][:1]
    content, name = name.read_bytes(), name.relative_to(tmp_path / "whole")
    shutil.copytree(tmp_path / "whole", tmp_path / "read")
    store.Store(tmp_path / "read", described, "1").close()
    expected, kept = store.read_columns(tmp_path / "read"), []
    for bit in drawn.sample(range(8 * len(content)), 400):
        shutil.rmtree(tmp_path / "read")
        shutil.copytree(tmp_path / "whole", tmp_path / "read")
        (tmp_path / "read" / name).write_bytes(flipped(content, bit))
        try:
            store.Store(tmp_path / "read", described, "1").close()
        except ValueError as error:
            assert str(tmp_path / "read" / name) in str(error) and "\n" not in str(error)
        else:
            kept.append(bit)
            found = store.read_columns(tmp_path / "read")
            for column, values in found.items():
                np.testing.assert_array_equal(values, expected[column][: len(values)])
            assert len(found["task"]) >= 19
    assert [*kept] == [bit for bit in kept if bit // 8 == len(content) - 1 and damaged != "part"]


def test_a_part_that_is_damaged_or_of_another_sweep_is_named_and_left(finished):
    folder = finished / "out" / "rows"
    (part,) = folder.iterdir()
    kept = part.read_bytes()
    before = SweepResult(finished / "out", 9, 0).columns()["seconds"].tolist()
    part.write_bytes(kept[: len(kept) // 2])
    refused(finished, f"{part} cannot be read .*move it elsewhere")
    with pytest.raises(ValueError, match=f"{part} cannot be read"):
        SweepResult(finished / "out", 9, 0).columns()
    part.write_bytes(kept)
    table, strange = parquet.read_table(part), folder / "strange.parquet"
    for change, said in (
        (table.drop_columns(["square"]), "it has columns that differ"),
        (table.set_column(1, "sweep", [["0" * 16] * 9]), "it has rows of another sweep"),
        (table.set_column(2, "version", [["0"] * 9]), "it has rows .*of another version"),
    ):
        parquet.write_table(change, strange)
        refused(finished, "strange.parquet cannot be read .its name does not have the digest")
        digest = hashlib.sha256(strange.read_bytes()).hexdigest()[:16]
        named = strange.rename(folder / f"strange-{digest}.parquet")
        refused(finished, f"{named.name} cannot be read .{said}")
        named.unlink()
    strange.mkdir()
    refused(finished, "strange.parquet cannot be read")
    strange.rmdir()
    whole(finished, before)


@pytest.mark.parametrize("name", ["out", "out/rows", "out/lock"])
def test_a_file_where_a_folder_should_be_is_named_and_the_other_way_round(name, finished):
    path = finished / name
    path.rename(finished / "aside")
    if name == "out/lock":
        path.mkdir()
    else:
        path.touch()
    with pytest.raises((ValueError, OSError), match=f"{path}.*(give a folder|correct that)"):
        squares(finished)


def test_parts_of_a_sweep_are_never_written_over_each_other(stopped):
    journal, rows = stopped / "out" / "journal.jsonl", stopped / "out" / "rows"
    lines, before = journal.read_text().splitlines(True), seconds(stopped)
    for first in (0, 3, 6):  # as if killed twice, each time after some tasks
        journal.write_text("".join(lines[first : first + 3]))
        store.Store(stopped / "out", DESCRIBED, version("odd_tasks:square")).close()
    parts = sorted(rows.iterdir())
    assert len(parts) == 3
    kept = {path: path.read_bytes() for path in parts[1:]}
    parts[0].unlink()
    journal.write_text("".join(lines))  # the rows of the part that is gone
    whole(stopped, before)
    assert len(list(rows.iterdir())) == 3
    assert all(path.read_bytes() == found for path, found in kept.items())


@pytest.mark.parametrize("analysis", ["os:system", "odd_tasks:square", "nowhere:nothing"])
def test_a_function_that_is_not_the_packages_is_called_only_if_it_is_trusted(
    analysis, odd, capsys, monkeypatch
):
    monkeypatch.setattr("importlib.import_module", lambda _: pytest.fail("imported"))
    content = {"analysis": analysis, "over": {"command": ["true"]}}
    (odd / "file.json").write_text(json.dumps(content))
    for given in (content, analysis, content | {"how": "list"}):
        rest = {} if isinstance(given, dict) else {"over": {"command": ["true"]}}
        with pytest.raises(ValueError, match=f"{analysis}.* not the package's.*--trust"):
            gpw.sweep(given, odd / "out", **rest)
    assert main(["sweep", str(odd / "file.json"), "--out", str(odd / "out")]) == 2
    assert "if you trust it, add --trust" in capsys.readouterr().err
    assert not (odd / "out").exists()


def test_a_trusted_function_is_called_by_its_name_by_the_command_or_as_it_is(odd):
    import odd_tasks

    content = {"analysis": "odd_tasks:square", "over": {"x": [3]}}
    (odd / "file.json").write_text(json.dumps(content))
    assert main(["sweep", str(odd / "file.json"), "--trust", "--workers", "1"]) == 0
    found = [
        SweepResult(odd / "file", 1, 0),
        gpw.sweep(content, odd / "named", trust=True, workers=1),
        gpw.sweep(odd_tasks.square, odd / "itself", over={"x": [3]}, workers=1),
    ]
    assert [each.columns()["square"].tolist() for each in found] == [[9]] * 3
    with pytest.raises(ValueError, match="trust must be True or False, not 'no'"):
        gpw.sweep(content, odd / "named", trust="no")


def test_a_folder_that_names_a_function_runs_nothing_when_it_is_drawn(odd, monkeypatch):
    pytest.importorskip("matplotlib")
    found = odd_sweep("square", odd / "out", [1, 2])
    assert found.plot(x="x", y="square", by="square")
    monkeypatch.setattr("importlib.import_module", lambda _: pytest.fail("imported"))
    with pytest.raises(ValueError, match=r"odd_tasks:square.* not the package's"):
        SweepResult(odd / "out", 2, 0).plot(x="x", y="square", by="square")


def test_results_that_no_column_can_hold_are_an_error_in_their_row(odd):
    (odd / "odd_tasks.py").write_text(
        "def vast(x):\n    return {'size': 2**x, 'word': 'a' if x < 9 else '\\udc80'}\n"
    )
    found = odd_sweep("vast", odd / "out", [1, 9, 99]).columns()
    assert [*found["status"]] == ["done", "done", "failed"] and found["word"][1] == "\\udc80"
    assert "must fit into 64 bits" in found["error"][2]
