"""The stress tests, with few trials; `benchmarks.stress` prints the table."""

import pytest

from benchmarks.stress_cases.case import Case
from benchmarks.stress_cases.everything import STATEMENTS

each = pytest.mark.parametrize("case", STATEMENTS, ids=[case.check.__name__ for case in STATEMENTS])


@each
def test_it_holds(case: Case):
    finding = case.run(case.quick)
    assert case.holds(finding), finding


@pytest.mark.slow
@each
def test_it_still_holds_when_tried_much_more_often(case: Case):
    finding = case.run(max(case.quick, case.long // 5))  # `benchmarks.stress --long` tries all
    assert case.holds(finding), finding
