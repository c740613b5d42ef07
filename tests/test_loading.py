"""Files of JSON, YAML and TOML."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

from gym_passive_walker._tools.loading import SUFFIXES, found_at, is_file, read_content

CONTENT = {
    ".json": '{"name": "Läufer", "mass": 1.5, "parts": [1, 2], "on": true}',
    ".toml": 'name = "Läufer"\nmass = 1.5\nparts = [1, 2]\non = true\n',
    ".yaml": "name: Läufer\nmass: 1.5\nparts: [1, 2]\n'on': true\n",
    ".yml": "name: Läufer\nmass: 15e-1\nparts: [1, 2]\n'on': true\n",
}


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("capitals", [False, True])
def test_each_format_is_read_by_its_ending(suffix, capitals, tmp_path):
    if suffix in (".yaml", ".yml"):
        pytest.importorskip("yaml")
    path = tmp_path / f"walker{suffix.upper() if capitals else suffix}"
    path.write_text(CONTENT[suffix], encoding="utf-8")
    found = read_content(path)
    assert found == {"name": "Läufer", "mass": 1.5, "parts": [1, 2], "on": True}
    assert read_content(str(path)) == found
    assert is_file(path) and is_file(str(path))


def test_a_yaml_file_without_its_library_is_to_be_written_as_json(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "yaml", None)
    (tmp_path / "walker.yaml").write_text(CONTENT[".yaml"], encoding="utf-8")
    with pytest.raises(ImportError, match=r"walker\.yaml needs pyyaml, which is not installed"):
        read_content(tmp_path / "walker.yaml")


def test_text_with_another_ending_names_no_file_but_every_path_does():
    assert set(SUFFIXES) == set(CONTENT)
    assert is_file("a.json") and is_file(Path("lab")) and is_file("a/b.c/d.YML")
    for value in ("lab", "lab.txt", "json", "a.json/lab", "", None, 3, {"a.json": 1}):
        assert not is_file(value)


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("torn.json", '{"a": ', "Expecting value"),
        ("torn.toml", "a = ", "Invalid value"),
        ("torn.yaml", "a: [1, 2", "expected"),
        ("bytes.json", b"\xff\xfe", "can't decode"),
        ("missing.json", None, "No such file"),
        ("folder.json", ..., "Is a directory"),
        ("a.txt", "{}", "its name must end in .json, .yaml, .yml, .toml"),
    ],
)
def test_a_file_that_cannot_be_read_is_named_with_the_reason(name, text, words, tmp_path):
    if name.endswith("yaml"):
        pytest.importorskip("yaml")
    path = tmp_path / name
    if text is ...:
        path.mkdir()
    elif text is not None:
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(ValueError, match="cannot be read: ") as refused:
        read_content(path)
    said = str(refused.value)
    assert said.startswith(f"{path} cannot") and words in said and "\n" not in said


def test_a_file_that_nests_too_deeply_is_refused(tmp_path):
    path = tmp_path / "deep.json"
    path.write_text("[" * 100_000)
    with pytest.raises(ValueError, match="cannot be read"):
        read_content(path)


@pytest.mark.parametrize("written", ["1e3", "+1.E3", "1e+3", "10.0e2", ".1e4", "1E3"])
def test_exponents_of_yaml_are_numbers_and_words_with_an_e_are_words(written, tmp_path):
    pytest.importorskip("yaml")
    path = tmp_path / "a.yaml"
    path.write_text(f"number: {written}\nword: 1e3x\nother: e3\nwhole: 12\n")
    found = read_content(path)
    assert found == {"number": 1000.0, "word": "1e3x", "other": "e3", "whole": 12}
    assert type(found["number"]) is float and type(found["whole"]) is int
    assert json.dumps(found)


REPEATED = {
    "a.json": '{"outer": {"mass": 1, "mass": 2}}',
    "b.json": '{"mass": 1, "mass": 1}',
    "a.yaml": "outer: {mass: 1, mass: 2}",
    "b.yaml": "mass: 1\nlength: 2\nmass: 1\n",
    "a.toml": "[outer]\nmass = 1\nmass = 2\n",
}


@pytest.mark.parametrize("name", REPEATED)
def test_a_repeated_key_is_refused(name, tmp_path):
    """Only its last value would count."""
    if name.endswith("yaml"):
        pytest.importorskip("yaml")
    path = tmp_path / name
    path.write_text(REPEATED[name])
    said = "overwrite a value" if name.endswith("toml") else "'mass' is given twice"
    with pytest.raises(ValueError, match=said) as refused:
        read_content(path)
    assert str(path) in str(refused.value)


def test_a_mapping_of_yaml_that_is_merged_into_another_gives_what_that_one_leaves_open(tmp_path):
    pytest.importorskip("yaml")
    path = tmp_path / "a.yaml"
    path.write_text("base: &base {mass: 1, length: 2}\nown: {<<: *base, mass: 3}\n")
    assert read_content(path)["own"] == {"mass": 3, "length": 2}


@pytest.mark.parametrize(
    "line", ["append('/extra')", "insert(0, os.getcwd())", "remove(os.getcwd())"]
)
def test_a_module_may_change_where_modules_are_found(line, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    usual = [*sys.path]
    monkeypatch.setattr(sys, "path", [*usual])
    name = f"changes_{line[:3]}"
    (tmp_path / f"{name}.py").write_text(f"import os, sys\nsys.path.{line}\nvalue = 1\n")
    found_at(f"{name}:value", "value")
    added = {"append": ["/extra"], "insert": [str(tmp_path)], "remove": []}[line.partition("(")[0]]
    assert sorted(sys.path) == sorted([*usual, *added])
