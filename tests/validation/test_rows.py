"""Each section of the validation page is computed again, and has the rows of the page."""

import math

import pytest

import gym_passive_walker as gpw
from tests.numbers import alike
from tests.validation.test_page import PAGE, tables
from validation import page, walks
from validation.__main__ import main
from validation.page import Section, sections
from validation.rows import claim, listed, number

LONG = ("The tuned kneed walker's way to chaos", "Controllers: a torque once a stride")
"""Sections of which the computation takes minutes."""
SECTIONS = [
    pytest.param(
        section, id=section.title, marks=[pytest.mark.slow] * section.title.startswith(LONG)
    )
    for section in sections()
]


@pytest.fixture(scope="module")
def committed():
    return tables(PAGE.read_text(encoding="utf-8"))


@pytest.mark.parametrize("section", SECTIONS)
def test_a_section_has_the_statements_and_numbers_of_the_page(section, committed):
    rows, printed = list(section.rows()), committed[section.title][2:]
    assert len(rows) == len(printed)
    for row, cells in zip(rows, printed, strict=True):
        assert row.sound, row
        assert row.agrees or row.remark, f"{row.what}: say why print and computation differ"
        assert [row.where, row.what, row.printed, row.remark] == [*cells[:3], cells[6]]
        assert row.agrees == (cells[5] == "yes"), row
        assert row.difference.partition("(")[2] == cells[4].partition("(")[2], row  # tolerance
        assert row.difference or alike(row.computed, cells[3], 1e-3, 1e-6), row
        if row.difference:  # a number; the last digits may differ on another CPU
            few = 1e-4 * max(abs(float(row.computed)), 1e-6)
            assert float(row.computed) == pytest.approx(float(cells[3]), rel=1e-4, abs=few), row
    assert sum(bool(each.marks) for each in SECTIONS) == len(LONG)


@pytest.mark.parametrize(
    ("statement", "computed", "options", "expected"),
    [
        ("a | b | 0.5", 0.55, {}, ("0.55", "+5.0e-02 (±0.05)", True)),
        ("a | b | 0.5", 0.56, {}, ("0.56", "+6.0e-02 (±0.05)", False)),
        ("a | b | 0.5", 0.44, {}, ("0.44", "-6.0e-02 (±0.05)", False)),
        ("a | b | 1/3", 0.3331, {"within": 1e-3}, ("0.3331", "-2.3e-04 (±0.001)", True)),
        ("a | b | π", 3.2, {"within": 0.05}, ("3.2", "+5.8e-02 (±0.05)", False)),
        ("a | b | −2", -2.25, {"digits": 2}, ("-2.2", "-2.5e-01 (±0.5)", True)),
    ],
)
def test_a_number_shows_its_digits_its_difference_and_its_tolerance(
    statement, computed, options, expected
):
    row = number(statement, computed, **options)
    assert (row.computed, row.difference, row.agrees) == expected and row.sound == row.agrees
    assert (row.where, row.what, row.printed) == tuple(statement.split(" | "))


@pytest.mark.parametrize(
    ("computed", "known", "sound"),
    [(0.52, "0.52", True), (0.5299, "0.52", True), (0.531, "0.52", False), (0.7004, "0.701", True)],
)
def test_a_recorded_number_is_met_to_a_unit_in_its_last_digit(computed, known, sound):
    row = number("a | b | 0.5", computed, known=known, remark="why")
    assert row.sound == sound and row.remark == "why"
    assert row.agrees == (abs(computed - 0.5) <= 0.05)


@pytest.mark.parametrize("holds", [True, False])
@pytest.mark.parametrize("expected", [True, False])
def test_a_claim_is_sound_if_it_is_as_expected(holds, expected):
    row = claim("a | b | c", "d", holds, expected=expected, remark="why")
    assert row == ("a", "b", "c", "d", "", holds, holds == expected, "why")


def test_numbers_are_listed_in_their_order_and_format():
    assert listed([2.0, 1.25], ".1f") == "2.0, 1.2" and listed([3, 1]) == "3, 1"


@pytest.mark.parametrize("at", [0.2, 0.5, 0.9])
def test_a_boundary_is_enclosed_to_the_accuracy(at):
    low, high = walks.boundary(0.0, 1.0, lambda x: x < at, 1e-3)
    assert low <= at <= high and 0.0 < high - low <= 1e-3


def test_gaits_are_counted_walker_by_walker_and_found_by_their_kind():
    names, slopes = ("D", "lab"), (0.009, 0.05, 0.036)
    each = [len(gpw.find_gaits(name, slope)) for name in names for slope in slopes]
    assert walks.numbers_of_gaits(names, iter(slopes)) == each and len({*each}) > 1
    for kind in walks.KINDS:
        gait = walks.gait("D", 0.009, kind)
        assert gait.stance_angle == gpw.find_gait("D", 0.009, kind).stance_angle
        velocity = gpw.foot_velocity(gait)
        found = walks.sliding("D", 0.009, kind)
        assert found == pytest.approx(abs(velocity.tangential) / abs(velocity.normal))


@pytest.mark.parametrize("kind", walks.KINDS)
def test_exponents_are_differences_of_logarithms(kind):
    near, far = (gpw.find_gait("C", slope, kind) for slope in (0.0299, 0.0301))
    over = math.log(0.0301 / 0.0299)
    angle, speed = walks.exponents("C", 0.03, kind)
    assert angle == pytest.approx(math.log(far.stance_angle / near.stance_angle) / over, rel=2e-3)
    assert speed == pytest.approx(math.log(far.speed / near.speed) / over, abs=2e-3)


def test_sections_are_announced_before_they_are_computed_and_written_in_order(
    tmp_path, monkeypatch, capsys
):
    said = []

    def rows(name):
        def made():
            said.append(f"computes {name}")
            yield number(f"1 | {name} | 1", 1.0)
            yield claim(f"2 | {name} | all", "none", False, remark="It is so, for a reason.")

        return made

    sections = (Section("one", rows("one")), Section("two", rows("two")))
    monkeypatch.setattr(page, "SUBJECTS", {"all": sections})
    unsound = page.write(tmp_path / "p.md", said.append)
    assert said == ["one", "computes one", "two", "computes two"]
    assert [row.what for row in unsound] == ["one", "two"]
    assert {path.name for path in tmp_path.iterdir()} == {"p.md", "chapter4.md"}
    computed = page.compute()
    assert list(computed) == ["one", "two"] and [len(each) for each in computed.values()] == [2, 2]
    assert main(["--out", str(tmp_path / "p.md")]) == 1
    printed = capsys.readouterr()
    assert "1 of 2  one" in printed.out and "not as known: 2, two: none" in printed.err
