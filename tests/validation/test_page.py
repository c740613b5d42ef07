"""The validation pages: each row is as expected, and the pages are those computed."""

import re
from pathlib import Path

import pytest

from validation import page
from validation.__main__ import main
from validation.page import PAGES, Page, Section, compute, render, sections
from validation.rows import Row, claim, number

PAGE = Path(__file__).parents[2] / "docs" / "validation.md"
FILES = [PAGE, *(PAGE.with_stem(f"validation-{name}") for name in PAGES)]


def tables(text):
    """The cells of each section's rows, by its title."""
    found = {}
    for part in re.split(r"^## ", text, flags=re.M)[1:]:
        title, _, body = part.partition("\n")
        lines = [line for line in body.splitlines() if line.startswith("|")]
        cells = [re.split(r"(?<!\\)\|", line)[1:-1] for line in lines]
        found[title] = [[cell.strip().replace("\\|", "|") for cell in row] for row in cells]
    return found


@pytest.fixture(scope="module")
def committed():
    return tables("".join(file.read_text(encoding="utf-8") for file in FILES))


def statements(rows):
    """The statements of a section, without digits that another CPU may round differently."""
    return [(row[0], row[1], row[2], row[5]) for row in rows]


def test_the_pages_are_rendered_from_their_rows(committed):
    rows = {
        section.title: [
            Row(
                *(cell.replace("\\|", "|") for cell in (*cells[:5],)),
                cells[5] == "yes",
                True,
                cells[6],
            )
            for cells in committed[section.title][2:]
        ]
        for section in sections()
    }
    rendered = render(rows, PAGE)
    assert [*rendered] == FILES
    for file, text in rendered.items():
        assert text == file.read_text(encoding="utf-8"), file


def test_the_pages_have_every_section_in_order(committed):
    titles = [section.title for section in sections()]
    assert [title for title in committed if title in titles] == titles
    for title in titles:
        assert committed[title][0] == list(page._COLUMNS)
        assert len(committed[title]) > 3
        assert all(len(row) == len(page._COLUMNS) for row in committed[title])


def test_every_disagreement_is_listed_with_its_reason(committed):
    listed = committed["Where print and computation differ"][2:]
    rows = [row for section in sections() for row in committed[section.title][2:]]
    apart = [row for row in rows if row[5] != "yes"]
    assert [row[:4] for row in listed] == [row[:4] for row in apart]
    assert all(len(row[-1]) > 20 for row in listed)
    assert f"{len(rows)} statements" in PAGE.read_text(encoding="utf-8")


def test_a_page_reads_as_it_was_written(monkeypatch):
    met = number("4.4 | a slope | 0.015", 0.0150884, digits=6)
    not_met = claim("4.7 | |x| | all", "none", False, expected=False, remark="It is so.")
    one, two = Section("One", list), Section("Two", list)
    monkeypatch.setattr(
        page, "PAGES", {"numbers": Page("One", (one,)), "words": Page("Two", (two,))}
    )
    pages = render({"One": [met], "Two": [not_met]}, "page.md")
    assert [*map(str, pages)] == ["page.md", "page-numbers.md", "page-words.md"]
    found = tables("".join(pages.values()))
    cells = ["4.4", "a slope", "0.015", "0.0150884", "+8.8e-05 (±0.0005)", "yes", ""]
    assert found["One"][2] == cells
    assert found["Two"][2] == ["4.7", "|x|", "all", "none", "", "**no**", "It is so."]
    assert found["Where print and computation differ"][2][1] == "|x|"


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
    monkeypatch.setattr(page, "PAGES", {"good": Page("Good", (good,))})
    assert main(["--out", str(path)]) == 0
    assert "1 of 1  Good" in capsys.readouterr().out
    monkeypatch.setattr(page, "PAGES", {"all": Page("All", (good, bad))})
    assert main(["--out", str(path)]) == 1
    assert "not as known: 4.4, y: 2" in capsys.readouterr().err
    assert list(tables((tmp_path / "page-all.md").read_text(encoding="utf-8"))) == ["Good", "Bad"]


@pytest.mark.slow
def test_the_whole_page_is_as_it_is_known_to_be(committed):
    computed = compute()
    unsound = [row for rows in computed.values() for row in rows if not row.sound]
    assert unsound == []
    for row in (row for rows in computed.values() for row in rows):
        assert row.agrees or row.remark, f"{row.what}: say why print and computation differ"
    fresh = tables("".join(render(computed).values()))
    for section in sections():
        assert statements(fresh[section.title]) == statements(committed[section.title])
