"""The validation page: it is rendered from its rows, and rows state what agrees."""

import re
from pathlib import Path

import pytest

from gym_passive_walker.pictures.figures import FIGURES
from validation import chapter, page
from validation.__main__ import main
from validation.page import SUBJECTS, Section, render, sections
from validation.rows import Row, claim, number

PAGE = Path(__file__).parents[2] / "docs" / "validation.md"


def tables(text):
    """The cells of each section's rows, by its title."""
    found = {}
    for part in re.split(r"^##+ ", text, flags=re.M)[1:]:
        title, _, body = part.partition("\n")
        lines = [line for line in body.splitlines() if line.startswith("|")]
        cells = [re.split(r"(?<!\\)\|", line)[1:-1] for line in lines]
        found[title] = [[cell.strip().replace("\\|", "|") for cell in row] for row in cells]
    return found


@pytest.fixture(scope="module")
def committed():
    return tables(PAGE.read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def rows(committed):
    """The rows of the committed page, by the titles of their sections."""
    return {
        section.title: [
            Row._make([*cells[:5], cells[5] == "yes", True, cells[6]])
            for cells in committed[section.title][2:]
        ]
        for section in sections()
    }


def test_the_pages_are_rendered_from_their_rows(rows):
    assert render(rows) == PAGE.read_text(encoding="utf-8")
    items = PAGE.with_name("chapter4.md").read_text(encoding="utf-8")
    assert chapter.render(rows) == items, "run python -m validation --out docs/validation.md"


def test_the_chapter_s_items_are_all_there_in_its_order():
    pictures = [name.partition("-")[0] for item in chapter.ITEMS for name in item.pictures]
    assert list(dict.fromkeys(pictures)) == list(
        dict.fromkeys(name.partition("-")[0] for name in FIGURES)
    )
    names = [item.name for item in chapter.ITEMS if item.name.startswith("Figure")]
    assert names == [f"Figure 4.{number}" for number in range(1, 14)]


def test_each_pattern_of_an_item_finds_its_rows(rows):
    every = [f"{row.where} | {row.what}" for each in rows.values() for row in each]
    for item in chapter.ITEMS:
        for pattern in item.statements.values():
            assert any(re.match(pattern, row) for row in every), pattern


def test_an_agreement_counts_its_statements_and_names_those_that_differ():
    met = number("4.4 | a slope | 0.015", 0.0150884)
    other = number("4.4 | a speed | 2", 3.0)
    assert chapter.agreement([met]) == "the statement agrees, the number within 0.6%"
    assert chapter.agreement([met, met]) == "all 2 statements agree, numbers within 0.6%"
    said = chapter.agreement([met, other])
    assert said.startswith("1 of 2 statements agree, numbers within 0.6%\n")
    assert said.endswith("- a speed: print 2, computed 3")
    assert chapter.agreement([other]).startswith("the statement does not agree\n")


def test_the_page_has_every_section_in_order(committed):
    titles = [section.title for section in sections()]
    assert [title for title in committed if title not in SUBJECTS] == [*titles, "Sources"]
    for title in titles:
        assert committed[title][0] == list(page._COLUMNS)
        assert len(committed[title]) > 3
        assert all(len(row) == len(page._COLUMNS) for row in committed[title])


def test_each_statement_is_on_the_page_once_and_each_difference_has_its_reason(committed):
    rows = [row for section in sections() for row in committed[section.title][2:]]
    assert len({tuple(row) for row in rows}) == len(rows)
    differ = [row for row in rows if row[5] != "yes"]
    assert all(len(row[6]) > 20 for row in differ)
    text = PAGE.read_text(encoding="utf-8")
    counts = f"{len(rows)} statements; {len(rows) - len(differ)} agree and {len(differ)} differ."
    assert counts in text
    contents = [row[1:] for row in tables("## Contents\n" + text)["Contents"][2:]]
    assert sum(int(all_of) for all_of, _ in contents) == len(rows)
    assert sum(int(of or 0) for _, of in contents) == len(differ)


def test_a_page_reads_as_it_was_written(monkeypatch):
    met = number("4.4 | a slope | 0.015", 0.0150884, digits=6)
    not_met = claim("4.7 | |x| | all", "none", False, expected=False, remark="It is so.")
    one, two = Section("One (4.4)", list), Section("Two", list, "Walker D.")
    monkeypatch.setattr(page, "SUBJECTS", {"Numbers": (one,), "Words": (two,)})
    text = render({"One (4.4)": [met], "Two": [not_met]})
    found = tables(text)
    cells = ["4.4", "a slope", "0.015", "0.0150884", "+8.8e-05 (±0.0005)", "yes", ""]
    assert [*found] == ["Numbers", "One (4.4)", "Words", "Two", "Sources"]
    assert found["One (4.4)"][2] == cells
    assert found["Two"][2] == ["4.7", "|x|", "all", "none", "", "**no**", "It is so."]
    assert "| [One (4.4)](#one-44) | 1 |  |\n| [Two](#two) | 1 | 1 |\n" in text
    assert "2 statements; 1 agree and 1 differ." in text and "### Two\n\nWalker D.\n\n|" in text


@pytest.mark.parametrize(
    ("printed", "computed", "agrees"),
    [
        ("0.24", 0.2449, True),
        ("0.24", 0.2451, False),
        ("12", 12.5001, False),
        ("\u22120.5", -0.53, True),
    ],
)
def test_a_number_is_met_if_the_computed_one_rounds_to_it(printed, computed, agrees):
    row = number(f"4.4 | a slope | {printed}", computed)
    assert row.agrees == row.sound == agrees


def test_a_known_disagreement_is_held_to_the_number_on_record():
    for computed, sound in ((0.0768533651, True), (0.0768533671, False)):
        row = number("4.7 | a slope | 0.084", computed, known="0.0768533651")
        assert not row.agrees and row.sound == sound
    assert not claim("4.7 | x | all", "all", True, expected=False).sound


def test_the_command_writes_the_page_and_fails_if_a_row_is_not_as_known(
    tmp_path, monkeypatch, capsys
):
    good = Section("Good", lambda: [number("4.4 | x | 1", 1.0)])
    bad = Section("Bad", lambda: [number("4.4 | y | 1", 2.0)])
    path = tmp_path / "page.md"
    monkeypatch.setattr(page, "SUBJECTS", {"All": (good,)})
    assert main(["--out", str(path)]) == 0
    assert "1 of 1  Good" in capsys.readouterr().out
    monkeypatch.setattr(page, "SUBJECTS", {"All": (good, bad)})
    assert main(["--out", str(path)]) == 1
    assert "not as known: 4.4, y: 2" in capsys.readouterr().err
    assert [*tables(path.read_text(encoding="utf-8"))] == ["All", "Good", "Bad", "Sources"]
    assert "# Chapter 4" in (tmp_path / "chapter4.md").read_text(encoding="utf-8")
