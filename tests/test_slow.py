"""Tests are slow that took long when all were measured."""

from pathlib import Path

from tests.slow import LIST, slow_in

REPORT = """
2.00s call     tests/a/test_a.py::test_long
0.10s setup    tests/a/test_a.py::test_short
0.30s call     tests/a/test_a.py::test_short
9.00s call     tests/a/test_a.py::test_cases[one]
0.01s call     tests/a/test_a.py::test_cases[two words]
0.70s call     tests/a/test_a.py::test_all[one]
0.40s call     tests/a/test_a.py::test_all[two]
=== 7 passed in 12.51s ===
"""


def slow(*names):
    return [f"tests/a/test_a.py::test_{name}" for name in names]


def test_functions_are_slow_on_average_and_cases_by_themselves():
    assert slow_in(REPORT, 0.5) == slow("all", "cases", "long")
    quicker = REPORT.replace("9.00s", "0.90s")
    assert slow_in(quicker, 0.6) == slow("all[one]", "cases[one]", "long")


def test_each_slow_test_is_one_of_the_suite():
    root = Path(__file__).parents[1]
    for line in LIST.read_text(encoding="utf-8").splitlines():
        file, _, name = line.partition("::")
        assert name.endswith("]") or "[" not in name, line
        function = name.partition("[")[0].rpartition("::")[2]
        assert f"def {function}(" in (root / file).read_text(encoding="utf-8"), line
